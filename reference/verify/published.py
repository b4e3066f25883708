r"""Numbers that others printed, against renders, our own random walks and our own integral equations.

A conservative slab of isotropic scattering, optical depth tau, under a uniform sky (Milne's equation):

    J(t) = E_2(t) / 2 + int_0^tau E_1(|t - s|) J(s) ds / 2
    T = 2 E_3(tau) + 2 int_0^tau J(s) E_2(tau - s) ds

Chandrasekhar's H for isotropic conservative scattering, and Hopf's constant:

    1 / H(mu) = int_0^1 mu' H(mu') / (mu + mu') dmu' / 2,      q = sqrt(3) / 2 int_0^1 mu^2 H(mu) dmu

Light of irradiance 1 across its rays at cosine mu0 is reflected by a thick slab into cosine mu as

    L = mu0 H(mu) H(mu0) / (4 pi) [1 / (mu + mu0) - 1 / (tau + 2 q)],

with an error that falls exponentially with tau (H. C. van de Hulst, Multiple Light Scattering, 1980).
A slab's radiance in a uniform sky is, by reciprocity, what it reflects of a beam along the line of sight.
"""

from __future__ import annotations

import mitsuba as mi
import numpy as np
from scipy.special import expn

from reference import slab_monte_carlo as walk
from reference.verify import form_factors, slabs
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.rendered import BLACK, joined, mean_of
from scenes.mitsuba_parts import film, point_sun, uniform_sky

HEASLET_WARMING = {0.1: 0.9157, 0.2: 0.8491, 0.5: 0.7040, 2.0: 0.3900, 3.0: 0.3016, 5.0: 0.2077}
"""Optical depth: transmittance."""
H_FUNCTION = {0.1: 1.24735, 0.2: 1.45035, 0.5: 2.01278, 1.0: 2.90781}
"""Cosine: H."""
THICK = 8.0
BATCHES = 16
VAN_DE_HULST = {"reflectance": 0.09739, "transmittance": 0.66096}
"""Optical depth 2, albedo 0.9, Henyey and Greenstein's phase function of g = 0.75, a beam straight down."""
GIOVANELLI = 0.2600
"""Share of a beam straight down that comes back from a half-space, with what its surface reflects: albedo
0.9, isotropic scattering, index 1.5."""
HOWELL = {"parallel squares": 0.1998, "squares with a common edge": 0.2000, "coaxial disks": 0.382}
"""Squares as far apart as they are wide, squares at right angles, disks as far apart as their radius."""


@check(
    "published",
    claim="a conservative slab under a uniform sky lets pass what Heaslet and Warming printed",
    routes=("volpath, float64 random walk and integral equation", "printed"),
    citation="M. A. Heaslet, R. F. Warming, Int. J. Heat Mass Transfer 8, 979-994 (1965)",
)
def heaslet_warming(seed: int) -> list[Comparison]:
    """`within` is two units of the last digit: the integral equation has 0.70417 where 0.7040 is printed."""
    depths = list(HEASLET_WARMING)
    printed = Sampled.exact(list(HEASLET_WARMING.values()))
    rng = np.random.default_rng(seed)
    walked = [[walked_transmittance(t, rng) for t in depths] for _ in range(BATCHES)]
    solved = Sampled.exact([milne_transmittance(t) for t in depths])
    found = {
        "volpath": slabs.transmittances([(t, 0.0) for t in depths], seed),
        "random walk": Sampled.of(walked),
        "integral equation": solved,
    }
    return [Comparison(label, sampled, printed, within=2e-4) for label, sampled in found.items()]


@check(
    "published",
    claim="a thick conservative slab reflects what Chandrasekhar's H function and Hopf's constant say",
    routes=("volpath, float64 random walk and integral equation", "printed"),
    citation="S. Chandrasekhar, Radiative Transfer (1950), table XI; E. Hopf, Mathematical Problems of "
    "Radiative Equilibrium (1934)",
)
def chandrasekhar_h(seed: int) -> list[Comparison]:
    """`within` is half a unit of the last printed digit for H and q, and what that does to L."""
    cosines, printed = np.array(list(H_FUNCTION)), np.array(list(H_FUNCTION.values()))
    nodes, weights, h = h_function()
    at = 1 / (weights * nodes * h / (cosines[:, None] + nodes)).sum(axis=1) * 2
    q = np.sqrt(3) / 2 * (weights * nodes**2 * h).sum()
    pairs = [(1.0, 1.0), (0.2, 1.0), (0.5, 0.1)]
    law = np.array([reflected(mu, mu0) for mu, mu0 in pairs])
    rng = np.random.default_rng(seed)
    walked = [[walked_reflection(mu, mu0, rng) for mu, mu0 in pairs] for _ in range(BATCHES)]
    seen = joined([mean_of(sunlit_slab(mu, mu0), 8, BATCHES, seed) for mu, mu0 in pairs])
    return [
        Comparison("H by integral equation", Sampled.exact(at), Sampled.exact(printed), within=0.5e-5),
        Comparison("q by H", Sampled.exact([q]), Sampled.exact([slabs.HOPF]), within=0.5e-6),
        Comparison("L by random walk", Sampled.of(walked), Sampled.exact(law)),
        Comparison("L by volpath", seen, Sampled.exact(law), within=1e-4 * law),
    ]


@check(
    "published",
    claim="a slab and a half-space that absorb give back what van de Hulst and Giovanelli printed",
    routes=("volpath and float64 random walk", "printed"),
    citation="H. C. van de Hulst, Multiple Light Scattering (1980), table 35; R. G. Giovanelli, Optica Acta "
    "2, 153 (1955); both as cited by L. Wang, S. L. Jacques, L. Zheng, Comput. Methods Programs Biomed. 47, "
    "131 (1995)",
)
def absorbing_slabs(seed: int) -> list[Comparison]:
    """`within` is half a unit of the last digit. The half-space is a slab of depth 10, which reflects all but
    1e-4 of it, and no thicker, since rays start a fixed distance inside a surface (`light_laws`)."""
    printed = Sampled.exact(list(VAN_DE_HULST.values()))
    rng = np.random.default_rng(seed)
    walked = [walk.slab_fluxes(2.0, 1.0, 0.9, 0.75, 25_000, rng) for _ in range(BATCHES)]
    medium = slabs.slab(2.0, 0.75, 0.9)
    glow = {"emitter": {"type": "area", "radiance": {"type": "rgb", "value": 1.0}}}
    lit = {
        "reflectance": {"sky": uniform_sky(1.0), "floor": slabs.ground()},
        "transmittance": {"floor": slabs.ground(**glow)},
    }
    seen = joined([mean_of(seen_straight(medium, **lit[k]), 8, BATCHES, seed) for k in VAN_DE_HULST])
    glass = {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}
    half_space = {**slabs.slab(10.0, 0.0, 0.9), "bsdf": glass}
    back = mean_of(seen_straight(half_space, **lit["reflectance"]), 8, BATCHES, seed)
    return [
        Comparison("slab by random walk", Sampled.of(walked), printed, within=0.5e-5),
        Comparison("slab by volpath", seen, printed, within=0.5e-5),
        Comparison("half-space by volpath", back, Sampled.exact([GIOVANELLI]), within=0.5e-4),
    ]


@check(
    "published",
    claim="squares and disks light each other by the printed configuration factors",
    routes=("path and closed form", "printed"),
    citation="J. R. Howell, A Catalog of Radiation Heat Transfer Configuration Factors, C-11, C-14, C-41",
)
def configuration_factors(seed: int) -> list[Comparison]:
    """`within` is half a unit of the last digit."""
    printed = Sampled.exact(list(HOWELL.values()))
    digits = np.array([0.5e-4, 0.5e-4, 0.5e-3])
    closed = [
        form_factors.parallel_squares(1.0),
        form_factors.perpendicular_squares(),
        form_factors.coaxial_disks(1.0),
    ]
    seen = joined([mean_of(facing(kind), 8, 16, seed) for kind in HOWELL], 1 / np.pi)
    return [
        Comparison("closed form", Sampled.exact(closed), printed, within=digits),
        Comparison("path", seen, printed, within=digits),
    ]


def walked_transmittance(tau: float, rng: np.random.Generator, strata: int = 4, photons: int = 2000) -> float:
    """One estimate of T by slab_fluxes: the squares of the cosines of a uniform sky are even in (0, 1)."""
    squares = (np.arange(strata) + rng.random(strata)) / strata
    return float(np.mean([walk.slab_fluxes(tau, c, 1.0, 0.0, photons, rng)[1] for c in np.sqrt(squares)]))


def milne_transmittance(tau: float, n: int = 200) -> float:
    """T by Nystrom's method on n Gauss points that crowd at both faces, the pole of E_1 taken off; n = 400
    changes it by less than 1e-6."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    u = 0.5 * (nodes + 1)
    s, ds = tau * u**2 * (3 - 2 * u), 0.5 * weights * tau * 6 * u * (1 - u)
    apart = np.abs(s[:, None] - s) + np.eye(n)
    kernel = 0.5 * expn(1, apart) * ds * (1 - np.eye(n))
    whole = 0.5 * (2 - expn(2, s) - expn(2, tau - s))
    j = np.linalg.solve(np.diag(1 + kernel.sum(axis=1) - whole) - kernel, 0.5 * expn(2, s))
    return float(2 * expn(3, tau) + 2 * (ds * j * expn(2, tau - s)).sum())


def h_function(n: int = 128) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes, weights and H at the nodes, by iteration from the mean of H and its image."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    u = 0.5 * (nodes + 1)
    mu, dmu = u**3, 0.5 * weights * 3 * u**2
    h = 1 + 1.9 * mu
    for _ in range(2000):
        h = 0.5 * (h + 2 / (dmu * mu * h / (mu[:, None] + mu)).sum(axis=1))
    return mu, dmu, h


def reflected(mu: float, mu0: float) -> float:
    """L of a slab of depth THICK by the printed numbers."""
    h = mu0 * H_FUNCTION[mu] * H_FUNCTION[mu0] / (4 * np.pi)
    return h * (1 / (mu + mu0) - 1 / (THICK + 2 * slabs.HOPF))


def walked_reflection(mu: float, mu0: float, rng: np.random.Generator, n: int = 3000) -> float:
    """One estimate of L by our random walk, seen and lit in one vertical plane."""
    w = np.broadcast_to([np.sqrt(1 - mu**2), 0.0, -mu], (n, 3))
    p = np.zeros((n, 3))
    p[:, 2] = THICK
    l = np.array([np.sqrt(1 - mu0**2), 0.0, mu0])
    return float(walk.radiance(p, w, walk.slab(THICK), l, 1.0, 0.0, rng).mean())


def sunlit_slab(mu: float, mu0: float) -> dict:
    """A slab of depth THICK under a sun of irradiance 1 at cosine mu0, seen at cosine mu."""
    sun = point_sun([float(np.sqrt(1 - mu0**2)), 0.0, mu0], 1.0)
    return seen_straight(slabs.slab(THICK, 0.0), mu, sun=sun)


def seen_straight(medium: dict, mu: float = 1.0, **more: dict) -> dict:
    """A slab seen from above at cosine mu, with lights."""
    eye = [float(4 * np.sqrt(1 - mu**2)), 0.0, 1 + 4 * mu]
    to_world = mi.ScalarTransform4f().look_at(eye, [0, 0, 1], [0, 1, 0]).scale([0.1, 0.1, 1])
    sensor = {
        "type": "orthographic",
        "near_clip": 1e-3,
        "far_clip": 1e5,
        "to_world": to_world,
        "film": film(8),
    }
    return {"type": "scene", "slab": medium, "sensor": sensor, **more}


def facing(kind: str) -> dict:
    """A glowing plane and a meter of the same shape, black both."""
    glow = {"type": "area", "radiance": {"type": "rgb", "value": 1.0}}
    move = mi.ScalarTransform4f()
    places = {
        "parallel squares": ("rectangle", move.translate([0, 0, 2]).rotate([1, 0, 0], 180)),
        "squares with a common edge": ("rectangle", move.translate([1, 0, 1]).rotate([0, 1, 0], -90)),
        "coaxial disks": ("disk", move.translate([0, 0, 1]).rotate([1, 0, 0], 180)),
    }
    shape, to_world = places[kind]
    light = {"type": shape, "to_world": to_world, "bsdf": BLACK, "emitter": glow}
    return {"type": "scene", "light": light, "meter": {"type": shape, "bsdf": BLACK}}
