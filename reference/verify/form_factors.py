r"""Form factors: the share of the light leaving one surface that falls on another, by closed forms.

From an element of area, where F = E / (pi L):

    sphere, radius r at distance d, above the horizon            F = (r / d)^2 cos(theta)
    disk, radius r, parallel at height h, its axis a away        F = (1 - (a^2 + h^2 - r^2) / S) / 2,
                                                                 S^2 = (a^2 + h^2 + r^2)^2 - 4 a^2 r^2
    polygon seen in unit directions u_k, normal n (Lambert)      F = sum_k gamma_k . n / (2 pi),
                                                                 gamma_k = angle(u_k, u_k+1) u_k x u_k+1 / |.|

From area to area:

    parallel squares of side a, c apart, X = a / c
        F = 2 / (pi X^2) [ln((1 + X^2) / sqrt(1 + 2 X^2))
            + 2 X sqrt(1 + X^2) atan(X / sqrt(1 + X^2)) - 2 X atan X]
    squares at right angles with a common edge
        F = (pi / 2 - sqrt 2 atan(1 / sqrt 2) + ln(3 / 4) / 4) / pi
    parallel disks of radius r on one axis, h apart, Y = 2 + (h / r)^2
        F = (Y - sqrt(Y^2 - 4)) / 2

Source: J. R. Howell, M. P. Menguc, R. Siegel, Thermal Radiation Heat Transfer, appendix C.
"""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from reference.verify.checks import Comparison, check
from reference.verify.light_laws import ALBEDO, floor
from reference.verify.rendered import BLACK, image_of, pixel_means

GLOW = {"type": "area", "radiance": {"type": "rgb", "value": 1.0}}
AT = (0.3, -0.2, 1.0)
RADIUS = 0.6
WALL = 1.5  # m: where the wall stands, and half its width


@check(
    "physics",
    claim="a floor below a glowing sphere, disk or rectangle is lit by their form factors",
    routes=("path", "closed form"),
)
def form_factors_of_elements(seed: int) -> list[Comparison]:
    """16 x 16 pixels of the floor: radiance rho F L; the upright rectangle stands on the floor."""
    move = mi.ScalarTransform4f().translate
    down = move(list(AT)).rotate([1, 0, 0], 180).scale(RADIUS)
    upright = move([WALL, 0, 0.5]).rotate([0, 1, 0], -90).scale([0.5, WALL, 1])
    cases = {
        "sphere": ({"type": "sphere", "center": list(AT), "radius": RADIUS}, to_sphere),
        "disk": ({"type": "disk", "to_world": down}, to_disk),
        "parallel rectangle": ({"type": "rectangle", "to_world": down}, to_parallel_square),
        "perpendicular rectangle": ({"type": "rectangle", "to_world": upright}, to_wall),
    }
    found = []
    for label, (shape, factor) in cases.items():
        image = image_of(floor({**shape, "bsdf": BLACK, "emitter": GLOW}), 16, 16, seed)
        found.append(Comparison(label, image, pixel_means(lambda x, y, f=factor: ALBEDO * f(x, y), 16)))
    return found


def to_sphere(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """From the floor at (x, y, 0) to the sphere of RADIUS at AT."""
    return RADIUS**2 * AT[2] / ((x - AT[0]) ** 2 + (y - AT[1]) ** 2 + AT[2] ** 2) ** 1.5


def to_disk(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """From the floor at (x, y, 0) to the disk of RADIUS round AT that faces down."""
    squared, h, r = (x - AT[0]) ** 2 + (y - AT[1]) ** 2, AT[2], RADIUS
    s = np.sqrt((squared + h**2 + r**2) ** 2 - 4 * squared * r**2)
    return 0.5 * (1 - (squared + h**2 - r**2) / s)


def to_parallel_square(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """From the floor at (x, y, 0) to the square of half side RADIUS round AT that faces down."""
    r = RADIUS
    corners = [(AT[0] + i * r, AT[1] + j * r, AT[2]) for i, j in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    return to_polygon(x, y, np.array(corners))


def to_wall(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """From the floor at (x, y, 0) to the wall at x = WALL, |y| < WALL, 0 < z < 1."""
    corners = [(WALL, i * WALL, z) for i, z in ((-1, 0), (1, 0), (1, 1), (-1, 1))]
    return to_polygon(x, y, np.array(corners))


def to_polygon(x: np.ndarray, y: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Lambert's formula for corners (n, 3) on or above the horizon, counterclockwise as seen from below."""
    u = corners - np.stack([x, y, np.zeros_like(x)], axis=-1)[..., None, :]
    u = u / np.linalg.norm(u, axis=-1, keepdims=True)
    after = np.roll(u, -1, axis=-2)
    across = np.cross(u, after)
    sine = np.linalg.norm(across, axis=-1)
    angle = np.arctan2(sine, (u * after).sum(axis=-1))
    return (angle * across[..., 2] / sine).sum(axis=-1) / (2 * np.pi)


def parallel_squares(ratio: float) -> float:
    """Between squares of that side over their distance."""
    x, s = ratio, np.sqrt(1 + ratio**2)
    inner = np.log(s**2 / np.sqrt(1 + 2 * x**2)) + 2 * x * s * np.arctan(x / s) - 2 * x * np.arctan(x)
    return float(2 / (np.pi * x**2) * inner)


def perpendicular_squares() -> float:
    """Between equal squares at right angles with a common edge."""
    return float((np.pi / 2 - np.sqrt(2) * np.arctan(1 / np.sqrt(2)) + np.log(3 / 4) / 4) / np.pi)


def coaxial_disks(ratio: float) -> float:
    """Between equal parallel disks of that radius over their distance."""
    y = 2 + 1 / ratio**2
    return float((y - np.sqrt(y**2 - 4)) / 2)
