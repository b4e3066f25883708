r"""Laws of light in empty space and in media that only absorb.

A point light of intensity I at height h over a diffuse floor of albedo rho, r from a point x of it:

    L(x) = rho / pi  I cos(theta) / r^2,      cos(theta) = h / r      (inverse square, cosine)

A sphere of radius a and radiance I / (pi a^2) that stands above the horizon gives the same at any a. A disk
that faces the floor, of radiance I / (pi a^2) too, gives E = I / (a^2 + h^2) below its centre: the point
light's I / h^2 within (a / h)^2.

Mitsuba draws directions to a sphere from a cone whose 1 - cos(alpha), sin(alpha) = a / r, is a difference of
float32 numbers: HALF_ULP / (1 - cos(alpha)) of the light may be made or lost, 0.5 % at alpha = 0.005.

Bouguer and Beer: what absorbs lets exp(-tau) pass, tau = int sigma_t ds. Of a volume on a grid, linear
between voxel centres and constant beyond them, tau of a column is the mean of its voxels times its height.
Mitsuba starts a ray that enters a medium RAY_EPSILON (1 + max |p|) further on, so that a little of tau is
missed, and of light as much again: OFFSET tau.
"""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from reference.verify.agreement import FLOAT32, Sampled
from reference.verify.checks import Comparison, check
from reference.verify.rendered import BLACK, from_above, image_of, joined, mean_of, pixel_means
from scenes.mitsuba_parts import diffuse, point_sun, uniform_sky

INTENSITY = 3.0  # W/sr
ALBEDO = 0.5
DEPTHS = (0.1, 0.5, 1.0, 2.0)
VOXELS = 16
HALF_ULP = 2.0**-24
RAY_EPSILON = 1500 * 2.0**-24
"""Mitsuba's RayEpsilon in float32, in units of 1 + max |p|."""
OFFSET = 3 * RAY_EPSILON
"""For the plate of height 1 between z = 1 and z = 2."""


@check(
    "physics",
    claim="a point light falls off with the square of the distance and with the cosine",
    routes=("path", "closed form"),
)
def inverse_square_and_cosine(seed: int) -> list[Comparison]:
    """Off-centre lights at three heights, 16 x 16 pixels of the floor."""
    found = []
    for height in (0.5, 2.0, 8.0):
        at = (0.3, -0.2, height)
        light = {
            "type": "point",
            "position": list(at),
            "intensity": {"type": "rgb", "value": INTENSITY},
        }
        closed = pixel_means(lambda x, y, at=at: ALBEDO / np.pi * irradiance_of_point(x, y, at), 16)
        found.append(Comparison(f"light at {height:g} m", image_of(floor(light), 16, 8, seed), closed))
    return found


@check(
    "physics",
    claim="a shrinking light of constant intensity comes to light as a point does",
    routes=("path", "point light in closed form"),
)
def limit_of_small_lights(seed: int) -> list[Comparison]:
    """Spheres, which do so at any size, and disks above the point that they light; a / h from 0.5 to 0.01.
    `within` is what float32 makes of the cone, and how far from a point the disk is."""
    found = []
    for radius in (0.5, 0.1, 0.01):
        closed = pixel_means(lambda x, y: ALBEDO / np.pi * irradiance_of_point(x, y, (0, 0, 1)), 16)
        image = image_of(floor(sphere_light(radius)), 16, 16, seed)
        lost = HALF_ULP / (1 - np.sqrt(1 - radius**2 / 3)) + FLOAT32
        found.append(Comparison(f"sphere, a / h = {radius}", image, closed, within=lost * closed.mean))
    for radius in (0.1, 0.01):
        spot = mean_of(floor(disk_light(radius), half_width=1e-3, size=8), 8, 16, seed)
        closed = np.array([ALBEDO / np.pi * INTENSITY])
        found.append(
            Comparison(
                f"disk, a / h = {radius}", spot, Sampled.exact(closed), within=(radius**2 + FLOAT32) * closed
            )
        )
    return found


@check(
    "physics",
    claim="a homogeneous absorber lets exp(-tau) pass",
    routes=("volpath", "closed form"),
)
def beer_in_homogeneous_media(seed: int) -> list[Comparison]:
    """Seen through a plate; and a floor lit through it, straight and at 60 degrees. `within` is OFFSET."""
    seen = joined([mean_of(seen_through(absorber(t)), 16, 16, seed) for t in DEPTHS])
    slanted = [(0.1, 1.0), (0.5, 0.5), (1.0, 1.0), (1.0, 0.5)]
    lit = joined([mean_of(lit_through(absorber(t), c), 16, 16, seed) for t, c in slanted], np.pi / ALBEDO)
    depth, cosine = np.array(slanted).T
    found = (("seen through", seen, np.array(DEPTHS), 1.0), ("lit through", lit, depth, cosine))
    return [
        Comparison(
            label,
            sampled,
            Sampled.exact(c * np.exp(-t / c)),
            within=(FLOAT32 + OFFSET * t / c) * c * np.exp(-t / c),
        )
        for label, sampled, t, c in found
    ]


@check(
    "physics",
    claim="an absorber on a grid lets exp(-int sigma_t ds) pass",
    routes=("volpath", "closed form"),
)
def beer_in_grids(seed: int) -> Comparison:
    """The shadow of an uneven plate on a floor, 16 x 16 pixels as its voxels are. `within` is OFFSET."""
    density = uneven_density()
    column = density.mean(axis=0)
    closed = pixel_means(lambda x, y: ALBEDO / np.pi * np.exp(-between_voxels(column, x, y)), VOXELS)
    image = image_of(lit_through(grid_absorber(density), 1.0), VOXELS, 16, seed)
    return Comparison("shadow", image, closed, within=(FLOAT32 + OFFSET * column.max()) * closed.mean)


def irradiance_of_point(x: np.ndarray, y: np.ndarray, at: tuple[float, float, float]) -> np.ndarray:
    """Irradiance (W/m^2) of the floor at (x, y, 0) by the point light at `at`."""
    squared = (x - at[0]) ** 2 + (y - at[1]) ** 2 + at[2] ** 2
    return INTENSITY * at[2] / squared**1.5


def floor(light: dict, half_width: float = 1.0, size: int = 16) -> dict:
    """A diffuse floor at z = 0 under a light, seen by a camera close above it."""
    return {
        "type": "scene",
        "floor": {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(10), "bsdf": diffuse(ALBEDO)},
        "light": light,
        "sensor": from_above(0.1, half_width, size),
    }


def glow(radius: float) -> dict:
    """An emitter of the radiance that gives INTENSITY to an area of pi radius^2."""
    radiance = INTENSITY / (np.pi * radius**2)
    return {"type": "area", "radiance": {"type": "rgb", "value": float(radiance)}}


def sphere_light(radius: float) -> dict:
    """A black sphere that glows, 1 m above the origin."""
    return {"type": "sphere", "center": [0, 0, 1], "radius": radius, "bsdf": BLACK, "emitter": glow(radius)}


def disk_light(radius: float) -> dict:
    """A black disk that glows downwards, 1 m above the origin."""
    to_world = mi.ScalarTransform4f().translate([0, 0, 1]).rotate([1, 0, 0], 180).scale(radius)
    return {"type": "disk", "to_world": to_world, "bsdf": BLACK, "emitter": glow(radius)}


def plate(medium: dict) -> dict:
    """A wide plate of a medium between z = 1 and z = 2."""
    to_world = mi.ScalarTransform4f().translate([0, 0, 1.5]).scale([100, 100, 0.5])
    return {"type": "cube", "to_world": to_world, "bsdf": {"type": "null"}, "interior": medium}


def absorber(depth: float) -> dict:
    """A medium of albedo 0 and extinction `depth` (1/m)."""
    return {"type": "homogeneous", "sigma_t": float(depth), "albedo": 0.0}


def seen_through(medium: dict) -> dict:
    """A plate against a sky of radiance 1."""
    return {
        "type": "scene",
        "plate": plate(medium),
        "sky": uniform_sky(1.0),
        "sensor": from_above(3.0, 1.0, 16),
    }


def lit_through(medium: dict, cosine: float) -> dict:
    """A floor below a plate and a sun of irradiance 1 at that cosine from straight above."""
    sun = point_sun([float(np.sqrt(1 - cosine**2)), 0.0, cosine], 1.0)
    return {**floor(sun), "plate": plate(medium)}


def uneven_density() -> np.ndarray:
    """Extinction at the voxels [z, y, x] of a plate 1 m high, between 0 and 3 1/m."""
    z, y, x = (np.mgrid[0:VOXELS, 0:VOXELS, 0:VOXELS] + 0.5) / VOXELS
    return 1.5 + 0.75 * np.sin(9 * x + 4 * z) + 0.75 * np.cos(7 * y - 5 * z)


def grid_absorber(density: np.ndarray) -> dict:
    """A medium of albedo 0 on a grid over |x|, |y| < 1 and 1 < z < 2."""
    to_world = mi.ScalarTransform4f().translate([-1, -1, 1]).scale([2, 2, 1])
    grid = mi.VolumeGrid(np.ascontiguousarray(density[..., None], np.float32))
    sigma_t = {"type": "gridvolume", "grid": grid, "filter_type": "trilinear", "to_world": to_world}
    return {"type": "heterogeneous", "sigma_t": sigma_t, "albedo": 0.0}


def between_voxels(values: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """values [y, x] at voxel centres of [-1, 1]^2, bilinear between them and constant beyond."""
    n = values.shape[0]
    at = [np.clip((t + 1) / 2 * n - 0.5, 0, n - 1) for t in (x, y)]
    low = [np.minimum(t.astype(int), n - 2) for t in at]
    u, v = (t - i for t, i in zip(at, low, strict=True))
    i, j = low
    below = (1 - u) * values[j, i] + u * values[j, i + 1]
    above = (1 - u) * values[j + 1, i] + u * values[j + 1, i + 1]
    return (1 - v) * below + v * above
