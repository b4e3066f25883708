r"""Wide slabs of homogeneous media between a sky and a black floor, and the theory of thick ones.

A conservative slab of optical depth tau and mean cosine g, under a uniform sky, lets pass (diffusion theory)

    T = (4 / 3) / (tau* + 2 q),      tau* = (1 - g) tau,

where q is the extrapolation length in transport mean free paths: Hopf's 0.710446 for isotropic scattering,
and no more than EXTRAPOLATION beyond it for Henyey and Greenstein's phase functions of g >= 0 (0.7120 at
g = 0.5, 0.7140 at 0.85, by discrete ordinates). T depends on tau and g through tau* alone: the similarity
relation.
"""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.rendered import BLACK, joined, mean_of
from scenes.mitsuba_parts import uniform_sky

HOPF = 0.710446
EXTRAPOLATION = 0.005
BATCHES = 16
WIDE = 1000.0
"""Half width over height: less than 1e-6 of the light comes or goes by the sides."""


@check(
    "physics",
    claim="thick conservative slabs let pass what diffusion theory says",
    routes=("volpath", "diffusion theory"),
)
def diffusion_limit(seed: int) -> Comparison:
    """Isotropic scattering, optical depths 5 and 8."""
    depths = (5.0, 8.0)
    theory = np.array([diffuse_transmittance(t) for t in depths])
    slack = np.array([spread_of_theory(t) for t in depths])
    return Comparison(
        "depths 5 and 8", transmittances([(t, 0.0) for t in depths], seed), Sampled.exact(theory), slack
    )


@check(
    "physics",
    claim="media of one (1 - g) sigma_s let pass the same light",
    routes=("volpath, g = 0.5", "volpath, g = 0"),
)
def similarity(seed: int) -> Comparison:
    """Optical depths 8 and 4."""
    forward, isotropic = (transmittances([s], 2 * seed + i) for i, s in enumerate(((8.0, 0.5), (4.0, 0.0))))
    return Comparison("tau* = 4", forward, isotropic, within=spread_of_theory(4.0))


def diffuse_transmittance(reduced: float, q: float = HOPF) -> float:
    """T for tau* = reduced."""
    return 4 / 3 / (reduced + 2 * q)


def spread_of_theory(reduced: float) -> float:
    """How much T changes with q by EXTRAPOLATION."""
    return diffuse_transmittance(reduced) - diffuse_transmittance(reduced, HOPF + EXTRAPOLATION)


def transmittances(slabs: list[tuple[float, float]], seed: int) -> Sampled:
    """Shares of a uniform sky's light that pass conservative slabs of (tau, g), one number each."""
    found = [mean_of(over_meter(slab(tau, g)), 8, BATCHES, seed) for tau, g in slabs]
    return joined(found, 1 / np.pi)


def slab(tau: float, g: float, albedo: float = 1.0) -> dict:
    """A slab 0 < z < 1 of optical depth tau."""
    phase = {"type": "hg", "g": g} if g else {"type": "isotropic"}
    return {
        "type": "cube",
        "to_world": mi.ScalarTransform4f().translate([0, 0, 0.5]).scale([WIDE, WIDE, 0.5]),
        "bsdf": {"type": "null"},
        "interior": {"type": "homogeneous", "sigma_t": float(tau), "albedo": albedo, "phase": phase},
    }


def ground(**more: dict) -> dict:
    """A black floor below the slab, with an emitter where one is given."""
    to_world = mi.ScalarTransform4f().translate([0, 0, -0.02]).scale([10 * WIDE, 10 * WIDE, 1])
    return {"type": "rectangle", "to_world": to_world, "bsdf": BLACK, **more}


def over_meter(medium: dict) -> dict:
    """A slab under a sky of radiance 1; the meter lies on the floor."""
    patch = {"type": "disk", "to_world": mi.ScalarTransform4f().translate([0, 0, -0.01]), "bsdf": BLACK}
    return {"type": "scene", "slab": medium, "floor": ground(), "sky": uniform_sky(1.0), "meter": patch}
