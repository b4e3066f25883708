"""The source function of a cloud of varying density by Mitsuba: what a point scatters towards the eye.

As `reference.source_function` has it for a layer, with the sun's own term by the exact depth through the
grid. Probes whose rays miss the cloud's box stay at the eye, outside the medium, and start there, where they
scatter as a droplet would. Under a sky S has colours. A module of its own, so that stored truths of layers,
whose names depend on the sampler's text, stay valid.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from reference import transport
from reference.closed_form.cloud_grid import depth_to_sun
from reference.render import batch_seed
from reference.slab_monte_carlo import phase
from reference.truth import sampler
from scenes.contract import SOURCE_FUNCTION
from scenes.cumulus import Cumulus, GridCloud

LANES = 1 << 20  # paths in flight at once


@sampler(Cumulus, SOURCE_FUNCTION)
def grid_source_function(scene: GridCloud, size: int, spp: int, seed: int) -> np.ndarray:
    """(size, size, C): one batch of spp paths per probe, row by row as `probes` says; C = 3 under a sky and
    1 under the sun alone."""
    description = scene.mitsuba(size)
    world = mi.load_dict(description)
    medium = world.shapes()[0].interior_medium()
    integrator = mi.load_dict(transport.integrator(description, SOURCE_FUNCTION))
    probes = scene.probes(size)
    point, w = mi.Point3f(probes.camera.origin), probes.camera.direction
    channels = 1 if probes.environment is None else 3

    total = np.zeros((size * size, channels))
    chunk = max(1, LANES // size**2)
    for first in range(0, spp, chunk):
        n = min(chunk, spp - first)
        random = mi.load_dict({"type": "independent"})
        random.seed(batch_seed(seed, first // chunk), size * size * n)
        lane = dr.arange(mi.UInt32, size * size * n) // n
        met = dr.zeros(mi.MediumInteraction3f, size * size * n)
        met.p = dr.gather(mi.Point3f, point, lane)
        met.wi = -dr.gather(mi.Vector3f, w, lane)
        met.sh_frame = mi.Frame3f(met.wi)
        met.t = 0.0
        context = mi.PhaseFunctionContext(random)
        wo, weight, _ = medium.phase_function().sample(context, met, random.next_1d(), random.next_2d())
        inside, light = scene.inside(met.p), mi.Spectrum(0.0)
        for where, held in ((inside, medium), (~inside, None)):
            if dr.any(where):
                ray = mi.RayDifferential3f(met.p, wo)
                light += dr.select(where, integrator.sample(world, random, ray, held, where)[0], 0)
        for k in range(channels):
            total[:, k] += np.array(dr.block_sum((weight * light)[k], n), dtype=np.float64)
    x, w = (np.array(a, dtype=np.float64).T for a in (point, w))
    sun = (
        probes.sun.irradiance * phase(w @ np.array(scene.to_sun()), scene.g) * np.exp(-depth_to_sun(scene, x))
    )
    return (total / spp + sun[:, None]).reshape(size, size, channels)
