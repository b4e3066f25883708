"""Two balls of cloud: Mitsuba and a closed form against each other and against walks in float64 NumPy."""

from __future__ import annotations

import numpy as np

from reference import two_balls_monte_carlo as walk
from reference.closed_form.two_balls import once_scattered_by_two_balls
from reference.surface_monte_carlo import eye_rays
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import SIZE, comparison, name, rendered, seeds
from reference.verify.routes_closed_form import compared
from reference.verify.routes_monte_carlo import walked
from scenes.contract import RADIANCE, SINGLE_SCATTERING
from scenes.two_balls import TwoBalls

BEFORE = TwoBalls(optical_depth=4.0)
BACKLIT = TwoBalls(optical_depth=2.0, sun_angle=150.0, turn=60.0, gap=0.5)


@check(
    "route",
    claim="light scattered once in two balls of cloud is a plain integral along each chord",
    routes=("volpath at depth 2", "closed form"),
    scenes=("TwoBalls",),
)
def once_in_two_balls_against_volpath(seed: int) -> list[Comparison]:
    """One ball before the other, and apart under a sun that shines through one into the other."""
    return [
        compared(s, SINGLE_SCATTERING, once_scattered_by_two_balls(s, SIZE), seed, 512)
        for s in (BEFORE, BACKLIT)
    ]


@check(
    "route",
    claim="light scattered once in two balls of cloud is what flights in float64 find",
    routes=("closed form", "own Monte Carlo"),
    scenes=("TwoBalls",),
)
def once_in_two_balls_against_walks(seed: int) -> list[Comparison]:
    """Along rays through pixel centres."""
    found = []
    for scene in (BEFORE, BACKLIT):
        o, w = (np.repeat(a.T, 128, axis=0) for a in eye_rays(scene.sensor(SIZE), SIZE))

        def draw(rng: np.random.Generator, scene=scene, o=o, w=w) -> np.ndarray:
            return walk.radiance(scene, o, w, rng, 1).reshape(SIZE, SIZE, 128, 1).mean(axis=2)

        closed = Sampled.exact(once_scattered_by_two_balls(scene, SIZE))
        found.append(comparison(name(scene, SINGLE_SCATTERING), closed, walked(draw, seeds(seed, 0))))
    return found


@check(
    "route",
    claim="all orders of scattering in two balls of cloud are what random walks in float64 give",
    routes=("volpath", "own Monte Carlo"),
    scenes=("TwoBalls",),
)
def two_balls_against_walks(seed: int) -> list[Comparison]:
    """Thin and broad, where a percent shows, and as a technique meets them."""
    return [
        comparison(
            name(scene),
            rendered(scene, RADIANCE, seeds(seed, 1), spp),
            walked(lambda rng, s=scene, n=own: walk.image(s, SIZE, n, rng), seeds(seed, 0)),
        )
        for scene, own, spp in ((TwoBalls(optical_depth=4.0, g=0.2), 160, 1024), (TwoBalls(), 24, 256))
    ]
