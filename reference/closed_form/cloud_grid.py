"""Transmittance through a cloud that is a trilinear grid, cell by cell in float64.

Between the planes through the middles of the voxels the density is a polynomial of the third degree along a
ray, which two Gauss points integrate exactly: the optical depth has no error but rounding. Beyond the
outermost middles it keeps their value as far as the box goes. Camera rays are worked out from the scene's
numbers; probes are where techniques are given them.
"""

from __future__ import annotations

import math
from functools import lru_cache

import drjit as dr
import mitsuba as mi
import numpy as np

from reference.closed_form.fog import pinhole_rays
from reference.truth import closed_form
from scenes.contract import SUN_TRANSMITTANCE, TRANSMITTANCE
from scenes.cumulus import Cumulus, GridCloud

GAUSS = (0.5 - math.sqrt(1 / 12), 0.5 + math.sqrt(1 / 12))


@closed_form(Cumulus, TRANSMITTANCE)
def cloud_transmittance(scene: GridCloud, size: int) -> np.ndarray:
    """T = exp(-tau) of the whole way through the box, 0 to 1, at the centres of size x size samples."""
    eye, target = scene.eye()
    origin, w = pinhole_rays(eye, target, scene.FIELD_OF_VIEW, size)
    w = w.reshape(-1, 3)
    tau = optical_depth(scene, np.broadcast_to(origin, w.shape), w)
    return np.exp(-tau).reshape(size, size, 1)


@closed_form(Cumulus, SUN_TRANSMITTANCE)
def sun_transmittance(scene: GridCloud, size: int) -> np.ndarray:
    """T = exp(-tau) from each probe out of the box towards the middle of the sun, 0 to 1."""
    x = np.array(scene.probes(size).camera.origin, dtype=np.float64).T
    return np.exp(-depth_to_sun(scene, x)).reshape(size, size, 1)


def depth_to_sun(scene: GridCloud, x: np.ndarray) -> np.ndarray:
    """Optical depth (n,) with rain, from points (n, 3), m, out of the box towards the sun."""
    return optical_depth(scene, x, np.broadcast_to(scene.to_sun(), x.shape))


def optical_depth(scene: GridCloud, origin: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Optical depth (n,) with rain along rays, origins and unit directions (n, 3), to the end of the box."""
    sigma_t, _ = scene.rainy
    low, high = np.array(scene.LOW), np.array(scene.HIGH)
    edge = (high - low) / scene.VOXELS
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - origin) / w, (high - origin) / w
    near = np.maximum(np.nanmax(np.minimum(a, b), axis=1), 0)
    far = np.nanmin(np.maximum(a, b), axis=1)
    wide = dr.float64_array_t(mi.Float)
    total = _integrate(
        wide(_values(scene)),
        scene.VOXELS,
        [wide(c) for c in ((origin - low) / edge - 0.5).T],
        [wide(c) for c in (w / edge).T],
        wide(near),
        wide(far),
    )
    return sigma_t * np.array(total)


def _integrate(values, shape, o, w, near, far):
    """int of the grid along o + t w, in units where voxels' middles are the whole numbers, between near and
    far; each loop turn adds what lies before the next plane."""
    wide = type(near)
    step = [dr.select(d == 0, dr.inf, 1 / dr.abs(d)) for d in w]
    start = [a + near * d for a, d in zip(o, w, strict=True)]
    ahead = [dr.select(d > 0, dr.floor(s) + 1 - s, s - dr.ceil(s) + 1) for s, d in zip(start, w, strict=True)]
    planes = [dr.select(d == 0, dr.inf, near + a * s) for a, s, d in zip(ahead, step, w, strict=True)]

    def turn(t, x, y, z, total):
        to = dr.minimum(dr.minimum(dr.minimum(x, y), z), far)
        for node in GAUSS:
            at = t + node * (to - t)
            total += (
                0.5 * (to - t) * _trilinear(values, shape, [a + at * d for a, d in zip(o, w, strict=True)])
            )
        x, y, z = (dr.select(p <= to, p + s, p) for p, s in zip((x, y, z), step, strict=True))
        return to, x, y, z, total

    state = (wide(near), *planes, dr.zeros(wide, dr.width(near)))
    return dr.while_loop(state, lambda t, x, y, z, total: t < far, turn)[-1]


def _trilinear(values, shape, p):
    """Value at a point; beyond the outermost middles that of the nearest."""
    p = [dr.clip(c, 0, n - 1) for c, n in zip(p, shape, strict=True)]
    cell = [dr.minimum(mi.UInt32(c), n - 2) for c, n in zip(p, shape, strict=True)]
    x, y, z = (c - type(c)(k) for c, k in zip(p, cell, strict=True))
    at = cell[0] + shape[0] * (cell[1] + shape[1] * cell[2])

    def row(k):
        first = dr.gather(type(x), values, at + k)
        return first + x * (dr.gather(type(x), values, at + k + 1) - first)

    def plane(k):
        return row(k) + y * (row(k + shape[0]) - row(k))

    return plane(0) + z * (plane(shape[0] * shape[1]) - plane(0))


@lru_cache(maxsize=4)
def _values(scene: GridCloud) -> np.ndarray:
    """The grid, x fastest, float64."""
    return scene.densities().astype(np.float64).ravel()
