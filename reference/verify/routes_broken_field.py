"""The density of fields of clouds, made again in NumPy: weather from its formula, noise from trees."""

from __future__ import annotations

import numpy as np

from reference.closed_form.broken_field import density_of_field
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import SIZE, name
from reference.verify.routes_cloud_noise import WITHIN, curl, grown, octave_sum, perlin_sum, worley
from scenes.broken_field import ACROSS, MIDDLE, RAIN, TYPE, WAVES, BrokenField
from scenes.cloud_density import CloudModel
from scenes.contract import DENSITY


@check(
    "route",
    claim="the density of a field of clouds is what nearest points of a tree and its recipe say",
    routes=("k-d tree and list", "closed form"),
    scenes=("BrokenField",),
)
def field_against_tree(seed: int) -> list[Comparison]:
    """Near and far, low and high in the layer, from no coverage to all of it."""
    found = []
    for fields in (
        {},
        {"extent": 240e3, "front": 3.0},
        {"height": 0.07, "cover": 0.7, "rain": 0.0},
        {"height": 0.8, "cover": 1.0},
        {"cover": 0.0, "rain": 1.0},
    ):
        scene = BrokenField(**fields)
        p = scene.points(SIZE).T
        weather = forecast(p, scene.cover, scene.front, scene.rain)
        image = modelled(scene.model(), p, *weather).reshape(SIZE, SIZE, 1)
        label = f"{name(scene, DENSITY)}"
        found.append(
            Comparison(label, Sampled.exact(image), Sampled.exact(density_of_field(scene, SIZE)), WITHIN)
        )
    return found


def forecast(p: np.ndarray, cover: float, front: float, rain: float) -> tuple[np.ndarray, np.ndarray]:
    """Coverage and type at points (n, 3), rain taken in: waves as real parts, the step as a Hermite cubic."""
    waves = np.array([*WAVES, TYPE])
    turned = np.exp(1j * (2 * np.pi * (p[:, :2] / 1e3) @ waves[:, :2].T + waves[:, 2])).real
    s = (p[:, :2] - MIDDLE) @ ACROSS
    t = np.clip(2 * s / front, -1, 1)
    swing = 0.6 * turned[:, :-1].mean(axis=1) + 0.4 * np.polyval([-0.5, 0, 1.5, 0], t)
    wet = rain * np.clip(1 - (s / RAIN - 1) ** 2, 0, None) ** 2
    dry = 0.55 + 0.4 * turned[:, -1]
    return np.maximum(cover + min(cover, 1 - cover) * swing, 0.7 * wet), 1 - (1 - dry) * (1 - wet)


def modelled(model: CloudModel, p: np.ndarray, cover: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """Density at points (n, 3) in m, with 1 - R instead of R throughout."""
    height = (p[:, 2] - model.base) / (model.top - model.base)
    h = np.clip(height, 0, 1)
    q = p / model.tile
    spared = (1 - perlin_sum(q, 8)) * (1 - octave_sum(q, (8, 32, 56)))
    wide = 0.625 * octave_sum(q, (8, 16, 32)) + 0.25 * octave_sum(q, (16, 32, 64))
    wide += 0.125 * (0.75 * worley(q, 32) + 0.25 * worley(q, 64))
    profile = np.array([grown(a, b) for a, b in zip(h, kind, strict=True)])
    left = np.maximum((1 - spared / (2 - wide)) * profile + cover - 1, 0)

    at = p / model.detail_tile
    torn = at + ((1 - h) * model.curl / model.detail_tile)[:, None] * curl(at)
    detail = 0.625 * octave_sum(torn, (2, 4, 8), 1) + 0.25 * octave_sum(torn, (4, 8, 16), 1)
    detail += 0.125 * (0.75 * worley(torn, 8, 1) + 0.25 * worley(torn, 16, 1))
    worn = model.erosion * (detail + np.minimum(10 * h, 1) * (1 - 2 * detail))
    return np.where(height == h, np.clip(1 - (1 - left) / (1 - worn), 0, 1), 0)
