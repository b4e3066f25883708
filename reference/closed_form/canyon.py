r"""Direct light in the Canyon scene, in float64.

What a point of the trench sees of the sky is a lune: on the floor between the planes through it and the two
upper edges, on a wall between its own plane and the one through the opposite edge. With H_1 and H_2 the
hemispheres above those planes and c the sun's disk,

    E_sun = n . Phi(c H_1 H_2),    E_sky = n . Phi(H_1 H_2) - E_sun (the sun hides sky),
    L     = albedo / pi (L_sun E_sun + L_sky E_sky).

The trench is taken to be endless; in Mitsuba it ends 100 m away, which adds 1e-4 of the sky at most.
"""

from __future__ import annotations

import math

import numpy as np

from reference.closed_form.caps import vector_irradiance
from reference.closed_form.valley import HALF, camera_rays
from reference.truth import closed_form
from scenes.contract import DIRECT_RADIANCE
from scenes.mitsuba_parts import direction
from scenes.terrain import Canyon


@closed_form(Canyon, DIRECT_RADIANCE)
def canyon_direct(scene: Canyon, size: int) -> np.ndarray:
    """Radiance (W m^-2 sr^-1), (size, size, 1): light that met one surface, and the sky where it is seen."""
    p, n, valid = first_hits(scene, *camera_rays(scene, size))
    sky, sun = irradiance(scene, p, n)
    if scene.sun_irradiance > 0:
        sun_radiance = scene.sun_irradiance / (math.pi * math.sin(scene.light_radius) ** 2)
        total = scene.sky * sky + (sun_radiance - scene.sky) * sun
    else:
        total = scene.sky * sky
    return np.where(valid, scene.albedo / math.pi * total, scene.sky).reshape(size, size, 1)


def first_hits(scene: Canyon, o: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (n, 3), unit normals (n, 3), and whether there is one, of rays from o (3,) along w (n, 3)."""
    half, depth = 0.5 * scene.width, scene.DEPTH
    nearest = np.full(len(w), np.inf)
    normals = np.tile([0.0, 0.0, 1.0], (len(w), 1))
    for axis, at, normal in (
        (2, depth, (0, 0, 1)),
        (2, 0, (0, 0, 1)),
        (0, -half, (1, 0, 0)),
        (0, half, (-1, 0, 0)),
    ):
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (at - o[axis]) / w[:, axis]
            p = o + t[:, None] * w
            upright = (p[:, 2] > 0) & (p[:, 2] < depth)
            on = upright if axis == 0 else (np.abs(p[:, 0]) > half) == (at > 0)
            here = (t > 0) & (t < nearest) & on & (np.abs(p[:, :2]) < scene.FAR * (1 + 1e-9)).all(axis=1)
        nearest = np.where(here, t, nearest)
        normals[here] = normal
    valid = np.isfinite(nearest)
    return o + np.where(valid, nearest, 0)[:, None] * w, normals, valid


def irradiance(scene: Canyon, p: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Irradiance of the whole visible sky over L_sky, and of the visible sun over L_sun, (n,) each."""
    open_ground = (n[:, 2] > 0) & (p[:, 2] > 0.5 * scene.DEPTH)
    planes = lune(scene, p, n)
    toward = np.array(direction(scene.light_elevation, scene.light_azimuth))
    sun = (toward, np.array(scene.light_radius))
    up = (np.array([0.0, 0.0, 1.0]), np.array(HALF))
    sky = np.where(open_ground, np.pi, (n * vector_irradiance(*planes)).sum(axis=1))
    seen = (n * vector_irradiance(sun, *planes)).sum(axis=1)
    return sky, np.where(open_ground, vector_irradiance(sun, up)[..., 2], seen)


def lune(scene: Canyon, p: np.ndarray, n: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """The two hemispheres that bound the visible sky of points of the trench: beside the left edge, which
    the left wall's own plane replaces, and beside the right one."""
    half = 0.5 * scene.width
    planes = []
    for side in (-1, 1):
        edge = np.array([side * half, 0, scene.DEPTH]) - p * [1, 0, 1]
        m = -side * np.stack([edge[:, 2], 0 * edge[:, 0], -edge[:, 0]], axis=-1)
        m = np.where((n[:, 0] * side < 0)[:, None], n, m / np.linalg.norm(m, axis=1, keepdims=True))
        planes.append((m, np.array(HALF)))
    return planes
