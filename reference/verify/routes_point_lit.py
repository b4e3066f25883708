"""Point lights on a glossy ball in closed form against Mitsuba, along rays through pixel centres."""

from __future__ import annotations

import numpy as np

from reference.closed_form.point_lit import lit_ball
from reference.verify.checks import Comparison, check
from reference.verify.routes import SIZE
from reference.verify.routes_closed_form import compared
from scenes.contract import DIRECT_RADIANCE
from scenes.point_lit import PointLitBall

ROUNDING = 1e-4
"""Of a float32 lobe as narrow as these, relative."""


@check(
    "route",
    claim="a glossy ball reflects point lights as GGX with Smith's masking and Fresnel's law says",
    routes=("direct", "closed form"),
    scenes=("PointLitBall",),
)
def ggx_against_direct(seed: int) -> list[Comparison]:
    """Smooth and rough, dull and bright, one light and many."""
    cases = (
        PointLitBall(),
        PointLitBall(roughness=0.15, lights=1),
        PointLitBall(roughness=1.0, f0=0.5, albedo=0.0, lights=16),
        PointLitBall(roughness=0.0, albedo=0.5),
    )
    return compared_with_mitsuba(cases, seed)


def compared_with_mitsuba(scenes: tuple[PointLitBall, ...], seed: int) -> list[Comparison]:
    """Each scene along rays through the centres of SIZE x SIZE pixels."""
    found = [(s, lit_ball(s, SIZE)) for s in scenes]
    return [compared(s, DIRECT_RADIANCE, e, seed, 512, within=ROUNDING * np.abs(e)) for s, e in found]
