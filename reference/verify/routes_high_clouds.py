"""The slab of high cloud against points strewn along each ray, where its factors are multiplied out."""

from __future__ import annotations

import numpy as np

from reference.closed_form.fog import pinhole_rays
from reference.closed_form.high_clouds import high_depth, high_light
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import BATCHES, SIZE, name
from scenes.contract import SINGLE_SCATTERING, TRANSMITTANCE
from scenes.high_clouds import WAVES, HighClouds

POINTS = 256
SCATTERERS, STEPS = 12, 64


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


@check(
    "route",
    claim="what a slab of streaks scatters once is what points along the ray find",
    routes=("points in layers, midpoint rule", "closed form"),
    scenes=("HighClouds",),
)
def high_light_against_points(seed: int) -> list[Comparison]:
    """Under a high sun and a low one, the latter with a thicker slab, a narrower lobe and wind."""
    rng = np.random.default_rng(seed)
    return [
        Comparison(
            f"{name(scene, SINGLE_SCATTERING)}: radiance",
            Sampled.of([scattered(scene, SIZE, rng) for _ in range(BATCHES)]),
            Sampled.exact(high_light(scene, SIZE)),
            1e-3 * high_light(scene, SIZE),
        )
        for scene in (
            HighClouds(),
            HighClouds(elevation=50.0, thickness=900.0, time=900.0, sun_elevation=20.0, g=0.85),
        )
    ]


def scattered(scene: HighClouds, size: int, rng: np.random.Generator) -> np.ndarray:
    """An estimate of the radiance (size, size, 1): a height in each of SCATTERERS layers of the
    slab, the depths to eye and sun by STEPS even steps."""
    o, w = pinhole_rays(*scene.eye(), scene.FIELD_OF_VIEW, size)
    l = np.array(scene.to_sun())
    cosine = w @ l
    lobe = (1 - scene.g**2) / (4 * np.pi * np.sqrt(1 + scene.g**2 - 2 * scene.g * cosine) ** 3)
    half = (np.arange(STEPS) + 0.5)[:, None, None] / STEPS
    total = np.zeros((size, size))
    for i in range(SCATTERERS):
        t = scene.thickness * (i + rng.random((size, size))) / SCATTERERS
        x, y = ((scene.BASE + t - o[2]) * w[..., i] / w[..., 2] for i in (0, 1))
        to_eye, to_sun = -half * t, half * (scene.thickness - t)
        seen = [c + to_eye * w[..., i] / w[..., 2] for i, c in enumerate((x, y))]
        lit = [c + to_sun * l[i] / l[2] for i, c in enumerate((x, y))]
        depth = t / scene.thickness / w[..., 2] * streaks(scene, *seen).mean(axis=0)
        depth += (1 - t / scene.thickness) / l[2] * streaks(scene, *lit).mean(axis=0)
        total += streaks(scene, x, y) * np.exp(-scene.optical_depth * depth)
    return (lobe * scene.optical_depth / w[..., 2] * total / SCATTERERS)[..., None]


def streaks(scene: HighClouds, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The product of the factors at places, m."""
    found = np.ones_like(x)
    for kx, ky, phase in WAVES:
        blown = [c - scene.time * v for c, v in zip((x, y), scene.WIND, strict=True)]
        found *= 1 + np.cos(2 * np.pi / scene.TILE * (kx * blown[0] + ky * blown[1]) + phase)
    return found


def strewn(scene: HighClouds, size: int, rng: np.random.Generator) -> np.ndarray:
    """An unbiased estimate of the optical depth (size, size, 1): POINTS uniform heights in the slab."""
    o, w = pinhole_rays(*scene.eye(), scene.FIELD_OF_VIEW, size)
    z = scene.BASE + scene.thickness * rng.random((POINTS, size, size))
    x, y = ((z - o[2]) * w[..., i] / w[..., 2] for i in (0, 1))
    return (scene.optical_depth / w[..., 2] * streaks(scene, x, y).mean(axis=0))[..., None]
