r"""Colour bleeding from one distance field per colour channel.

SIGGRAPH 2006 Course 26, chapter 9.9. phi is positive outside; lengths are in units of the volume's longest
edge.

    bias     phi_c = min over objects of (phi_i + b rho_ic): a red wall is farther away in red
    lookup   C_c = gain exp(-k sum (d_i - phi_c(P + d_i N'))), as in 9.6
    shading  N . L of the light times C_c

A channel that is raised near a coloured wall is brighter there, as if the wall's light came back. What the
bias adds to the image is held against light of one bounce:

    L_c = rho_c / pi E (C_c - C),   C without bias, E the light's irradiance with its N . L and no shadows

In print, and what was done here:
- Raising a channel near its wall needs a field that is positive outside, against the text's sign.
- "A small constant" is not given: `bias`.
- Room images have N . L times the field, so that nothing bleeds onto what is turned away from the light;
  `lit="everywhere"` leaves the cosine out.
- Whether white walls raise all channels is not said: each object's bias goes with its albedo, so they do.
- gain, k and alpha are those of the sky light: open ground would get 1.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    LINEAR_IN_LIGHT,
    NO_MODEL,
    OCCLUSION,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    technique,
)
from approximations.kit.solids import distance_to
from approximations.kit.volume import (
    Volume,
    as_volume,
    cell_centres,
    grid_over,
    halved,
    look_up_all,
    on_grid,
    stored,
)
from scenes.contract import ONE_BOUNCE, AreaLight, Scene, View
from scenes.rooms import ColouredRoom

LEVELS = 4


@dataclass
class Fields:
    """unit: the volume's longest edge (m); cell: edge of a cell of the finest level over it; plain, biased:
    levels of phi and of phi_c in units."""

    unit: float
    cell: float
    plain: tuple[Volume, ...]
    biased: tuple[Volume, ...]


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 9.9",
    covers=("sdf-sky-light/08",),
    estimates=ONE_BOUNCE,
    on=(ColouredRoom,),
    replaces="light that met one diffuse surface on its way to the one seen",
    neglects=(NO_MODEL, OCCLUSION, SPATIAL_DETAIL),
    claims=(LINEAR_IN_LIGHT,),
    stress={"ColouredRoom": ("saturation",)},
)
def colour_bleeding(
    view: View,
    fields: Fields,
    *,
    lit: Literal["N.L", "everywhere"] = "N.L",
    alpha: Annotated[float, Sweep(0, 0.5, low=0, high=1)] = 0.5,
    k: Annotated[float, Sweep(0.7, 1.4, low=0, high=100)] = 0.7,
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) that the bias adds, one colour per pixel.

    lit    the light's irradiance with N . L, or as if all faced it
    alpha  how far the lookups lean upwards
    k      strength, over the sum of the distances
    """
    surface = view.surface
    p, n = surface.position, surface.normal
    irradiance = sum((_irradiance(light, p, n, lit) for light in view.lights), mi.Color3f(0))
    distances = [fields.cell * 2**i for i in range(LEVELS)]
    places = [p + d * fields.unit * (n + alpha * mi.Vector3f(0, 0, 1)) for d in distances]

    def openness(levels: tuple[Volume, ...]) -> mi.Color3f:
        total = sum(mi.Color3f(*look_up_all(v, at)) for v, at in zip(levels, places, strict=True))
        return dr.exp(k * (total / sum(distances) - (1 + alpha)))

    bleed = openness(fields.biased) - openness(fields.plain)
    return dr.select(surface.valid, surface.albedo * dr.inv_pi * irradiance * bleed, 0)


def _irradiance(light: AreaLight, p: mi.Point3f, n: mi.Vector3f, lit: str) -> mi.Color3f:
    """Of a flat light taken to be a point at its centre (W m^-2), nothing in the way."""
    u, v = mi.Vector3f(light.u), mi.Vector3f(light.v)
    towards = mi.Point3f(light.centre) - p
    w = dr.normalize(towards)
    leaves = dr.maximum(dr.dot(4 * dr.cross(u, v), -w), 0)
    arrives = dr.maximum(dr.dot(n, w), 0) if lit == "N.L" else 1
    return mi.Color3f(light.radiance) * leaves * arrives / dr.squared_norm(towards)


@colour_bleeding.bake
def bake(
    view: View,
    *,
    bias: Annotated[float, Sweep(0.02, 0.05, 0.1, low=0, high=1)] = 0.05,
    resolution: Annotated[int, Sweep(32, 64, low=8, high=512)] = 64,
    bits: Annotated[int, Sweep(8, 32, low=2, high=32)] = 8,
) -> Fields:
    """Four levels each.

    bias        b, in units of the longest edge, for an albedo of 1
    resolution  cells along the longest edge
    bits        of the values, from minus to plus half the longest edge; 32 for float
    """
    grid = grid_over(view.bounds, resolution)
    unit, centres = grid.cell * max(grid.shape), cell_centres(grid)
    near = [(distance_to(s, centres) / unit, mi.Color3f(s.albedo)) for s in view.solids]

    def levels(b: float) -> tuple[Volume, ...]:
        phi = functools.reduce(dr.minimum, (d + b * rho for d, rho in near))
        g, values, found = grid, on_grid(grid, phi), []
        for _ in range(LEVELS):
            found.append(as_volume(g, stored(values, 0.5, bits)))
            g, values = halved(g, values)
        return tuple(found)

    return Fields(unit, 1 / resolution, levels(0.0), levels(bias))


@colour_bleeding.domain
def domain(scene: Scene) -> Domain:
    """Rooms with coloured walls."""
    if scene.saturation == 0:
        return Domain(False, "no wall has a colour that could bleed")
    return Domain(True)
