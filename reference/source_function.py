"""The source function of a cloud by Mitsuba: what a point scatters towards the eye, all orders.

S(x, w) = int f(w . w') L(x, w') dw' is estimated by drawing w' from the phase function and tracing L
with the volumetric path tracer from inside the medium; a delta sun, which no drawn direction hits, is
added as f(w . l) E_sun e^-tau(x, l).
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from reference.truth import sampler
from scenes.cloud import CloudSlab
from scenes.contract import SOURCE_FUNCTION

LANES = 1 << 20  # paths in flight at once


@sampler(CloudSlab, SOURCE_FUNCTION)
def source_function(scene: CloudSlab, size: int, spp: int, seed: int) -> np.ndarray:
    """(size, size, 1): one batch of spp paths per probe, row by row as `probes` says."""
    world = mi.load_dict(scene.mitsuba(size))
    medium = world.shapes()[0].interior_medium()
    integrator = mi.load_dict({"type": "volpath", "max_depth": -1, "rr_depth": 100000})
    probes = scene.probes(size)
    point, w, l = probes.camera.origin, probes.camera.direction, probes.sun.direction

    total = np.zeros(size * size)
    chunk = max(1, LANES // size**2)
    for first in range(0, spp, chunk):
        n = min(chunk, spp - first)
        random = mi.load_dict({"type": "independent"})
        random.seed((seed << 12) + first // chunk, size * size * n)
        lane = dr.arange(mi.UInt32, size * size * n) // n
        met = dr.zeros(mi.MediumInteraction3f, size * size * n)
        met.p = dr.gather(mi.Point3f, point, lane)
        met.wi = -dr.gather(mi.Vector3f, w, lane)
        met.sh_frame = mi.Frame3f(met.wi)
        met.t = 0.0
        context = mi.PhaseFunctionContext(random)
        wo, weight, _ = medium.phase_function().sample(context, met, random.next_1d(), random.next_2d())
        light, _, _ = integrator.sample(world, random, mi.RayDifferential3f(met.p, wo), medium)
        total += np.array(dr.block_sum((weight * light).x, n), dtype=np.float64)
    sun = _unscattered(scene, probes.sun.irradiance, np.array(point)[2], np.array(w), np.array(l)[:, 0])
    return (total / spp + sun).reshape(size, size, 1)


def _unscattered(
    scene: CloudSlab, irradiance: float, z: np.ndarray, w: np.ndarray, l: np.ndarray
) -> np.ndarray:
    g, depth = scene.g, (1.0 - z) * scene.sigma_t * scene.precipitation / l[2]
    cosine = l @ w
    return irradiance * np.exp(-depth) * (1 - g**2) / (4 * np.pi * (1 + g**2 - 2 * g * cosine) ** 1.5)
