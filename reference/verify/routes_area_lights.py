"""Irradiance of glowing shapes in closed form against Mitsuba, along rays through pixel centres."""

from __future__ import annotations

import math

import numpy as np

from reference.closed_form import area_lights
from reference.verify.checks import Comparison, check
from reference.verify.routes import SIZE
from reference.verify.routes_closed_form import compared
from scenes.area_lit import AreaLitPlane, DiffuseAreaLitPlane, LitFloor, RoundLitPlane, pattern
from scenes.contract import DIRECT_RADIANCE


@check(
    "route",
    claim="a floor gets from spheres, disks and rectangles what Lambert's contour integral says",
    routes=("direct", "closed form"),
    scenes=("DiffuseAreaLitPlane",),
)
def contours_against_direct(seed: int) -> list[Comparison]:
    """Each shape above the floor and cut by it; facing down, aside and upwards; wider than the picture."""
    cases = (
        DiffuseAreaLitPlane(shape="sphere"),
        DiffuseAreaLitPlane(shape="sphere", height=0.3),
        DiffuseAreaLitPlane(shape="disk", tilt=0.0),
        DiffuseAreaLitPlane(shape="disk", tilt=90.0, height=0.2),
        DiffuseAreaLitPlane(),
        DiffuseAreaLitPlane(tilt=120.0),
        DiffuseAreaLitPlane(tilt=90.0, height=0.1),
        DiffuseAreaLitPlane(tilt=0.0, size=8.0),
    )
    found = [(s, area_lights.diffuse_floor(s, SIZE)) for s in cases]
    return [compared(s, DIRECT_RADIANCE, closed, seed, 256) for s, closed in found]


@check(
    "route",
    claim="a floor gets from a tube what a prism of many strips gives it",
    routes=("direct", "contour integrals of strips"),
    scenes=("RoundLitPlane",),
)
def tubes_against_direct(seed: int) -> list[Comparison]:
    """Aslant above the floor, cut by it, and level close to it."""
    cases = [
        RoundLitPlane(shape="tube", specular=0.0, **given)
        for given in ({}, {"height": 0.2}, {"tilt": 0.0, "height": 0.1})
    ]
    return [compared(s, DIRECT_RADIANCE, floor_under(s), seed, 256) for s in cases]


@check(
    "route",
    claim="a rectangle with a picture on it shines as its texels do, one small rectangle each",
    routes=("direct", "contour integrals of texels"),
    scenes=("AreaLitPlane",),
)
def picture_against_direct(seed: int) -> Comparison:
    """64 x 64 pieces, each with the bilinear value at its middle."""
    scene = AreaLitPlane(shape="textured", specular=0.0, albedo=0.5)
    light, p = scene.light(), area_lights.floor_points(SIZE)
    n = 64
    e = np.zeros((len(p), 3))
    for i in range(n):
        for j in range(n):
            s, t = (i + 0.5) / n, (j + 0.5) / n
            middle = light.centre + (2 * s - 1) * light.u + (2 * t - 1) * light.v
            piece = area_lights.rectangle(p, middle, light.u / n, light.v / n)
            e += piece[:, None] * bilinear(s, t)
    closed = (scene.albedo / math.pi * light.radiance * e).reshape(SIZE, SIZE, 3)
    return compared(scene, DIRECT_RADIANCE, closed, seed, 256, within=1e-3 * closed)


def floor_under(scene: LitFloor) -> np.ndarray:
    """Radiance (SIZE, SIZE, 1) of a diffuse floor at pixel centres."""
    light, p = scene.light(), area_lights.floor_points(SIZE)
    e = area_lights.SHAPES[light.shape](p, light.centre, light.u, light.v)
    return (scene.albedo / math.pi * light.radiance * e).reshape(SIZE, SIZE, 1)


def bilinear(s: float, t: float) -> np.ndarray:
    """The pattern's factor (3,) at (s, t), texel centres half a texel from the edges, clamped."""
    texels = pattern()[::-1]
    n = len(texels)
    x, y = (np.clip(n * c - 0.5, 0, n - 1) for c in (s, t))
    i, j = min(int(x), n - 2), min(int(y), n - 2)
    fx, fy = x - i, y - j
    rows = (1 - fy) * texels[j] + fy * texels[j + 1]
    return (1 - fx) * rows[i] + fx * rows[i + 1]
