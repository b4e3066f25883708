r"""Signed distance volume from a binary image.

SIGGRAPH 2006 Course 26, chapter 9.4 and 9.7, listing 2. phi is positive outside.

    image    a cell is inside where its centre is inside a body
    metric   d = distance between the cell's centre and that of the nearest cell of the other state
    surface  phi = d outside, -d inside, in cells
    storage  round(phi) clamped to 127, plus 128, in 8 bits
    lookup   trilinear

In print, and what was done here:
- The text has S > 0 inside; the listing writes values below 128 inside, and what is built on the volume needs
  that: phi = -S.
- The search through all pairs of cells takes v^2 steps for v cells; a linear-time exact transform finds the
  same. The text names other metrics as cheaper stand-ins; chamfer is the 3-4-5 one over 3.
- From cell centre to cell centre, distances jump from 1 to -1 across the surface and are half a cell too
  long. `surface="half"` takes half a cell off.
- How a distance is rounded to 8 bits is not said; here it is to the nearest step. Text and figures use 127
  cells ("whole cells") as well as a range of -1 to 1, here half the volume's longest edge ("8 bits").
"""

from __future__ import annotations

from typing import Annotated, Literal

import mitsuba as mi
import numpy as np

from approximations.contract import NUMBER_FORMAT, SPATIAL_DETAIL, Domain, Sweep, exact_when, technique
from approximations.kit.distance_transform import signed_distance
from approximations.kit.solids import distance_to_all
from approximations.kit.volume import Volume, as_volume, cell_centres, grid_over, look_up, on_grid, stored
from scenes.contract import DISTANCE, Scene, View
from scenes.fields import SolidsUnderSky

STORAGE = {"8 bits": 8, "16 bits": 16, "float": 32}


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 9.4 and 9.7, listing 2",
    covers=("sdf-sky-light/02",),
    estimates=DISTANCE,
    on=(SolidsUnderSky,),
    replaces="the signed distance to the nearest surface",
    neglects=(SPATIAL_DETAIL, NUMBER_FORMAT),
    claims=(exact_when("SolidsUnderSky", 0.008, knobs={"metric": "exact", "storage": "float"}),),
    stress={"SolidsUnderSky": ("thickness",)},
)
def distance_volume(view: View, volume: Volume) -> mi.Float:
    """Signed distance (m), one number per probe."""
    return look_up(volume, view.camera.origin)


@distance_volume.bake
def bake(
    view: View,
    *,
    resolution: Annotated[int, Sweep(16, 32, 64, 128, low=4, high=512)] = 64,
    metric: Literal["euclidean", "chamfer", "chessboard", "city block", "exact"] = "euclidean",
    surface: Literal["centres", "half"] = "centres",
    storage: Literal["whole cells", "8 bits", "16 bits", "float"] = "whole cells",
) -> Volume:
    """The volume, in m.

    resolution  cells along the longest edge
    metric      of the transform, or "exact": the bodies' distance at the centres, without a binary image
    surface     distances between centres, or half a cell less
    storage     steps of one cell up to 127, or a range of half the longest edge in 8 or 16 bits or float
    """
    grid = grid_over(view.bounds, resolution)
    phi = on_grid(grid, distance_to_all(view.solids, cell_centres(grid)))
    if metric != "exact":
        cells = signed_distance(phi < 0, metric)
        phi = grid.cell * (cells if surface == "centres" else np.sign(cells) * (np.abs(cells) - 0.5))
    if storage == "whole cells":
        phi = grid.cell * np.clip(np.round(phi / grid.cell), -127, 127)
    else:
        phi = stored(phi, 0.5 * grid.cell * max(grid.shape), STORAGE[storage])
    return as_volume(grid, phi)


@distance_volume.domain
def domain(scene: Scene) -> Domain:
    """Bodies thicker than a cell of the published 128^3 volume."""
    if scene.thickness < 4 / 128:
        return Domain(False, "the wall is thinner than a cell and may vanish")
    return Domain(True)
