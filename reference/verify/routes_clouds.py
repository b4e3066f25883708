"""Clouds of varying density: exact depths and Mitsuba's walks against walks of our own in float64 NumPy."""

from __future__ import annotations

import numpy as np

from reference import grid_monte_carlo as walk
from reference.closed_form import cloud_grid
from reference.render import sample
from reference.surface_monte_carlo import eye_rays
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import SIZE, comparison, name, rendered, seeds
from reference.verify.routes_closed_form import compared
from reference.verify.routes_monte_carlo import walked
from scenes.contract import (
    RADIANCE,
    SINGLE_SCATTERING,
    SOURCE_FUNCTION,
    SUN_TRANSMITTANCE,
    TRANSMITTANCE,
)
from scenes.cumulus import Cumulus, GridCloud
from scenes.cumulus_sky import CumulusUnderSky


@check(
    "route",
    claim="the share of light that crosses a cloud is what walks that end at the first droplet find",
    routes=("volpath", "closed form"),
    scenes=("Cumulus",),
)
def cloud_transmittance_against_volpath(seed: int) -> list[Comparison]:
    """The cloud made of soot, before a sky of radiance 1."""
    found = []
    for scene in (Cumulus(optical_depth=4.0), Cumulus(optical_depth=1.0, seen="below", precipitation=2.0)):
        soot = scene.mitsuba(SIZE)
        soot["medium"] = {**soot["medium"], "albedo": 0.0}
        del soot["sun"]
        soot["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}}
        closed = cloud_grid.cloud_transmittance(scene, SIZE)
        found.append(compared(scene, TRANSMITTANCE, closed, seed, 256, description=soot))
    return found


@check(
    "route",
    claim="the sun's light left at points in a cloud is what null collisions on the way say",
    routes=("closed form", "own Monte Carlo"),
    scenes=("Cumulus",),
)
def sun_in_cloud_against_walks(seed: int) -> list[Comparison]:
    """The declared closed form on its probes."""
    found = []
    for scene in (Cumulus(optical_depth=8.0), Cumulus(optical_depth=2.0, sun_elevation=10.0, seen="below")):
        closed = Sampled.exact(cloud_grid.sun_transmittance(scene, SIZE))
        grid, l = walk.Grid(scene), np.array(scene.to_sun())

        def draw(rng: np.random.Generator, scene=scene, grid=grid, l=l) -> np.ndarray:
            p = probes(scene, 64)[0]
            left = walk.transmittance(grid, p, np.broadcast_to(l, p.shape), rng)
            return left.reshape(SIZE, SIZE, 64, 1).mean(axis=2)

        own = walked(draw, seeds(seed, 0))
        found.append(comparison(name(scene, SUN_TRANSMITTANCE), closed, own))
    return found


@check(
    "route",
    claim="what a point in a cloud scatters towards the eye is what random walks in float64 give",
    routes=("source-function sampler", "own Monte Carlo"),
    scenes=("Cumulus", "CumulusUnderSky"),
)
def source_in_cloud_against_walks(seed: int) -> list[Comparison]:
    """The declared sampler on its probes, under the sun, under sun and sky, and under the sky alone."""
    found = []
    for scene in (
        Cumulus(optical_depth=4.0, g=0.2),
        Cumulus(optical_depth=4.0, g=0.2, lit_by="both"),
        CumulusUnderSky(optical_depth=4.0, g=0.2),
    ):
        declared = sample(scene, SOURCE_FUNCTION, SIZE)
        ours = Sampled.of([declared(64, s) for s in seeds(seed, 1)])
        grid, channels = walk.Grid(scene), 1 if scene.lit_by == "sun" else 3

        def draw(rng: np.random.Generator, scene=scene, grid=grid, channels=channels) -> np.ndarray:
            light = walk.source_function(scene, grid, *probes(scene, 16), rng)
            return light.reshape(SIZE, SIZE, 16, 3).mean(axis=2)[..., :channels]

        found.append(comparison(name(scene, SOURCE_FUNCTION), ours, walked(draw, seeds(seed, 0))))
    return found


@check(
    "route",
    claim="light from a cloud of varying density is what random walks in float64 give",
    routes=("volpath", "own Monte Carlo"),
    scenes=("Cumulus",),
)
def cumulus_against_walks(seed: int) -> list[Comparison]:
    """All orders under the sun, and under sun and sky; light that was scattered once."""
    found = []
    for scene, quantity, orders in (
        (Cumulus(optical_depth=4.0, g=0.2), RADIANCE, np.inf),
        (Cumulus(optical_depth=4.0, g=0.2), SINGLE_SCATTERING, 1),
        (Cumulus(optical_depth=4.0, g=0.2, lit_by="both", seen="below"), RADIANCE, np.inf),
    ):
        grid = walk.Grid(scene)

        def draw(rng: np.random.Generator, scene=scene, grid=grid, orders=orders) -> np.ndarray:
            o, w = eye_rays(scene.sensor(SIZE), SIZE, 16, rng)
            light = walk.radiance(scene, grid, np.broadcast_to(o, w.shape).T, w.T, rng, orders)
            return light.reshape(SIZE, SIZE, 16, 3).mean(axis=2)

        own = walked(draw, seeds(seed, 0))
        found.append(comparison(name(scene, quantity), rendered(scene, quantity, seeds(seed, 1), 64), own))
    return found


def probes(scene: GridCloud, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and directions (n, 3) of the probes, each `samples` times."""
    camera = scene.probes(SIZE).camera
    return tuple(
        np.repeat(np.array(a, dtype=np.float64).T, samples, axis=0) for a in (camera.origin, camera.direction)
    )
