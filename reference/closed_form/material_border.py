r"""Two materials that share a spot: each reflects as if it were alone, weighted by its share.

    L = (1 - t) (s E / pi + f L(r)) + t g L(r),

t the share of the metal, s and f the stone's diffuse and specular reflectance, g the metal's, E the
irradiance and L(r) what comes from the mirrored direction. A formula that reads filtered parameters of one
material instead of two differs from it by `halo`.
"""

from __future__ import annotations

import numpy as np

from reference.closed_form import ball
from reference.surface_monte_carlo import eye_rays
from reference.truth import closed_form
from scenes.contract import RADIANCE
from scenes.material_border import MaterialBorder


def bilinear(texels: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A square texture (n, n) at (u, v) in [0, 1], texel centres at (i + 1/2) / n, repeated at the edges."""
    n = len(texels)
    x, y = (np.clip(c * n - 0.5, 0, n - 1) for c in (u, v))
    i, j = (np.minimum(c.astype(int), max(n - 2, 0)) for c in (x, y))
    s, t = x - i, y - j
    right, up = np.minimum(i + 1, n - 1), np.minimum(j + 1, n - 1)
    low = texels[j, i] * (1 - s) + texels[j, right] * s
    high = texels[up, i] * (1 - s) + texels[up, right] * s
    return low * (1 - t) + high * t


def parts(scene: MaterialBorder, size: int) -> tuple[np.ndarray, ...]:
    """Whether the square is met (n,), t (n, 1), E / pi (1, 3), L(r) and L along the eye ray (n, 3)."""
    o, w = eye_rays(scene.sensor(size), size)
    reach = -o[2] / w[2]
    x, y = (o + reach * w)[:2]
    met = (reach > 0) & (np.abs(x) <= 1) & (np.abs(y) <= 1)
    t = bilinear(scene.coverage(), 0.5 * (1 + x), 0.5 * (1 + y))
    around = scene.environment()
    diffuse = ball.irradiance(around, np.array([[0.0, 0.0, 1.0]])) / np.pi
    mirrored = (w * np.array([[1.0], [1.0], [-1.0]])).T
    return met, t[:, None], diffuse, ball.environment(around, mirrored), ball.environment(around, w.T)


@closed_form(MaterialBorder, RADIANCE)
def material_border(scene: MaterialBorder, size: int) -> np.ndarray:
    """Radiance (W m^-2 sr^-1), (size, size, 3)."""
    met, t, diffuse, specular, sky = parts(scene, size)
    stone = np.array(scene.STONE) * diffuse + scene.POLISH * specular
    blend = (1 - t) * stone + t * np.array(scene.GOLD) * specular
    return np.where(met[:, None], blend, sky).reshape(size, size, 3)


def halo(scene: MaterialBorder, size: int) -> np.ndarray:
    """t (1 - t) (g - s) (E / pi - L(r)), (size, size, 3): what metallicness adds at a border."""
    met, t, diffuse, specular, _ = parts(scene, size)
    added = t * (1 - t) * (np.array(scene.GOLD) - np.array(scene.STONE)) * (diffuse - specular)
    return np.where(met[:, None], added, 0).reshape(size, size, 3)
