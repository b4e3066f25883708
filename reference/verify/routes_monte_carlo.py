"""Mitsuba against random walks of our own in float64 NumPy: surfaces, fog, layers and balls of cloud."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from reference import fog_monte_carlo, surface_monte_carlo
from reference import slab_monte_carlo as walk
from reference.render import sample
from reference.surface_monte_carlo import eye_rays
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import SIZE, comparison, name, rendered, seeds
from scenes.cloud import SUN_IRRADIANCE, CloudSlab, CloudSphere, SunlitCloud
from scenes.contract import DIRECT_RADIANCE, RADIANCE, SINGLE_SCATTERING, SOURCE_FUNCTION
from scenes.fog import FogOverGround
from scenes.sunlit import SphereOverPlane, Valley


def walked(draw: Callable[[np.random.Generator], np.ndarray], drawn: tuple[int, ...]) -> Sampled:
    """One batch of own walks for each seed."""
    return Sampled.of([draw(np.random.default_rng(s)) for s in drawn])


@check(
    "route",
    claim="light among diffuse surfaces under sun and sky is what random walks in float64 give",
    routes=("path, direct", "own Monte Carlo"),
    scenes=("SphereOverPlane", "Valley"),
)
def surfaces_against_walks(seed: int) -> list[Comparison]:
    """All light, and light that met one surface."""
    found = []
    for scene in (SphereOverPlane(), Valley(), SphereOverPlane(gap=0.5, light_radius=0.05, albedo=0.8)):
        for quantity, reflections in ((RADIANCE, math.inf), (DIRECT_RADIANCE, 1)):
            own = walked(
                lambda rng, s=scene, r=reflections: surface_monte_carlo.radiance(s, SIZE, 64, rng, r),
                seeds(seed, 0),
            )
            found.append(
                comparison(name(scene, quantity), grey(rendered(scene, quantity, seeds(seed, 1), 256)), own)
            )
    return found


@check(
    "route",
    claim="light in height fog over ground is what random walks in float64 give",
    routes=("volpath", "own Monte Carlo"),
    scenes=("FogOverGround",),
)
def fog_against_walks(seed: int) -> list[Comparison]:
    """All light, and light that was scattered or reflected once."""
    scene = FogOverGround()
    found = []
    for quantity, meetings in ((RADIANCE, math.inf), (SINGLE_SCATTERING, 1)):
        own = walked(
            lambda rng, m=meetings: fog_monte_carlo.radiance(scene, SIZE, 32, rng, m), seeds(seed, 0)
        )
        found.append(
            comparison(name(scene, quantity), grey(rendered(scene, quantity, seeds(seed, 1), 144)), own)
        )
    return found


CLOUDS = (
    (CloudSlab(optical_depth=4.0, g=0.2), 100, 320),
    (CloudSlab(optical_depth=4.0, g=0.5, seen="below"), 64, 512),
    (CloudSlab(optical_depth=8.0, precipitation=2.0, rain="absorbing"), 32, 256),
    (CloudSphere(optical_depth=4.0, g=0.2), 192, 1024),
    (CloudSphere(), 32, 256),
)
"""Scenes, and samples a pixel of own walks and of Mitsuba."""


@check(
    "route",
    claim="all orders of scattering in layers and balls of cloud are what random walks in float64 give",
    routes=("volpath", "own Monte Carlo"),
    scenes=("CloudSlab", "CloudSphere"),
)
def clouds_against_walks(seed: int) -> list[Comparison]:
    """Radiance at the camera."""
    return [
        comparison(
            name(scene),
            grey(rendered(scene, RADIANCE, seeds(seed, 1), spp)),
            walked(lambda rng, s=scene, n=own: cloud_radiance(s, SIZE, n, rng), seeds(seed, 0)),
        )
        for scene, own, spp in CLOUDS
    ]


@check(
    "route",
    claim="light that grazes a thick layer is what random walks in float64 give",
    routes=("volpath", "own Monte Carlo"),
    scenes=("CloudSlab",),
)
def grazing_layer_against_walks(seed: int) -> Comparison:
    """The sun at 2 degrees lights the skin of the layer alone, which Mitsuba's own rays leave out: they find
    9 % less (`reference.entry`)."""
    scene = CloudSlab(optical_depth=32.0, g=0.0, sun_elevation=2.0)
    own = walked(lambda rng: cloud_radiance(scene, SIZE, 16, rng), seeds(seed, 0))
    return comparison(name(scene), grey(rendered(scene, RADIANCE, seeds(seed, 1), 100)), own)


def cloud_radiance(scene: SunlitCloud, size: int, samples: int, rng: np.random.Generator) -> np.ndarray:
    """Radiance (size, size, 1) by walks that start where the camera's rays enter the cloud."""
    sigma_t, albedo = scene.rainy
    o, w = eye_rays(scene.sensor(size), size, samples, rng)
    if isinstance(scene, CloudSlab):
        o, exit_depth = sigma_t * (o + ((scene.seen == "above") - o[2]) / w[2] * w), walk.slab(sigma_t)
        enters = np.ones(o.shape[1], bool)
    else:
        middle = np.einsum("in,in->n", o, w)
        inside = 1 - np.einsum("in,in->n", o, o) + middle**2
        o = sigma_t * (o - (middle + np.sqrt(np.maximum(inside, 0))) * w)
        enters, exit_depth = inside > 0, walk.ball(sigma_t)
    total, l = np.zeros(o.shape[1]), np.array(scene.to_sun())
    total[enters] = walk.radiance(o.T[enters], w.T[enters], exit_depth, l, albedo, scene.g, rng)
    return SUN_IRRADIANCE * total.reshape(size, size, samples).mean(axis=2)[..., None]


@check(
    "route",
    claim="what a point in a layer scatters towards the eye is what random walks in float64 give",
    routes=("source-function sampler", "own Monte Carlo"),
    scenes=("CloudSlab",),
)
def source_function_against_walks(seed: int) -> list[Comparison]:
    """The declared sampler on its probes."""
    found = []
    for scene in (CloudSlab(optical_depth=4.0, g=0.2), CloudSlab(optical_depth=8.0, albedo=0.95)):
        draw = sample(scene, SOURCE_FUNCTION, SIZE)
        declared = Sampled.of([draw(256, s) for s in seeds(seed, 1)])
        own = walked(lambda rng, s=scene: cloud_source(s, SIZE, 64, rng), seeds(seed, 0))
        found.append(comparison(name(scene, SOURCE_FUNCTION), declared, own))
    return found


def cloud_source(scene: CloudSlab, size: int, samples: int, rng: np.random.Generator) -> np.ndarray:
    """The source function (size, size, 1) on `scene.probes`, whose places are worked out again here."""
    (sigma_t, albedo), l = scene.rainy, np.array(scene.to_sun())
    row, column = np.meshgrid(*2 * [np.linspace(0, 1, size)], indexing="ij")
    first, last = scene.FIRST_PROBE, scene.LAST_PROBE * scene.optical_depth
    depth, c = first * (last / first) ** row.ravel(), 2 * column.ravel() - 1
    aside = np.array([l[2], 0.0, -l[0]])
    w = c[:, None] * l + np.sqrt(1 - c * c)[:, None] * aside
    p = np.zeros((size * size, 3))
    p[:, 2] = sigma_t * (1 - depth / scene.sigma_t)
    p, w = (np.repeat(v, samples, axis=0) for v in (p, w))
    total = walk.source_function(p, w, walk.slab(sigma_t), l, albedo, scene.g, rng)
    return SUN_IRRADIANCE * total.reshape(size, size, samples).mean(axis=2)[..., None]


def grey(image: Sampled) -> Sampled:
    """The first channel of a grey image."""
    return Sampled(image.mean[..., :1], image.variance[..., :1], image.batches)
