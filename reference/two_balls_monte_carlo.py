"""Light in two balls of cloud by random walks in float64 NumPy: a second route beside Mitsuba.

Flights are drawn as optical depths and laid out along a ray over the chords of both balls, whichever comes
first, so that walks cross the clear air between them. The sun is met at every droplet.
"""

from __future__ import annotations

import numpy as np

from reference.slab_monte_carlo import phase, turn
from reference.surface_monte_carlo import eye_rays
from scenes.cloud import SUN_IRRADIANCE
from scenes.two_balls import TwoBalls


def chords(scene: TwoBalls, p: np.ndarray, w: np.ndarray) -> np.ndarray:
    """(n, 2, 2): distances (m) at which rays from p along unit w, both (n, 3), enter and leave the balls,
    from 0 on, in the order in which they are met; the two are the same where a ball is missed."""
    found = []
    for c in scene.middles():
        middle = np.sum((np.array(c) - p) * w, axis=1)
        apart = np.sum((p - np.array(c)) ** 2, axis=1) - middle**2
        half = np.sqrt(np.maximum(1 - apart, 0))
        found.append(np.maximum(np.stack([middle - half, middle + half], axis=1), 0))
    both = np.stack(found, axis=1)
    first = np.argmin(both.sum(axis=2), axis=1)
    n = np.arange(len(p))
    return np.stack([both[n, first], both[n, 1 - first]], axis=1)


def radiance(
    scene: TwoBalls, p: np.ndarray, w: np.ndarray, rng: np.random.Generator, orders: float = np.inf
) -> np.ndarray:
    """One estimate of L(p, w), W m^-2 sr^-1, per row of p and of unit w, both (n, 3), of light that was
    scattered up to `orders` times."""
    (sigma, albedo), l = scene.rainy, np.array(scene.to_sun())
    total, lane, weight = np.zeros(len(p)), np.arange(len(p)), SUN_IRRADIANCE
    while len(lane) and orders > 0:
        spans = chords(scene, p, w)
        way = rng.exponential(1 / sigma, len(lane))
        first, second = (spans[:, k, 1] - spans[:, k, 0] for k in (0, 1))
        t = np.where(way < first, spans[:, 0, 0] + way, spans[:, 1, 0] + way - first)
        stays = way < first + second
        p, w, lane = p[stays] + t[stays, None] * w[stays], w[stays], lane[stays]
        weight, orders = weight * albedo, orders - 1
        sunward = chords(scene, p, np.broadcast_to(l, p.shape))
        depth = sigma * np.sum(sunward[:, :, 1] - sunward[:, :, 0], axis=1)
        total[lane] += weight * phase(w @ l, scene.g) * np.exp(-depth)
        w = turn(w, scene.g, rng)
    return total


def image(
    scene: TwoBalls, size: int, samples: int, rng: np.random.Generator, orders: float = np.inf
) -> np.ndarray:
    """(size, size, 1), the mean of so many walks a pixel."""
    o, w = eye_rays(scene.sensor(size), size, samples, rng)
    light = radiance(scene, o.T, np.broadcast_to(w, o.shape).T, rng, orders)
    return light.reshape(size, size, samples).mean(axis=2)[..., None]
