r"""The noise that clouds are carved from and the density made of it, in float64.

    P = (1 + (4 N_c + 2 N_2c + N_4c) / 7) / 2,  1 - R = (1 - P) (1 - W),  W of c, 4c and 7c cells

N and w are Perlin and Worley octaves (scenes.cloud_noise), W = (5 w_a + 2 w_b + w_c) / 8, c the cells of the
coarsest octave. Of the readings of "Perlin-Worley" this is the one that stays between 0 and 1.
"""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from reference.truth import closed_form
from scenes.cloud_noise import perlin, worley
from scenes.contract import DENSITY
from scenes.noise_tile import NoiseTile


@closed_form(NoiseTile, DENSITY)
def noise_on_plane(scene: NoiseTile, size: int) -> np.ndarray:
    """(size, size, 1), 0 to 1."""
    q = mi.Point3d(scene.points(size))
    c = scene.cells

    def octaves(*cells: int) -> np.ndarray:
        return np.array([5, 2, 1]) @ [np.array(worley(q, n)) for n in cells] / 8

    if scene.channel == "R":
        n = np.array([4, 2, 1]) @ [np.array(perlin(q, f)) for f in (c, 2 * c, 4 * c)] / 7
        image = 1 - (0.5 - 0.5 * n) * (1 - octaves(c, 4 * c, 7 * c))
    elif scene.channel == "A":
        image = np.array([0.75, 0.25]) @ [np.array(worley(q, n)) for n in (4 * c, 8 * c)]
    else:
        k = c if scene.channel == "G" else 2 * c
        image = octaves(k, 2 * k, 4 * k)
    return image.reshape(size, size, 1)
