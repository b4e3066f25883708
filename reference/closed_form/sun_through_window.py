r"""Share of a round sun that a point in a room sees through a window, in float64.

Seen from p, directions w = s + x e1 + y e2 about the sun's direction s put the sun on the disk
x^2 + y^2 <= tan(r)^2. An edge of the window from a to b bounds the plane through p that holds it: what passes
inside has

    m . w >= 0,  m = (a - p) x (b - p),   a half plane  m.s + m.e1 x + m.e2 y >= 0  of the disk,

and so has the horizon of p's own surface, and each upright edge of a pillar that reaches from floor to
ceiling. So the share is the area of a disk cut by half planes: with q = m.s / |(m.e1, m.e2)| the distance of
a line from the middle, by Green's theorem

    area = 1/2 sum q (length of the line inside)  +  r^2 / 2 (angle of the circle inside).
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from reference.surface_monte_carlo import eye_rays, first_hits, shapes
from reference.truth import closed_form
from scenes.contract import LIGHT_VISIBILITY
from scenes.window_room import PillarRoom, StainedRoom, SunlitRoom, WindowRoom

Opening = tuple[float, float, float, float]
NEAR = 1e-9
"""m: how near to a plane a point is taken to lie in it."""


def cut_disk(radius: float, q: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """Share (n,) of a disk of that radius about 0 where u . x + q >= 0 for every one of k lines: q (k, n) and
    the angle of the unit vectors u (k, n)."""
    q = q / radius
    share = np.where((q > -1).all(axis=0), 1.0, 0.0)
    cut = np.flatnonzero((q > -1).all(axis=0) & (q < 1).any(axis=0))
    if len(cut):
        for part in np.array_split(cut, 1 + len(cut) // 16384):
            share[part] = _cut(q[:, part], towards[:, part])
    return share


def _cut(q: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """The same for a unit disk."""
    k, n = q.shape
    u = np.stack([np.cos(towards), np.sin(towards)])  # (2, k, n)
    along = np.stack([-u[1], u[0]])
    area = np.zeros(n)
    reach = np.sqrt(np.maximum(1 - q**2, 0))
    for i in range(k):
        low, high = -reach[i], reach[i].copy()
        for j in range(k):
            if j == i:
                continue
            # the point -q_i u_i + t along_i must keep u_j . x + q_j >= 0
            slope = (u[:, j] * along[:, i]).sum(axis=0)
            at = q[j] - q[i] * (u[:, j] * u[:, i]).sum(axis=0)
            level = np.abs(slope) < 1e-14
            t = -at / np.where(level, 1, slope)
            low = np.where(~level & (slope > 0), np.maximum(low, t), low)
            high = np.where(~level & (slope < 0), np.minimum(high, t), high)
            high = np.where(level & (at < 0), low, high)
        area += np.where(np.abs(q[i]) < 1, 0.5 * q[i] * np.maximum(high - low, 0), 0)
    half = np.where(q < 1, np.arccos(np.clip(-q, -1, 1)), np.pi)
    ends = [np.where(q < 1, np.angle(np.exp(1j * (towards + d * half))), np.pi) for d in (-1, 1)]
    cuts = np.sort(np.concatenate([*ends, np.full((1, n), -np.pi), np.full((1, n), np.pi)]), axis=0)
    for a, b in itertools.pairwise(cuts):
        middle = 0.5 * (a + b)
        inside = (np.cos(middle - towards) + q >= 0).all(axis=0)
        area += np.where(inside, 0.5 * (b - a), 0)
    return area / np.pi


class Points:
    """First hits p (n, 3) of the eye rays, their normals, whether anything is met, and the sun's frame."""

    def __init__(self, scene: SunlitRoom, size: int) -> None:
        o, w = eye_rays(scene.sensor(size), size)
        t, n, _ = first_hits(shapes(scene.surfaces()), o, w)
        self.met = np.isfinite(t)
        self.p = (o + np.where(self.met, t, 0) * w).T
        self.n = np.where(self.met[:, None], n.T, [0.0, 0.0, 1.0])
        s = np.array(scene.toward_sun())
        e1 = np.cross([0.0, 0.0, 1.0], s)
        e1 /= np.linalg.norm(e1)
        self.frame = np.stack([s, e1, np.cross(s, e1)], axis=1)
        self.radius = math.tan(math.radians(scene.sun_radius))

    def edge(self, a: tuple, b: tuple) -> np.ndarray:
        """m (n, 3) of an edge."""
        return np.cross(np.array(a) - self.p, np.array(b) - self.p)

    def opening(self, x: float, where: Opening) -> list[np.ndarray]:
        """The four half spaces of an opening in the plane x, all directions for points beyond it."""
        y0, y1, z0, z1 = where
        corners = [(x, y0, z0), (x, y0, z1), (x, y1, z1), (x, y1, z0)]
        beyond = (self.p[:, 0] > x - NEAR)[:, None]
        sun = self.frame[:, 0]
        turn = zip(corners, corners[1:] + corners[:1], strict=True)
        return [np.where(beyond, sun, self.edge(b, a)) for a, b in turn]

    def share(self, halves: list[np.ndarray]) -> np.ndarray:
        """Share (n,) of the sun above the horizon and inside the half spaces."""
        m = np.stack([*halves, self.n]) @ self.frame
        across = np.hypot(m[..., 1], m[..., 2])
        parallel = across < 1e-12
        q = m[..., 0] / np.where(parallel, 1, across)
        q = np.where(parallel, np.where(m[..., 0] >= 0, 1e9, -1e9), q)
        return cut_disk(self.radius, q, np.arctan2(m[..., 2], m[..., 1]))


def through(scene: SunlitRoom, points: Points, where: Opening, more: list[np.ndarray] = ()) -> np.ndarray:
    """Share (n,) through a part of the window, its frame and further half spaces."""
    halves = points.opening(scene.wall(), where)
    if scene.wall_thickness > 0:
        halves += points.opening(scene.wall() + scene.wall_thickness, scene.opening())
    return points.share([*halves, *more])


@closed_form(WindowRoom, LIGHT_VISIBILITY)
def window_room(scene: WindowRoom, size: int) -> np.ndarray:
    """Share (size, size, 1) of the sun that the first hits see; 1 where nothing is met."""
    points = Points(scene, size)
    share = through(scene, points, scene.opening())
    return np.where(points.met, share, 1).reshape(size, size, 1)


@closed_form(PillarRoom, LIGHT_VISIBILITY)
def pillar_room(scene: PillarRoom, size: int) -> np.ndarray:
    """The same less what lies between the outermost upright edges of the pillar."""
    points = Points(scene, size)
    low, high = scene.pillar()
    corners = np.array([(x, y) for x in (low[0], high[0]) for y in (low[1], high[1])])
    to = corners[None] - points.p[:, None, :2]
    middle = 0.5 * (np.array(low) + high)[:2] - points.p[:, :2]
    middle = np.arctan2(middle[:, 1], middle[:, 0])
    turn = np.angle(np.exp(1j * (np.arctan2(to[..., 1], to[..., 0]) - middle[:, None])))
    ends = middle + turn.min(axis=1), middle + turn.max(axis=1)
    wedge = [
        k * np.stack([-np.sin(end), np.cos(end), 0 * end], axis=1)
        for k, end in zip((1, -1), ends, strict=True)
    ]
    ahead = points.share([np.stack([np.cos(middle), np.sin(middle), 0 * middle], axis=1)]) > 0
    hidden = np.where(ahead, through(scene, points, scene.opening(), wedge), 0)
    seen = through(scene, points, scene.opening()) - hidden
    return np.where(points.met, np.maximum(seen, 0), 1).reshape(size, size, 1)


@closed_form(StainedRoom, LIGHT_VISIBILITY)
def stained_room(scene: StainedRoom, size: int) -> np.ndarray:
    """Share (size, size, 3) by colour: what is seen through each pane times its tint, in sum."""
    points = Points(scene, size)
    tinted = sum(through(scene, points, pane)[:, None] * np.array(tint) for pane, tint in scene.panes())
    return np.where(points.met[:, None], tinted, 1).reshape(size, size, 3)
