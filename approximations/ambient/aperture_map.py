r"""Apertures in a map: where the caps of ambient aperture lighting are kept, and in how many bits.

SIGGRAPH 2006 Course 26, section 8.3: four floats per vertex or per texel, baked once, which the rasteriser or
the texture unit then interpolates. The light is worked out per pixel as in `ambient_aperture`.

    place   (u, v) -> point and normal, by the surface's chart, one for each vertex or texel
    bake    axis a and radius r0 of the cap there                                   (8.3)
    store   (a, r0) as float32, float16, or 8 bits each: q = round(255 (1 + a_i) / 2), round(255 r0 2 / pi)
    fetch   a = normalize(sum w_i a_i), r0 = sum w_i r_i, with bilinear weights w for texels and barycentric
            ones for vertices
    light   smoothstep area, averaged direction, sky without a cosine               (8.4)

Not said in print: how many of them, the number format, whether the axis is normalised again after the
interpolation (it is here: an average of unit vectors is shorter than 1), and at which normal the cosine is
taken (the pixel's own).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.ambient.ambient_aperture import Apertures, ambient_aperture
from approximations.contract import (
    COSINE_OVER_LIGHT,
    HORIZON_CLIPPING,
    NUMBER_FORMAT,
    SHAPE_OF_VISIBILITY,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    technique,
)
from scenes.contract import DIRECT_RADIANCE, Scene, View
from scenes.terrain import Canyon, Foliage, Terrain

BELOW_ONE = 0.999999
SHADING = {
    "published": {"overlap": "smoothstep", "cosine": "normalised", "sky_cosine": "none"},
    "exact": {"overlap": "exact", "cosine": "exact", "sky_cosine": "exact"},
}


@dataclass
class ApertureMap:
    """Caps on a grid over the chart: (rows, columns, 4) of axis and radius (rad), or one cap per pixel."""

    grid: mi.TensorXf | None
    pixels: Apertures | None
    place: str


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 8.3",
    covers=("ambient-aperture/01",),
    estimates=DIRECT_RADIANCE,
    on=(Terrain, Canyon, Foliage),
    replaces="visibility times direct light of a round sun and a uniform sky",
    neglects=(
        COSINE_OVER_LIGHT,
        SHAPE_OF_VISIBILITY,
        SPATIAL_DETAIL,
        HORIZON_CLIPPING,
        NUMBER_FORMAT,
    ),
    stress={"Terrain": ("amplitude",), "Canyon": ("width",), "Foliage": ("leaves",)},
)
def aperture_map(
    view: View, apertures: ApertureMap, *, shading: Literal["published", "exact"] = "published"
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel.

    shading  "published" as in section 8.4, or "exact": the light that the caps truly let through.
    """
    fetch = {"texel": fetch_texels, "vertex": fetch_vertices, "exact": lambda apertures, uv: apertures.pixels}
    caps = fetch[apertures.place](apertures, view.surface.uv)
    return ambient_aperture(view, caps, **SHADING[shading])


def fetch_texels(apertures: ApertureMap, uv: mi.Point2f) -> Apertures:
    """Bilinear in the caps of texel middles, clamped at the border."""
    linear, clamp = dr.FilterMode.Linear, dr.WrapMode.Clamp
    texture = mi.Texture2f(apertures.grid, use_accel=False, filter_mode=linear, wrap_mode=clamp)
    x, y, z, r = texture.eval(uv)
    return Apertures(dr.normalize(mi.Vector3f(x, y, z)), r)


def fetch_vertices(apertures: ApertureMap, uv: mi.Point2f) -> Apertures:
    """Barycentric in the caps of the three vertices of a triangle; cells are cut from +u to +v."""
    rows, columns, _ = apertures.grid.shape
    at = dr.clip(uv, 0, BELOW_ONE) * mi.Point2f(columns - 1, rows - 1)
    cell = mi.Point2u(at)
    inner = at - mi.Point2f(cell)
    far = inner.x > 1 - inner.y
    along = dr.select(far, 1 - inner, inner)
    shares = (1 - along.x - along.y, along.x, along.y)
    corners = (far, far), (~far, far), (far, ~far)
    caps = dr.zeros(mi.Vector4f)
    for share, (right, up) in zip(shares, corners, strict=True):
        column, row = cell.x + dr.select(right, mi.UInt32(1), 0), cell.y + dr.select(up, mi.UInt32(1), 0)
        caps += share * dr.gather(mi.Vector4f, apertures.grid.array, row * columns + column)
    return Apertures(dr.normalize(caps.xyz), caps.w)


@aperture_map.bake
def bake(
    view: View,
    *,
    place: Literal["texel", "vertex", "exact"] = "texel",
    side: Annotated[int, Sweep(24, 192, low=2, high=1024)] = 96,
    precision: Literal["float32", "float16", "8 bit"] = "float32",
    rays: Annotated[int, Sweep(16, 256, low=4, high=65536)] = 64,
) -> ApertureMap:
    """Caps for a map of side x side texels, for the vertices of as many cells, or "exact": for every pixel.

    A map of 96 x 96 takes 144 KB as float32 and 36 KB in 8 bits.
    """
    if place == "exact":
        return ApertureMap(None, ambient_aperture.bake_function(view, rays=rays), place)
    count = side + 1 if place == "vertex" else side
    i, j = dr.meshgrid(dr.arange(mi.Float, count), dr.arange(mi.Float, count))
    uv = mi.Point2f(i, j) / side if place == "vertex" else (mi.Point2f(i, j) + 0.5) / side
    p, n = view.chart(uv)
    points = replace(view, surface=replace(view.surface, position=p, normal=n))
    caps = ambient_aperture.bake_function(points, rays=rays)
    axis = [rounded(x, -1, 1, precision) for x in caps.axis]
    grid = dr.ravel(mi.Vector4f(*axis, rounded(caps.radius, 0, 0.5 * dr.pi, precision)))
    dr.eval(grid)
    return ApertureMap(mi.TensorXf(grid, (count, count, 4)), None, place)


def rounded(x: mi.Float, low: float, high: float, precision: str) -> mi.Float:
    """x as it is stored; 8 bits span [low, high]."""
    if precision == "8 bit":
        step = (high - low) / 255
        return low + step * dr.round((x - low) / step)
    return mi.Float(mi.Float16(x)) if precision == "float16" else x


@aperture_map.domain
def domain(scene: Scene) -> Domain:
    """Terrain that hides the sky from the sides, and a light well above the horizon (8.1, 8.4.3)."""
    if isinstance(scene, Foliage):
        return Domain(False, "the visible sky is many small holes, not one round region")
    if scene.light_elevation < 15:
        return Domain(False, "the light stands close to the horizon")
    if isinstance(scene, Canyon) and scene.width < 1:
        return Domain(False, "the visible sky of a deep canyon is a thin band")
    return Domain(True)
