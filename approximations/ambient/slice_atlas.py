r"""A distance volume read from slices tiled on a 2D texture.

SIGGRAPH 2006 Course 26, chapter 9.6 (listing) and 9.8 (figure 8), for hardware that cannot render to the
slices of a volume texture. With n slices and uvw in the volume,

    z = n w - 1/2, clamped to [0, n - 1];  k = floor z;  uv clamped half a texel inside the tile
    value = lerp(tile k at uv, tile k + 1 at uv, z - k)

In print, and what was done here:
- The half slice is used but never declared in the listing's struct: `half_slice=False` leaves it out.
- The table of the tiles' corners is a point-sampled texture of no stated precision; 8 bits are offered.
- Without the clamp, the outer half texels of a tile mix with the tile beside it.
Done right, it is the trilinear lookup of a volume texture to the last bits. `fetch` tells its own error from
that of the grid: "native" is the volume texture, "exact" the distance itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import mitsuba as mi

from approximations.contract import NUMBER_FORMAT, SPATIAL_DETAIL, Domain, Sweep, exact_when, technique
from approximations.kit.slice_atlas import Atlas, as_atlas, fetch
from approximations.kit.solids import distance_to_all
from approximations.kit.volume import Volume, as_volume, cell_centres, grid_over, look_up, on_grid
from scenes.contract import DISTANCE, Scene, View
from scenes.fields import SolidsUnderSky


@dataclass
class Slices:
    """The same values as tiles and as a volume texture."""

    atlas: Atlas
    volume: Volume


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 9.6 listing and 9.8 figure 8",
    covers=("sdf-sky-light/06",),
    estimates=DISTANCE,
    on=(SolidsUnderSky,),
    replaces="the trilinear lookup of a volume texture",
    neglects=(SPATIAL_DETAIL, NUMBER_FORMAT),
    claims=(exact_when("SolidsUnderSky", 1e-5, knobs={"fetch_by": "exact"}),),
)
def slice_atlas(
    view: View,
    slices: Slices,
    *,
    fetch_by: Literal["atlas", "native", "exact"] = "atlas",
    half_slice: bool = True,
    clamped: bool = True,
) -> mi.Float:
    """Signed distance (m), one number per probe.

    fetch_by    the tiles, the volume texture, or the bodies' distance without a grid
    half_slice  slices lie at the middle of their layer
    clamped     lookups stay half a texel inside a tile
    """
    p = view.camera.origin
    if fetch_by == "exact":
        return distance_to_all(view.solids, p)
    if fetch_by == "native":
        return look_up(slices.volume, p)
    return fetch(slices.atlas, p, half_slice, clamped)


@slice_atlas.bake
def bake(
    view: View,
    *,
    resolution: Annotated[int, Sweep(32, 64, low=4, high=512)] = 64,
    table_bits: Annotated[int, Sweep(8, 32, low=4, high=32)] = 32,
) -> Slices:
    """resolution: cells along the longest edge; table_bits: of the corners of the tiles, 32 for float. The
    values are the bodies' distance at the cells' centres, in m."""
    grid = grid_over(view.bounds, resolution)
    phi = on_grid(grid, distance_to_all(view.solids, cell_centres(grid)))
    return Slices(as_atlas(grid, phi, table_bits), as_volume(grid, phi))


@slice_atlas.domain
def domain(scene: Scene) -> Domain:
    """Any volume."""
    return Domain(True)
