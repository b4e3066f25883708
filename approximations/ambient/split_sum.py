r"""Split sum: a filtered environment times a table of what the BRDF reflects of a uniform one.

The product of two averages stands for the average of the product (Karis 2013):

    L(v) = cube(r, roughness) (F0 A + B),
    A = int (1 - (1 - v.h)^5) D G / (4 n.l n.v) n.l dl,   B = int (1 - v.h)^5 D G / (4 n.l n.v) n.l dl,

F being Schlick's, so that a uniform environment is reflected exactly. The cube is filtered by GGX as if
n = v = r, as for prefiltered_environment; what is left is the stretch of the lobe at grazing angles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.ambient import prefiltered_environment as prefiltered
from approximations.contract import SHAPE_OF_LOBE, Sweep, exact_when, technique
from approximations.kit.cube_map import CubeMap, lookup
from approximations.kit.sampling import GOLDEN_ANGLE
from scenes.contract import RADIANCE, View
from scenes.environment_ball import GlossyBall


@dataclass
class SplitSum:
    """The filtered environment; A and B as the two channels of an image over n.v (across) and roughness."""

    probe: CubeMap
    table: mi.Texture2f


@technique(
    source="Karis, Real Shading in Unreal Engine 4, SIGGRAPH 2013 course Physically Based Shading",
    estimates=RADIANCE,
    on=(GlossyBall,),
    replaces="reflection of a distant environment by a GGX surface",
    neglects=(SHAPE_OF_LOBE,),
    claims=(exact_when("GlossyBall", 0.02, fields={"contrast": 0.0}),),
    stress={"GlossyBall": ("roughness", "f0")},
    baseline=True,
)
def split_sum(view: View, baked: SplitSum) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel."""
    surface, v = view.surface, -view.camera.direction
    roughness, nv = dr.sqrt(surface.alpha), dr.clip(dr.dot(surface.normal, v), 0, 1)
    a, b = baked.table.eval(mi.Point2f(nv, roughness))
    r = prefiltered.mirrored(surface.normal, v)
    light = lookup(baked.probe, r, roughness * (prefiltered.MIPS - 1))
    return dr.select(
        surface.valid, light * (surface.specular * a + b), view.environment(view.camera.direction)
    )


@split_sum.bake
def bake(view: View, *, table: Annotated[int, Sweep(8, low=4, high=256)] = 32) -> SplitSum:
    """The filtered environment, and a table of `table` x `table` texels."""
    probe = prefiltered.bake(view, lobe="GGX")
    at = (np.arange(table) + 0.5) / table
    nv, roughness = np.meshgrid(at, at)
    texels = np.stack(reflected(nv, roughness), axis=-1)
    return SplitSum(probe, mi.Texture2f(mi.TensorXf(texels.astype(np.float32)), wrap_mode=dr.WrapMode.Clamp))


def reflected(nv: np.ndarray, roughness: np.ndarray, samples: int = 1024) -> tuple[np.ndarray, np.ndarray]:
    """A and B in float64, by half vectors drawn from D n.h on a spiral."""
    u, phi = np.linspace(0, 1, samples, endpoint=False), GOLDEN_ANGLE * np.arange(samples)
    nv, a2 = nv[..., None], roughness[..., None] ** 4
    nh = np.sqrt((1 - u) / (1 - u * (1 - a2)))
    vh = nv * nh + np.sqrt((1 - nv**2) * (1 - nh**2)) * np.cos(phi)
    nl = 2 * vh * nh - nv
    lit = nl > 0
    seen = smith(np.where(lit, nl, 1), a2) * smith(nv, a2) * vh / (nh * nv)
    grazing = (1 - vh) ** 5
    return tuple(np.where(lit, seen * part, 0).mean(axis=-1) for part in (1 - grazing, grazing))


def smith(cosine: np.ndarray, a2: np.ndarray) -> np.ndarray:
    """Share of GGX's facets, of squared width a2, that are seen at that cosine."""
    return 2 / (1 + np.sqrt(1 + a2 * (1 / cosine**2 - 1)))
