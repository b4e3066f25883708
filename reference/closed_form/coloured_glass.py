"""Light through balls of coloured matter by Beer's law, in float64.

L = integral of L_panel(l) exp(-sigma(l) s) rgb(l) dl, s = 2 sqrt(r^2 - d^2) the chord at distance d from a
ball's centre line. The integral is the sum over 1 nm of the CIE 1931 observer, spectra linear in between.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from reference.colour import Extinction, film_response, observer, spectrum_to_rgb
from reference.truth import closed_form
from scenes.coloured import WAVELENGTHS, ColouredGlass
from scenes.contract import RADIANCE


@closed_form(ColouredGlass, RADIANCE)
def radiance(scene: ColouredGlass, size: int) -> np.ndarray:
    """Linear sRGB (size, size, 3) at the centres of size x size samples."""
    fine = observer()[0]
    weights = np.interp(fine, WAVELENGTHS, scene.panel())[:, None] * film_response()
    image = np.broadcast_to(weights.sum(axis=0), (size, size, 3)).copy()
    for dye, inside, chord in chords(scene, size):
        sigma = np.interp(fine, WAVELENGTHS, scene.absorption(dye))
        lengths, which = np.unique(chord.round(12), return_inverse=True)
        parts = np.array_split(lengths, 1 + len(lengths) // 4096)
        image[inside] = np.concatenate([np.exp(-np.outer(s, sigma)) @ weights for s in parts])[which]
    return image


def rgb_radiance(scene: ColouredGlass, size: int, extinction: Extinction = "band") -> np.ndarray:
    """The same in three channels: L_rgb exp(-sigma_rgb s), sigma_rgb clipped as `reference.colour` does."""
    panel = np.maximum(spectrum_to_rgb(WAVELENGTHS, scene.panel(), "emission"), 0)
    image = np.broadcast_to(panel, (size, size, 3)).copy()
    for dye, inside, chord in chords(scene, size):
        sigma = spectrum_to_rgb(WAVELENGTHS, scene.absorption(dye), "extinction", extinction)
        image[inside] = panel * np.exp(-np.outer(chord, np.maximum(sigma, 0)))
    return image


def chords(scene: ColouredGlass, size: int) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """For each ball its dye, which samples (size, size) it covers, and their path length in it."""
    s = ((2 * np.arange(size) + 1) / size - 1) * scene.HALF_WIDTH
    x, z = np.meshgrid(s, -s)
    for dye, (cx, _, cz) in scene.CENTRES.items():
        squared = scene.RADIUS**2 - (x - cx) ** 2 - (z - cz) ** 2
        inside = squared > 0
        yield dye, inside, 2 * np.sqrt(squared[inside])
