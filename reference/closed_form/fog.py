"""Transmittance of height fog from the camera to the first surface or the fog's end, in float64.

Camera rays, first hits and optical depth are worked out here from the scene's numbers alone.

With density b exp(-c z), a segment of length s whose ends lie at heights z0 and z1 has the optical depth
tau = b s exp(-c min(z0, z1)) phi(c |z1 - z0|), phi(t) = (1 - exp(-t)) / t. SIGGRAPH 2006 Course 26, ch. 6.4.
"""

from __future__ import annotations

import math

import numpy as np

from reference.truth import closed_form
from scenes.contract import TRANSMITTANCE
from scenes.fog import FogOverGround


@closed_form(FogOverGround, TRANSMITTANCE)
def fog_transmittance(scene: FogOverGround, size: int) -> np.ndarray:
    """T = exp(-tau), 0 to 1, at the centres of size x size samples."""
    origin, w = pinhole_rays(*scene.eye(), scene.FOV, size)
    length = np.minimum(first_hit(scene, origin, w), box_span(scene.LOW, scene.HIGH, origin, w)[1])
    tau = optical_depth(scene.density, scene.falloff, origin[2], w[..., 2], length)
    return np.exp(-tau)[..., None]


def pinhole_rays(
    eye: list[float], target: list[float], fov: float, size: int
) -> tuple[np.ndarray, np.ndarray]:
    """Origin (3,) and unit directions (size, size, 3), row by row from the top; z is up, fov in degrees."""
    forward = _unit(np.subtract(target, eye).astype(np.float64))
    right = _unit(np.cross(forward, [0.0, 0.0, 1.0]))
    up = np.cross(right, forward)
    across = ((np.arange(size) + 0.5) / size * 2 - 1) * math.tan(math.radians(fov) / 2)
    w = forward + across[None, :, None] * right - across[:, None, None] * up
    return np.array(eye, np.float64), _unit(w)


def first_hit(scene: FogOverGround, origin: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Distance (m) along each ray to the ground, a box or a ball, infinite where it meets none."""
    with np.errstate(divide="ignore"):
        t = -origin[2] / w[..., 2]
    x, y = (origin[i] + t * w[..., i] for i in (0, 1))
    (x0, y0, _), (x1, y1, _) = scene.LOW, scene.HIGH
    on_ground = (t > 0) & (x0 <= x) & (x <= x1) & (y0 <= y) & (y <= y1)
    nearest = np.where(on_ground, t, np.inf)
    for centre, half in scene.boxes().values():
        near, far = box_span(np.subtract(centre, half), np.add(centre, half), origin, w)
        nearest = np.where((near > 0) & (near < far), np.minimum(nearest, near), nearest)
    for centre, radius in scene.balls().values():
        toward = np.asarray(centre) - origin
        along = w @ toward
        inside = radius**2 - (np.sum(toward**2) - along**2)
        near = along - np.sqrt(np.maximum(inside, 0))
        nearest = np.where((inside > 0) & (near > 0), np.minimum(nearest, near), nearest)
    return nearest


def box_span(low, high, origin: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (m) at which rays enter and leave an axis-aligned box; near > far where they miss."""
    with np.errstate(divide="ignore"):
        a, b = (np.asarray(low) - origin) / w, (np.asarray(high) - origin) / w
    return np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)


def optical_depth(b: float, c: float, z: float, slope: np.ndarray, length: np.ndarray) -> np.ndarray:
    """tau of segments that start at height z (m) and rise by `slope` per metre of `length`."""
    rise = slope * length
    t = c * np.abs(rise)
    phi = np.divide(-np.expm1(-t), t, out=np.ones_like(t), where=t > 0)
    return b * length * np.exp(-c * np.minimum(z, z + rise)) * phi


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)
