"""The closed forms of balls against Mitsuba, along rays through pixel centres."""

from __future__ import annotations

import math

from reference.closed_form import ball
from reference.verify.checks import Comparison, check
from reference.verify.routes import SIZE
from reference.verify.routes_closed_form import compared
from scenes.ball_in_room import BallInRoom
from scenes.contract import DIRECT_RADIANCE, RADIANCE
from scenes.environment_ball import EnvironmentBall
from scenes.lamps import BallUnderLamps, PolishedBall

GRAZING = 1e-5
"""Of the brightest pixel: what float32 positions make of a cosine near 0."""


@check(
    "route",
    claim="irradiance of a lobe of light is a short sum over Legendre polynomials",
    routes=("path with envmap", "closed form"),
    scenes=("EnvironmentBall",),
)
def lobe_against_envmap(seed: int) -> list[Comparison]:
    """A broad lobe and a narrower one from behind. Between the rows of its image the environment is off by at
    most (k + k^2) h^2 / 8 of itself, h being the angle between two."""
    scenes = EnvironmentBall(), EnvironmentBall(sharpness=10.0, contrast=1.0, turn=120.0)
    found = []
    for scene in scenes:
        closed, k = ball.environment_ball(scene, SIZE), scene.sharpness
        between_rows = (k + k * k) * (math.pi / scene.ROWS) ** 2 / 8
        found.append(compared(scene, RADIANCE, closed, seed, 512, between_rows * closed))
    return found


@check(
    "route",
    claim="balls under point lights reflect what Lambert's law and one GGX lobe say",
    routes=("direct and path", "closed form"),
    scenes=("BallUnderLamps", "BallInRoom", "PolishedBall"),
)
def lamps_against_mitsuba(seed: int) -> list[Comparison]:
    """Many lamps near and few far; a lamp in a room, whose walls are left out; gloss from the front and as a
    rim."""
    cases = [
        (BallUnderLamps(distance=1.5), RADIANCE, ball.ball_under_lamps),
        (BallUnderLamps(lamps=2, distance=10.0), RADIANCE, ball.ball_under_lamps),
        (BallInRoom(), DIRECT_RADIANCE, ball.ball_in_room),
        (PolishedBall(), RADIANCE, ball.polished_ball),
        (PolishedBall(alpha=0.15, lamp_angle=130.0), RADIANCE, ball.polished_ball),
    ]
    closed = [f(s, SIZE) for s, _, f in cases]
    return [
        compared(s, q, c, seed, 512, GRAZING * c.max()) for (s, q, _), c in zip(cases, closed, strict=True)
    ]
