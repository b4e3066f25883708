r"""Two main lights, the rest folded into an ambient cube.

SIGGRAPH 2006 Course 26, sections 7.4, 7.4.1 and 7.4.3: what a model costs must not grow with the lights.
The lights are ranked once per model; the first m are shaded per pixel, every other one is taken to be far
away in the direction l from the model's middle and is added to the ambient cube:

    E(n) = sum over the first m of I max(n . l(p), 0) / d(p)^2 + E_cube(n),
    C_k  = pi L_ambient + sum over the others of I / d^2 max(a_k . l, 0),   a_k the six half axes.

A light along a diagonal of the axes comes back at 0.577 of its strength on the normal that faces it, and
still lights normals that face away from it. When two lights change places in the ranking the image jumps.

In print, and what was done here:
- The measure of importance is not given: `ranking` offers the irradiance at the middle (the usual one), the
  intensity, and the distance.
- How a light is folded is not given in symbols: C_k as above is what a light at infinity gives a surface
  that faces a_k. `fold` can leave the others out, or shade all lights per pixel ("exact").
"""

from __future__ import annotations

from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.ambient.ambient_cube import HALF_AXES, evaluate_cube
from approximations.contract import ANGULAR_DETAIL, DISTANT_LIGHT, LINEAR_IN_LIGHT, Domain, Sweep, technique
from scenes.contract import RADIANCE, PointLight, Scene, View
from scenes.lamps import BallUnderLamps


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 7.4.3",
    covers=("source-shading/05",),
    estimates=RADIANCE,
    on=(BallUnderLamps,),
    replaces="direct light of all point lights",
    neglects=(ANGULAR_DETAIL, DISTANT_LIGHT),
    claims=(LINEAR_IN_LIGHT,),
    stress={"BallUnderLamps": ("lamps", "distance")},
)
def two_lights_folded(
    view: View,
    order: tuple[int, ...],
    *,
    main: Annotated[int, Sweep(1, 4, low=0, high=16)] = 2,
    fold: Literal["axes", "dropped", "exact"] = "axes",
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel.

    main   number of lights shaded per pixel.
    fold   what becomes of the others: added to the cube, "dropped", or "exact": shaded per pixel too.
    """
    surface = view.surface
    lights = [view.points[i] for i in order]
    first = lights if fold == "exact" else lights[:main]
    rest = lights[main:] if fold == "axes" else []
    cube = [
        mi.Color3f(dr.pi * view.sky)
        + sum(arriving(light, mi.Point3f(0), mi.Vector3f(axis)) for light in rest)
        for axis in HALF_AXES.tolist()
    ]
    irradiance = evaluate_cube(cube, surface.normal)
    irradiance += sum(arriving(light, surface.position, surface.normal) for light in first)
    return dr.select(surface.valid, surface.albedo * dr.inv_pi * irradiance, view.sky)


def arriving(light: PointLight, p: mi.Point3f, n: mi.Vector3f) -> mi.Color3f:
    """Irradiance (W m^-2) that a point light gives a surface at p that faces n."""
    toward = light.position - p
    return light.intensity * (dr.maximum(dr.dot(n, toward), 0) / dr.power(dr.norm(toward), 3))


@two_lights_folded.bake
def bake(
    view: View, *, ranking: Literal["irradiance", "intensity", "distance"] = "irradiance"
) -> tuple[int, ...]:
    """The lights from the most important to the least: once per model and frame, on the processor."""
    intensity = np.array([np.ravel(light.intensity).max() for light in view.points])
    nearness = np.array([1 / np.linalg.norm(np.ravel(light.position)) for light in view.points])
    measure = {"irradiance": intensity * nearness**2, "intensity": intensity, "distance": nearness}[ranking]
    return tuple(reversed(np.argsort(measure, kind="stable").tolist()))


@two_lights_folded.domain
def domain(scene: Scene) -> Domain:
    """A few lights some way off, of which two stand out."""
    if scene.distance < 2:
        return Domain(False, "a lamp this near is in another direction from every part of the model")
    return Domain(True)
