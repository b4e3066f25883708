"""Closed forms of ground and sky against Mitsuba, along rays through pixel centres."""

from __future__ import annotations

import math

import mitsuba as mi
import numpy as np

from reference.closed_form import canyon, sky_frames
from reference.verify.checks import Comparison, check
from reference.verify.routes import SIZE
from reference.verify.routes_closed_form import compared
from scenes.contract import DIRECT_RADIANCE, RADIANCE
from scenes.mitsuba_parts import SUN_DISTANCE, environment_light
from scenes.sky_frames import SkyFrames
from scenes.terrain import Canyon

REACH = 5.0
"""Of the points seen of a canyon from the origin, m."""
ENDS = 1e-4
"""Of the sky, that comes in at the ends of a canyon."""
ROWS = 1024
"""Of the image of the sky that is compared, which must show its smallest clouds."""


@check(
    "route",
    claim="direct light in a canyon is what lunes and a cap say",
    routes=("direct", "closed form"),
    scenes=("Canyon",),
)
def canyon_against_direct(seed: int) -> list[Comparison]:
    """As wide as deep; narrow with a small high sun; wide with a low sun along it."""
    scenes = (
        Canyon(),
        Canyon(width=0.3, light_radius=0.05, light_elevation=80.0),
        Canyon(width=4.0, light_elevation=20.0, light_azimuth=100.0),
    )
    found = []
    for scene in scenes:
        sun = scene.sun_irradiance / (math.pi * math.sin(scene.light_radius) ** 2)
        shifted = abs(sun - scene.sky) * 2 * math.sin(scene.light_radius) * REACH / SUN_DISTANCE
        within = scene.albedo / math.pi * shifted + ENDS * scene.sky
        closed = canyon.canyon_direct(scene, SIZE)
        found.append(compared(scene, DIRECT_RADIANCE, closed, seed, 256, within))
    return found


@check(
    "route",
    claim="a polished ball shows the sky that the formula gives",
    routes=("path with envmap", "closed form"),
    scenes=("SkyFrames",),
)
def sky_against_envmap(seed: int) -> list[Comparison]:
    """Two skies without the sun's disk, whose edge the image of the environment blurs."""
    scenes = SkyFrames(sun_irradiance=0.0), SkyFrames(sun_irradiance=0.0, sun_elevation=70.0, cloudiness=0.2)
    found = []
    for scene in scenes:
        closed = sky_frames.sky_frame(scene, SIZE)
        description = scene.mitsuba(SIZE) | {"sky": environment_light(scene.radiance, ROWS)}
        found.append(compared(scene, RADIANCE, closed, seed, 16, between_texels(scene), description))
    return found


def between_texels(scene: SkyFrames) -> np.ndarray:
    """Largest error (SIZE, SIZE, 3) of a bilinear look-up: an eighth of the second differences over a texel
    along its two sides; the whole radiance next to the horizon, where the sky ends."""
    w = np.array(sky_frames.mirrored(scene, SIZE), np.float64)
    h = math.pi / ROWS
    east = np.stack([-w[1], w[0], 0 * w[0]]) / np.hypot(w[0], w[1])
    north = np.cross(w, east, axis=0)

    def sky(v: np.ndarray) -> np.ndarray:
        return np.array(
            scene.radiance(mi.Vector3f((v / np.linalg.norm(v, axis=0)).astype(np.float32))), np.float64
        )

    around = [np.abs(sky(w + h * d) + sky(w - h * d) - 2 * sky(w)) for d in (east, north)]
    bound = np.where(np.abs(w[2]) < 3 * h, sky(w), 0.25 * sum(around) + 1e-3 * sky(w))
    return bound.T.reshape(SIZE, SIZE, 3)
