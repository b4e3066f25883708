r"""Transmittance of a slab whose extinction is the same at every height, in float64.

The product of the streaks' factors 1 + cos is a sum of waves a_k exp(i k . x). Along a ray that is in the
slab for the length s about its middle x_m each has the mean sinc, so that

    tau = optical_depth / d_z Re sum_k a_k exp(i k . (x_m - t wind)) sinc(k . d s / 2).
"""

from __future__ import annotations

import numpy as np

from reference.closed_form.fog import pinhole_rays
from reference.truth import closed_form
from scenes.contract import TRANSMITTANCE
from scenes.high_clouds import WAVES, HighClouds


@closed_form(HighClouds, TRANSMITTANCE)
def high_transmittance(scene: HighClouds, size: int) -> np.ndarray:
    """T = exp(-tau), 0 to 1, at the centres of size x size samples."""
    return np.exp(-high_depth(scene, size))


def high_depth(scene: HighClouds, size: int) -> np.ndarray:
    """Optical depth (size, size, 1) of the slab."""
    o, w = pinhole_rays(*scene.eye(), scene.FIELD_OF_VIEW, size)
    slope = w[..., :2] / w[..., 2:]
    middle = (scene.BASE + scene.thickness / 2 - o[2]) * slope - scene.time * np.array(scene.WIND)
    total = np.ones(slope.shape[:2])
    for kx, ky, amplitude, phase in terms():
        k = 2 * np.pi / scene.TILE * np.array([kx, ky])
        mean = np.sinc(slope @ k * scene.thickness / (2 * np.pi))
        total += amplitude * mean * np.cos(middle @ k + phase)
    return (scene.optical_depth * total / w[..., 2])[..., None]


def terms() -> list[tuple[int, int, float, float]]:
    """(k_x, k_y, amplitude, phase) of the cosines that the product of the factors is 1 plus the sum of."""
    found: list[tuple[int, int, float, float]] = []
    for kx, ky, phase in WAVES:
        both = [
            (kx + side * ax, ky + side * ay, a / 2, phase + side * f)
            for ax, ay, a, f in found
            for side in (1, -1)
        ]
        found += [(kx, ky, 1.0, phase), *both]
    return found
