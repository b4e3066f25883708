"""Shadows of area lights: closed forms against shadow rays, Mitsuba against float64 rays of our own."""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi
import numpy as np

from reference.closed_form import half_plane
from reference.surface_monte_carlo import LIFT, blocked, dot, eye_rays, first_hits, shapes
from reference.verify.agreement import FLOAT32, Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import SIZE, comparison, name, rendered, seeds
from reference.visibility import light_point, light_visibility
from scenes.contract import DIRECT_RADIANCE, LIGHT_VISIBILITY
from scenes.shadow_casters import HalfPlane, PoleAndBars, ShadowCasters

RAYS = 1024
FEW_RAYS = 1e-3
"""Of the light: a share so small that no ray of a batch may find it, which says nothing of its variance."""


@check(
    "route",
    claim="the share of a light past a straight edge is a share of a square or a disk",
    routes=("shadow rays", "closed form"),
    scenes=("HalfPlane",),
)
def half_plane_against_shadow_rays(seed: int) -> list[Comparison]:
    """A square and a disk over sheets near the ground and half way to the light."""
    scenes = (
        HalfPlane(),
        HalfPlane(light_shape="disk", light_size=1.0),
        HalfPlane(light_shape="disk", height=2.0),
        HalfPlane(light_size=3.0, height=0.2),
    )
    return [
        Comparison(
            name(scene, LIGHT_VISIBILITY),
            Sampled.of([shadow_rays(scene, s) for s in seeds(seed, 0)]),
            Sampled.exact(half_plane.visibility(scene, SIZE)),
            np.array(FEW_RAYS),
        )
        for scene in scenes
    ]


def shadow_rays(scene: HalfPlane, seed: int) -> np.ndarray:
    """(SIZE, SIZE, 1): the share of RAYS from each pixel centre's hit that reach the light."""
    view = scene.view(SIZE)
    random = mi.load_dict({"type": "independent"})
    random.seed(seed, SIZE * SIZE * RAYS)
    lane = dr.arange(mi.UInt32, SIZE * SIZE * RAYS) // RAYS
    start = dr.gather(mi.Point3f, view.surface.position, lane) + mi.Vector3f(0, 0, 2e-5)
    w = dr.normalize(light_point(view.lights[0], random.next_2d()) - start)
    free = dr.select(dr.isfinite(view.trace(start, w)), mi.Float(0), 1)
    return np.array(dr.block_sum(free, RAYS), np.float64).reshape(SIZE, SIZE, 1) / RAYS


@check(
    "route",
    claim="shares and light of a square or round light are what rays in float64 give",
    routes=("direct, shadow rays", "own Monte Carlo"),
    scenes=("PoleAndBars",),
)
def area_shadows_against_rays(seed: int) -> list[Comparison]:
    """Casters on the ground and above it."""
    found = []
    for scene in (PoleAndBars(), PoleAndBars(light_shape="disk", light_size=2.0, gap=0.5)):
        both = [own_rays(scene, 64, np.random.default_rng(s)) for s in seeds(seed, 0)]
        share, light = (Sampled.of([b[i] for b in both]) for i in (0, 1))
        cast = Sampled.of([light_visibility(scene, SIZE, 64, s) for s in seeds(seed, 1)])
        slack = FLOAT32 + FEW_RAYS * np.ones_like(share.mean)
        found.append(Comparison(name(scene, LIGHT_VISIBILITY), cast, share, slack))
        direct = rendered(scene, DIRECT_RADIANCE, seeds(seed, 1), 256)
        found.append(comparison(name(scene, DIRECT_RADIANCE), direct, light))
    return found


def own_rays(scene: ShadowCasters, samples: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Share of the light and direct radiance, (SIZE, SIZE, 1) each, with one point of the light a sample:

    L = rho / pi L_e A V cos(theta_x) cos(theta_y) / r^2.
    """
    known, light = shapes(scene.surfaces()), scene.light()
    o, w = eye_rays(scene.sensor(SIZE), SIZE, samples, rng)
    t, n, rho = first_hits(known, o, w)
    x = o + t * w + LIFT * n
    a, b = rng.uniform(-1, 1, (2, o.shape[1]))
    area = 4.0 * scene.light_size**2
    if light.shape == "disk":
        radius, turn = np.sqrt(0.5 * (a + 1)), math.pi * b
        a, b, area = radius * np.cos(turn), radius * np.sin(turn), math.pi * scene.light_size**2
    y = light.centre[:, None] + a * light.u[:, None] + b * light.v[:, None]
    r = np.linalg.norm(y - x, axis=0)
    toward = (y - x) / r
    back = -np.cross(light.u, light.v) / np.linalg.norm(np.cross(light.u, light.v))
    at_x, at_y = np.maximum(dot(n, toward), 0), np.maximum(back @ toward, 0)
    seen = (at_x > 0) & ~blocked(known, x, toward)
    radiance = rho / math.pi * scene.radiance * area * seen * at_x * at_y / r**2
    return tuple(v.reshape(SIZE, SIZE, samples, 1).mean(axis=2) for v in (seen.astype(float), radiance))
