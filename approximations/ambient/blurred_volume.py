r"""Pseudo-distance from a blurred binary volume.

SIGGRAPH 2006 Course 26, chapter 9.5 and 9.7. phi is positive outside, B is what is inside, 0 to 1.

    image    share of each cell that is inside, from a finer binary image
    levels   blur, halve, blur, halve, ...
    remap    at a flat wall blurred by a Gaussian of width s, B = (1 - erf(phi / (s sqrt 2))) / 2; so
             phi = s sqrt(2 pi) (1/2 - B)           "linear": right in slope at the surface
             phi = s sqrt(2) erfinv(1 - 2 B)        "erfinv": right at a flat wall, as far as B has digits

In print, and what was done here:
- Any function that falls off from the surface with the right sign will do, says the text, and uses B as it
  is. To hold it against a distance it needs a unit: `remap="linear"` gives it that of its slope at a wall.
- The source's 512^3 image becomes a 128^3 volume; here each cell looks at `finer`^3 points, the same mean.
- The kernel is not given: `sigma` is the width of a Gaussian in cells, once per level.
- The width s that the remap needs is that of blur, cells and lookup together: per axis and in cells, 1/12 for
  the box of a cell, sigma^2 for each blur, 1/16 for each halving, which turns v into v / 4, and 1/6 for the
  trilinear lookup on average.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import NO_MODEL, NUMBER_FORMAT, SPATIAL_DETAIL, Domain, Sweep, technique
from approximations.kit.solids import share_inside
from approximations.kit.volume import (
    Volume,
    as_volume,
    blurred,
    cell_centres,
    grid_over,
    halved,
    look_up,
    on_grid,
    stored,
)
from scenes.contract import DISTANCE, Scene, View
from scenes.fields import SolidsUnderSky


@dataclass
class Blurred:
    """1/2 - B in a volume, the width s of its blur (m), and the least step of B that the storage has."""

    volume: Volume
    width: float
    step: float


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 9.5 and 9.7",
    covers=("sdf-sky-light/05",),
    estimates=DISTANCE,
    on=(SolidsUnderSky,),
    replaces="the signed distance to the nearest surface",
    neglects=(NO_MODEL, SPATIAL_DETAIL, NUMBER_FORMAT),
    stress={"SolidsUnderSky": ("thickness",)},
)
def blurred_volume(view: View, field: Blurred, *, remap: Literal["linear", "erfinv"] = "linear") -> mi.Float:
    """Pseudo-distance (m), one number per probe. It saturates a few widths from the surface.

    remap  how 1/2 - B becomes a length; "erfinv" stops half a step of the storage short of 0 and 1.
    """
    b = look_up(field.volume, view.camera.origin)
    if remap == "linear":
        return math.sqrt(2 * math.pi) * field.width * b
    most = 1 - field.step
    return math.sqrt(2) * field.width * dr.erfinv(dr.clip(2 * b, -most, most))


@blurred_volume.bake
def bake(
    view: View,
    *,
    resolution: Annotated[int, Sweep(32, 64, low=4, high=512)] = 64,
    finer: Annotated[int, Sweep(1, 4, low=1, high=16)] = 4,
    sigma: Annotated[float, Sweep(0.5, 1, 2, low=0, high=16)] = 1.0,
    level: Annotated[int, Sweep(0, 1, 2, 3, low=0, high=5)] = 0,
    bits: Annotated[int, Sweep(8, 32, low=2, high=32)] = 8,
) -> Blurred:
    """resolution: cells along the longest edge; finer: points of the binary image along a cell's edge; sigma:
    blur in cells, at each level; level: how often the volume is halved; bits: of the values, 32 for float."""
    grid = grid_over(view.bounds, resolution)
    b = blurred(on_grid(grid, share_inside(view.solids, cell_centres(grid), grid.cell, finer)), sigma)
    variance = 1 / 12 + sigma**2
    for _ in range(level):
        grid, b = halved(grid, b)
        b, variance = blurred(b, sigma), variance / 4 + 1 / 16 + sigma**2
    volume = as_volume(grid, stored(0.5 - b, 0.5, bits))
    return Blurred(volume, grid.cell * math.sqrt(variance + 1 / 6), 2.0 ** -min(bits, 20))


@blurred_volume.domain
def domain(scene: Scene) -> Domain:
    """Where only what is near a surface matters, and bodies are thicker than the blur."""
    if scene.thickness < 2 * 4 / 64:
        return Domain(False, "the blur spreads the wall until its inside is no longer inside")
    return Domain(True)
