"""Density that the wind has carried, on ways back that are integrated step by step."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from reference.closed_form.blown_field import carried_density
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import SIZE, name
from reference.verify.routes_broken_field import modelled
from scenes.blown_field import COVER, SWING, TYPE, WAVES, BlownField
from scenes.contract import DENSITY

WITHIN = 1e-9


@check(
    "route",
    claim="clouds that the wind has carried are what the air brings along paths integrated step by step",
    routes=("Runge-Kutta and trees", "closed form"),
    scenes=("BlownField",),
)
def blown_field_against_paths(seed: int) -> list[Comparison]:
    """Soon and late, with much shear and with much updraft."""
    found = []
    for fields in ({}, {"time": 600.0, "shear": 20.0}, {"updraft": 4.0, "time": 300.0}, {"time": 0.0}):
        scene = BlownField(**fields)
        p = walked_back(scene, scene.points(SIZE)).T
        turned = np.cos(2e-3 * np.pi * p[:, :2] @ np.array(WAVES)[:, :2].T + np.array(WAVES)[:, 2])
        cover = COVER + SWING * turned.mean(axis=1)
        image = modelled(scene.wind().model, p, cover, np.full(len(p), TYPE)).reshape(SIZE, SIZE, 1)
        exact = carried_density(scene, SIZE)
        found.append(Comparison(name(scene, DENSITY), Sampled.exact(image), Sampled.exact(exact), WITHIN))
    return found


def walked_back(scene: BlownField, p: np.ndarray) -> np.ndarray:
    """(3, n): where the air at points p (3, n) was `time` seconds ago."""

    def backwards(_: float, at: np.ndarray) -> np.ndarray:
        z = at.reshape(3, -1)[2]
        along = scene.speed + scene.shear * (z - scene.BASE) / (scene.TOP - scene.BASE)
        x, y = scene.DIRECTION
        return -np.stack([along * x, along * y, np.full_like(z, scene.updraft)]).ravel()

    if scene.time == 0:
        return p
    way = solve_ivp(backwards, (0, scene.time), p.ravel(), method="DOP853", rtol=1e-12, atol=1e-9)
    return way.y[:, -1].reshape(3, -1)
