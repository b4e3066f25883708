"""Which integrator, and how many samples, answer a question exactly at the least cost.

Read the rules top down; the first that fits is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from scenes.contract import DIRECT_RADIANCE, SINGLE_SCATTERING, Quantity

MEDIA = {"homogeneous", "heterogeneous"}
PASSED_THROUGH = {"mask", "null", "thindielectric"}
NO_ROULETTE = 100_000
"""Roulette starts at this depth: in media of albedo near 1 it only adds noise (4x the standard error)."""


@dataclass(frozen=True)
class Effort:
    """Monte Carlo effort: samples per pixel in a batch, independent batches, first seed."""

    spp: int = 64
    batches: int = 16
    seed: int = 1


def plugin_types(description: Any) -> set[str]:
    """Every plugin type named in a Mitsuba scene dictionary."""
    if not isinstance(description, dict):
        return set()
    own = {description["type"]} if isinstance(description.get("type"), str) else set()
    return own.union(*(plugin_types(v) for v in description.values()))


def integrator(description: dict, quantity: Quantity) -> dict:
    """The least integrator that is exact for a quantity on a scene.

    Media, masks and null interfaces need `volpath`, since `path` is black behind them; without them
    `path` is cheaper. One scattering event is depth 2 (depth 1 is what is seen directly).
    """
    through = bool(plugin_types(description) & (MEDIA | PASSED_THROUGH))
    if quantity in (SINGLE_SCATTERING, DIRECT_RADIANCE) and through:
        return {"type": "volpath", "max_depth": 2, "rr_depth": NO_ROULETTE}
    if quantity in (SINGLE_SCATTERING, DIRECT_RADIANCE):
        return {"type": "direct"}
    if through:
        return {"type": "volpath", "max_depth": -1, "rr_depth": NO_ROULETTE}
    return {"type": "path", "max_depth": -1}


def effort(description: dict, size: int) -> Effort:
    """Samples that bring the error of a whole image to far below what is asked of it.

    Surfaces: a pixel to about 1 %. Media, where paths are tens of times longer: to 5 to 15 %, with the
    small images of a sweep at 256 samples and those that are looked at four times finer at 128 x 128.
    """
    if not plugin_types(description) & MEDIA:
        return Effort(spp=256)
    return Effort(spp=16 if size <= 64 else max(16, 64 * 128**2 // size**2))
