r"""Density that the wind has carried along, in float64 at the probes: what it was where the air came from.

With dz/dt = w and dx/dt = U + S (z - base) / depth the way back is in closed form,

    z_0 = z - w t,   x_0 = x - U t - S t ((z + z_0) / 2 - base) / depth.
"""

from __future__ import annotations

import numpy as np

from reference.truth import closed_form
from scenes.blown_field import BlownField
from scenes.contract import DENSITY


@closed_form(BlownField, DENSITY)
def carried_density(scene: BlownField, size: int) -> np.ndarray:
    """(size, size, 1), 0 to 1."""
    return scene.values(size)
