r"""Sky light from a few lookups into a distance field along the normal.

SIGGRAPH 2006 Course 26, chapter 9.6 and listing 1. phi is positive outside; lengths are in units of the
volume's longest edge.

    offset   N' = N + alpha U, U up, not normalised
    sample   phi_i = phi(P + d_i N') in a version of the field that is blurred in proportion to d_i: mip i
    text     d_1 one cell, each distance twice the last;  C = gain exp(-k sum (d_i - phi_i))
    listing  d_i = 0.03 (1, 2, 4, 8), w_i = 1, 1.2, 1.4, 1.8;  C = gain exp(sum w_i phi_i)

There is no N . L: on an isolated plane at an angle t to the ground, phi_i = d_i (1 + alpha cos t), so that
the listing gives exp(0.702 (1 + alpha cos t)) where the sky gives (1 + cos t) / 2.

In print, and what was done here:
- The text's S is positive inside and its sum [S_i + d_i]; the listing needs phi, which is larger in the open.
- k is not given. Here it is k over the sum of the distances. alpha k = ln 2 fits (1 + cos t) / 2 at t = 0 and
  at 90 degrees, and the listing's 0.702 is nearly that for its alpha of 1; where things stand on the ground,
  half of it errs half as much, which is the default.
- alpha is 0.5 in the text and 1 in the listing of the same figure.
- The text counts samples from d_0 = 0, the figure and the listing have four: `first="surface"` adds d_0.
- The brightness that the listing multiplies by is a global constant; here open ground gets 1. `gain="none"`
  leaves it out.
- The figure's volume is 128^3; the default is half that, so that all scenes fit the time of a comparison.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    HIDDEN_GEOMETRY,
    NO_MODEL,
    NUMBER_FORMAT,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    technique,
)
from approximations.kit.distance_transform import signed_distance
from approximations.kit.solids import distance_to_all, share_inside
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
from scenes.contract import SKY_VISIBILITY, Scene, View
from scenes.fields import BallOverFloor, SolidsUnderSky

LEVELS = 4
DELTA, WEIGHTS = 0.03, (1.0, 1.2, 1.4, 1.8)


@dataclass
class Field:
    """unit: the volume's longest edge (m); cell: edge of a cell of the finest level over it; levels: phi in
    units, none where the bodies' own distance is read."""

    unit: float
    cell: float
    levels: tuple[Volume, ...]


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 9.6, listing 1",
    covers=("sdf-sky-light/04",),
    estimates=SKY_VISIBILITY,
    on=(BallOverFloor, SolidsUnderSky),
    replaces="the cosine-weighted share of the sky that a point sees",
    neglects=(NO_MODEL, SPATIAL_DETAIL, HIDDEN_GEOMETRY, NUMBER_FORMAT),
    stress={"BallOverFloor": ("gap",), "SolidsUnderSky": ("thickness",)},
)
def sdf_sky_light(
    view: View,
    volumes: Field,
    *,
    formula: Literal["text", "listing"] = "text",
    alpha: Annotated[float, Sweep(0, 0.5, 1, low=0, high=1)] = 0.5,
    k: Annotated[float, Sweep(0.35, 0.7, 1.386, low=0, high=100)] = 0.7,
    first: Literal["cell", "surface"] = "cell",
    gain: Literal["open ground", "none"] = "open ground",
    mips: Literal["by distance", "finest"] = "by distance",
) -> mi.Float:
    """Share of the sky, 0 to 1 and above: nothing bounds it. One number per pixel.

    formula  of the text, or of the listing
    alpha    how far the offset leans upwards
    k        of the text, over the sum of the distances
    first    the nearest sample: one cell away, or one more at the surface; of the text
    gain     open ground gets 1, or the formula as it stands
    mips     sample i reads level i, or all read the finest
    """
    p, n = view.surface.position, view.surface.normal
    step, weights = (volumes.cell, (1.0,) * LEVELS) if formula == "text" else (DELTA, WEIGHTS)
    distances = [step * 2**i for i in range(LEVELS)]
    lean = n + alpha * mi.Vector3f(0, 0, 1)

    def phi(i: int, d: float) -> mi.Float:
        at = p + d * volumes.unit * lean
        if not volumes.levels:
            return distance_to_all(view.solids, at) / volumes.unit
        return look_up(volumes.levels[i if mips == "by distance" else 0], at)

    total = sum(w * phi(i, d) for i, (w, d) in enumerate(zip(weights, distances, strict=True)))
    reach = sum(w * d for w, d in zip(weights, distances, strict=True))
    if formula == "listing":
        exponent, on_ground = total, reach * (1 + alpha)
    else:
        if first == "surface":
            total += phi(0, 0.0)
        exponent, on_ground = k / reach * (total - reach), k * alpha
    light = dr.exp(exponent - (on_ground if gain == "open ground" else 0.0))
    return dr.select(view.surface.valid, light, 1)


@sdf_sky_light.bake
def bake(
    view: View,
    *,
    field: Literal["distance", "binary", "blurred", "exact"] = "distance",
    resolution: Annotated[int, Sweep(32, 64, 128, low=8, high=512)] = 64,
    bits: Annotated[int, Sweep(8, 32, low=2, high=32)] = 8,
) -> Field:
    """Four levels, each the mean over 2 x 2 x 2 cells of the last.

    field       distances of the bodies at the cells' centres; of the binary image's cells from each other;
                the binary image blurred by one cell at each level, scaled to its slope at a wall; or "exact":
                the bodies' distance itself, without a volume
    resolution  cells along the longest edge
    bits        of the values, from minus to plus half the longest edge; 32 for float
    """
    grid = grid_over(view.bounds, resolution)
    unit = grid.cell * max(grid.shape)
    centres = cell_centres(grid)
    if field == "exact":
        return Field(unit, grid.cell / unit, ())
    if field == "blurred":
        values, variance = 0.5 - on_grid(grid, share_inside(view.solids, centres, grid.cell, 4)), 1 / 12
    else:
        values = on_grid(grid, distance_to_all(view.solids, centres)) / unit
    if field == "binary":
        values = signed_distance(values < 0, "euclidean") * grid.cell / unit
    levels = []
    for _ in range(LEVELS):
        shown = values
        if field == "blurred":
            values, variance = blurred(values, 1.0), variance + 1
            shown = values * math.sqrt(2 * math.pi * (variance + 1 / 6)) * grid.cell / unit
            variance = variance / 4 + 1 / 16
        levels.append(as_volume(grid, stored(shown, 0.5, bits)))
        grid, values = halved(grid, values)
    return Field(unit, 1 / resolution, tuple(levels))


@sdf_sky_light.domain
def domain(scene: Scene) -> Domain:
    """Bodies near each other, on the ground, thicker than a cell (9.6)."""
    if isinstance(scene, SolidsUnderSky) and scene.thickness < 4 / 64:
        return Domain(False, "the wall is thinner than a cell and light leaks through it")
    return Domain(True)
