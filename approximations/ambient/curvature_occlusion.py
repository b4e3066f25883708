r"""Darkened creases from the error that a distance volume makes at the surface.

SIGGRAPH 2006 Course 26, chapter 9.5. phi is positive outside; lengths here are in cells.

    phi(P)   trilinear lookup at the surface point, where the exact distance is 0: negative in creases,
             positive on edges
    output   0.5 + exp(k phi)

What it measures: a blur of variance s^2 along each axis gives phi = s^2 / 2 (k_1 + k_2) at a surface of
principal curvatures k_1 and k_2; the trilinear lookup acts as s^2 = 1/6 cell on average, and as 0 to 1.5
times that from place to place within a cell, which shows as bands.

In print, and what was done here:
- The text has exp(k S) with S = -phi, positive in creases; so its k is negative if creases are to be dark.
- The output is 1.5 on flat surfaces and never below 0.5. `scale` offers it as it stands, two thirds of it,
  and it clamped to 1.
- k is not given. Here it acts on phi over the width of the blur (one cell where there is none); in grooves of
  60 to 120 degrees 8 to 12 are nearest to the truth if edges are clamped, 4 where they glare.
- A Gaussian blur is recommended, of no stated width: `sigma`, 0 for the unfiltered volume of the figure.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import NO_MODEL, NUMBER_FORMAT, SPATIAL_DETAIL, Domain, Sweep, technique
from approximations.kit.solids import distance_to_all
from approximations.kit.volume import (
    Volume,
    as_volume,
    blurred,
    cell_centres,
    grid_over,
    look_up,
    on_grid,
    stored,
)
from scenes.contract import SKY_VISIBILITY, Scene, View
from scenes.fields import BallOverFloor, Groove


@dataclass
class Smoothed:
    """Distances (m) and the width of their blur (m)."""

    volume: Volume
    width: float


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 9.5",
    covers=("sdf-sky-light/03",),
    estimates=SKY_VISIBILITY,
    on=(Groove, BallOverFloor),
    replaces="the cosine-weighted share of the sky that a point sees",
    neglects=(NO_MODEL, SPATIAL_DETAIL, NUMBER_FORMAT),
    stress={"Groove": ("opening",)},
)
def curvature_occlusion(
    view: View,
    field: Smoothed,
    *,
    k: Annotated[float, Sweep(1, 4, 8, low=0, high=100)] = 4.0,
    scale: Literal["printed", "two thirds", "clamped"] = "printed",
) -> mi.Float:
    """Openness, 0 to 1 and above as printed; one number per pixel.

    k      strength, of phi over the width of the blur
    scale  0.5 + exp(k phi), two thirds of it, or it clamped to 1
    """
    phi = look_up(field.volume, view.surface.position) / field.width
    light = 0.5 + dr.exp(k * phi)
    if scale == "two thirds":
        light /= 1.5
    elif scale == "clamped":
        light = dr.minimum(light, 1)
    return dr.select(view.surface.valid, light, 1)


@curvature_occlusion.bake
def bake(
    view: View,
    *,
    resolution: Annotated[int, Sweep(32, 64, low=8, high=512)] = 64,
    sigma: Annotated[float, Sweep(0, 1, 4, low=0, high=16)] = 0.0,
    bits: Annotated[int, Sweep(8, 16, 32, low=2, high=32)] = 8,
) -> Smoothed:
    """resolution: cells along the longest edge; sigma: Gaussian blur in cells; bits: of the values, within
    half the longest edge to each side; 32 for float."""
    grid = grid_over(view.bounds, resolution)
    phi = blurred(on_grid(grid, distance_to_all(view.solids, cell_centres(grid))), sigma)
    volume = as_volume(grid, stored(phi, 0.5 * grid.cell * max(grid.shape), bits))
    return Smoothed(volume, grid.cell * max(sigma, 1.0))


@curvature_occlusion.domain
def domain(scene: Scene) -> Domain:
    """Creases: what is near and concave."""
    if isinstance(scene, BallOverFloor):
        return Domain(False, "the ball's curvature says nothing of the floor that it hides")
    if scene.opening >= 180:
        return Domain(False, "nothing is hidden on a ridge, and its edge is brightened")
    return Domain(True)
