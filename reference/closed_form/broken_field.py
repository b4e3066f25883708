"""Density of a field of clouds under a weather that is a formula, in float64 at the probes."""

from __future__ import annotations

import numpy as np

from reference.truth import closed_form
from scenes.broken_field import BrokenField
from scenes.contract import DENSITY


@closed_form(BrokenField, DENSITY)
def density_of_field(scene: BrokenField, size: int) -> np.ndarray:
    """(size, size, 1), 0 to 1."""
    return scene.values(size)
