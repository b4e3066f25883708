r"""Direct light in the Valley scene, in float64.

A wall point sees its own hemisphere less the other wall, which is a rectangle and so the intersection of four
hemispheres. With c the sun's disk, H the hemisphere about n and W the other wall,

    E_sun = n . [Phi(c H) - Phi(c W)],    E_sky = n . [Phi(H) - Phi(W)] - E_sun (the sun hides sky),
    L     = albedo / pi (L_sun E_sun + L_sky E_sky).

The walls end where the scene's do, 200 m away. Were they infinite, the visible set would be the lune of solid
angle 2 psi between the point's own wall and the other's upper edge, and E_sky would be lower by at most
1e-6 pi. The sun is distant, as the fields say; the scene's Mitsuba form puts it 1e5 m away, which shifts
shadows by at most 1e-4 rad. A sun of irradiance 0 is not there and hides no sky.
"""

from __future__ import annotations

import math

import numpy as np

from reference.closed_form.caps import vector_irradiance
from reference.truth import closed_form
from scenes.contract import DIRECT_RADIANCE
from scenes.mitsuba_parts import direction
from scenes.sunlit import Valley

HALF = 0.5 * np.pi


@closed_form(Valley, DIRECT_RADIANCE)
def valley_direct(scene: Valley, size: int) -> np.ndarray:
    """Radiance (W m^-2 sr^-1), (size, size, 1): light that met one wall, and the sky where it is seen."""
    p, side, valid = first_hits(scene, *camera_rays(scene, size))
    irradiance = scene.sky * irradiance_of_sky(scene, p, side)
    if scene.sun_irradiance > 0:
        sun_radiance = scene.sun_irradiance / (math.pi * math.sin(scene.light_radius) ** 2)
        irradiance += (sun_radiance - scene.sky) * irradiance_of_sun(scene, p, side)
    image = np.where(valid, scene.albedo / math.pi * irradiance, scene.sky)
    return image.reshape(size, size, 1)


def camera_rays(scene: Valley, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Origin (3,) and directions (size^2, 3) through the centres of size x size samples, from the top row."""
    sensor = scene.sensor(size)
    to_world = np.array(sensor["to_world"].matrix, np.float64)
    u = (1 - (2 * np.arange(size) + 1) / size) * math.tan(0.5 * math.radians(sensor["fov"]))
    y, x = np.meshgrid(u, u, indexing="ij")
    local = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    return to_world[:3, 3], local @ to_world[:3, :3].T


def first_hits(
    scene: Valley, origin: np.ndarray, rays: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Wall points (n, 3), the side of each (-1 or 1), and whether it is there. From above the bottom
    (x = 0), a ray towards +x can only meet the right wall and one towards -x only the left."""
    side = np.where(rays[:, 0] > 0, 1.0, -1.0)
    along, normal = wall(scene, side)
    t = -(normal @ origin) / (normal * rays).sum(axis=1)
    p = origin + t[:, None] * rays
    up = (along * p).sum(axis=1)
    valid = (t > 0) & (up > 0) & (up < scene.WALL) & (np.abs(p[:, 1]) < scene.LENGTH)
    return np.where(valid[:, None], up[:, None] * along + p * [0, 1, 0], 0.5 * along), side, valid


def wall(scene: Valley, side: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors up the slope and along the inner normal of the wall of that side, (n, 3)."""
    a = math.radians(scene.slope)
    zero, one = np.zeros_like(side), np.ones_like(side)
    along = np.stack([side * math.cos(a), zero, one * math.sin(a)], axis=-1)
    return along, np.stack([-side * math.sin(a), zero, one * math.cos(a)], axis=-1)


def other_wall(scene: Valley, p: np.ndarray, side: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of each edge of the other wall, seen from p: the axis m of the hemisphere that it bounds (n, 3), and
    the angle that it subtends (n,). The four hemispheres intersect in the wall."""
    up, _ = wall(scene, -side)
    y = np.array([0.0, 1.0, 0.0])
    bottom, top = np.zeros_like(p) - p * [1, 0, 1], scene.WALL * up - p * [1, 0, 1]
    far, near = ((sign * scene.LENGTH - p[:, 1:2]) * y for sign in (1, -1))
    corners = [bottom + near, bottom + far, top + far, top + near]
    middle = sum(corners)
    edges = []
    for b, c in zip(corners, corners[1:] + corners[:1], strict=True):
        m = np.cross(b, c)
        sine = np.linalg.norm(m, axis=1)
        angle = np.arctan2(sine, (b * c).sum(axis=1))
        edges.append((m * (np.sign((m * middle).sum(axis=1)) / sine)[:, None], angle))
    return edges


def irradiance_of_sun(scene: Valley, p: np.ndarray, side: np.ndarray) -> np.ndarray:
    """E_sun over L_sun (n,)."""
    n = wall(scene, side)[1]
    sun = (np.array(direction(scene.light_elevation, scene.light_azimuth)), np.array(scene.light_radius))
    other = [(m, np.array(HALF)) for m, _ in other_wall(scene, p, side)]
    seen = vector_irradiance(sun, (n, np.array(HALF))) - vector_irradiance(sun, *other)
    return (n * seen).sum(axis=1)


def irradiance_of_sky(scene: Valley, p: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Irradiance of the whole visible sky, sun included, over L_sky (n,): the wall is a polygon, whose Phi
    is half the sum of angle times m over its edges (Lambert)."""
    n = wall(scene, side)[1]
    blocked = sum(0.5 * angle * (n * m).sum(axis=1) for m, angle in other_wall(scene, p, side))
    return math.pi - blocked
