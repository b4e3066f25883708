"""Modelled density of clouds, in float64 at the probes: every octave where it is asked for."""

from __future__ import annotations

import numpy as np

from reference.truth import closed_form
from scenes.contract import DENSITY
from scenes.density_section import DensitySection


@closed_form(DensitySection, DENSITY)
def density_in_section(scene: DensitySection, size: int) -> np.ndarray:
    """(size, size, 1), 0 to 1."""
    return scene.values(size)
