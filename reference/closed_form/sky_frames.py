"""The sky of SkyFrames, which is given by a formula: the film's frame before anything is done to it."""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from reference.truth import closed_form
from scenes.contract import RADIANCE
from scenes.sky_frames import SkyFrames


@closed_form(SkyFrames, RADIANCE)
def sky_frame(scene: SkyFrames, size: int) -> np.ndarray:
    """Radiance (W m^-2 sr^-1), (size, size, 3), where rays through the pixels' middles leave the ball."""
    return np.array(scene.radiance(mirrored(scene, size)), np.float64).T.reshape(size, size, 3)


def mirrored(scene: SkyFrames, size: int) -> mi.Vector3f:
    """Directions of a polished ball seen from afar: with the eye along e and the unit vector u across it,
    at rho from the middle, the normal is rho u - cos e and the ray leaves along -e cos(2 t) + u sin(2 t),
    where rho = sin t."""
    frame = np.array(scene.sensor(size)["to_world"].matrix, np.float64)[:3, :3]
    right, up, eye = (frame / np.linalg.norm(frame, axis=0)).T
    half = np.linalg.norm(frame[:, 0])
    step = half * (1 - (2 * np.arange(size) + 1) / size)
    y, x = (v.ravel()[:, None] for v in np.meshgrid(step, step, indexing="ij"))
    rho = np.hypot(x, y)
    t = np.arcsin(rho)
    u = (x * right + y * up) / np.maximum(rho, 1e-300)
    w = np.sin(2 * t) * u - np.cos(2 * t) * eye
    return mi.Vector3f(w.T.astype(np.float32))
