"""The slab of high cloud against points strewn along each ray, where its factors are multiplied out."""

from __future__ import annotations

import numpy as np

from reference.closed_form.fog import pinhole_rays
from reference.closed_form.high_clouds import high_depth
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import BATCHES, SIZE, name
from scenes.contract import TRANSMITTANCE
from scenes.high_clouds import WAVES, HighClouds

POINTS = 256


@check(
    "route",
    claim="the optical depth of a slab of streaks is what points along the ray find",
    routes=("uniform points", "closed form"),
    scenes=("HighClouds",),
)
def high_clouds_against_points(seed: int) -> list[Comparison]:
    """A thin and a thick slab, before and after the wind has blown."""
    rng = np.random.default_rng(seed)
    return [
        Comparison(
            f"{name(scene, TRANSMITTANCE)}: optical depth",
            Sampled.of([strewn(scene, SIZE, rng) for _ in range(BATCHES)]),
            Sampled.exact(high_depth(scene, SIZE)),
        )
        for scene in (HighClouds(), HighClouds(elevation=50.0, thickness=2000.0, time=900.0))
    ]


def strewn(scene: HighClouds, size: int, rng: np.random.Generator) -> np.ndarray:
    """An unbiased estimate of the optical depth (size, size, 1): POINTS uniform heights in the slab."""
    o, w = pinhole_rays(*scene.eye(), scene.FIELD_OF_VIEW, size)
    z = scene.BASE + scene.thickness * rng.random((POINTS, size, size))
    x, y = ((z - o[2]) * w[..., i] / w[..., 2] - scene.time * scene.WIND[i] for i in (0, 1))
    streaks = np.ones_like(z)
    for kx, ky, phase in WAVES:
        streaks *= 1 + np.cos(2 * np.pi / scene.TILE * (kx * x + ky * y) + phase)
    return (scene.optical_depth / w[..., 2] * streaks.mean(axis=0))[..., None]
