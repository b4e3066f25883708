r"""Transmittance of puffs of cloud behind hills, in float64.

A ray that passes the middle of a puff of radius R at the distance h has the optical depth

    optical_depth (1 - h^2 / R^2)^(5/2),   since int (1 - u^2)^2 du over [-1, 1] is 16/15.

Rays that meet a hill meet it before any cloud, and have the transmittance 1.
"""

from __future__ import annotations

import numpy as np

from reference.closed_form.fog import pinhole_rays
from reference.truth import closed_form
from scenes.contract import TRANSMITTANCE
from scenes.moving_clouds import HILLS, PUFFS, MovingClouds


@closed_form(MovingClouds, TRANSMITTANCE)
def moving_transmittance(scene: MovingClouds, size: int) -> np.ndarray:
    """T = exp(-tau), 0 to 1, at the centres of size x size samples of the last frame."""
    return np.exp(-moving_depth(scene, size))


def moving_depth(scene: MovingClouds, size: int) -> np.ndarray:
    """Optical depth (size, size, 1) of the last frame, 0 on the hills."""
    o, w = pinhole_rays(*scene.eye(), scene.FIELD_OF_VIEW, size)
    return depth_along(scene, o, w)[..., None]


def depth_along(scene: MovingClouds, o: np.ndarray, w: np.ndarray, blown: np.ndarray | float = 0.0):
    """Optical depth (...) of rays from o (3,) along w (..., 3), with the puffs where they were when they had
    still to be blown by so much (m, (3,))."""
    depth, hidden = np.zeros(w.shape[:-1]), np.zeros(w.shape[:-1], bool)
    for *centre, radius in PUFFS:
        along, inner = chord(np.subtract(centre, blown), radius, o, w)
        depth += np.where(along > 0, scene.optical_depth * inner**2.5, 0)
    for *centre, radius in HILLS:
        along, inner = chord(np.array(centre, np.float64), radius, o, w)
        hidden |= (along > 0) & (inner > 0)
    return np.where(hidden, 0, depth)


def chord(centre: np.ndarray, radius: float, o: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far along (m) rays pass nearest to a ball's middle, and 1 - h^2 / R^2 there, 0 where they miss."""
    toward = centre - o
    along = w @ toward
    return along, np.maximum(1 - (toward @ toward - along**2) / radius**2, 0)
