"""The puffs of MovingClouds against points strewn along each ray."""

from __future__ import annotations

import numpy as np

from reference.closed_form.fog import pinhole_rays
from reference.closed_form.moving_clouds import moving_depth
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import BATCHES, SIZE, name
from scenes.contract import TRANSMITTANCE
from scenes.moving_clouds import HILLS, PUFFS, MovingClouds

POINTS = 512


@check(
    "route",
    claim="the optical depth of soft puffs behind hills is what points along the ray find",
    routes=("uniform points", "closed form"),
    scenes=("MovingClouds",),
)
def moving_clouds_against_points(seed: int) -> list[Comparison]:
    """Thin and thick puffs."""
    rng = np.random.default_rng(seed)
    return [
        Comparison(
            f"{name(scene, TRANSMITTANCE)}: optical depth",
            Sampled.of([strewn(scene, SIZE, rng) for _ in range(BATCHES)]),
            Sampled.exact(moving_depth(scene, SIZE)),
        )
        for scene in (MovingClouds(), MovingClouds(optical_depth=0.3))
    ]


def strewn(scene: MovingClouds, size: int, rng: np.random.Generator) -> np.ndarray:
    """An unbiased estimate of the optical depth (size, size, 1): POINTS heights in the layer, one in each of
    as many even parts, on every ray that no hill's discriminant cuts."""
    o, w = pinhole_rays(*scene.eye(), scene.FIELD_OF_VIEW, size)
    rise = scene.TOP - scene.BASE
    z = scene.BASE + rise * (np.arange(POINTS)[:, None, None] + rng.random((POINTS, size, size))) / POINTS
    x, y = (o[i] + (z - o[2]) * w[..., i] / w[..., 2] for i in (0, 1))
    extinction = np.zeros_like(z)
    for cx, cy, cz, radius in PUFFS:
        share = ((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2) / radius**2
        extinction += 15 * scene.optical_depth / (16 * radius) * np.where(share < 1, (1 - share) ** 2, 0)
    hidden = np.zeros((size, size), bool)
    for *centre, radius in HILLS:
        b, c = w @ (o - centre), (o - centre) @ (o - centre) - radius**2
        hidden |= (b < 0) & (b * b > c)
    return np.where(hidden, 0, rise / w[..., 2] * extinction.mean(axis=0))[..., None]
