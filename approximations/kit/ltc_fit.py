r"""Linearly transformed cosines fitted to GGX: `python -m approximations.kit.ltc_fit` writes `ltc_ggx.npz`.

Heitz, Dupuy, Hill and Neubelt, "Real-Time Polygonal-Light Shading with Linearly Transformed Cosines" (2016),
section 4. A clamped cosine D_o(w) = max(w_z, 0) / pi whose directions a matrix M moves becomes

    D(w) = D_o(M^-1 w / |M^-1 w|) |det M^-1| / |M^-1 w|^3,

which is as long as D_o, since the last two factors are the Jacobian. For every roughness r = sqrt(alpha) and
every elevation of the view, M is sought for which D is nearest to the lobe f cos / A: single-scattering GGX
with separable Smith masking and no Fresnel term, A its integral, the albedo.

    frame      z along the lobe's mean direction, y across the plane of incidence
    M          [x y z] [[m11, 0, m13], [0, m22, 0], [0, 0, 1]], m11 = m22 and m13 = 0 at normal incidence
    distance   int |D - f cos / A|^3 dw, by samples of both lobes
    search     Nelder-Mead from rough to smooth and from normal to grazing, each cell from its neighbour;
               over log m11, log m22 and m13 / m11, which makes it blind to the lobe's size

Kept is M^-1 over its middle element, [[a, 0, b], [0, 1, 0], [c, 0, d]]: a scale of M changes nothing.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

TABLE = Path(__file__).with_name("ltc_ggx.npz")
SIDE = 64  # cells: roughness by sqrt(1 - cos) of the view's angle from the normal, ends included
SMOOTHEST = 1e-4  # alpha
SAMPLES = 24  # to a side of the square that each lobe's samples come from


def square(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Middles of n x n cells of the unit square."""
    s = (np.arange(n) + 0.5) / n
    return tuple(x.ravel() for x in np.meshgrid(s, s))


def unit(v: np.ndarray) -> np.ndarray:
    """Of length 1, over the last axis."""
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def masking(c: np.ndarray, alpha: float) -> np.ndarray:
    """Smith's G1 = 2 c / (c + sqrt(alpha^2 + (1 - alpha^2) c^2))."""
    return 2 * c / (c + np.sqrt(alpha**2 + (1 - alpha**2) * c * c))


def lobe(v: np.ndarray, w: np.ndarray, alpha: float) -> tuple[np.ndarray, np.ndarray]:
    """f cos at directions w (k, 3) for a view v (3,), and the density of `lobe_samples` there (1/sr)."""
    h = unit(v + w)
    d = alpha**2 / (np.pi * (alpha**2 * h[:, 2] ** 2 + h[:, 0] ** 2 + h[:, 1] ** 2) ** 2)
    density = masking(v[2], alpha) * d / (4 * v[2])
    up = w[:, 2] > 0
    return np.where(up, density * masking(np.where(up, w[:, 2], 1), alpha), 0), density


def lobe_samples(v: np.ndarray, alpha: float, n: int) -> np.ndarray:
    """n^2 directions by visible normals (Heitz 2018), some of them below the horizon."""
    a, b = square(n)
    stretched = unit(v * [alpha, alpha, 1])
    x = np.array([1.0, 0, 0]) if stretched[2] > 1 - 1e-12 else unit(np.cross([0, 0, 1], stretched))
    y = np.cross(stretched, x)
    r, phi = np.sqrt(a), 2 * np.pi * b
    p, q = r * np.cos(phi), r * np.sin(phi)
    s = 0.5 * (1 + stretched[2])
    q = (1 - s) * np.sqrt(1 - p * p) + s * q
    up = np.sqrt(np.maximum(1 - p * p - q * q, 0))
    h = unit((p[:, None] * x + q[:, None] * y + up[:, None] * stretched) * [alpha, alpha, 1])
    return 2 * (h @ v)[:, None] * h - v


def cosine_samples(n: int) -> np.ndarray:
    """n^2 directions of density cos / pi."""
    a, b = square(n)
    r, phi = np.sqrt(a), 2 * np.pi * b
    return np.stack([r * np.cos(phi), r * np.sin(phi), np.sqrt(1 - a)], axis=-1)


def transformed_cosine(m: np.ndarray, w: np.ndarray) -> np.ndarray:
    """D(w) of the matrix M (3, 3) at unit directions (k, 3), 1/sr."""
    inverse = np.linalg.inv(m)
    o = w @ inverse.T
    far = np.linalg.norm(o, axis=1)
    return np.maximum(o[:, 2], 0) / np.pi * abs(np.linalg.det(inverse)) / far**4


def moments(v: np.ndarray, alpha: float, n: int = 128) -> tuple[float, np.ndarray]:
    """The albedo, and the unit mean direction of the lobe in the plane of incidence."""
    w = lobe_samples(v, alpha, n)
    up = w[:, 2] > 0
    weight = np.where(up, masking(np.where(up, w[:, 2], 1), alpha), 0)
    mean = weight @ w
    return float(weight.mean()), unit(mean * [1, 0, 1])


def matrix(given: np.ndarray, z: np.ndarray) -> np.ndarray:
    """M of log m11, log m22, m13 / m11 about the mean direction z."""
    m11, m22 = np.exp(given[:2])
    frame = np.stack([[z[2], 0, -z[0]], [0, 1, 0], z], axis=1)
    return frame @ np.array([[m11, 0, m11 * given[2]], [0, m22, 0], [0, 0, 1]])


def fit_cell(v: np.ndarray, alpha: float, start: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """M, the albedo and the parameters that made it, for a view v in the xz plane."""
    from scipy.optimize import minimize

    albedo, z = moments(v, alpha)
    fixed, base = lobe_samples(v, alpha, SAMPLES), cosine_samples(SAMPLES)
    fixed = fixed[fixed[:, 2] > 0]
    fixed_value, fixed_density = lobe(v, fixed, alpha)
    normal = v[0] < 1e-9

    def parameters(x: np.ndarray) -> np.ndarray:
        return np.array([x[0], x[0], 0.0]) if normal else x

    def distance(x: np.ndarray) -> float:
        m = matrix(parameters(x), z)
        own = unit(base @ m.T)
        value, density = lobe(v, own, alpha)
        d_own, d_fixed = transformed_cosine(m, own), transformed_cosine(m, fixed)
        own_part = np.abs(d_own - value / albedo) ** 3 / (d_own + density)
        fixed_part = np.abs(d_fixed - fixed_value / albedo) ** 3 / (d_fixed + fixed_density)
        scale = alpha**4  # a density is about 1 / alpha^2
        return scale * (own_part.sum() + fixed_part.sum()) / len(base)

    x0 = start[:1] if normal else start
    simplex = np.vstack([x0, x0 + 0.15 * np.eye(len(x0))])
    found = minimize(
        distance,
        x0,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 1e-3, "fatol": 1e-9, "maxiter": 150},
    )
    x = parameters(found.x)
    return matrix(x, z), albedo, x


def fit(side: int = SIDE) -> tuple[np.ndarray, np.ndarray]:
    """(side, side, 4) of a, b, c, d and (side, side) albedos, roughness down, sqrt(1 - cos) across."""
    inverse, albedo = np.zeros((side, side, 4)), np.zeros((side, side))
    first = np.zeros(3)
    for i in reversed(range(side)):
        alpha = max((i / (side - 1)) ** 2, SMOOTHEST)
        x = first - [0, 0, first[2]]
        for j in range(side):
            cos = max(1 - (j / (side - 1)) ** 2, 1e-3)
            v = np.array([np.sqrt(1 - cos * cos), 0, cos])
            m, albedo[i, j], x = fit_cell(v, alpha, x)
            if j == 0:
                first = x
            k = np.linalg.inv(m)
            inverse[i, j] = np.array([k[0, 0], k[0, 2], k[2, 0], k[2, 2]]) / k[1, 1]
    return inverse, albedo


if __name__ == "__main__":
    fitted, energy = fit()
    np.savez(TABLE, inverse=fitted.astype(np.float32), albedo=energy.astype(np.float32))
