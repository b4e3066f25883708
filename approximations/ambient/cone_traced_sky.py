r"""Sky visibility by cones marched through a distance field: what a renderer with one would use today.

Wright, Dynamic occlusion with signed distance fields, SIGGRAPH 2015 course "Advances in real-time rendering".
Six cones of 30 degrees half angle cover the hemisphere, one about the normal and five at 60 degrees from
it (weights 1/4 and 3/20, Crassin et al., Interactive indirect illumination using voxel cone tracing, 2011).
Along each, at distance t from a start off the surface, the cone has radius r = t tan 30; the nearest surface
hides

    zero   1 - phi / r           nothing when phi = r, all of it from phi = 0 on
    half   1/2 - phi / (2 r)     half of it when phi = 0

and of all steps within the volume the worst counts. A step is as long as the distance, at least half the
radius. The field is sampled at the centres of a grid, and looked up trilinearly. The floor touches the
slanted cones, so that open ground is not quite 1.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import ANGULAR_DETAIL, SHAPE_OF_VISIBILITY, SPATIAL_DETAIL, Sweep, technique
from approximations.kit.solids import distance_to_all
from approximations.kit.volume import Volume, as_volume, cell_centres, grid_over, look_up, on_grid
from scenes.contract import SKY_VISIBILITY, View
from scenes.fields import BallOverFloor, SolidsUnderSky

TAN = math.tan(math.radians(30))
ASIDE = [math.radians(72 * i) for i in range(5)]
CONES = [
    (0.0, 0.0, 1.0, 0.25),
    *((math.sqrt(0.75) * math.cos(a), math.sqrt(0.75) * math.sin(a), 0.5, 0.15) for a in ASIDE),
]


@technique(
    source="Wright, Dynamic occlusion with signed distance fields, SIGGRAPH 2015",
    estimates=SKY_VISIBILITY,
    on=(BallOverFloor, SolidsUnderSky),
    replaces="the cosine-weighted share of the sky that a point sees",
    neglects=(ANGULAR_DETAIL, SHAPE_OF_VISIBILITY, SPATIAL_DETAIL),
    stress={"BallOverFloor": ("gap",), "SolidsUnderSky": ("thickness",)},
    baseline=True,
)
def cone_traced_sky(
    view: View,
    field: Volume,
    *,
    hides: Literal["zero", "half"] = "half",
    steps: Annotated[int, Sweep(4, 8, 16, low=1, high=256)] = 8,
) -> mi.Float:
    """Share of the sky, 0 to 1, one number per pixel.

    hides  how much of a cone a surface at distance phi hides
    steps  along each cone
    """
    p, n = view.surface.position, view.surface.normal
    frame = mi.Frame3f(n)
    first, middle = dr.max(field.span) / 64, field.low + 0.5 * field.span

    def cone(x: float, y: float, z: float) -> mi.Float:
        w = frame.to_world(mi.Vector3f(x, y, z))

        def march(i: mi.UInt32, t: mi.Float, open_: mi.Float) -> tuple[mi.UInt32, mi.Float, mi.Float]:
            at, r = p + t * w, t * TAN
            phi = look_up(field, at)
            share = phi / r if hides == "zero" else 0.5 + 0.5 * phi / r
            within = dr.all(dr.abs(at - middle) <= 0.5 * field.span)
            return i + 1, t + dr.maximum(phi, 0.5 * r), dr.select(within, dr.minimum(open_, share), open_)

        start = (mi.UInt32(0), dr.zeros(mi.Float, dr.width(n)) + first, dr.ones(mi.Float, dr.width(n)))
        return dr.clip(dr.while_loop(start, lambda i, t, open_: i < steps, march)[2], 0, 1)

    share = sum(weight * cone(x, y, z) for x, y, z, weight in CONES)
    return dr.select(view.surface.valid, share, 1)


@cone_traced_sky.bake
def bake(view: View, *, resolution: Annotated[int, Sweep(32, 64, low=8, high=512)] = 64) -> Volume:
    """Distances in m; resolution: cells along the longest edge."""
    grid = grid_over(view.bounds, resolution)
    return as_volume(grid, on_grid(grid, distance_to_all(view.solids, cell_centres(grid))))
