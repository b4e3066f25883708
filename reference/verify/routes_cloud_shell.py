"""The shell of cloud against points strewn along each ray, which know only how far they are from the Earth's
centre and what the cloud is there."""

from __future__ import annotations

import numpy as np

from reference.closed_form.cloud_shell import shell_depth
from reference.closed_form.fog import pinhole_rays
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import BATCHES, SIZE, name
from scenes.cloud_shell import CloudShell
from scenes.contract import TRANSMITTANCE

STRATA = 128
REPEATS = 16
"""Whether a stretch's end is met by a point is yes or no: so many make its share a number."""
FARTHEST = 6e5  # m, beyond where any of these rays has left the shell


@check(
    "route",
    claim="the optical depth of a shell is what points along the ray find",
    routes=("stratified points", "closed form"),
    scenes=("CloudShell",),
)
def shell_against_points(seed: int) -> list[Comparison]:
    """From the ground up and across the horizon, from within, and from above past the Earth's limb."""
    rng = np.random.default_rng(seed)
    cases = (
        CloudShell(elevation=2.0, wavelength=20000.0),
        CloudShell(elevation=40.0, rolls=0.0),
        CloudShell(height=3000.0, elevation=2.0, wavelength=20000.0),
        CloudShell(height=9000.0, elevation=4.0, wavelength=20000.0),
    )
    return [
        Comparison(
            f"{name(scene, TRANSMITTANCE)}: optical depth",
            Sampled.of([strewn(scene, SIZE, rng) for _ in range(BATCHES)]),
            Sampled.exact(shell_depth(scene, SIZE)),
        )
        for scene in cases
    ]


def strewn(scene: CloudShell, size: int, rng: np.random.Generator) -> np.ndarray:
    """An unbiased estimate of the optical depth (size, size, 1): REPEATS times one point in each of
    STRATA equal parts of FARTHEST, none of them counted beyond the first that lies under the ground."""
    origin, w = pinhole_rays(*scene.eye(), scene.FIELD_OF_VIEW, size)
    part = FARTHEST / STRATA
    depth = np.empty((size, size, 1))
    for row in range(size):
        t = (np.arange(STRATA) + rng.random((REPEATS, size, STRATA))) * part
        p = origin + t[..., None] * w[row][:, None, :]
        height = np.linalg.norm(p + np.array([0, 0, scene.RADIUS]), axis=-1) - scene.RADIUS
        seen = ~np.maximum.accumulate(height < 0, axis=-1)
        inside = seen & (height > scene.BOTTOM) & (height < scene.TOP)
        density = 1 + scene.rolls * np.cos(2 * np.pi / scene.wavelength * p[..., 0])
        depth[row, :, 0] = scene.sigma * part * (density * inside).sum(axis=-1).mean(axis=0)
    return depth
