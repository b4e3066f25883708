r"""Shadow map with a randomly rotated Poisson kernel: soft shadows of fixed width from one depth map.

SIGGRAPH 2006 Course 26, chapter 3, section 3.3.3. The share V of an area light that a point sees,

    V(x) = (1 / A) int_A V(x, y) dA_y,

is replaced by a blur of the shadow of the light's middle:

    map     depth from the light's middle, 1024 x 1024 texels of 16 bits
    s(x) = (1/8) sum_j [depth(uv + rho R(theta) o_j) >= z_x - bias],   o_j a Poisson disk of 8 points
    theta   from a small texture of random angles, tiled over the screen

The kernel turns on bright and smooth surfaces, where bands would show, and stands still on dark or rough
ones: `rotation`. Plain percentage-closer filtering on a lattice is what the section sets itself against.

In print, and what was done here:
- Radius, bias and the offsets are not given. rho is a share of the map's width, the bias a length along the
  light's axis (m); the offsets are drawn as best candidates.
- Where the depth range of the light begins decides what 16 bits are worth, and is not given: `near`.
- How a tap compares with a tilted receiver is not said. With the receiver's own depth at all taps, the bias
  must exceed rho times its slope, or the surface shades itself; `receiver="plane"` takes the depth of the
  tangent plane at each tap.
- The real width of a penumbra is light size x (z_x - z_b) / z_b, z_b the caster's depth. rho is right for
  one distance of caster and receiver; there a round light's penumbra is exact.

The picture that is judged has 4 x 4 samples a pixel, each with an angle of its own: noise and steps of one
sample a pixel are four times as large.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.contract import (
    NUMBER_FORMAT,
    PENUMBRA_WIDTH,
    SAMPLING,
    SHAPE_OF_VISIBILITY,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    at_most,
    exact_when,
    technique,
)
from approximations.kit.point_sets import best_candidates, lattice, spiral
from approximations.kit.sampling import random_turn
from approximations.kit.shadow_map import bounds, filtered, render
from scenes.contract import LIGHT_VISIBILITY, Scene, View
from scenes.shadow_casters import HalfPlane, PoleAndBars

TILE = 64
"""Side of the texture of angles, in pixels."""
MANY = 256
"""Taps that stand for the whole disk."""
BITS = {"16": 16, "24": 24, "exact": None}


@dataclass
class Kernel:
    """Offsets in the unit disk (or square), and TILE x TILE angles (rad)."""

    offsets: mi.Vector2f
    turns: mi.Float


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 3, 3.3.3",
    covers=("rain/06",),
    estimates=LIGHT_VISIBILITY,
    on=(PoleAndBars, HalfPlane),
    replaces="share of an area light that a point sees",
    neglects=(PENUMBRA_WIDTH, SHAPE_OF_VISIBILITY, SAMPLING, SPATIAL_DETAIL, NUMBER_FORMAT),
    claims=(
        at_most(1),
        exact_when(
            "HalfPlane",
            0.01,
            fields={"light_shape": "disk"},
            knobs={
                "depth_bits": "exact",
                "kernel": "exact",
                "rotation": "none",
                "receiver": "plane",
                "radius": 0.0361,
                "map_size": 2048,
            },
        ),
    ),
    stress={"PoleAndBars": ("light_size", "light_elevation", "gap")},
)
def rotated_poisson_pcf(
    view: View,
    table: Kernel,
    *,
    map_size: Annotated[int, Sweep(256, 1024, low=16, high=4096)] = 1024,
    depth_bits: Literal["16", "24", "exact"] = "16",
    near: Annotated[float, Sweep(0.01, 0.1, low=0.001, high=3)] = 0.1,
    rotation: Literal["screen", "none"] = "screen",
    radius: Annotated[float, Sweep(0.003, 0.01, 0.03, low=0, high=0.5)] = 0.01,
    bias: Annotated[float, Sweep(0.05, 0.2, 0.5, low=0, high=5)] = 0.2,
    receiver: Literal["constant", "plane"] = "constant",
    compare: Literal["nearest", "bilinear"] = "nearest",
) -> mi.Float:
    """Share of the light that is seen, 0 to 1, one number per pixel.

    map_size    texels along a side of the shadow map.
    depth_bits  bits of its depth, or "exact": float32.
    near        distance from the light at which the depth range begins, m.
    rotation    whether the kernel turns from pixel to pixel ("screen") or stands still.
    radius      rho, share of the map's width.
    bias        m along the light's axis.
    receiver    depth held against the taps: the point's own, or that of its tangent plane.
    compare     one texel a tap, or four with bilinear weights.
    """
    surface, light = view.surface, view.lights[0]
    p, n = surface.position, surface.normal
    maps = render(
        view.trace, light.centre, light.u, *bounds(surface), size=map_size, bits=BITS[depth_bits], near=near
    )
    i = dr.arange(mi.UInt32, view.width * view.height)
    row, column = i // view.width % TILE, i % view.width % TILE
    turn = dr.gather(mi.Float, table.turns, dr.fma(row, TILE, column))
    lit = filtered(
        maps,
        p,
        n,
        table.offsets,
        turn if rotation == "screen" else mi.Float(0),
        radius * 2 * maps.tangent,
        bias=bias,
        plane=receiver == "plane",
        bilinear=compare == "bilinear",
    )
    faces = dr.dot(n, light.centre - p) > 0
    return dr.select(surface.valid, dr.select(faces, lit, 0), 1)


@rotated_poisson_pcf.bake
def bake(
    *,
    kernel: Literal["poisson", "grid", "exact"] = "poisson",
    taps: Annotated[int, Sweep(8, 64, low=1, high=256)] = 8,
) -> Kernel:
    """Offsets: a Poisson disk, a lattice of the same spread, or "exact": MANY taps for all of the disk."""
    if kernel == "exact":
        offsets = spiral(MANY)
    elif kernel == "grid":
        offsets = np.sqrt(np.pi / 4) * lattice(taps)
    else:
        offsets = best_candidates(taps, "disk", seed=1)
    return Kernel(mi.Vector2f(offsets.T.astype(np.float32)), random_turn(TILE * TILE, seed=1))


@rotated_poisson_pcf.domain
def domain(scene: Scene) -> Domain:
    """A small animated light over a street: shadows soft at the edge, with contact (3.3.3)."""
    if scene.light_size > 1:
        return Domain(False, "a light whose penumbrae are wider than a filter of fixed width can follow")
    if isinstance(scene, PoleAndBars) and scene.light_elevation < 20:
        return Domain(False, "the light grazes the ground, which then shades itself")
    return Domain(True)
