"""Shares of the sun in rooms: closed forms and rays in float64 against Mitsuba's shadow rays, at the first
hits of rays through pixel centres."""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi
import numpy as np

from reference.closed_form import sun_through_window as window
from reference.render import variant_of
from reference.surface_monte_carlo import blocked, shapes
from reference.toolchain import other_variant
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import BATCHES, SIZE, name, seeds
from reference.visibility import LIFT, light_point
from scenes.contract import LIGHT_VISIBILITY
from scenes.mitsuba_parts import camera_rays
from scenes.window_room import BallRoom, PillarRoom, StainedRoom, SunlitRoom, WindowRoom


@check(
    "route",
    claim="what a window lets through of the sun is a disk cut by straight lines",
    routes=("shadow rays", "closed form"),
    scenes=("WindowRoom", "PillarRoom", "StainedRoom"),
)
def window_against_shadow_rays(seed: int) -> list[Comparison]:
    """Thin wall and deep frame, small sun and large; a pillar; coloured panes."""
    cases = [
        (WindowRoom(), window.window_room),
        (WindowRoom(wall_thickness=0.5, sun_radius=8.0, sun_azimuth=-40.0), window.window_room),
        (PillarRoom(pillar_gap=1.5, sun_radius=5.0), window.pillar_room),
        (StainedRoom(sun_radius=5.0), window.stained_room),
    ]
    return [
        Comparison(
            name(s, LIGHT_VISIBILITY), shadow_rays(s, seed, 1024), Sampled.exact(f(s, SIZE)), lifted(s)
        )
        for s, f in cases
    ]


@check(
    "route",
    claim="a ball in a sun beam hides what rays in float64 say",
    routes=("shadow rays", "own Monte Carlo"),
    scenes=("BallRoom",),
)
def ball_against_own_rays(seed: int) -> Comparison:
    """Both shadows with penumbrae that cross."""
    scene, rng = BallRoom(sun_radius=6.0), np.random.default_rng(seed)
    own = Sampled.of([own_rays(scene, 512, rng) for _ in range(BATCHES)])
    return Comparison(name(scene, LIGHT_VISIBILITY), shadow_rays(scene, seed, 1024), own, lifted(scene))


def lifted(scene: SunlitRoom) -> float:
    """What the lift of Mitsuba's points off their surfaces makes of a share at most: the lift over a half of
    the sun's radius a metre away, across which a share goes from 0 to 1."""
    return LIFT * (1 + np.linalg.norm(scene.HIGH)) / (0.5 * math.tan(math.radians(scene.sun_radius)))


def shadow_rays(scene: SunlitRoom, seed: int, samples: int) -> Sampled:
    """Shares (SIZE, SIZE, C) from rays to uniform points of the sun's disk; tinted where there are panes."""
    with other_variant(variant_of(scene)):
        view = scene.view(1)
        world = mi.load_dict({"type": "scene", **scene.surfaces()}, optimize=False)
        camera = camera_rays(mi.load_dict(scene.sensor(SIZE)), SIZE)
        hit = world.ray_intersect(mi.Ray3f(camera.origin, camera.direction))
        n = dr.select(dr.dot(hit.n, camera.direction) > 0, -hit.n, hit.n)
        p = hit.p + LIFT * (1 + dr.norm(hit.p)) * n
        lane = dr.arange(mi.UInt32, SIZE * SIZE * samples) // samples
        o, normal = dr.gather(mi.Point3f, mi.Point3f(p), lane), dr.gather(mi.Vector3f, mi.Vector3f(n), lane)
        met = np.array(hit.is_valid())[:, None]
        batches = []
        for s in seeds(seed, 0):
            random = mi.load_dict({"type": "independent"})
            random.seed(s, dr.width(lane))
            w = dr.normalize(light_point(view.lights[0], random.next_2d()) - o)
            free = (dr.dot(w, normal) > 0) & ~world.ray_test(mi.Ray3f(o, w))
            tint = view.transmittance(o, w) if view.transmittance else mi.Color3f(1)
            share = dr.block_sum(dr.select(free, tint, 0), samples) / samples
            share = np.where(met, np.array(share, np.float64).T, 1)
            batches.append(share.reshape(SIZE, SIZE, 3)[..., : 3 if view.transmittance else 1])
        return Sampled.of(batches)


def own_rays(scene: SunlitRoom, samples: int, rng: np.random.Generator) -> np.ndarray:
    """Shares (SIZE, SIZE, 1) from rays in float64 to a sun at infinity."""
    points, known = window.Points(scene, SIZE), shapes(scene.surfaces())
    total = np.zeros(len(points.p))
    for _ in range(samples):
        r, phi = points.radius * np.sqrt(rng.random(len(total))), 2 * np.pi * rng.random(len(total))
        w = points.frame @ np.stack([np.ones_like(r), r * np.cos(phi), r * np.sin(phi)])
        w /= np.linalg.norm(w, axis=0)
        free = ~blocked(known, points.p.T + 1e-9 * points.n.T, w)
        total += free & ((points.n.T * w).sum(axis=0) > 0)
    return np.where(points.met, total / samples, 1).reshape(SIZE, SIZE, 1)
