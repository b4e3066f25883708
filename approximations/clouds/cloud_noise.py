r"""Cloud noise packed into a small texture that repeats.

GPU Pro 7, II.4, 4.3.1. Perlin noise alone gives mist; Worley noise, the distance to the nearest of scattered
points turned over, gives packed balls. The chapter joins the two and keeps sums of octaves, so that a sample
of density costs one read of a texture with four channels, not ten noises of 27 points each.

    P = 1/2 + 1/2 (N_8 + N_16 / 2 + N_32 / 4) / 1.75      Perlin octaves N_n of n cells, in [0, 1]
    w_n = max(1 - F1 n, 0)                                Worley octave; F1: distance to the nearest point
    W(a, b, c) = 5/8 w_a + 1/4 w_b + 1/8 w_c
    R = W + P (1 - W),  W = W(8, 32, 56)                  "Perlin-Worley"
    G = W(8, 16, 32),  B = W(16, 32, 64),  A = 3/4 w_32 + 1/4 w_64

128^3 texels of four 8-bit channels are 8 MiB, of 16 bits 16 MiB, without mips. There R runs from 0.363 to
0.974 with a mean of 0.738, so that it uses six tenths of its 255 steps; G from 0.040 to 0.908, B from 0.015
to 0.917 and A from 0 to 0.967, with means of 0.477. Read between texels, R errs by 0.007 and G by 0.006,
but A, of two texels to the finest cell, by 0.034.

In print, and what was done here:
- Cells, octaves and how Perlin noise is scaled are not given; these are what public implementations use. That
  the sums are weighed by 5/8, 1/4 and 1/8 comes from the sampler (4.3.4).
- Perlin-Worley is said to be a remap of Perlin noise with the Worley sum as its old minimum. To the letter
  that is (P - W) / (1 - W), down to -9 and below 0 in 44 % of the tile: no shape for a cloud ("printed"). The
  default takes W for the new minimum, which swells the mist by balls, stays in [0, 1] and is what others
  build; a third reading is the "product" W P.
- Billows are printed as |2 P + 1|, which folds nothing; |2 P - 1| is meant.
- 8 bits are assumed: print gives sizes of textures only. What falls outside [0, 1] is clipped by them.
- Mips are left out: they blur what the sampler's remaps go on to bend, which is another error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    NUMBER_FORMAT,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from approximations.kit.cloud_model import packed, shape_noise
from scenes.contract import DENSITY, Scene, View
from scenes.noise_tile import NoiseTile


@dataclass
class Baked:
    """The texture, and which reading of its first channel it holds."""

    texture: Any
    first: str


@technique(
    source="GPU Pro 7, II.4, sec. 4.3.1",
    covers=("cloudscapes/02", "cloudscapes/03"),
    estimates=DENSITY,
    on=(NoiseTile,),
    replaces="octaves of noise computed where they are asked for",
    neglects=(SPATIAL_DETAIL, NUMBER_FORMAT),
    claims=(
        exact_when("NoiseTile", 2e-5, knobs={"lookup": "exact"}),
        exact_when("NoiseTile", 2e-5, fields={"channel": "B"}, knobs={"lookup": "exact"}),
    ),
    stress={"NoiseTile": ("cells",)},
)
def packed_noise(
    view: View, baked: Baked, *, lookup: Literal["nearest", "trilinear", "exact"] = "trilinear"
) -> mi.Float:
    """The recipe's channel, 0 to 1, one number per probe.

    lookup  how the texture is read; "exact" does without and composes the octaves at the probe itself
    """
    q, recipe = view.camera.origin, view.noise
    if lookup == "exact":
        return shape_noise(q, recipe.cells, baked.first)[recipe.channel]
    if lookup == "nearest":
        size = baked.texture.shape[0]
        q = (dr.floor(q * size) + 0.5) / size
    return baked.texture.eval(q)[recipe.channel]


@packed_noise.bake
def bake(
    view: View,
    *,
    resolution: Annotated[int, Sweep(32, 64, 128, low=4, high=256)] = 128,
    storage: Literal["8 bits", "16 bits", "exact"] = "8 bits",
    first: Literal["dilated", "printed", "product", "perlin", "billows"] = "dilated",
) -> Baked:
    """The texture, from the noise at the middles of its texels.

    resolution  texels along an edge
    storage     bits a channel, from 0 to 1; "exact" is float
    first       what R is: the readings W + P (1 - W), (P - W) / (1 - W) and W P; or P or |2 P - 1| alone
    """
    recipe = view.noise
    return Baked(packed(lambda q: shape_noise(q, recipe.cells, first), resolution, storage), first)


@packed_noise.domain
def domain(scene: Scene) -> Domain:
    """Octaves that the published 128^3 texture resolves: the finest has two texels or more a cell."""
    if 8 * scene.cells > 64:
        return Domain(False, "the finest octave has less than two texels of a 128^3 texture a cell")
    return Domain(True)
