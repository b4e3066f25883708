r"""A scene's distance field put together from its objects' own fields, each frame.

SIGGRAPH 2006 Course 26, chapter 9.8. phi is positive outside.

    clear   the volume to far
    object  the cells within its oriented box, padded by its range of influence
    local   phi_i of the object at those cells
    merge   phi = min(phi, phi_i): the union; exact outside, inside an overlap only a bound

Local fields by kind of object:

    analytic     box and ball in closed form; what is larger than LARGE, such as a floor, always is
    volume       a 32^3 volume over the padded box, baked once
    star         a star-shaped body by its radius in each direction: r - R(w), a distance along the radius
    star cosine  the same times the cosine of the slope, n . w: right to first order at the surface

In print, and what was done here:
- With the text's sign (positive inside) the `min` of the blend is an intersection, and with the cleared
  volume it is empty: far everywhere. `merge="max"` is that in phi.
- The radius map of 32 x 32 x 6 texels is blurred with its square, and the spread of the radius sets the width
  of the falloff by a formula that is not given; here the slope of r - R is kept at 1, or at n . w.
- The octants of a ball or a box are alike, so that a quarter of three faces of the radius map is kept.
- Slices of the boxes are rasterised; here a cell is drawn where its centre lies in the padded box.
- Beyond its padded box an object has no effect: the field steps from `padding` to far there. What far is is
  not said: `clear` offers the range of -1 to 1 that the volumes have, and the padding.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    HIDDEN_GEOMETRY,
    PRINTED_SLIP,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    technique,
)
from approximations.kit.solids import distance_to, local_point
from approximations.kit.volume import Grid, Volume, as_volume, cell_centres, grid_over, look_up
from scenes.contract import DISTANCE, Scene, Solid, View
from scenes.fields import SolidsUnderSky

FACE = 16  # texels along half the edge of a face of the radius map
LARGE = 10.0  # m: larger bodies are analytic


@dataclass
class Local:
    """An object's own field, in its axes: a volume, or the faces of its radius map; neither if analytic."""

    volume: Volume | None = None
    faces: mi.Texture3f | None = None


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
    if own.volume:
        return look_up(own.volume, mi.Point3f(q))
    if own.faces:
        radius, slope = own.faces.eval(_on_faces(q))
        return (dr.norm(q) - radius) * slope
    return distance_to(solid, p)


def _on_faces(q: mi.Vector3f) -> mi.Point3f:
    """Texture coordinates of a direction on the faces of a radius map, one layer each: x, y, z."""
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
    view: View, *, field: Literal["analytic", "volume", "star", "star cosine"] = "analytic"
) -> tuple[Local, ...]:
    """The objects' own fields, in m."""
    make = {"volume": _own_volume, "star": _radius_map, "star cosine": _radius_map}.get(field)
    return tuple(make(solid, field) if make and max(solid.half) < LARGE else Local() for solid in view.solids)


def _own_volume(solid: Solid, field: str) -> Local:
    """32 cells along the longest edge of a box that leaves room for a range of influence of 0.5 m."""
    reach = [h + 0.5 for h in solid.half]
    grid = grid_over(([-r for r in reach], reach), 32)
    q = cell_centres(grid)
    upright = Solid(solid.shape, (0.0, 0.0, 0.0), solid.half)
    return Local(volume=as_volume(grid, distance_to(upright, q)))


def _radius_map(solid: Solid, field: str) -> Local:
    """Radius and cosine of the slope in the directions of the texels of three faces."""
    grid = Grid((0.0, 0.0, 0.0), 1.0, (3, FACE, FACE))
    texel = cell_centres(grid)
    u, v = texel.x / FACE, texel.y / FACE
    x, y, z = mi.Vector3f(1, u, v), mi.Vector3f(v, 1, u), mi.Vector3f(u, v, 1)
    w = dr.normalize(dr.select(texel.z < 1, x, dr.select(texel.z < 2, y, z)))
    if solid.shape == "ball":
        radius, slope = dr.full(mi.Float, solid.half[0], dr.width(w)), mi.Float(1)
    else:
        to_side = mi.Vector3f(solid.half) / w
        radius = dr.min(to_side)
        slope = dr.max(dr.select(to_side <= radius, w, 0))
    if field == "star":
        slope = mi.Float(1)
    return Local(faces=as_volume(grid, dr.ravel(mi.Vector2f(radius, slope))).texture)


@merged_fields.domain
def domain(scene: Scene) -> Domain:
    """Any bodies whose own fields are at hand."""
    return Domain(True)
