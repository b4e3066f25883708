r"""Sky visibility and distance among balls and boxes, in float64.

Openness is the cosine-weighted share of the hemisphere about the normal n that nothing hides.

BallOverFloor, R the radius, D the distance from a floor point to the centre at height H, t the angle between
n and the vertical:
    on the floor  1 - (R / D)^2 H / D          all of the ball is above the floor's horizon
    on the ball   (1 + cos t) / 2              the floor hides all that is below the horizon
Groove, m the normal of the plane through the point and the other wall's upper edge:
    on a wall     (1 + n . m) / 2              the sky is the lune between the two planes; 1 on a ridge
Floors and walls are taken to be endless; the scenes' end FAR away, which adds 2 h / (pi FAR) at a height h.

The signed distance of a union is the least of its parts' outside, and inside where no part's boundary that is
nearer lies within another part, as in the slice of SolidsUnderSky. Of a box of half edges h, with q = |p| - h
in its own axes, it is |max(q, 0)| + min(max q_i, 0).
"""

from __future__ import annotations

import math

import numpy as np

from reference.surface_monte_carlo import eye_rays
from reference.truth import closed_form
from scenes.contract import DISTANCE, SKY_VISIBILITY, Solid
from scenes.fields import BallOverFloor, Groove, SolidsUnderSky


@closed_form(BallOverFloor, SKY_VISIBILITY)
def openness_round_ball(scene: BallOverFloor, size: int) -> np.ndarray:
    """(size, size, 1), 0 to 1."""
    o, w = eye_rays(scene.sensor(size), size)
    height = 1 + scene.gap
    rise = o - np.array([[0.0], [0.0], [height]])
    b, c = (rise * w).sum(axis=0), (rise * rise).sum(axis=0) - 1
    hits_ball = b * b > c
    n = rise + (-b - np.sqrt(np.where(hits_ball, b * b - c, 0))) * w
    p = o - o[2] / w[2] * w
    distance = np.sqrt(p[0] ** 2 + p[1] ** 2 + height**2)
    image = np.where(hits_ball, 0.5 * (1 + n[2]), 1 - height / distance**3)
    return image.reshape(size, size, 1)


@closed_form(Groove, SKY_VISIBILITY)
def openness_of_groove(scene: Groove, size: int) -> np.ndarray:
    """(size, size, 1), 0 to 1. Walls seen end on, and what lies beside them, are open."""
    if scene.opening >= 180:
        return np.ones((size, size, 1))
    o, w = eye_rays(scene.sensor(size), size)
    a, wall = math.radians(0.5 * scene.opening), scene.WALL
    side = np.where(_meets(o, w, a, 1.0, wall), 1.0, np.where(_meets(o, w, a, -1.0, wall), -1.0, 0.0))
    up = _along(o, w, a, np.where(side == 0, 1.0, side))
    edge = np.stack([-side * (wall + up) * math.sin(a), (wall - up) * math.cos(a)])
    m = np.stack([edge[1] * side, -edge[0] * side])
    cosine = (-side * math.cos(a) * m[0] + math.sin(a) * m[1]) / np.maximum(np.hypot(*m), 1e-300)
    return np.where(side == 0, 1, 0.5 * (1 + cosine)).reshape(size, size, 1)


def _along(o: np.ndarray, w: np.ndarray, a: float, side: np.ndarray | float) -> np.ndarray:
    """How far up its wall a ray meets the wall's plane, m."""
    across = -side * math.cos(a) * o[0] + math.sin(a) * o[2]
    t = -across / (-side * math.cos(a) * w[0] + math.sin(a) * w[2])
    return side * math.sin(a) * (o + t * w)[0] + math.cos(a) * (o + t * w)[2]


def _meets(o: np.ndarray, w: np.ndarray, a: float, side: float, wall: float) -> np.ndarray:
    faces = -side * math.cos(a) * w[0] + math.sin(a) * w[2] < 0
    up = _along(o, w, a, side)
    return faces & (up > 0) & (up < wall)


@closed_form(SolidsUnderSky, DISTANCE)
def distance_in_slice(scene: SolidsUnderSky, size: int) -> np.ndarray:
    """(size, size, 1), m, at the scene's probes."""
    column, row = np.arange(size) / max(size - 1, 1), (np.arange(size) + 0.5) / size
    z, x = np.meshgrid(scene.HEIGHT * (1 - row), scene.HALF_WIDTH * (2 * column - 1), indexing="ij")
    p = np.stack([x, np.zeros_like(x), z], axis=-1)
    return np.min([signed_distance(s, p) for s in scene.solids()], axis=0)[..., None]


def signed_distance(solid: Solid, p: np.ndarray) -> np.ndarray:
    """Of points (..., 3) from one solid, m, negative inside."""
    local = (p - np.array(solid.centre)) @ np.array(solid.axes).T
    if solid.shape == "ball":
        return np.linalg.norm(local, axis=-1) - solid.half[0]
    q = np.abs(local) - np.array(solid.half)
    return np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(axis=-1), 0)
