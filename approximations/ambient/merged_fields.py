r"""A scene's distance field put together from its objects' own fields, each frame.

SIGGRAPH 2006 Course 26, chapter 9.8. phi is positive outside.

    clear   the volume to far
    object  the cells within its oriented box, padded by its range of influence
    local   phi_i of the object at those cells
    merge   phi = min(phi, phi_i): the union; exact outside, inside an overlap only a bound

Local fields by kind of object, in its own axes:

    analytic  box and ball in closed form; what is larger than LARGE, such as a floor, always is
    volume    a 32^3 volume over the padded box, baked once
    star      a star-shaped body by its radius in each direction: phi_i = r - E[R](w)
    height    two height fields back to back: phi_i = |z| - E[Z](x, y)

E is the mean of a blurred map. Its square blurred as well gives the spread, which flattens the falloff.

In print, and what was done here:
- With the text's sign (positive inside) the `min` of the blend is an intersection, and with the cleared
  volume it is empty: far everywhere. `merge="max"` is that in phi.
- How the spread sets the width of the falloff is not given. Over a blur of width w a surface of slope g has
  the spread g w, and its distance is 1 / sqrt(1 + g^2) of that along the ray: `width="spread"` multiplies by
  it. At the outline of a height field, a cliff, that draws curtains.
- Radius and height are distances along a ray, not to the surface: too long where the surface is steep.
- A height field has no sides: beyond the outline the map holds minus the greatest height.
- The octants of a ball or a box are alike, so that a quarter of three faces of the 32 x 32 x 6 radius map is
  kept.
- Slices of the boxes are rasterised; here a cell is drawn where its centre lies in the padded box.
- Beyond its padded box an object has no effect: the field steps from `padding` to far there. What far is is
  not said: `clear` offers the range of -1 to 1 that the volumes have, and the padding.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy import ndimage

from approximations.contract import (
    HIDDEN_GEOMETRY,
    PRINTED_SLIP,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    technique,
)
from approximations.kit.solids import distance_to, local_point
from approximations.kit.volume import Grid, Volume, as_volume, cell_centres, grid_over, look_up, look_up_all
from scenes.contract import DISTANCE, Scene, Solid, View
from scenes.fields import SolidsUnderSky

FACE = 16  # texels along half the edge of a face of the radius map
BLUR = 1.0  # width of the maps' Gaussian blur, texels
REACH = 0.5  # m round an object that its own volume and height map hold
LARGE = 10.0  # m: larger bodies are analytic


@dataclass
class Local:
    """An object's own field: its kind, and the volume or the map (mean, slope) that it is read from."""

    kind: str
    map: Volume | None = None


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 9.8",
    covers=("sdf-sky-light/07",),
    estimates=DISTANCE,
    on=(SolidsUnderSky,),
    replaces="the signed distance to the nearest surface",
    neglects=(HIDDEN_GEOMETRY, SPATIAL_DETAIL, PRINTED_SLIP),
    stress={"SolidsUnderSky": ("gap",)},
)
def merged_fields(
    view: View,
    local: tuple[Local, ...],
    *,
    resolution: Annotated[int, Sweep(32, 64, low=4, high=512)] = 64,
    padding: Annotated[float, Sweep(0.1, 0.5, 4, low=0, high=100)] = 0.5,
    clear: Literal["range", "padding"] = "range",
    merge: Literal["min", "max"] = "min",
) -> mi.Float:
    """Signed distance (m), one number per probe.

    resolution  cells of the scene's volume along its longest edge
    padding     range of influence of an object (m)
    clear       far is the volume's range, half its longest edge, or the padding
    merge       union, or the intersection that the text's sign makes of it
    """
    grid = grid_over(view.bounds, resolution)
    p = cell_centres(grid)
    far = padding if clear == "padding" else 0.5 * grid.cell * max(grid.shape)
    blend, phi = dr.minimum if merge == "min" else dr.maximum, mi.Float(far)
    for solid, own in zip(view.solids, local, strict=True):
        drawn = dr.all(dr.abs(local_point(solid, p)) <= mi.Vector3f(solid.half) + padding)
        phi = blend(phi, dr.select(drawn, _own_field(solid, own, p), far))
    return look_up(as_volume(grid, phi), view.camera.origin)


def _own_field(solid: Solid, own: Local, p: mi.Point3f) -> mi.Float:
    """phi_i at p."""
    q = local_point(solid, p)
    if own.kind == "analytic":
        return distance_to(solid, p)
    if own.kind == "volume":
        return look_up(own.map, mi.Point3f(q))
    along, at = (dr.norm(q), _on_faces(q)) if own.kind == "star" else (dr.abs(q.z), mi.Point3f(q.x, q.y, 0))
    mean, slope = look_up_all(own.map, at)
    return (along - mean) * slope


def _on_faces(q: mi.Vector3f) -> mi.Point3f:
    """Place of a direction on the faces of a radius map over the unit cube, one layer each: x, y, z."""
    a = dr.abs(q)
    x, y = (a.x >= a.y) & (a.x >= a.z), a.y >= a.z
    major, u, v = (
        dr.select(x, one, dr.select(y, two, three))
        for one, two, three in ((a.x, a.y, a.z), (a.y, a.z, a.x), (a.z, a.x, a.y))
    )
    layer = dr.select(x, 0.5, dr.select(y, 1.5, mi.Float(2.5)))
    return mi.Point3f(u, v, layer * major / 3) / dr.maximum(major, 1e-12)


@merged_fields.bake
def bake(
    view: View,
    *,
    field: Literal["analytic", "volume", "star", "height"] = "analytic",
    width: Literal["none", "spread"] = "none",
) -> tuple[Local, ...]:
    """The objects' own fields, in m.

    field  how each is kept
    width  of the falloff of the last two: 1, or less where the map varies
    """
    make = {"volume": _own_volume, "star": _radius_map, "height": _height_map}.get(field)
    return tuple(
        Local(field, make(solid, width)) if make and max(solid.half) < LARGE else Local("analytic")
        for solid in view.solids
    )


def _own_volume(solid: Solid, width: str) -> Volume:
    """32 cells along the longest edge of the box with REACH."""
    reach = [h + REACH for h in solid.half]
    grid = grid_over(([-r for r in reach], reach), 32)
    return as_volume(grid, distance_to(Solid(solid.shape, (0.0, 0.0, 0.0), solid.half), cell_centres(grid)))


def _radius_map(solid: Solid, width: str) -> Volume:
    """Radius in the directions of the texels of a quarter of three faces; a texel is taken to be 1 / FACE
    of the radius wide."""
    grid = Grid((0.0, 0.0, 0.0), 1 / FACE, (3, FACE, FACE))
    v, u = (np.indices((FACE, FACE)) + 0.5) / FACE
    one = np.ones_like(u)
    faces = np.stack([(one, u, v), (v, one, u), (u, v, one)])
    w = faces / np.linalg.norm(faces, axis=1, keepdims=True)
    radius = np.full(grid.shape, solid.half[0])
    if solid.shape == "box":
        radius = np.min(np.reshape(solid.half, (1, 3, 1, 1)) / w, axis=1)
    volume = _mean_and_slope(grid, radius, radius / FACE, width)
    volume.span = mi.Vector3f(1)
    return volume


def _height_map(solid: Solid, width: str) -> Volume:
    """Height over the plane z = 0 of the object's own axes, 32 x 32 texels."""
    reach = max(solid.half[:2]) + REACH
    cell = 2 * reach / 32
    y, x = (np.indices((1, 32, 32))[1:] + 0.5) * cell - reach
    hx, hy, hz = solid.half
    if solid.shape == "ball":
        squared = hz**2 - x**2 - y**2
        height = np.where(squared > 0, np.sqrt(np.maximum(squared, 0)), -hz)
    else:
        height = np.where((np.abs(x) < hx) & (np.abs(y) < hy), hz, -hz)
    return _mean_and_slope(Grid((-reach, -reach, 0.0), cell, (1, 32, 32)), height, cell, width)


def _mean_and_slope(grid: Grid, values: np.ndarray, texel: np.ndarray | float, width: str) -> Volume:
    """The blurred map, and beside it 1 or 1 / sqrt(1 + (spread / w)^2), w the width of the blur in m."""

    def blur(a: np.ndarray) -> np.ndarray:
        return ndimage.gaussian_filter(a, (0, BLUR, BLUR), mode="reflect")

    mean, variance = blur(values), np.maximum(blur(values**2) - blur(values) ** 2, 0)
    slope = 1 / np.sqrt(1 + variance / (BLUR * texel) ** 2) if width == "spread" else np.ones_like(mean)
    return as_volume(grid, np.stack([mean, slope], axis=-1))


@merged_fields.domain
def domain(scene: Scene) -> Domain:
    """Any bodies whose own fields are at hand."""
    return Domain(True)
