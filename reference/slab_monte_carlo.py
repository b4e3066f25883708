"""Light in homogeneous clouds by random walks in float64 NumPy: a second route beside Mitsuba.

Lengths are optical depths: `exit_depth(p, w)` gives how far the cloud's boundary lies from points p
inside along unit directions w. The medium scatters by Henyey-Greenstein of mean cosine g, each meeting
keeps the share `albedo`; the sun is a point in unit direction l that gives irradiance 1 across its rays.
Walks run backwards from the eye and meet the sun at every vertex:

    S(x, w) = f(w . l) T(x, l) + int f(w . w') L(x, w') dw',   L(o, w) = int_0 e^-t albedo S(o + t w, w) dt
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

ExitDepth = Callable[[np.ndarray, np.ndarray], np.ndarray]


def phase(cosine: np.ndarray, g: float) -> np.ndarray:
    """Henyey-Greenstein, 1/sr; 1 is straight on."""
    return (1 - g**2) / (4 * np.pi * (1 + g**2 - 2 * g * cosine) ** 1.5)


def turn(w: np.ndarray, g: float, rng: np.random.Generator) -> np.ndarray:
    """Directions drawn from the phase function about unit directions w (n, 3)."""
    u, azimuth = rng.random(len(w)), 2 * np.pi * rng.random(len(w))
    if abs(g) < 1e-6:
        cosine = 2 * u - 1
    else:
        cosine = (1 + g**2 - ((1 - g**2) / (1 - g + 2 * g * u)) ** 2) / (2 * g)
    sine = np.sqrt(np.maximum(1 - cosine**2, 0))
    aside = np.where(np.abs(w[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    a = np.cross(w, aside)
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b = np.cross(w, a)
    out = cosine[:, None] * w + sine[:, None] * (np.cos(azimuth)[:, None] * a + np.sin(azimuth)[:, None] * b)
    return out / np.linalg.norm(out, axis=1, keepdims=True)


def slab(depth: float) -> ExitDepth:
    """The layer 0 <= z <= depth, its lit top at z = depth."""

    def exit_depth(p: np.ndarray, w: np.ndarray) -> np.ndarray:
        with np.errstate(divide="ignore"):
            return np.where(w[..., 2] > 0, depth - p[..., 2], p[..., 2]) / np.abs(w[..., 2])

    return exit_depth


def ball(radius: float) -> ExitDepth:
    """The ball of that optical radius round the origin."""

    def exit_depth(p: np.ndarray, w: np.ndarray) -> np.ndarray:
        middle = -np.sum(p * w, axis=-1)
        apart = np.sum(p * p, axis=-1) - middle**2
        return middle + np.sqrt(np.maximum(radius**2 - apart, 0))

    return exit_depth


def radiance(
    p: np.ndarray,
    w: np.ndarray,
    exit_depth: ExitDepth,
    l: np.ndarray,
    albedo: float,
    g: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """One estimate of L(p, w) per row of p (on or in the cloud) and unit w, both (n, 3): all orders."""
    total, lane, weight = np.zeros(len(p)), np.arange(len(p)), 1.0
    while len(lane):
        flight = rng.exponential(size=len(lane))
        stays = flight < exit_depth(p, w)
        p, w, lane = p[stays] + flight[stays, None] * w[stays], w[stays], lane[stays]
        weight *= albedo
        total[lane] += weight * phase(w @ l, g) * np.exp(-exit_depth(p, np.broadcast_to(l, p.shape)))
        w = turn(w, g, rng)
    return total


def source_function(
    p: np.ndarray,
    w: np.ndarray,
    exit_depth: ExitDepth,
    l: np.ndarray,
    albedo: float,
    g: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """One estimate of S(p, w) per row of p and unit w (from eye to sample), both (n, 3)."""
    sun = phase(w @ l, g) * np.exp(-exit_depth(p, np.broadcast_to(l, p.shape)))
    return sun + radiance(p, turn(w, g, rng), exit_depth, l, albedo, g, rng)


def slab_fluxes(
    depth: float, mu: float, albedo: float, g: float, photons: int, rng: np.random.Generator
) -> tuple[float, float]:
    """Shares of the light falling on a slab, at cosine mu from its vertical, that leave through the lit
    side and through the other (unscattered light included). Photons run forwards."""
    w = np.broadcast_to([np.sqrt(1 - mu**2), 0.0, -mu], (photons, 3))
    p = np.zeros((photons, 3))
    p[:, 2] = depth
    exit_depth, weight, back, through = slab(depth), 1.0, 0.0, 0.0
    while len(p):
        flight = rng.exponential(size=len(p))
        stays = flight < exit_depth(p, w)
        back += weight * np.count_nonzero(~stays & (w[:, 2] > 0))
        through += weight * np.count_nonzero(~stays & (w[:, 2] < 0))
        weight *= albedo
        p = p[stays] + flight[stays, None] * w[stays]
        w = turn(w[stays], g, rng)
    return back / photons, through / photons
