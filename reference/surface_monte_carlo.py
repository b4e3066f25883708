r"""Light among diffuse surfaces by random walks in float64 NumPy: a second route beside Mitsuba.

A scene's spheres, rectangles and upright boxes are read from its dictionaries; rays, hits and sampling are
worked out here. Walks run backwards from the eye. With rho the reflectance, V what a shadow ray finds, L_sun
and r the sun's radiance and angular radius, Omega = 2 pi (1 - cos r) its solid angle,

    L(o, w) = L_sun or L_sky where the ray o + t w meets nothing, else at the point met, of normal n,
    L       = rho / pi Omega L_sun V(s) n . s + rho L'(w'),   s uniform in the sun, w' ~ n . w' / pi,

where L' leaves out the sun's disk, whose light the first term has counted already. Back faces are black.
The sun stands where the scene's Mitsuba form has it: SUN_DISTANCE from the origin.

Vectors have the shape (3, n). Lengths are in m, radiance in W m^-2 sr^-1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scenes.mitsuba_parts import SUN_DISTANCE, direction
from scenes.sunlit import Sunlit

LIFT = 1e-9
"""m: rays start this far above the surface that they leave."""


@dataclass(frozen=True)
class Ball:
    """centre (3,), radius."""

    centre: np.ndarray
    radius: float


@dataclass(frozen=True)
class Rectangle:
    """centre (3,), half edges u and v (3,), perpendicular; the front is where u x v points."""

    centre: np.ndarray
    u: np.ndarray
    v: np.ndarray


@dataclass(frozen=True)
class Box:
    """Lower and upper corner (3,), edges along the axes."""

    low: np.ndarray
    high: np.ndarray


Shape = Ball | Rectangle | Box


def shapes(surfaces: dict) -> list[tuple[Shape, float]]:
    """Shapes with grey reflectances, from Mitsuba dictionaries by name. Raises ValueError for others."""
    return [(_shape(s), float(s["bsdf"]["reflectance"]["value"])) for s in surfaces.values()]


def _shape(description: dict) -> Shape:
    if description["type"] == "sphere":
        return Ball(np.array(description["center"], np.float64), description["radius"])
    matrix = np.array(description["to_world"].matrix, np.float64)
    u, v, _, centre = matrix[:3].T
    if description["type"] == "rectangle":
        return Rectangle(centre, u, v)
    half = np.diag(matrix)[:3]
    if description["type"] != "cube" or not np.array_equal(matrix[:3, :3], np.diag(half)):
        raise ValueError(f"a {description['type']} of this pose has no intersection here")
    return Box(centre - half, centre + half)


def distance(shape: Shape, o: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Distance (n,) at which rays from outside first meet a shape, infinite where they miss it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        if isinstance(shape, Ball):
            toward = shape.centre[:, None] - o
            along = dot(toward, w)
            inside = shape.radius**2 - dot(toward, toward) + along**2
            t = along - np.sqrt(np.maximum(inside, 0))
            return np.where((inside > 0) & (t > 0), t, np.inf)
        if isinstance(shape, Rectangle):
            n = normal_of(shape)
            t = (n @ shape.centre - n @ o) / (n @ w)
            at = o + np.where(np.isfinite(t), t, 0) * w - shape.centre[:, None]
            on = (np.abs(shape.u @ at) <= shape.u @ shape.u) & (np.abs(shape.v @ at) <= shape.v @ shape.v)
            return np.where(on & (t > 0) & np.isfinite(t), t, np.inf)
        near, far = box_span(shape.low, shape.high, o, w)
        return np.where((near > 0) & (near < far), near, np.inf)


def box_span(
    low: np.ndarray, high: np.ndarray, o: np.ndarray, w: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distances (n,) at which rays enter and leave a box along the axes; near > far where they miss."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low[:, None] - o) / w, (high[:, None] - o) / w
    return np.fmin(a, b).max(axis=0), np.fmax(a, b).min(axis=0)


def normal_of(shape: Rectangle) -> np.ndarray:
    """Unit normal (3,)."""
    n = np.cross(shape.u, shape.v)
    return n / np.linalg.norm(n)


def outward(shape: Shape, p: np.ndarray) -> np.ndarray:
    """Unit normals (3, n) at points of a shape."""
    if isinstance(shape, Ball):
        return (p - shape.centre[:, None]) / shape.radius
    if isinstance(shape, Rectangle):
        return np.repeat(normal_of(shape)[:, None], p.shape[1], axis=1)
    middle, half = 0.5 * (shape.low + shape.high), 0.5 * (shape.high - shape.low)
    at = (p - middle[:, None]) / half[:, None]
    axis = np.argmax(np.abs(at), axis=0)
    return np.sign(at) * (np.arange(3)[:, None] == axis)


def first_hits(
    known: list[tuple[Shape, float]], o: np.ndarray, w: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance (n,), unit normal (3, n) and reflectance (n,) of what each ray meets first."""
    nearest, which = np.full(o.shape[1], np.inf), np.full(o.shape[1], -1)
    for i, (shape, _) in enumerate(known):
        t = distance(shape, o, w)
        which[t < nearest] = i
        nearest = np.minimum(nearest, t)
    normal, reflectance = np.zeros_like(w), np.zeros(o.shape[1])
    for i in np.unique(which[which >= 0]):
        hit, (shape, rho) = which == i, known[i]
        normal[:, hit] = outward(shape, o[:, hit] + nearest[hit] * w[:, hit])
        reflectance[hit] = np.where(dot(normal[:, hit], w[:, hit]) < 0, rho, 0.0)
    return nearest, normal, reflectance


def blocked(known: list[tuple[Shape, float]], o: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Whether anything lies along each ray (n,)."""
    found = np.zeros(o.shape[1], bool)
    for shape, _ in known:
        found |= np.isfinite(distance(shape, o, w))
    return found


def eye_rays(
    sensor: dict, size: int, samples: int = 1, rng: np.random.Generator | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Origins and unit directions (3, size^2 samples) of a perspective or orthographic camera's dictionary:
    `samples` rays uniform over each pixel, or through its centre without rng; row by row from the top."""
    to_world = np.array(sensor["to_world"].matrix, np.float64)
    pixel = np.repeat(np.arange(size * size), samples)
    jitter = np.full((2, len(pixel)), 0.5) if rng is None else rng.random((2, len(pixel)))
    x, y = 1 - 2 * (np.stack([pixel % size, pixel // size]) + jitter) / size
    if sensor["type"] == "perspective":
        edge = math.tan(0.5 * math.radians(sensor["fov"]))
        o, w = np.zeros((3, len(pixel))), np.stack([edge * x, edge * y, np.ones_like(x)])
    else:
        o, w = np.stack([x, y, np.zeros_like(x)]), np.broadcast_to([[0.0], [0.0], [1.0]], (3, len(pixel)))
    return to_world[:3, :3] @ o + to_world[:3, 3:], unit(to_world[:3, :3] @ w)


def radiance(
    scene: Sunlit, size: int, samples: int, rng: np.random.Generator, reflections: float = math.inf
) -> np.ndarray:
    """Radiance (size, size, 1), the mean of `samples` walks a pixel; light that met at most so many
    surfaces (1: the scene's direct radiance)."""
    known, toward = shapes(scene.surfaces()), np.array(direction(scene.light_elevation, scene.light_azimuth))
    r, has_sun = scene.light_radius, scene.sun_irradiance > 0
    sun = scene.sun_irradiance / (math.pi * math.sin(r) ** 2)
    o, w = eye_rays(scene.sensor(size), size, samples, rng)
    total, lane, weight, met = np.zeros(o.shape[1]), np.arange(o.shape[1]), np.ones(o.shape[1]), 0
    while len(lane):
        t, n, rho = first_hits(known, o, w)
        out = np.isinf(t)
        axis, cosine = disk(toward, r, o[:, out])
        in_sun = has_sun & (dot(axis, w[:, out]) > cosine)
        total[lane[out]] += weight[out] * np.where(in_sun, sun if met == 0 else 0.0, scene.sky)
        if met >= reflections:
            break
        o, n, lane = (o + t * w)[:, ~out] + LIFT * n[:, ~out], n[:, ~out], lane[~out]
        weight, met = weight[~out] * rho[~out], met + 1
        if has_sun:
            axis, cosine = disk(toward, r, o)
            s = within_cone(axis, cosine, rng)
            lit = (dot(n, s) > 0) & ~blocked(known, o, s)
            solid_angle = 2 * math.pi * (1 - cosine)
            total[lane] += weight / math.pi * solid_angle * sun * lit * dot(n, s)
        w = cosine_weighted(n, rng)
    return total.reshape(size, size, samples).mean(axis=2)[..., None]


def disk(toward: np.ndarray, r: float, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The sun from points p (3, n): unit axis (3, n) and cosine of its angular radius (n,)."""
    axis = SUN_DISTANCE * toward[:, None] - p
    squared = dot(axis, axis)
    return axis / np.sqrt(squared), np.sqrt(1 - (SUN_DISTANCE * math.sin(r)) ** 2 / squared)


def within_cone(axis: np.ndarray, cosine: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Unit directions (3, n), uniform in solid angle about unit axes (3, n) up to an angle of that cosine."""
    height = 1 - rng.random(axis.shape[1]) * (1 - cosine)
    return about(axis, height, rng)


def cosine_weighted(n: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Unit directions (3, k) of density n . w / pi about unit normals (3, k)."""
    return about(n, np.sqrt(rng.random(n.shape[1])), rng)


def about(axis: np.ndarray, cosine: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Unit directions (3, n) of that cosine with unit axes (3, n), uniform in azimuth."""
    aside = np.where(np.abs(axis[0]) < 0.9, [[1.0], [0], [0]], [[0], [1.0], [0]])
    a = unit(np.cross(axis, aside, axis=0))
    b = np.cross(axis, a, axis=0)
    azimuth, sine = 2 * np.pi * rng.random(len(cosine)), np.sqrt(np.maximum(1 - cosine**2, 0))
    return unit(cosine * axis + sine * (np.cos(azimuth) * a + np.sin(azimuth) * b))


def unit(v: np.ndarray) -> np.ndarray:
    """v (3, n) over its length."""
    return v / np.sqrt(dot(v, v))


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Scalar products (n,) of (3, n) with (3, n)."""
    return np.einsum("in,in->n", a, b)
