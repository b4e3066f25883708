"""The closed forms of balls against Mitsuba, along rays through pixel centres."""

from __future__ import annotations

import math

import numpy as np

from reference.closed_form import ball
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import BATCHES, SIZE, name, seeds
from reference.verify.routes_closed_form import compared, through_centres
from scenes.ball_in_room import BallInRoom
from scenes.contract import DIRECT_RADIANCE, RADIANCE
from scenes.environment_ball import EnvironmentBall, GlossyBall
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


@check(
    "route",
    claim="a metal ball reflects its surroundings as half vectors drawn from GGX's law say",
    routes=("path with envmap", "own Monte Carlo"),
    scenes=("GlossyBall",),
)
def gloss_against_half_vectors(seed: int) -> list[Comparison]:
    """A smooth ball and a rough white one."""
    found = []
    for scene in (GlossyBall(), GlossyBall(roughness=0.9, f0=1.0, sharpness=5.0)):
        rng = np.random.default_rng(seed)
        own = Sampled.of([glossy_ball(scene, 24, rng) for _ in range(BATCHES)])
        path = through_centres(scene, scene.mitsuba(SIZE), RADIANCE, seeds(seed, 0), 512)
        found.append(Comparison(name(scene, RADIANCE), path, own, 1e-3 * own.mean))
    return found


def glossy_ball(scene: GlossyBall, strata: int, rng: np.random.Generator) -> np.ndarray:
    """Radiance (SIZE, SIZE, 3) at pixel centres, from strata x strata half vectors h each. They have the
    density D n.h, so that one weighs F G v.h / (n.h n.v); F is Schlick's."""
    n, met, d = ball.normals(scene, SIZE)
    a2 = scene.roughness**4
    cells = np.stack(np.divmod(np.arange(strata**2), strata))[:, None]
    u, phi = (cells + rng.random((2, len(n), strata**2))) / strata
    nh = np.sqrt((1 - u) / (1 - u * (1 - a2)))
    across = np.cross(n, [0.6, 0.0, 0.8])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    round_n = across[:, None] * np.cos(2 * np.pi * phi)[..., None]
    round_n += np.cross(n, across)[:, None] * np.sin(2 * np.pi * phi)[..., None]
    h = nh[..., None] * n[:, None] + np.sqrt(1 - nh**2)[..., None] * round_n
    vh, nv = h @ -d, (n @ -d)[:, None]
    l = d + 2 * vh[..., None] * h
    nl = (l * n[:, None]).sum(axis=2)
    lit = (nl > 0) & (vh > 0)
    masking = ball.smith(np.where(lit, nl, 1), a2) * ball.smith(np.maximum(nv, 1e-9), a2)
    fresnel = scene.f0 + (1 - scene.f0) * (1 - vh) ** 5
    weight = np.where(lit, fresnel * masking * vh / (nh * np.maximum(nv, 1e-9)), 0)
    light = ball.environment(scene, l.reshape(-1, 3)).reshape(*l.shape)
    reflected = (weight[..., None] * light).mean(axis=1)
    return np.where(met[:, None], reflected, ball.environment(scene, d[None])).reshape(SIZE, SIZE, 3)
