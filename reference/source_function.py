"""The source function of a cloud by Mitsuba: what a point scatters towards the eye, all orders.

S(x, w) = int f(w . w') L(x, w') dw' is estimated by drawing w' from the phase function and tracing L
with the volumetric path tracer from inside the medium; a delta sun, which no drawn direction hits, is
added as f(w . l) E_sun e^-tau(x, l). What that first term alone sends to the camera, light scattered once,
has a closed form for the layer and is a smooth integral along the chord of the ball. Under a sky S has
colours.
"""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.special import exprel

from reference import transport
from reference.closed_form.cloud_grid import depth_to_sun
from reference.render import batch_seed
from reference.truth import closed_form, sampler
from scenes.cloud import CloudSlab, CloudSphere, SunlitCloud
from scenes.contract import SINGLE_SCATTERING, SOURCE_FUNCTION, View
from scenes.cumulus import Cumulus, GridCloud

LANES = 1 << 20  # paths in flight at once
PANELS, NODES = 12, 8  # of the Gauss rule along a chord; more beyond an optical depth of 64


@sampler(CloudSlab, SOURCE_FUNCTION)
def in_slab(scene: CloudSlab, size: int, spp: int, seed: int) -> np.ndarray:
    """(size, size, 1): one batch of spp paths per probe, row by row as `probes` says."""
    probes = scene.probes(size)
    z = np.array(probes.camera.origin, dtype=np.float64)[2]
    depth = scene.rainy[0] * (1 - z) / scene.to_sun()[2]
    return scattered(scene, probes, spp, seed) + _of_sun(scene, probes, depth)


@sampler(Cumulus, SOURCE_FUNCTION)
def in_grid(scene: GridCloud, size: int, spp: int, seed: int) -> np.ndarray:
    """(size, size, C): one batch of spp paths per probe, row by row as `probes` says; C = 3 under a sky and
    1 under the sun alone."""
    probes = scene.probes(size)
    depth = depth_to_sun(scene, np.array(probes.camera.origin, dtype=np.float64).T)
    return scattered(scene, probes, spp, seed) + _of_sun(scene, probes, depth)


def scattered(scene: SunlitCloud | GridCloud, probes: View, spp: int, seed: int) -> np.ndarray:
    """(size, size, C): what the probes scatter of all light but the sun's own."""
    size = probes.width
    description = scene.mitsuba(size)
    world = mi.load_dict(description)
    medium = world.shapes()[0].interior_medium()
    integrator = mi.load_dict(transport.integrator(description, SOURCE_FUNCTION))
    point, w = mi.Point3f(probes.camera.origin), probes.camera.direction

    total = np.zeros((size * size, 1 if probes.environment is None else 3))
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
        light, _, _ = integrator.sample(world, random, mi.RayDifferential3f(met.p, wo), medium)
        for k in range(total.shape[1]):
            total[:, k] += np.array(dr.block_sum((weight * light)[k], n), dtype=np.float64)
    return total.reshape(size, size, -1) / spp


def _of_sun(scene: SunlitCloud | GridCloud, probes: View, depth: np.ndarray) -> np.ndarray:
    w = np.array(probes.camera.direction, dtype=np.float64)
    once = probes.sun.irradiance * _lobe(scene, w) * np.exp(-depth)
    return once.reshape(probes.height, probes.width, 1)


@closed_form(CloudSlab, SINGLE_SCATTERING)
def once_scattered_by_slab(scene: CloudSlab, size: int) -> np.ndarray:
    """(size, size, 1): albedo f E_sun int_0^tau e^-(t/m) e^-(d/s) dt/m, m and s the cosines of view ray and
    sun with the vertical; d = t seen from above, tau - t from below."""
    view, (tau, albedo) = scene.view(size), scene.rainy
    w = np.array(view.camera.direction, dtype=np.float64)
    a, b = 1 / np.abs(w[2]), 1 / scene.to_sun()[2]
    if scene.seen == "above":
        integral = tau * a * exprel(-tau * (a + b))
    else:
        integral = tau * a * np.exp(-tau * np.minimum(a, b)) * exprel(-tau * np.abs(a - b))
    return _image(view, albedo * _lobe(scene, w) * integral)


@closed_form(CloudSphere, SINGLE_SCATTERING)
def once_scattered_by_sphere(scene: CloudSphere, size: int) -> np.ndarray:
    """(size, size, 1): albedo f E_sun int e^-(sigma t) e^-(sigma out(x)) sigma dt over the chord, where
    out(x) is the way from x to the boundary towards the sun, by a composite Gauss rule in the angle u with
    t = half (1 - cos(pi u)), since out may start and end as a root does."""
    view, (sigma, albedo) = scene.view(size), scene.rainy
    l, o = np.array(scene.to_sun()), np.array(view.camera.origin, dtype=np.float64)
    half = np.sqrt(np.maximum(1 - o[0] ** 2 - o[2] ** 2, 0))
    x, weight = leggauss(NODES)
    integral = np.zeros(size * size)
    panels = math.ceil(PANELS * max(1, sigma / 32))
    for panel in range(panels):
        for u, du in zip((panel + (x + 1) / 2) / panels, weight / (2 * panels), strict=True):
            t = half * (1 - np.cos(np.pi * u))
            middle = -(l[0] * o[0] + l[1] * (t - half) + l[2] * o[2])
            inside = o[0] ** 2 + (t - half) ** 2 + o[2] ** 2
            out = middle + np.sqrt(np.maximum(1 - inside + middle**2, 0))
            integral += half * np.pi * np.sin(np.pi * u) * du * sigma * np.exp(-sigma * (t + out))
    w = np.array([[0.0], [1.0], [0.0]])
    return _image(view, albedo * _lobe(scene, w) * integral)


def _image(view: View, radiance_per_irradiance: np.ndarray) -> np.ndarray:
    return view.sun.irradiance * radiance_per_irradiance.reshape(view.height, view.width, 1)


def _lobe(scene: SunlitCloud, w: np.ndarray) -> np.ndarray:
    """Henyey-Greenstein between the ways to the sun and from eye to sample (3, n)."""
    g, cosine = scene.g, np.array(scene.to_sun()) @ w
    return (1 - g**2) / (4 * np.pi * (1 + g**2 - 2 * g * cosine) ** 1.5)
