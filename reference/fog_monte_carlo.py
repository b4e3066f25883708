r"""Light in height fog over ground by random walks in float64 NumPy: a second route beside Mitsuba.

Extinction is b exp(-c z) within a box. From a point at height z, along a direction of slope m = w_z,

    tau(s) = k (1 - exp(-c m s)) / (c m),   k = b exp(-c z)     (k s where c m = 0),

which is inverted for the distance to the next meeting; where tau never reaches the number drawn, there is
none. Scattering is isotropic and keeps the share `albedo`, surfaces are Lambertian, the sun is a point of
irradiance E in direction l, the sky L_sky is the same everywhere. Walks run backwards from the eye; each
vertex takes

    E T(l) V(l) / (4 pi)   in the fog,      rho / pi E T(l) V(l) n . l   on a surface,

and walks that leave the scene take L_sky. Vectors (3, n), lengths in m, radiance in W m^-2 sr^-1.
"""

from __future__ import annotations

import math

import numpy as np

from reference.surface_monte_carlo import (
    LIFT,
    about,
    blocked,
    box_span,
    cosine_weighted,
    dot,
    eye_rays,
    first_hits,
    shapes,
)
from scenes.fog import FogOverGround
from scenes.mitsuba_parts import direction


def radiance(
    scene: FogOverGround, size: int, samples: int, rng: np.random.Generator, meetings: float = math.inf
) -> np.ndarray:
    """Radiance (size, size, 1), the mean of `samples` walks a pixel; light that was scattered or reflected
    at most so many times (1: the scene's single scattering)."""
    known, low, high = shapes(scene.surfaces()), np.array(scene.LOW), np.array(scene.HIGH)
    l = np.array(direction(scene.sun_elevation, scene.SUN_AZIMUTH))[:, None]
    o, w = eye_rays(scene.sensor(size), size, samples, rng)
    total, lane, weight, met = np.zeros(o.shape[1]), np.arange(o.shape[1]), np.ones(o.shape[1]), 0
    while len(lane):
        t, n, rho = first_hits(known, o, w)
        start, end = fog_span(low, high, o, w)
        s = start + free_flight(scene, o[2] + start * w[2], w[2], rng.exponential(size=len(lane)))
        scatters = s < np.minimum(t, end)
        out = ~scatters & np.isinf(t)
        total[lane[out]] += weight[out] * scene.sky
        if met >= meetings:
            break
        kept, met = ~out, met + 1
        scatters, lane, n = scatters[kept], lane[kept], n[:, kept]
        p = (o + np.where(np.isfinite(t), np.minimum(s, t), s) * w)[:, kept] if kept.any() else o[:, kept]
        o = np.where(scatters, p, p + LIFT * n)
        weight = weight[kept] * np.where(scatters, scene.albedo, rho[kept])
        toward = np.broadcast_to(l, o.shape)
        lobe = np.where(scatters, 1 / (4 * math.pi), np.maximum(dot(n, toward), 0) / math.pi)
        seen = (lobe > 0) & ~blocked(known, o, toward)
        total[lane] += (
            weight * lobe * scene.sun_irradiance * seen * transmittance(scene, low, high, o, toward)
        )
        sphere = about(toward, 2 * rng.random(len(lane)) - 1, rng)
        upper = np.where(scatters[None], 0.0, n)
        upper[2, scatters] = 1.0
        w = np.where(scatters, sphere, cosine_weighted(upper, rng))
    return total.reshape(size, size, samples).mean(axis=2)[..., None]


def fog_span(
    low: np.ndarray, high: np.ndarray, o: np.ndarray, w: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distances (n,) between which rays are in the fog; both 0 where they miss it."""
    near, far = box_span(low, high, o, w)
    near = np.maximum(near, 0)
    return np.where(near < far, near, 0), np.where(near < far, far, 0)


def optical_depth(scene: FogOverGround, z: np.ndarray, m: np.ndarray, s: np.ndarray) -> np.ndarray:
    """tau of segments of length s from height z with slope m (n,)."""
    k, a = scene.density * np.exp(-scene.falloff * z), scene.falloff * m
    return k * np.where(a == 0, s, -np.expm1(-a * s) / np.where(a == 0, 1, a))


def free_flight(scene: FogOverGround, z: np.ndarray, m: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """The length s (n,) at which the optical depth is tau, infinite where it never is."""
    k, a = scene.density * np.exp(-scene.falloff * z), scene.falloff * m
    with np.errstate(divide="ignore", invalid="ignore"):
        x = a * tau / k
        return np.where(a == 0, tau / k, np.where(x < 1, -np.log1p(-x) / a, np.inf))


def transmittance(
    scene: FogOverGround, low: np.ndarray, high: np.ndarray, o: np.ndarray, w: np.ndarray
) -> np.ndarray:
    """exp(-tau) (n,) from points to where the fog ends along w."""
    start, end = fog_span(low, high, o, w)
    return np.exp(-optical_depth(scene, o[2] + start * w[2], w[2], end - start))
