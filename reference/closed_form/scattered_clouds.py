r"""Transmittance of scattered clouds, cell by cell in float64.

A ball of radius r that a ray passes at the distance b < r, with the extinction sigma (1 - (s / r)^2), has the
optical depth

    4/3 sigma (r^2 - b^2)^1.5 / r^2.

Clouds stay within their cells, so that a ray meets those of the cells that it walks through, each whole.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from reference.closed_form.fog import pinhole_rays
from reference.truth import closed_form
from scenes.contract import TRANSMITTANCE
from scenes.scattered_clouds import REPEAT, ScatteredClouds, table

SLIVER = 1e-9  # edges of a cell, between planes that are one but for rounding


@closed_form(ScatteredClouds, TRANSMITTANCE)
def scattered_transmittance(scene: ScatteredClouds, size: int) -> np.ndarray:
    """T = exp(-tau), 0 to 1, at the centres of size x size samples."""
    return np.exp(-scattered_depth(scene, size))


def scattered_depth(scene: ScatteredClouds, size: int) -> np.ndarray:
    """Optical depth (size, size, 1) of the whole layer."""
    origin, w = pinhole_rays(*scene.eye(), scene.FIELD_OF_VIEW, size)
    wide = dr.float64_array_t(mi.Float)
    start = [float(x) / scene.spacing for x in np.array(origin) - [0, 0, scene.BASE]]
    d = [wide(np.ascontiguousarray(c)) for c in w.reshape(-1, 3).T]
    near, far = -start[2] / d[2], (scene.layers - start[2]) / d[2]
    clouds = wide(table().astype(np.float64).ravel())
    step = [dr.select(c == 0, dr.inf, 1 / dr.abs(c)) for c in d]
    entry = [a + near * c for a, c in zip(start[:2], d[:2], strict=True)]
    ahead = [
        dr.select(c > 0, dr.floor(e) + 1 - e, e - dr.floor(e)) for e, c in zip(entry, d[:2], strict=True)
    ]
    planes = [near + a * s for a, s in zip(ahead, step[:2], strict=True)] + [near + step[2]]

    def turn(t, x, y, z, total):
        to = dr.minimum(dr.minimum(dr.minimum(x, y), z), far)
        amid = 0.5 * (t + to)
        cell = [mi.Int32(dr.floor(a + amid * c)) for a, c in zip(start, d, strict=True)]
        cloud = (cell[0] & (REPEAT - 1)) + REPEAT * (
            (cell[1] & (REPEAT - 1)) + REPEAT * (cell[2] & (REPEAT - 1))
        )
        row = [dr.gather(wide, clouds, 8 * mi.UInt32(cloud) + k) for k in range(8)]
        depth = dr.zeros(wide, dr.width(d[0]))
        for side in (-1, 1):
            ball = [
                wide(c) + row[k] + side * scene.AWAY * row[3] * row[4 + k] - start[k]
                for k, c in enumerate(cell)
            ]
            along = sum(b * c for b, c in zip(ball, d, strict=True))
            radius = (scene.BALL * row[3]) ** 2
            within = radius - sum(b * b for b in ball) + along * along
            depth += 4 / 3 * dr.maximum(within, 0) ** 1.5 / radius
        total += dr.select((row[7] < scene.cover) & (to > t + SLIVER), depth, 0)
        x, y, z = (dr.select(p <= to, p + s, p) for p, s in zip((x, y, z), step, strict=True))
        return to, x, y, z, total

    state = (wide(near), *planes, dr.zeros(wide, dr.width(d[0])))
    total = dr.while_loop(state, lambda t, x, y, z, total: t < far, turn)[-1]
    return scene.sigma_t * scene.spacing * np.array(total).reshape(size, size, 1)
