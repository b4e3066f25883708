r"""Diffuse balls in an environment and among lamps, in float64.

A ball is convex, so that a point with normal n sees its whole hemisphere and no light that it reflected:
L = albedo / pi E(n). The irradiance of a von Mises-Fisher lobe is a sum over Legendre polynomials, since
both the lobe and the clamped cosine turn about an axis (Funk and Hecke):

    E(n) = sum_l (2 l + 1) / (4 pi) A_l rho_l P_l(n . a),   rho_l = I_{l + 1/2}(k) / I_{1/2}(k),
    A_l  = pi, 2 pi / 3, 0 for other odd l, else 2 pi (-1)^(l/2 - 1) / ((l + 2)(l - 1)) l! / (2^l (l/2)!^2).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import eval_legendre, ive

from reference.truth import closed_form
from scenes.ball import Ball
from scenes.ball_in_room import BallInRoom
from scenes.contract import DIRECT_RADIANCE, RADIANCE
from scenes.environment_ball import EnvironmentBall, InEnvironment
from scenes.lamps import BallUnderLamps, PolishedBall

ORDERS = 160
"""Legendre orders: at k = 300 the last one has rho below 1e-18."""


def eye_rays(scene: Ball, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Origins (size^2, 3) and the one direction (3,) of the parallel rays, row by row from the top."""
    to_world = np.array(scene.sensor(size)["to_world"].matrix, np.float64)
    u = 1 - (2 * np.arange(size) + 1) / size
    y, x = np.meshgrid(u, u, indexing="ij")
    local = np.stack([x, y, np.zeros_like(x), np.ones_like(x)], axis=-1).reshape(-1, 4)
    d = to_world[:3, 2] / np.linalg.norm(to_world[:3, 2])
    return (local @ to_world.T)[:, :3], d


def normals(scene: Ball, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit normals (size^2, 3), which are positions too, whether the ball is met, and the rays' direction."""
    o, d = eye_rays(scene, size)
    b = o @ d
    inside = b * b - (o * o).sum(axis=1) + 1
    met = inside > 0
    n = o - (b + np.sqrt(np.maximum(inside, 0)))[:, None] * d
    return np.where(met[:, None], n, -d), met, d


def cosine_coefficients(orders: int) -> np.ndarray:
    """A_l of the clamped cosine, l < orders."""
    a = np.zeros(orders)
    a[:2] = np.pi, 2 * np.pi / 3
    for l in range(2, orders, 2):
        ratio = math.exp(math.lgamma(l + 1) - l * math.log(2) - 2 * math.lgamma(l / 2 + 1))
        a[l] = 2 * np.pi * (-1) ** (l // 2 - 1) / ((l + 2) * (l - 1)) * ratio
    return a


def lobe_irradiance(cosine: np.ndarray, sharpness: float, orders: int = ORDERS) -> np.ndarray:
    """E over the irradiance of a facing point light, for cosines n . a of any shape."""
    orders = np.arange(orders)
    rho = ive(orders + 0.5, sharpness) / ive(0.5, sharpness)
    weights = (2 * orders + 1) / (4 * np.pi) * cosine_coefficients(len(orders)) * rho
    used = np.flatnonzero(np.abs(weights) > 1e-17)
    return sum(weights[l] * eval_legendre(l, cosine) for l in used)


def environment(scene: InEnvironment, w: np.ndarray) -> np.ndarray:
    """Radiance (n, 3) from unit directions (n, 3)."""
    k = scene.sharpness
    lobe = k * np.exp(k * (w @ scene.toward() - 1)) / (2 * np.pi * -math.expm1(-2 * k))
    fill, lamp = np.array(scene.FILL), np.array(scene.LAMP)
    return (1 - scene.contrast) * fill + scene.contrast * np.pi * lobe[:, None] * lamp


def irradiance(scene: InEnvironment, n: np.ndarray) -> np.ndarray:
    """E (n, 3) at unit normals (n, 3)."""
    lobe = lobe_irradiance(n @ scene.toward(), scene.sharpness)
    fill, lamp = np.array(scene.FILL), np.array(scene.LAMP)
    return np.pi * ((1 - scene.contrast) * fill + scene.contrast * lobe[:, None] * lamp)


@closed_form(EnvironmentBall, RADIANCE)
def environment_ball(scene: EnvironmentBall, size: int) -> np.ndarray:
    """Radiance (W m^-2 sr^-1), (size, size, 3)."""
    n, met, d = normals(scene, size)
    sky = environment(scene, d[None])
    return np.where(met[:, None], scene.albedo / np.pi * irradiance(scene, n), sky).reshape(size, size, 3)


@closed_form(BallUnderLamps, RADIANCE)
def ball_under_lamps(scene: BallUnderLamps, size: int) -> np.ndarray:
    """Radiance (W m^-2 sr^-1), (size, size, 3): albedo / pi (pi L_ambient + sum I max(n . l, 0) / d^2)."""
    n, met, _ = normals(scene, size)
    light = np.full((len(n), 3), np.pi * scene.ambient)
    for position, intensity in scene.lamp_list():
        light += point_irradiance(n, position)[:, None] * np.array(intensity)
    return np.where(met[:, None], scene.albedo / np.pi * light, scene.ambient).reshape(size, size, 3)


@closed_form(BallInRoom, DIRECT_RADIANCE)
def ball_in_room(scene: BallInRoom, size: int) -> np.ndarray:
    """Direct radiance (W m^-2 sr^-1), (size, size, 1): albedo / pi I max(n . l, 0) / d^2; no wall is seen."""
    n, _, _ = normals(scene, size)
    position, intensity = scene.lamp()
    light = intensity * point_irradiance(n, position)
    return (scene.albedo / np.pi * light).reshape(size, size, 1)


def point_irradiance(n: np.ndarray, position: list[float]) -> np.ndarray:
    """E over the intensity of a point light, max(n . l, 0) / d^2, at the points n of the ball, (m,)."""
    toward = np.array(position) - n
    return np.maximum((n * toward).sum(axis=1), 0) / np.linalg.norm(toward, axis=1) ** 3


@closed_form(PolishedBall, RADIANCE)
def polished_ball(scene: PolishedBall, size: int) -> np.ndarray:
    """Radiance (W m^-2 sr^-1), (size, size, 1): I / d^2 D G F / (4 n . v), GGX with Smith's masking of both
    ways apart and Fresnel's equations; black where the ball is not met."""
    n, met, d = normals(scene, size)
    position, intensity = scene.lamp()
    toward = np.array(position) - n
    far = np.linalg.norm(toward, axis=1, keepdims=True)
    l, v = toward / far, -d
    h = l + v
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    nl, nv, nh, hv = (n * l).sum(axis=1), n @ v, (n * h).sum(axis=1), h @ v
    a = scene.alpha**2
    density = a / (np.pi * (nh**2 * (a - 1) + 1) ** 2)
    lit = met & (nl > 0) & (nv > 0)
    nl, nv = np.where(lit, nl, 1), np.where(lit, nv, 1)
    masking = smith(nl, a) * smith(nv, a)
    reflected = density * masking * fresnel(hv, scene.INDEX) / (4 * nv) * intensity / far[:, 0] ** 2
    return np.where(lit, reflected, 0).reshape(size, size, 1)


def smith(cosine: np.ndarray, a: float) -> np.ndarray:
    """Smith's masking of one way for GGX of squared width a."""
    return 2 / (1 + np.sqrt(1 + a * (1 / cosine**2 - 1)))


def fresnel(cosine: np.ndarray, index: float) -> np.ndarray:
    """Unpolarised reflectance of a dielectric."""
    inner = np.sqrt(1 - (1 - cosine**2) / index**2)
    s, p = (
        (cosine - index * inner) / (cosine + index * inner),
        (inner - index * cosine) / (inner + index * cosine),
    )
    return 0.5 * (s**2 + p**2)
