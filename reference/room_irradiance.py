"""Irradiance on free surface elements in a room: the lamp sampled over its surface, all other light over the
hemisphere with the path tracer."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from reference.render import batch_seed
from reference.truth import sampler
from reference.visibility import light_point
from scenes.contract import IRRADIANCE
from scenes.rooms import IrradianceTrack


@sampler(IrradianceTrack, IRRADIANCE)
def irradiance(scene: IrradianceTrack, size: int, spp: int, seed: int) -> np.ndarray:
    """(size, size, 3): one batch of spp light paths per probe, row by row as `probes` says."""
    probes, light = scene.probes(size), scene.light()
    world = mi.load_dict(scene.world(), optimize=False)
    integrator = mi.load_dict({"type": "path", "hide_emitters": True})
    random = mi.load_dict({"type": "multijitter", "sample_count": spp})
    random.seed(batch_seed(seed, 0), size * size * spp)
    lane = dr.arange(mi.UInt32, size * size * spp) // spp
    p = dr.gather(mi.Point3f, probes.surface.position, lane)
    n = dr.gather(mi.Vector3f, probes.surface.normal, lane)

    towards = light_point(light, random.next_2d()) - p
    far = dr.norm(towards)
    w = towards / far
    across = dr.cross(mi.Vector3f(light.u), mi.Vector3f(light.v))
    free = probes.trace(p, w) > far * (1 - 1e-4)
    flux = dr.maximum(dr.dot(n, w), 0) * dr.maximum(-dr.dot(across, w), 0) * 4 / dr.square(far)
    total = dr.select(free, flux * light.radiance, 0)

    w = mi.Frame3f(n).to_world(mi.warp.square_to_cosine_hemisphere(random.next_2d()))
    met, _, _ = integrator.sample(world, random, mi.RayDifferential3f(p, w))
    mean = dr.block_sum(total + dr.pi * met, spp)
    return np.array(mean, np.float64).T.reshape(size, size, 3) / spp
