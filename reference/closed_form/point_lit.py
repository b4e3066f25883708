r"""The ball under point lights, in float64: a sum over the lights, each one direction.

    L = sum_i (albedo / pi + D G1(n.l) G1(n.v) F(v.h) / (4 n.l n.v)) n.l I_i / r_i^2

over the lights above the tangent plane; the ball is convex and shadows nothing else. D and G1 are written by
the tangents of their angles (Walter et al. 2007), F by the sines and tangents of Fresnel's own law.
"""

from __future__ import annotations

import math

import numpy as np

from reference.truth import closed_form
from scenes.contract import DIRECT_RADIANCE
from scenes.point_lit import HALF, MIRROR, PointLitBall


@closed_form(PointLitBall, DIRECT_RADIANCE)
def lit_ball(scene: PointLitBall, size: int) -> np.ndarray:
    """Radiance (W m^-2 sr^-1), (size, size, 1); 0 beside the ball."""
    n = normals(size)
    hit = np.isfinite(n[:, 0])
    n = n[hit]
    v = np.array([0.0, -1, 0])
    radiance = np.zeros(len(n))
    for position in scene.positions():
        to = position - n
        r = np.linalg.norm(to, axis=1)
        l = to / r[:, None]
        nl = np.maximum((n * l).sum(axis=1), 0)
        reflected = scene.albedo / math.pi * np.ones(len(n))
        if scene.roughness**2 > MIRROR:
            reflected += lobe(n, l, v, scene.roughness**2, scene.f0)
        radiance += reflected * nl * scene.intensity / scene.lights / r**2
    image = np.zeros(size * size)
    image[hit] = radiance
    return image.reshape(size, size, 1)


def normals(size: int) -> np.ndarray:
    """At what size x size samples of the picture see, row by row from the top (size^2, 3); nan beside it."""
    s = ((2 * np.arange(size) + 1) / size - 1) * HALF
    x, z = (a.ravel() for a in np.meshgrid(s, -s))
    square = 1 - x * x - z * z
    y = -np.sqrt(np.where(square > 0, square, np.nan))
    return np.where(square[:, None] > 0, np.stack([x, y, z], axis=1), np.nan)


def lobe(n: np.ndarray, l: np.ndarray, v: np.ndarray, alpha: float, f0: float) -> np.ndarray:
    """f (1/sr) of the GGX lobe; 0 where the light is below the surface."""
    h = l + v
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    nl, nv, nh = ((n * w).sum(axis=1) for w in (l, np.broadcast_to(v, n.shape), h))
    up = (nl > 0) & (nv > 0)
    nl, nv, nh = (np.where(up, c, 1.0) for c in (nl, nv, nh))
    tan2 = np.where(up, (np.cross(n, h) ** 2).sum(axis=1), 0) / nh**2
    d = 1 / (math.pi * alpha**2 * nh**4 * (1 + tan2 / alpha**2) ** 2)
    g = smith(nl, alpha) * smith(nv, alpha)
    return np.where(up, d * g * fresnel(h @ v, f0) / (4 * nl * nv), 0)


def smith(c: np.ndarray, alpha: float) -> np.ndarray:
    """G1 = 2 / (1 + sqrt(1 + alpha^2 tan^2))."""
    return 2 / (1 + np.sqrt(1 + alpha**2 * (1 / c**2 - 1)))


def fresnel(c: np.ndarray, f0: float) -> np.ndarray:
    """Of unpolarised light at an angle of cosine c from the normal, by both polarisations' amplitudes."""
    index = (1 + math.sqrt(f0)) / (1 - math.sqrt(f0))
    inside = np.sqrt(1 - (1 - c * c) / index**2)
    across = (c - index * inside) / (c + index * inside)
    along = (index * c - inside) / (index * c + inside)
    return 0.5 * (across**2 + along**2)
