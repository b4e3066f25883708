r"""A slab whose extinction is the same at every height: what crosses it and is scattered once, in float64.

The product of the streaks' factors 1 + cos is a sum of waves a_k exp(i k . x). Along a ray that is in the
slab for the length s about its middle x_m each has the mean sinc, so that

    tau = optical_depth / d_z Re sum_k a_k exp(i k . (x_m - t wind)) sinc(k . d s / 2).

Light scattered once, E f int sigma e^-(tau_view + tau_sun) dt, is left as one smooth integral along the ray:
both depths are of that form, and Gauss's rule takes NODES points every PANEL (m) of the slab's thickness and
every DEEP of its largest optical depth.
"""

from __future__ import annotations

import math
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.polynomial.legendre import leggauss

from reference.closed_form.fog import pinhole_rays
from reference.slab_monte_carlo import phase
from reference.truth import closed_form
from scenes.contract import SINGLE_SCATTERING, TRANSMITTANCE
from scenes.high_clouds import WAVES, HighClouds

NODES, PANEL, DEEP = 16, 300.0, 20.0


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
    for kx, ky, amplitude, f in terms():
        k = 2 * np.pi / scene.TILE * np.array([kx, ky])
        mean = np.sinc(slope @ k * scene.thickness / (2 * np.pi))
        total += amplitude * mean * np.cos(middle @ k + f)
    return (scene.optical_depth * total / w[..., 2])[..., None]


@closed_form(HighClouds, SINGLE_SCATTERING)
def high_light(scene: HighClouds, size: int) -> np.ndarray:
    """Radiance (size, size, 1), W m^-2 sr^-1, of light that was scattered once."""
    o, w = pinhole_rays(*scene.eye(), scene.FIELD_OF_VIEW, size)
    wide = dr.float64_array_t(mi.Float)
    up, l = wide((1 / w[..., 2]).ravel()), scene.to_sun()
    view, sun = _turning(scene, w[..., :2] / w[..., 2:]), _turning(scene, np.array(l[:2]) / l[2])
    drifted = _turning(scene, scene.time * np.array(scene.WIND))
    below = float(scene.BASE - o[2])
    start = [below * v - d + f for v, d, (_, _, f) in zip(view, drifted, WAVES, strict=True)]
    deepest = 8 * scene.optical_depth * (1 / w[..., 2].min() + 1 / l[2])
    panels = math.ceil(max(scene.thickness / PANEL, deepest / DEEP))
    x, weight = leggauss(NODES)
    at = (np.arange(panels)[:, None] + (x + 1) / 2).ravel() / panels * scene.thickness
    heights, weights = wide(at), wide(np.tile(weight / 2, panels) / panels)

    def add(i: Any, total: Any) -> tuple[Any, Any]:
        z = dr.gather(wide, heights, i)
        left = scene.thickness - z
        here = [a + z * v for a, v in zip(start, view, strict=True)]
        seen = z * up * _mean(here, [-v * z / 2 for v in view])
        lit = left / l[2] * _mean(here, [v * left / 2 for v in sun])
        streaks = wide(1)
        for angle in here:
            streaks *= 1 + dr.cos(angle)
        kept = dr.exp(-scene.optical_depth / scene.thickness * (seen + lit))
        return i + 1, total + dr.gather(wide, weights, i) * streaks * kept

    state = (mi.UInt32(0), dr.zeros(wide, size * size))
    total = dr.while_loop(state, lambda i, total: i < len(at), add)[1]
    once = scene.optical_depth * np.array(total * up).reshape(size, size)
    return (scene.SUN_IRRADIANCE * phase(w @ np.array(l), scene.g) * once)[..., None]


def _turning(scene: HighClouds, way: np.ndarray) -> list:
    """By how much the phase of each factor turns along ways (..., 2)."""
    wide = dr.float64_array_t(mi.Float)
    return [wide(np.ravel(way @ (2 * np.pi / scene.TILE * np.array(k)))) for *k, _ in WAVES]


def _mean(here: list, half: list) -> Any:
    """Mean of the product of the factors 1 + cos along a way whose middle is `half` further on in each one's
    phase: of each cosine in the sum, whose phasors are products of the factors', cos(middle) sinc(half)."""
    middles = _products([dr.sincos(a + h)[::-1] for a, h in zip(here, half, strict=True)])
    halves = _products([dr.sincos(h)[::-1] for h in half])
    total = 1.0
    for (_, _, amplitude, _), middle, turned, angle in zip(
        terms(), middles, halves, _sums(half), strict=True
    ):
        total += amplitude * middle[0] * dr.select(dr.abs(angle) < 1e-6, 1.0, turned[1] / angle)
    return total


def _products(phasors: list[tuple[Any, Any]]) -> list[tuple[Any, Any]]:
    """(cos, sin) of the cosines that `terms` lists, from those of the factors."""
    found: list[tuple[Any, Any]] = []
    for c, s in phasors:
        found += [(c, s), *((c * a - k * s * b, s * a + k * c * b) for a, b in found for k in (1, -1))]
    return found


def _sums(angles: list) -> list:
    """The angles of the same."""
    found: list[Any] = []
    for angle in angles:
        found += [angle, *(angle + k * a for a in found for k in (1, -1))]
    return found


def terms() -> list[tuple[int, int, float, float]]:
    """(k_x, k_y, amplitude, phase) of the cosines that the product of the factors is 1 plus the sum of."""
    found: list[tuple[int, int, float, float]] = []
    for kx, ky, start in WAVES:
        both = [
            (kx + side * ax, ky + side * ay, a / 2, start + side * f)
            for ax, ay, a, f in found
            for side in (1, -1)
        ]
        found += [(kx, ky, 1.0, start), *both]
    return found
