r"""A hill in the shadow of heaped clouds, in float64.

The product of the heaps' factors 1 + cos is a sum of waves a_k cos(k . x + f_k). Along the sun's direction l
a Gaussian layer of standard deviation b turns each into its Fourier transform, so that with x_c where the ray
crosses the middle of the layer

    tau = optical_depth / l_z sum_k a_k exp(-(b k . l_xy / l_z)^2 / 2) cos(k . x_c + f_k),
    L = albedo / pi [E_sun max(n . l, 0) e^-tau + pi L_sky].

The ground is seven b or more below the middle.
"""

from __future__ import annotations

import numpy as np

from reference.closed_form.fog import pinhole_rays
from reference.truth import closed_form
from scenes.clouded_ground import WAVES, CloudedGround
from scenes.contract import DIRECT_RADIANCE


@closed_form(CloudedGround, DIRECT_RADIANCE)
def clouded_radiance(scene: CloudedGround, size: int) -> np.ndarray:
    """Radiance (size, size, 1), W m^-2 sr^-1, at the centres of size x size samples."""
    p, n = ground(scene, size)
    facing = np.maximum(n @ np.array(scene.to_sun()), 0)
    direct = (1 - scene.sky_share) * facing * np.exp(-sun_depth(scene, p))
    return (scene.ALBEDO * (direct / np.pi + scene.sky_share))[..., None]


def ground(scene: CloudedGround, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Points seen (m) and unit normals there, (size, size, 3) each."""
    down = np.radians(scene.TILT)
    target = np.array(scene.EYE) + [0, np.cos(down), -np.sin(down)]
    o, w = pinhole_rays(list(scene.EYE), list(target), scene.FIELD_OF_VIEW, size)
    centre = np.array([0, 0, -scene.RADIUS])
    b = w @ (o - centre)
    t = -b - np.sqrt(b * b - ((o - centre) @ (o - centre) - scene.RADIUS**2))
    p = o + t[..., None] * w
    return p, (p - centre) / scene.RADIUS


def sun_depth(scene: CloudedGround, p: np.ndarray) -> np.ndarray:
    """Optical depth from points (..., 3) under the layer towards the sun."""
    l = np.array(scene.to_sun())
    slope = l[:2] / l[2]
    x = p[..., :2] + (scene.MIDDLE - p[..., 2:]) * slope
    total = np.zeros(p.shape[:-1], complex)
    for (kx, ky), amplitude in spectrum().items():
        k = 2 * np.pi / scene.TILE * np.array([kx, ky])
        blur = np.exp(-0.5 * (0.25 * scene.thickness * (k @ slope)) ** 2)
        total += amplitude * blur * np.exp(1j * (x @ k))
    return scene.optical_depth / l[2] * total.real


def spectrum() -> dict[tuple[int, int], complex]:
    """Amplitude of exp(i k . x) in the product of the heaps' factors, by cycles in a tile."""
    waves = {(0, 0): 1.0 + 0j}
    for kx, ky, phase in WAVES:
        turned = {(0, 0): 1.0, (kx, ky): 0.5 * np.exp(1j * phase), (-kx, -ky): 0.5 * np.exp(-1j * phase)}
        product: dict[tuple[int, int], complex] = {}
        for (ax, ay), a in waves.items():
            for (bx, by), b in turned.items():
                product[ax + bx, ay + by] = product.get((ax + bx, ay + by), 0) + a * b
        waves = product
    return waves
