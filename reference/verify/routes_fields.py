r"""Distance and openness among solids against Mitsuba's rays.

The distance from a point to a surface is the least that any ray from there travels. Of N rays spread evenly
over the sphere, one leaves within the angle a = 2 sqrt(2 / N) of the nearest point's direction (each stands
for 4 pi / N of the sphere, and the cells of a spiral are at most twice as long as wide). So the least of them
is at least d, at a flat face at most d / cos a, and at a box's edge, beside which it meets one of two faces,
d (1 + a). The sign comes from which side of the surface is met. Each solid is met alone, since the floor's
top within a box is no boundary, and the least of the signed distances counts.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from reference.closed_form.fields import distance_in_slice, openness_of_groove, openness_round_ball
from reference.truth import box_filter
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import BATCHES, SIZE, name, seeds
from reference.visibility import sky_visibility
from scenes.contract import DISTANCE, SKY_VISIBILITY
from scenes.fields import FAR, BallOverFloor, Groove, SolidsUnderSky

RAYS = 1 << 14
FINE = 16
"""Samples along a pixel's edge of the closed form, where rays are spread over pixels."""


@check(
    "route",
    claim="the distance in the slice is what the nearest of many rays travels",
    routes=("rays to all sides", "closed form"),
    scenes=("SolidsUnderSky",),
)
def distance_against_rays(seed: int) -> list[Comparison]:
    """Balls, boxes and a thin wall, inside and outside."""
    found = []
    for scene in (SolidsUnderSky(), SolidsUnderSky(thickness=0.01, gap=0.3)):
        exact = distance_in_slice(scene, SIZE)
        within = 2 * np.sqrt(2 / RAYS) * np.abs(exact) + 2e-5
        rays = Sampled.exact(nearest_of_rays(scene, SIZE))
        found.append(Comparison(name(scene, DISTANCE), rays, Sampled.exact(exact), within))
    return found


def nearest_of_rays(scene: SolidsUnderSky, size: int) -> np.ndarray:
    """Signed distance (size, size, 1) at the scene's probes: of each solid the least that RAYS rays to all
    sides travel, negative where it is met from inside; the least of all solids."""
    p = scene.probes(size).camera.origin
    return np.min([_nearest(shape, p) for shape in scene.surfaces().values()], axis=0).reshape(size, size, 1)


def _nearest(shape: dict, p: mi.Point3f) -> np.ndarray:
    world = mi.load_dict({"type": "scene", "shape": shape}, optimize=False)
    nearest, sign = dr.full(mi.Float, dr.inf, dr.width(p)), dr.ones(mi.Float, dr.width(p))

    def step(i: mi.UInt32, nearest: mi.Float, sign: mi.Float) -> tuple[mi.UInt32, mi.Float, mi.Float]:
        z = 1 - (2 * mi.Float(i) + 1) / RAYS
        turn, r = mi.Float(i) * (np.pi * (3 - np.sqrt(5))), dr.safe_sqrt(1 - z * z)
        w = mi.Vector3f(r * dr.cos(turn), r * dr.sin(turn), z)
        hit = world.ray_intersect(mi.Ray3f(p, w))
        nearer = hit.is_valid() & (hit.t < nearest)
        side = dr.select(dr.dot(hit.n, w) > 0, mi.Float(-1), 1)
        return i + 1, dr.select(nearer, hit.t, nearest), dr.select(nearer, side, sign)

    start = (mi.UInt32(0), nearest, sign)
    _, nearest, sign = dr.while_loop(start, lambda i, nearest, sign: i < RAYS, step)
    return np.array(sign * nearest, np.float64)


@check(
    "route",
    claim="openness round a ball and in a groove is what hemispheres and lunes say",
    routes=("rays to the sky", "closed form"),
    scenes=("BallOverFloor", "Groove"),
)
def openness_against_rays(seed: int) -> list[Comparison]:
    """A ball on and over a floor, grooves of two openings. The closed form is averaged over 16 x 16 points of
    a pixel, which misses at most 1/64 of the step at an outline; floors and walls end FAR away."""
    found = []
    for scene, closed in (
        (BallOverFloor(), openness_round_ball),
        (BallOverFloor(gap=1.0), openness_round_ball),
        (Groove(), openness_of_groove),
        (Groove(opening=45.0), openness_of_groove),
    ):
        fine = closed(scene, SIZE * FINE)
        exact = box_filter(fine, FINE)
        blocks = fine.reshape(SIZE, FINE, SIZE, FINE, 1)
        edge = np.ptp(blocks, axis=(1, 3)) / (4 * FINE)
        drawn = Sampled.of([sky_visibility(scene, SIZE, 64, s) for s in seeds(seed, 0)[:BATCHES]])
        within = edge + 2 * 3.0 / (np.pi * FAR) + 1e-5
        found.append(Comparison(name(scene, SKY_VISIBILITY), drawn, Sampled.exact(exact), within))
    return found
