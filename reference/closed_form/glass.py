"""Ordered alpha compositing of all layers that a ray meets, in float64."""

from __future__ import annotations

import numpy as np

from reference.truth import closed_form
from scenes.contract import RADIANCE
from scenes.glass import GlassSheets


@closed_form(GlassSheets, RADIANCE)
def radiance(scene: GlassSheets, size: int) -> np.ndarray:
    """C = sum_i a c_i prod_{j<i} (1 - a) + C_wall prod_j (1 - a), nearest first; (size, size, 3)."""
    rays = pinhole(scene, size)
    layers = scene.layers()
    depth = np.stack([hits(sheet, rays) for sheet in layers])
    colour = np.array([sheet.colour for sheet in layers])
    order = np.argsort(depth, axis=0, kind="stable")
    image, passing = np.zeros((size, size, 3)), np.ones((size, size, 1))
    for nth in order:
        met = np.isfinite(np.take_along_axis(depth, nth[None], axis=0)[0])
        opacity = np.where(met, scene.alpha, 0.0)[..., None]
        image += passing * opacity * colour[nth]
        passing *= 1 - opacity
    return image + passing * wall(scene, rays)


def pinhole(scene: GlassSheets, size: int) -> np.ndarray:
    """Rays (x, 1, z) through the centres of the samples, row by row from the top; (size, size, 3)."""
    s = (2 * np.arange(size) + 1) / size - 1
    edge = np.tan(np.radians(scene.FOV) / 2)
    x, z = np.meshgrid(edge * s, -edge * s)
    return np.stack([x, np.ones_like(x), z], axis=-1)


def hits(sheet, rays: np.ndarray) -> np.ndarray:
    """Depth along y (m) where each ray meets the sheet, infinite where it does not."""
    c, u, v = (np.array(e) for e in (sheet.centre, sheet.u, sheet.v))
    n = np.cross(u, v)
    y = (n @ c) / (rays @ n)
    met = y[..., None] * rays - c
    a, b = (met @ np.cross(e, n) / (f @ np.cross(e, n)) for e, f in ((v, u), (u, v)))
    inside = np.maximum(np.abs(a), np.abs(b)) <= sheet.half
    return np.where(inside, y, np.inf)


def wall(scene: GlassSheets, rays: np.ndarray) -> np.ndarray:
    """Radiance of the checkered wall behind everything: the first colour where both or neither of the
    half periods are odd."""
    texels = scene.CHECKS * (scene.WALL * rays[..., [0, 2]] / scene.WALL_HALF + 1)
    odd = np.floor(texels).astype(int).sum(axis=-1) % 2 == 1
    first, second = (scene.brightness * np.array(c) for c in scene.WALL_COLOURS)
    return np.where(odd[..., None], second, first)
