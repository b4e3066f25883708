r"""Transmittance of a shell of cloud round the Earth, in float64.

Spheres of height k are met where t = -b +- sqrt(b^2 - c), b = (R + h) m, c = (h - k) (2 R + h + k); along
a stretch [t0, t1] of a ray whose direction has the component d_x the sheets have the optical depth

    sigma [t1 - t0 + rolls (sin(q t1) - sin(q t0)) / q],   q = 2 pi d_x / wavelength.
"""

from __future__ import annotations

import numpy as np

from reference.closed_form.fog import pinhole_rays
from reference.truth import closed_form
from scenes.cloud_shell import CloudShell
from scenes.contract import TRANSMITTANCE


@closed_form(CloudShell, TRANSMITTANCE)
def shell_transmittance(scene: CloudShell, size: int) -> np.ndarray:
    """T = exp(-tau), 0 to 1, at the centres of size x size samples."""
    return np.exp(-shell_depth(scene, size))


def shell_depth(scene: CloudShell, size: int) -> np.ndarray:
    """Optical depth (size, size, 1) to the ground or through all of the shell."""
    origin, w = pinhole_rays(*scene.eye(), scene.FIELD_OF_VIEW, size)
    h, m = origin[2], w[..., 2]
    ground = spheres(scene.RADIUS, 0.0, h, m)[0]
    end = np.where(ground > 0, ground, np.inf)
    top, base = spheres(scene.RADIUS, scene.TOP, h, m), spheres(scene.RADIUS, scene.BOTTOM, h, m)
    within = _sheets(scene, w, *_clipped(top, end))
    return (within - _sheets(scene, w, *_clipped(base, end)))[..., None]


def spheres(radius: float, height: float, h: float, m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (m) at which rays from height h with the elevation's sine m cross the sphere of a height,
    nan where they do not."""
    b, c = (radius + h) * m, (h - height) * (2 * radius + h + height)
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b * b - c)
    far = -(b + np.copysign(root, b))
    one, other = far, c / far
    return np.minimum(one, other), np.maximum(one, other)


def _clipped(crossings: tuple[np.ndarray, np.ndarray], end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The part ahead of the camera and before `end`, of no length where there is none."""
    near, far = (np.clip(np.nan_to_num(t, nan=0.0), 0, end) for t in crossings)
    return near, far


def _sheets(scene: CloudShell, w: np.ndarray, t0: np.ndarray, t1: np.ndarray) -> np.ndarray:
    q = 2 * np.pi / scene.wavelength * w[..., 0]
    middle, half = 0.5 * q * (t0 + t1), 0.5 * (t1 - t0)
    waves = 2 * half * np.cos(middle) * np.sinc(q * half / np.pi)
    return scene.sigma * (t1 - t0 + scene.rolls * waves)
