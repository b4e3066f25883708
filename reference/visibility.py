"""Shares of a light and of the sky that surface points see, by shadow rays: for any scene that names its
opaque `surfaces` and hands its lights to `view`.

Camera rays are spread over the pixels at random; the rays from each first hit are stratified. Where a camera
ray meets nothing the share is 1.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from reference.render import batch_seed
from reference.truth import sampler
from scenes.contract import LIGHT_VISIBILITY, SKY_VISIBILITY, AreaLight, Scene

LIFT = 1e-5
"""Of a point off its surface, in units of 1 + |p|."""


@sampler(Scene, SKY_VISIBILITY)
def sky_visibility(scene: Scene, size: int, spp: int, seed: int) -> np.ndarray:
    """(size, size, 1): int V(w) cos dw / pi over the hemisphere of the first hit."""
    world, hit, random = _first_hits(scene, size, spp, seed)
    w = hit.frame.to_world(mi.warp.square_to_cosine_hemisphere(random.next_2d()))
    return _image(dr.select(hit.valid, _free(world, hit, w, dr.inf), 1), size, spp)


@sampler(Scene, LIGHT_VISIBILITY)
def light_visibility(scene: Scene, size: int, spp: int, seed: int) -> np.ndarray:
    """(size, size, 1): the share of the first light's surface that the first hit sees; what lies below the
    hit's own horizon it does not see."""
    world, hit, random = _first_hits(scene, size, spp, seed)
    towards = light_point(scene.view(1).lights[0], random.next_2d()) - hit.p
    far = dr.norm(towards)
    w = towards / far
    free = _free(world, hit, w, far * (1 - 1e-4))
    return _image(dr.select(hit.valid, dr.select(dr.dot(w, hit.frame.n) > 0, free, 0), 1), size, spp)


def light_point(light: AreaLight, sample: mi.Point2f) -> mi.Point3f:
    """A point of the light's surface, uniform in area, from two uniform numbers."""
    c, u, v = (mi.Vector3f(x) for x in (light.centre, light.u, light.v))
    if light.shape == "sphere":
        return mi.Point3f(c + dr.norm(u) * mi.warp.square_to_uniform_sphere(sample))
    if light.shape == "disk":
        at = mi.warp.square_to_uniform_disk(sample)
        return mi.Point3f(c + at.x * u + at.y * v)
    if light.shape == "rectangle":
        return mi.Point3f(c + (2 * sample.x - 1) * u + (2 * sample.y - 1) * v)
    across = mi.Frame3f(dr.normalize(u)).to_world(
        mi.Vector3f(dr.cos(2 * dr.pi * sample.y), dr.sin(2 * dr.pi * sample.y), 0)
    )
    return mi.Point3f(c + (2 * sample.x - 1) * u + dr.norm(v) * across)


class _Hits:
    def __init__(self, si: mi.SurfaceInteraction3f, ray: mi.Ray3f) -> None:
        n = dr.select(dr.dot(si.n, ray.d) > 0, -si.n, si.n)
        self.valid, self.frame = si.is_valid(), mi.Frame3f(n)
        self.p = si.p + LIFT * (1 + dr.norm(si.p)) * n


def _first_hits(scene: Scene, size: int, spp: int, seed: int) -> tuple[mi.Scene, _Hits, mi.Sampler]:
    world = mi.load_dict({"type": "scene", **scene.surfaces()}, optimize=False)
    sensor = mi.load_dict(scene.mitsuba(size)["sensor"])
    random = mi.load_dict({"type": "multijitter", "sample_count": spp})
    random.seed(batch_seed(seed, 0), size * size * spp)
    lane = dr.arange(mi.UInt32, size * size * spp) // spp
    at = (mi.Point2f(lane % size, lane // size) + random.next_2d()) / size
    ray, _ = sensor.sample_ray(0.0, 0.5, at, mi.Point2f(0.5))
    return world, _Hits(world.ray_intersect(ray), ray), random


def _free(world: mi.Scene, hit: _Hits, w: mi.Vector3f, far: mi.Float) -> mi.Float:
    ray = mi.Ray3f(hit.p, w)
    ray.maxt = far
    return dr.select(world.ray_test(ray, hit.valid), mi.Float(0), 1)


def _image(share: mi.Float, size: int, spp: int) -> np.ndarray:
    return np.array(dr.block_sum(share, spp), np.float64).reshape(size, size, 1) / spp
