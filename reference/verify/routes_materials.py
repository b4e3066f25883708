"""Two mirrors in one texture against Mitsuba, along rays through pixel centres."""

from __future__ import annotations

import math

from reference.closed_form import material_border
from reference.verify.checks import Comparison, check
from reference.verify.routes import SIZE
from reference.verify.routes_closed_form import compared
from scenes.contract import RADIANCE
from scenes.material_border import MaterialBorder


@check(
    "route",
    claim="what shares a texel reflects by its share",
    routes=("path with envmap", "closed form"),
    scenes=("MaterialBorder",),
)
def inlay_against_blend(seed: int) -> list[Comparison]:
    """The finest level and a coarse one. Between the rows of its image the environment is off by at most
    (k + k^2) h^2 / 8 of itself, h being the angle between two."""
    found = []
    for scene in (MaterialBorder(), MaterialBorder(mip=2, sharpness=5.0, contrast=0.5)):
        closed, k = material_border.material_border(scene, SIZE), scene.sharpness
        between_rows = (k + k * k) * (math.pi / scene.environment().ROWS) ** 2 / 8
        found.append(compared(scene, RADIANCE, closed, seed, 512, 2 * between_rows * closed + 1e-5))
    return found
