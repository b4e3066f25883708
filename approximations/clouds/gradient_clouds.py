r"""A cloud of sprites: a ramp from dark to bright for its light, and a rim that glows before the sun.

SIGGRAPH 2006 Course 26, chapter 6.9.1. The source gives pictures and no formula; what stands here is put
together from its words and from what its engine did later. A cloud is a set of textured sprites round a
centre c, sorted and blended from back to front. At a sprite's place p, with l the way to the sun,

    w = clamp(1/2 + contrast / 2 (p - c) . l / |p - c|),    colour = (1 - w) dark + w bright,

and the rim, added to the colour at a pixel of opacity alpha that is seen along v,

    rim = scale max(v . l, 0)^exponent clamp(slope (threshold - alpha)) bright.

What was chosen here, since nothing is given:
- Sprites stand in a ball of SPREAD of the cloud's radius r, evenly; each has the opacity
  1 - e^(-a e^(-b^2 / (2 s^2))), b the ray's distance from its place, s = WIDTH r, and a such that all of them
  hold as much extinction as the ball that they stand for.
- w is taken per sprite, as the source takes it per vertex, or per "pixel" where the ray meets the sprite,
  which was reported to give too much light.
- bright is the radiance of a white surface that faces the sun, E / pi; dark, which the source takes from the
  sky, is DARK of it, since there is no sky here.
- alpha is that of all sprites in a pixel. The rim is weighted with it, as all that a sprite shows.
- Soft clipping, alpha clamp((z_scene - z) / s), has nothing to clip here: no ground, no near or far plane.
w knows nothing of optical depth, so thin and thick clouds are equally bright; no part shades another, and
nothing asks where the energy comes from: a ball of optical depth 16 lit from the side is given 3.5 times its
light, 1 / pi at most where the truth has some 0.1, and half of what remains with the right gain is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.contract import (
    LINEAR_IN_LIGHT,
    MULTIPLE_SCATTERING,
    NO_MODEL,
    Domain,
    Sweep,
    technique,
)
from scenes.cloud import CloudSphere
from scenes.contract import RADIANCE, Scene, View

SPREAD = 0.85  # of the cloud's radius
WIDTH = 0.2
DARK = 0.25
PLASTIC = 1.324717957244746  # x^3 = x + 1
"""Its powers turn whole numbers into points that are even in the plane."""


@dataclass
class Sprites:
    """Places in radii of the cloud, from back to front, the optical depth amid each, and their number."""

    place: mi.Point3f
    depth: float
    count: int


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 6.9.1",
    covers=("atmosphere/10",),
    estimates=RADIANCE,
    on=(CloudSphere,),
    replaces="all orders of scattering in a cloud in sunlight",
    neglects=(NO_MODEL, MULTIPLE_SCATTERING),
    claims=(LINEAR_IN_LIGHT,),
    stress={"CloudSphere": ("sun_angle", "optical_depth")},
)
def gradient_clouds(
    view: View,
    sprites: Sprites,
    *,
    gradient: Literal["sprite", "pixel"] = "sprite",
    contrast: Annotated[float, Sweep(0.5, 1.0, low=0, high=4)] = 1.0,
    scale: Annotated[float, Sweep(0.0, 1.0, low=0, high=10)] = 1.0,
    threshold: Annotated[float, Sweep(0.25, 0.5, low=0, high=1)] = 0.5,
    slope: Annotated[float, Sweep(4.0, low=0.1, high=100)] = 4.0,
    exponent: Annotated[float, Sweep(8.0, low=0, high=200)] = 8.0,
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) of a ball of cloud round the origin, 1 m in radius, before a black sky.

    gradient   whether the ramp is taken per sprite or per pixel.
    contrast   of the ramp.
    scale      strength of the rim.
    threshold  opacity above which there is no rim.
    slope      of its rise below that; 1 / slope is the softness.
    exponent   of its fall with the angle from the sun.
    """
    o, v, l = view.camera.origin, view.camera.direction, view.sun.direction
    bright = view.sun.irradiance / dr.pi

    def blend(i, light, through):
        p = dr.gather(mi.Point3f, sprites.place, i)
        away = p - o
        along = dr.dot(away, v)
        b2 = dr.squared_norm(away - along * v)
        alpha = 1 - dr.exp(-sprites.depth * dr.exp(-0.5 * b2 / WIDTH**2))
        side = dr.normalize(mi.Vector3f(p if gradient == "sprite" else o + along * v))
        w = dr.clip(0.5 + 0.5 * contrast * dr.dot(side, l), 0, 1)
        colour = bright * dr.lerp(mi.Float(DARK), mi.Float(1), w)
        return i + 1, dr.lerp(light, colour, alpha), through * (1 - alpha)

    n = dr.width(v)
    start = (dr.zeros(mi.UInt32, n), dr.zeros(mi.Float, n), dr.ones(mi.Float, n))
    _, light, through = dr.while_loop(start, lambda i, light, through: i < sprites.count, blend)
    opacity = 1 - through
    before_sun = dr.power(dr.maximum(dr.dot(v, l), 0), exponent)
    rim = scale * before_sun * dr.clip(slope * (threshold - opacity), 0, 1) * bright
    return mi.Color3f(light + opacity * rim)


@gradient_clouds.bake
def bake(view: View, *, count: Annotated[int, Sweep(8, 32, 128, low=1, high=1024)] = 32) -> Sprites:
    """Where the sprites stand, sorted for the camera.

    count  of sprites: a spiral through shells of equal volume.
    """
    k = np.arange(1, count + 1)
    z, turn = 1 - 2 * ((k / PLASTIC) % 1), 2 * np.pi * k / PLASTIC**2
    radius, ring = SPREAD * np.cbrt(k / count), np.sqrt(1 - z * z)
    places = radius * np.stack([ring * np.cos(turn), ring * np.sin(turn), z])
    order = np.argsort(-(np.array(view.camera.forward, np.float64).reshape(3) @ places))
    sigma_t = float(np.array(view.cloud.extinction(mi.Point3f(0, 0, 0)))[0])
    depth = 4 / 3 * np.pi * sigma_t / (count * 2 * np.pi * WIDTH**2)
    return Sprites(mi.Point3f(places[:, order].astype(np.float32)), float(depth), count)


@gradient_clouds.domain
def domain(scene: Scene) -> Domain:
    """White clouds of a sky, lit by the sun (6.9.1)."""
    if scene.optical_depth < 4 or scene.albedo < 0.99:
        return Domain(False, "not a white cloud: the ramp takes it to be thick, and to absorb nothing")
    return Domain(True)
