"""The hill under clouds against Mitsuba, which tracks the sun's light through a grid of the same clouds.

A grid of spacing c that is linear between the middles of its cells damps a wave k by (c k)^2 / 12: at most 4
cycles along x or y in a tile of 48 cells, 2.3 % of its amplitude. So `within` is GRID of the change that tau
makes in the sun's light.
"""

from __future__ import annotations

import numpy as np

from reference.closed_form.clouded_ground import clouded_radiance, ground, sun_depth
from reference.verify.checks import Comparison, check
from reference.verify.routes import SIZE
from reference.verify.routes_closed_form import compared
from scenes.clouded_ground import CloudedGround
from scenes.contract import DIRECT_RADIANCE

GRID = 0.03


@check(
    "route",
    claim="the sun through heaped clouds and the sky on a hill are what tracked rays find",
    routes=("volpath at depth 2", "closed form"),
    scenes=("CloudedGround",),
)
def clouded_ground_against_volpath(seed: int) -> list[Comparison]:
    """Thick and thin layers, a sun high and low enough to leave a dark side."""
    found = []
    for scene in (
        CloudedGround(optical_depth=0.5, sun_elevation=15.0, thickness=1000.0, sky_share=0.0),
        CloudedGround(optical_depth=1.0, sun_elevation=80.0, thickness=200.0),
    ):
        p, n = ground(scene, SIZE)
        tau = sun_depth(scene, p)
        facing = np.maximum(n @ np.array(scene.to_sun()), 0)
        sun = scene.ALBEDO / np.pi * (1 - scene.sky_share) * facing * tau * np.exp(-tau)
        found.append(
            compared(scene, DIRECT_RADIANCE, clouded_radiance(scene, SIZE), seed, 256, GRID * sun[..., None])
        )
    return found
