"""The noise that clouds are carved from, in float64: every octave where it is asked for."""

from __future__ import annotations

import numpy as np

from reference.truth import closed_form
from scenes.contract import DENSITY
from scenes.noise_tile import NoiseTile


@closed_form(NoiseTile, DENSITY)
def noise_on_plane(scene: NoiseTile, size: int) -> np.ndarray:
    """(size, size, 1), 0 to 1."""
    return scene.values(size)
