r"""Diffusion of sunlight in a cloud on a grid of cubic cells, by finite volumes and conjugate gradients.

    div F + sigma_a phi = (1 - f) sigma_s T*,    F = -(grad phi / 3 + (g - f) sigma_s T* l) / sigma_tr
    T* = e^-d*,  d* = (1 - f albedo) d,  sigma_tr = (1 - g albedo) sigma_t;    n . F = phi / 2 at the edge

l is the way to the sun, whose irradiance is 1, d the optical depth towards it. Through a face F depends on
phi on both sides by the harmonic mean of 1 / sigma_tr, and on T* by the geometric mean, exact where T* falls
off exponentially; at an edge half a cell more is crossed. A cell takes in the mean of T* over its chord.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage, sparse

CLOSE = 1e-6  # residual over right-hand side at which the solver stops
TURNS = 2000
DEEP = 50.0  # half a cell's optical depth that T* is told from none at


def solve(
    sigma: np.ndarray,
    depth: np.ndarray,
    cell: float,
    axes: tuple[int, ...],
    sun: np.ndarray,
    albedo: float,
    g: float,
    ahead: float,
) -> tuple[np.ndarray, list[np.ndarray]]:
    """phi (nz, ny, nx) and F's z, y, x in W m^-2, for a sun of irradiance 1.

    sigma, depth: extinction (1/m) and optical depth towards the sun at the middles of the cells, whose edge
    is `cell` m, no extinction outside the cloud; axes: those of the arrays along which anything changes; sun:
    z, y, x of the way to it; ahead: the share of what is scattered that goes on as if it had not been.
    """
    cloud = sigma > 0
    r = 1.5 * cell * (1 - albedo * g) * np.where(cloud, sigma, 1.0)  # half a cell over D = 1 / (3 sigma_tr)
    thinner = 1 - ahead * albedo
    chord = cell / sum(abs(sun[a]) for a in axes)
    half = np.minimum(thinner * sigma * chord / 2, DEEP)
    beam = np.where(cloud, np.exp(-thinner * depth), 0.0)
    tilt = (g - ahead) * albedo / (1 - albedo * g)
    right = cell * albedo * (1 - ahead) * sigma * beam * np.sinh(half) / np.maximum(half, 1e-9)
    diagonal = np.where(cloud, cell * (1 - albedo) * sigma, 1.0)
    outward = _outward(cloud, axes)
    between, faces = [], []
    for a in axes:
        here, there = _sides(a)
        linked = cloud[here] & cloud[there]
        k = np.where(linked, 1 / (r[here] + r[there]), 0.0)
        drift = np.where(linked, -tilt * sun[a] * np.sqrt(beam[here] * beam[there]), 0.0)
        right[here] -= drift
        right[there] += drift
        diagonal[here] += k
        diagonal[there] += k
        between.append((a, k, drift))
        for up in (1, -1):
            edge = cloud & ~_shifted(cloud, a, up)
            lit = beam * np.exp(np.sign(up * sun[a]) * half)
            leaves = np.where(edge, outward[a] / (r + 2), 0.0)
            drift = np.where(edge, -tilt * sun[a] * up * np.minimum(lit, 1) * r / (r + 2), 0.0)
            diagonal += leaves
            right -= drift
            faces.append((a, up, leaves, drift))

    phi = np.zeros_like(sigma)
    phi[cloud] = _inverse(cloud, diagonal, between, right[cloud])
    flux = [np.zeros_like(phi) for _ in range(3)]
    for a, k, drift in between:
        here, there = _sides(a)
        through = k * (phi[here] - phi[there]) + drift
        flux[a][here] += through / 2
        flux[a][there] += through / 2
    for a, up, leaves, drift in faces:
        flux[a] += up * (leaves * phi + drift) / 2
    return phi, flux


def _inverse(cloud: np.ndarray, diagonal: np.ndarray, between: list, right: np.ndarray) -> np.ndarray:
    """phi of the cells that are cloud, by conjugate gradients, preconditioned with the diagonal."""
    number = (np.cumsum(cloud) - 1).reshape(cloud.shape)
    rows, columns, values = [number[cloud]], [number[cloud]], [diagonal[cloud]]
    for a, k, _ in between:
        here, there = _sides(a)
        one, other = (number[side][k > 0] for side in (here, there))
        rows += [one, other]
        columns += [other, one]
        values += [-k[k > 0]] * 2
    places = np.concatenate(rows), np.concatenate(columns)
    matrix = sparse.csr_matrix((np.concatenate(values), places), shape=(len(right),) * 2)
    return _conjugate_gradients(matrix, diagonal[cloud], right)


def _conjugate_gradients(matrix: sparse.csr_matrix, diagonal: np.ndarray, right: np.ndarray) -> np.ndarray:
    """x with matrix x = right. Products are summed by einsum: BLAS would set all cores on each of them."""
    x, residual, way, size = np.zeros_like(right), right.copy(), np.zeros_like(right), np.inf
    least = CLOSE**2 * np.einsum("i,i", right, right)
    for _ in range(TURNS):
        z = residual / diagonal
        size, before = np.einsum("i,i", residual, z), size
        way = z + size / before * way
        image = matrix @ way
        step = size / np.einsum("i,i", way, image)
        x += step * way
        residual -= step * image
        if np.einsum("i,i", residual, residual) <= least:
            break
    return x


def _sides(axis: int) -> tuple[tuple, tuple]:
    """Indices of all cells but the last, and of all but the first, along an axis."""
    before, after = [slice(None)] * 3, [slice(None)] * 3
    before[axis], after[axis] = slice(None, -1), slice(1, None)
    return tuple(before), tuple(after)


def _shifted(cloud: np.ndarray, axis: int, up: int) -> np.ndarray:
    """Whether a cell's neighbour along an axis, up (1) or down (-1), is cloud; none is beyond the grid."""
    out = np.zeros_like(cloud)
    here, there = _sides(axis)
    if up > 0:
        out[here] = cloud[there]
    else:
        out[there] = cloud[here]
    return out


def _outward(cloud: np.ndarray, axes: tuple[int, ...]) -> dict[int, np.ndarray]:
    """|n|_2 / |n|_1 of the cloud's smoothed edge, by axis: what a stepped face counts for."""
    if len(axes) == 1:
        return {axes[0]: np.ones(cloud.shape)}
    padded = np.pad(cloud.astype(float), 2)
    inner = tuple(slice(2, -2) for _ in range(3))
    n = [np.abs(ndimage.gaussian_filter1d(ndimage.gaussian_filter(padded, 1.0), 1.0, a, 1)) for a in range(3)]
    share = np.sqrt(sum(c * c for c in n)) / np.maximum(sum(n), 1e-12)
    return dict.fromkeys(axes, np.where(share > 0, share, 1.0)[inner])
