r"""Energy is neither made nor lost: the white furnace.

Where radiance 1 comes from everywhere, what conserves energy is invisible.

    diffuse, albedo 1          L = 1
    cavity                     L = e / (1 - rho)       walls that emit e and reflect rho
    conservative medium        L = 1                   whatever its depth, phase function and density
    smooth glass, from outside L = 1                   R + T = 1, and T carries n^2 / n^2
    smooth glass, from inside  L = n^2                 L / n^2 is constant along a ray

A rough surface of one scattering loses what its masking holds back. With G = G_1(i) G_1(o) (Smith) and
normals m drawn as they are seen from i, D_i(m), the light that a mirror and a glass of index n give back are

    A = int D_i(m) G_1(r, m) dm,      r = 2 (i . m) m - i
    A = int D_i(m) [F G_1(r, m) + (1 - F) G_1(t, m) / n^2] dm,

where F is Fresnel's reflectance at i . m and t the refracted direction; A < 1.
"""

from __future__ import annotations

from functools import cache

import mitsuba as mi
import numpy as np
from numpy.polynomial import Chebyshev

from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.rendered import image_of, mean_of, pixel_means
from scenes.mitsuba_parts import diffuse, film, orthographic, perspective, uniform_sky

INDEX = 1.5
QUADRATURE = 2e-5
TILT = 35.0  # deg from straight down


@check(
    "physics",
    claim="a white surface is invisible in a white furnace; rough ones keep what one scattering keeps",
    routes=("path", "float64 quadrature over visible normals"),
)
def furnace_of_surfaces(seed: int) -> list[Comparison]:
    """A plane seen at 0 to 80 degrees from its normal, 16 x 16 pixels."""
    rough = {"distribution": "ggx", "int_ior": INDEX, "ext_ior": 1.0}
    found = [Comparison("diffuse", image_of(plane(diffuse(1.0)), 16, 16, seed), _exact_image(1.0, 16))]
    for alpha in (0.1, 0.5):
        mirror = {"type": "roughconductor", "material": "none", "distribution": "ggx", "alpha": alpha}
        glass = {"type": "roughdielectric", "alpha": alpha, **rough}
        for label, bsdf, index in (("mirror", mirror, None), ("glass", glass, INDEX)):
            kept = kept_by_one_scattering(alpha, index)
            found.append(
                Comparison(
                    f"rough {label}, alpha {alpha}",
                    image_of(plane(bsdf), 16, 16, seed),
                    pixel_means(lambda x, y, kept=kept: kept(cosine_of_view(x, y)), 16),
                    within=QUADRATURE,
                )
            )
    return found


@check(
    "physics",
    claim="a closed cavity of emittance e and reflectance rho holds the radiance e / (1 - rho)",
    routes=("path", "closed form"),
)
def furnace_of_interreflection(seed: int) -> list[Comparison]:
    """Seen from off the centre of a cube; mean over the image."""
    return [
        Comparison(f"rho {rho}", mean_of(cavity(rho), 8, 32, seed), Sampled.exact([1 / (1 - rho)]))
        for rho in (0.5, 0.9)
    ]


@check(
    "physics",
    claim="a medium of albedo 1 is invisible in a white furnace",
    routes=("volpath", "closed form"),
)
def furnace_of_media(seed: int) -> list[Comparison]:
    """Balls of several optical diameters and phase functions, one of uneven density; mean over the image."""
    balls = [(0.5, 0.0), (5.0, -0.5), (5.0, 0.85), (20.0, 0.0)]
    found = [(f"depth {t:g}, g {g:g}", ball(homogeneous(t / 2, g))) for t, g in balls]
    found.append(("uneven, depth up to 6, g 0.5", ball(uneven(3.0, 0.5))))
    return [Comparison(label, mean_of(d, 8, 16, seed), Sampled.exact([1.0])) for label, d in found]


@check(
    "physics",
    claim="L / n^2 is the same along a ray through lossless glass, and R + T = 1",
    routes=("path", "closed form"),
)
def radiance_through_glass(seed: int) -> list[Comparison]:
    """A ball and a plate of glass in a white furnace from outside, and the ball from its centre."""
    glass = {"type": "dielectric", "int_ior": INDEX, "ext_ior": 1.0}
    look = orthographic([0, -5, 0], [0, 0, 0], 0.7, 8)
    sky = uniform_sky(1.0)
    solid = {"type": "sphere", "radius": 1.0, "bsdf": glass}
    plate = {"type": "cube", "to_world": mi.ScalarTransform4f().scale([100, 0.1, 100]), "bsdf": glass}
    tilted = orthographic([0, -5, 8], [0, 0, 0], 0.7, 8)
    inside = perspective([0, 0, 0], [0, 1, 0.2], 80, 8)
    cases = {
        "through a ball": ({"type": "scene", "ball": solid, "sky": sky, "sensor": look}, 1.0),
        "through a plate": ({"type": "scene", "plate": plate, "sky": sky, "sensor": tilted}, 1.0),
        "within a ball": ({"type": "scene", "ball": solid, "sky": sky, "sensor": inside}, INDEX**2),
    }
    return [Comparison(n, image_of(d, 8, 8, seed), _exact_image(v, 8)) for n, (d, v) in cases.items()]


def plane(bsdf: dict) -> dict:
    """A wide disk at z = 0 in a sky of radiance 1, seen from z = 1 by a camera tilted by TILT."""
    t = np.radians(TILT)
    return {
        "type": "scene",
        "plane": {"type": "disk", "to_world": mi.ScalarTransform4f().scale(1e4), "bsdf": bsdf},
        "sky": uniform_sky(1.0),
        "sensor": {
            "type": "perspective",
            "fov": 90.0,
            "to_world": mi.ScalarTransform4f().look_at(
                [0, 0, 1], [0, float(np.sin(t)), 1 - float(np.cos(t))], [0, 0, 1]
            ),
            "film": film(16),
        },
    }


def cosine_of_view(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Cosine between the plane's normal and the ray of the image point (x, y) in [-1, 1]^2, y upwards."""
    t = np.radians(TILT)
    return (np.cos(t) - y * np.sin(t)) / np.sqrt(1 + x**2 + y**2)


def cavity(rho: float) -> dict:
    """The inside of a cube that emits radiance 1 and reflects rho."""
    return {
        "type": "scene",
        "walls": {
            "type": "cube",
            "flip_normals": True,
            "bsdf": diffuse(rho),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 1.0}},
        },
        "sensor": perspective([0.3, -0.5, 0.1], [0, 1, 0], 70, 8),
    }


def homogeneous(sigma_t: float, g: float, albedo: float = 1.0) -> dict:
    """A medium of extinction sigma_t (1/m) with Henyey and Greenstein's phase function."""
    return {"type": "homogeneous", "sigma_t": sigma_t, "albedo": albedo, "phase": {"type": "hg", "g": g}}


def uneven(greatest: float, g: float) -> dict:
    """A medium whose extinction (1/m) rises and falls between 0 and `greatest` in a cube from -1 to 1."""
    z, y, x = np.mgrid[0:8, 0:8, 0:8] / 7
    density = 0.5 + 0.5 * np.sin(5 * x + 3 * y) * np.cos(4 * z + x)
    grid = mi.VolumeGrid(np.ascontiguousarray(greatest * density[..., None], np.float32))
    to_world = mi.ScalarTransform4f().translate([-1, -1, -1]).scale(2)
    sigma_t = {"type": "gridvolume", "grid": grid, "filter_type": "trilinear", "to_world": to_world}
    return {"type": "heterogeneous", "sigma_t": sigma_t, "albedo": 1.0, "phase": {"type": "hg", "g": g}}


def ball(medium: dict) -> dict:
    """A ball of radius 1 of a medium in a sky of radiance 1; the image lies within its outline."""
    return {
        "type": "scene",
        "ball": {"type": "sphere", "radius": 1.0, "bsdf": {"type": "null"}, "interior": medium},
        "sky": uniform_sky(1.0),
        "sensor": orthographic([0, -5, 0], [0, 0, 0], 0.7, 8),
    }


def kept_by_one_scattering(alpha: float, index: float | None) -> Chebyshev:
    """A as a function of the cosine of i >= 0.1, for GGX roughness alpha; a mirror where index is None.

    Within QUADRATURE of 512 Gauss points at any cosine.
    """
    return Chebyshev.interpolate(
        lambda cosines: [_kept(c, alpha, index, 256) for c in cosines], deg=20, domain=[0.1, 1.0]
    )


def _kept(cosine: float, alpha: float, index: float | None, n: int) -> float:
    """n Gauss points in t and n / 4 even ones in azimuth of half the disk of radii sin t, which Heitz's map
    takes to half the normals visible from i (JCGT 7(4), 2018)."""
    i = np.array([np.sqrt(1 - cosine**2), 0.0, cosine])
    nodes, weights = gauss_points(n)
    half = np.pi * ((np.arange(n // 4) + 0.5) / (n // 4) - 0.5)
    t, azimuth = np.meshgrid(np.pi / 4 * (nodes + 1), half, indexing="ij")
    weights = (weights * np.pi / 4)[:, None] * np.sin(2 * t) / half.size
    h = i * [alpha, alpha, 1]
    h /= np.linalg.norm(h)
    a = np.array([0.0, 1.0, 0.0])
    b = np.cross(h, a)
    p, q = np.sin(t) * np.cos(azimuth), np.sin(t) * np.sin(azimuth)
    s = 0.5 * (1 + h[2])
    q = (1 - s) * np.sqrt(1 - p**2) + s * q
    m = p[..., None] * a + q[..., None] * b + np.sqrt(np.maximum(1 - p**2 - q**2, 0))[..., None] * h
    m = m * [alpha, alpha, 1]
    m /= np.linalg.norm(m, axis=-1, keepdims=True)
    along = (m * i).sum(axis=-1)
    reflected = 2 * along[..., None] * m - i
    mirrored = np.where(reflected[..., 2] > 0, smith(reflected, alpha), 0)
    if index is None:
        return float((weights * mirrored).sum())
    deep = np.sqrt(1 - (1 - along**2) / index**2)
    fresnel = 0.5 * (
        ((along - index * deep) / (along + index * deep)) ** 2
        + ((index * along - deep) / (index * along + deep)) ** 2
    )
    refracted = (along / index - deep)[..., None] * m - i / index
    passed = np.where(refracted[..., 2] < 0, smith(refracted, alpha), 0)
    return float((weights * (fresnel * mirrored + (1 - fresnel) * passed / index**2)).sum())


@cache
def gauss_points(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes on (-1, 1) and weights; finding them takes longer than one quadrature."""
    return np.polynomial.legendre.leggauss(n)


def smith(w: np.ndarray, alpha: float) -> np.ndarray:
    """G_1 of GGX for unit directions w (..., 3)."""
    return 2 / (1 + np.sqrt(1 + alpha**2 * (w[..., 0] ** 2 + w[..., 1] ** 2) / w[..., 2] ** 2))


def _exact_image(value: float, size: int) -> Sampled:
    return Sampled.exact(np.full((size, size, 1), value))
