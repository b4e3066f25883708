"""Scattered clouds against points strewn along each ray, which know every ball by its place alone."""

from __future__ import annotations

import numpy as np

from reference.closed_form.fog import pinhole_rays
from reference.closed_form.scattered_clouds import scattered_depth
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import BATCHES, SIZE, name
from scenes.contract import TRANSMITTANCE
from scenes.scattered_clouds import REPEAT, ScatteredClouds, table

STRATA = 512


@check(
    "route",
    claim="the optical depth of scattered clouds is what points along the ray find",
    routes=("stratified points", "closed form"),
    scenes=("ScatteredClouds",),
)
def scattered_clouds_against_points(seed: int) -> list[Comparison]:
    """Large clouds overhead and small ones towards the horizon."""
    rng = np.random.default_rng(seed)
    return [
        Comparison(
            f"{name(scene, TRANSMITTANCE)}: optical depth",
            Sampled.of([strewn(scene, SIZE, rng) for _ in range(BATCHES)]),
            Sampled.exact(scattered_depth(scene, SIZE)),
        )
        for scene in (ScatteredClouds(), ScatteredClouds(elevation=60.0, spacing=1000.0, cover=0.5))
    ]


def strewn(scene: ScatteredClouds, size: int, rng: np.random.Generator) -> np.ndarray:
    """An unbiased estimate of the optical depth (size, size, 1): a point in each of STRATA equal parts of the
    layer's height."""
    origin, w = pinhole_rays(*scene.eye(), scene.FIELD_OF_VIEW, size)
    clouds = table().astype(np.float64)
    height = scene.layers * scene.spacing
    total = np.zeros((size, size))
    for row in range(size):
        z = scene.BASE + height * (np.arange(STRATA) + rng.random((size, STRATA))) / STRATA
        t = (z - origin[2]) / w[row, :, 2:]
        p = (np.array(origin) + t[..., None] * w[row][:, None, :] - [0, 0, scene.BASE]) / scene.spacing
        cell = np.floor(p).astype(int)
        cell[..., 2] = np.clip(cell[..., 2], 0, scene.layers - 1)
        found = clouds[np.mod(cell, REPEAT) @ [1, REPEAT, REPEAT**2]]
        radius = scene.BALL * found[..., 3]
        density = np.zeros((size, STRATA))
        for side in (-1, 1):
            middle = cell + found[..., :3] + side * scene.AWAY * found[..., 3:4] * found[..., 4:7]
            squared = ((p - middle) ** 2).sum(axis=-1)
            density += np.maximum(1 - squared / radius**2, 0)
        density *= found[..., 7] < scene.cover
        total[row] = scene.sigma_t * height / w[row, :, 2] * density.mean(axis=1)
    return total[..., None]
