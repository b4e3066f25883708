"""Openness to the sky among boxes and balls, against rays of our own in float64."""

from __future__ import annotations

import numpy as np

from reference.surface_monte_carlo import LIFT, blocked, cosine_weighted, eye_rays, first_hits, shapes
from reference.verify.agreement import FLOAT32, Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import SIZE, name, seeds
from reference.visibility import sky_visibility
from scenes.contract import SKY_VISIBILITY
from scenes.occluders import Occluders

SAMPLES = 64


@check(
    "route",
    claim="the share of the sky that points see is what rays in float64 give",
    routes=("rays in float32", "own Monte Carlo"),
    scenes=("Occluders",),
)
def openness_against_rays(seed: int) -> list[Comparison]:
    """From above and from the side."""
    found = []
    for scene in (Occluders(), Occluders(camera_elevation=15.0, pole=0.1)):
        cast = Sampled.of([sky_visibility(scene, SIZE, SAMPLES, s) for s in seeds(seed, 1)])
        own = Sampled.of([openness(scene, np.random.default_rng(s)) for s in seeds(seed, 0)])
        found.append(
            Comparison(name(scene, SKY_VISIBILITY), cast, own, np.full_like(own.mean, FLOAT32 + 1e-3))
        )
    return found


def openness(scene: Occluders, rng: np.random.Generator) -> np.ndarray:
    """(SIZE, SIZE, 1): share of SAMPLES cosine-weighted rays that meet nothing, 1 where the eye's does."""
    known = shapes(scene.surfaces())
    o, w = eye_rays(scene.sensor(SIZE), SIZE, SAMPLES, rng)
    t, n, _ = first_hits(known, o, w)
    met = np.isfinite(t)
    free = np.ones(len(t))
    x = o[:, met] + t[met] * w[:, met] + LIFT * n[:, met]
    free[met] = ~blocked(known, x, cosine_weighted(n[:, met], rng))
    return free.reshape(SIZE, SIZE, SAMPLES, 1).mean(axis=2)
