"""Two balls of cloud: Mitsuba and a closed form against each other and against walks in float64 NumPy."""

from __future__ import annotations

import numpy as np

from reference import two_balls_monte_carlo as walk
from reference.closed_form.two_balls import once_scattered_by_two_balls
from reference.truth import box_filter
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import SIZE, comparison, name, rendered, seeds
from reference.verify.routes_closed_form import compared
from reference.verify.routes_monte_carlo import walked
from scenes.contract import RADIANCE, SINGLE_SCATTERING
from scenes.two_balls import TwoBalls

FINE = 32  # points a side of a pixel at which the closed form is averaged


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
        for s in (
            TwoBalls(optical_depth=4.0),
            TwoBalls(optical_depth=2.0, sun_angle=150.0, gap=0.5, turn=60.0),
        )
    ]


@check(
    "route",
    claim="light scattered once in two balls of cloud is what flights in float64 find",
    routes=("closed form", "own Monte Carlo"),
    scenes=("TwoBalls",),
)
def once_in_two_balls_against_walks(seed: int) -> list[Comparison]:
    """Over whole pixels."""
    found = []
    for scene in (
        TwoBalls(optical_depth=4.0),
        TwoBalls(optical_depth=2.0, sun_angle=120.0, turn=75.0, gap=0.2),
    ):
        closed = Sampled.exact(box_filter(once_scattered_by_two_balls(scene, FINE * SIZE), FINE))
        own = walked(lambda rng, s=scene: walk.image(s, SIZE, 128, rng, 1), seeds(seed, 0))
        label = name(scene, SINGLE_SCATTERING)
        found.append(comparison(label, closed, own, 2e-3 * np.abs(closed.mean)))
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
