"""How light is followed: integrator, depth, roulette, sampler, emitter sampling, samples in a batch.

Everything is chosen from what a scene contains and what is asked of it, by the rules of `transport`, each
with the gain that was measured for it: efficiency = 1 / (variance x time) against Mitsuba's defaults, which
`lightproof bench reference` measures again. The filter is always a box: pixels stay independent.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from reference.indirect import indirect
from scenes.contract import DIRECT_RADIANCE, INDIRECT_RADIANCE, ONE_BOUNCE, SINGLE_SCATTERING, Quantity

MEDIA = {"homogeneous", "heterogeneous"}
PASSED_THROUGH = {"mask", "null", "thindielectric"}
SHAPES = {"sphere", "rectangle", "cube", "disk", "cylinder", "obj", "ply", "serialized", "shapegroup"}
DELTA_LIGHTS = {"point", "directional", "spot", "projector"}
LIGHTS = DELTA_LIGHTS | {"area", "constant", "envmap", "sunsky", "directionalarea"}
SPECTRA = {"regular", "irregular", "spectrum", "blackbody"}

NO_ROULETTE = 100_000
"""A depth that no path reaches."""
SPENT = 0.05
"""Roulette starts where a path's expected throughput has fallen to this."""
LANES = {"surfaces": 1 << 20, "thin media": 1 << 18, "clouds": 3 << 17}
"""Paths in one batch: enough to fill the cores and to hide what a batch costs besides (0.03 s), few enough
that 16 batches of the smallest image are not more than it needs."""
LEAST_SPP = {"multijitter": 64, "independent": 16}
MOST_SPP = 256


@dataclass(frozen=True)
class Transport:
    """integrator: Mitsuba's dictionary. sampler: name of the plugin. spp: samples a pixel in a batch.
    starts_inside: whether camera rays begin below the interface of the medium that they enter."""

    integrator: dict
    sampler: str
    spp: int
    starts_inside: bool = False

    def plain(self) -> dict:
        """As JSON data."""
        return asdict(self)


def transport(description: dict, quantity: Quantity, size: int) -> Transport:
    """The least transport that is exact for a quantity on a scene, with the samples that serve it best.

    Sampler: `multijitter`, whose 2D stratification makes area lights, skies and pixel areas 10 to 60 times as
    efficient on surfaces and 1.5 times in fog. In clouds the first dimensions decide nothing, so that
    `independent` is as good and 10 % cheaper. `multijitter` is biased below 64 samples a pixel (-0.6 % at
    16 in a closed room, within 0.03 % of none at 64 and 256), `ldsampler` always (-2.6 % in a valley).

    Rays start inside the one medium that the camera sees from outside (`reference.entry`, which integrators
    of Mitsuba allow for one medium only).

    Batches: LANES paths, and a square number of samples a pixel, as the strata want it.
    """
    kind = "surfaces"
    found = media(description)
    if any(least_albedo(m) > 0 for m in found):
        kind = "thin media" if reflects(description) else "clouds"
    outside = "medium" not in description.get("sensor", {})
    sampler = "independent" if kind == "clouds" else "multijitter"
    strata = round(math.sqrt(min(max(LANES[kind] / size**2, LEAST_SPP[sampler]), MOST_SPP)))
    return Transport(
        integrator(description, quantity),
        sampler,
        strata**2,
        starts_inside=kind != "surfaces" and outside and len(found) == 1,
    )


def integrator(description: dict, quantity: Quantity) -> dict:
    """The least integrator that is exact. Read the rules top down; the first that fits is taken.

    1. Nothing scatters: only lights are seen, depth 1. Glowing sheets, 6 times as efficient.
    2. Light that met one surface, or was scattered once: depth 2 (depth 1 is what is seen directly). `direct`
       where nothing is passed through; it samples no BSDF where no BSDF sample could hit a light.
    3. Media, masks and null interfaces need `volpath`, since `path` is black behind them; `volpathmis` where
       extinction differs between wavelengths, since `volpath` draws a distance for one of them and weighs
       the others without bound (28 times the noise in deep coloured glass).
    4. `path` for the rest. Light that came by another surface is what it, or `direct` for one bounce, sees
       from where the camera ray was scattered to (reference.indirect).
    """
    through = bool(plugin_types(description) & (MEDIA | PASSED_THROUGH))
    volumetric = "volpathmis" if any(coloured(m) for m in media(description)) else "volpath"
    if not scatters(description):
        return {"type": volumetric if through else "path", "max_depth": 1, "rr_depth": NO_ROULETTE}
    if quantity in (SINGLE_SCATTERING, DIRECT_RADIANCE):
        if through:
            return {"type": volumetric, "max_depth": 2, "rr_depth": NO_ROULETTE}
        delta = plugin_types(description) & LIGHTS <= DELTA_LIGHTS
        return {"type": "direct", "bsdf_samples": 0} if delta else {"type": "direct"}
    if quantity in (INDIRECT_RADIANCE, ONE_BOUNCE):
        return indirect(
            {"type": "path", "max_depth": -1} if quantity == INDIRECT_RADIANCE else {"type": "direct"}
        )
    if through:
        return {"type": volumetric, "max_depth": -1, "rr_depth": roulette_depth(description)}
    return {"type": "path", "max_depth": -1}


def roulette_depth(description: dict) -> int:
    """log(SPENT) / log(albedo), at least Mitsuba's 5; no roulette where nothing is absorbed.

    Roulette at 5 costs clouds of albedo 1 a factor of 12 (paths that carry everything are cut at random, 5 %
    at every turn), and none at all costs a factor of 3 where the albedo is 0.1 or 0.9 (paths that carry
    nothing go on).
    """
    albedo = max((least_albedo(m) for m in media(description)), default=1.0)
    if albedo <= 0:
        return 5
    return NO_ROULETTE if albedo >= 1 else max(5, min(round(math.log(SPENT) / math.log(albedo)), NO_ROULETTE))


def least_albedo(medium: dict) -> float:
    """A medium's single-scattering albedo, 1 where it varies (no roulette is always right)."""
    value = medium.get("albedo", 0.75)
    if isinstance(value, dict):
        value = value.get("value")
    if isinstance(value, (list, tuple)):
        value = max(value)
    return float(value) if isinstance(value, (int, float)) else 1.0


def coloured(medium: dict) -> bool:
    """Whether a medium's extinction differs between wavelengths or channels."""
    sigma_t = medium.get("sigma_t", {})
    if not isinstance(sigma_t, dict):
        return False
    if sigma_t.get("type") in ("rgb", "srgb"):
        value = sigma_t.get("value", sigma_t.get("color"))
        return isinstance(value, (list, tuple)) and len(set(value)) > 1
    return sigma_t.get("type") in SPECTRA


def parts(description: Any) -> Iterator[dict]:
    """Every plugin's dictionary within a scene dictionary, itself included."""
    if isinstance(description, dict):
        yield description
        for value in description.values():
            yield from parts(value)


def plugin_types(description: Any) -> set[str]:
    """Every plugin type named in a Mitsuba scene dictionary."""
    return {p["type"] for p in parts(description) if isinstance(p.get("type"), str)}


def media(description: dict) -> list[dict]:
    """The participating media."""
    return [p for p in parts(description) if p.get("type") in MEDIA]


def reflects(description: dict) -> bool:
    """Whether any shape does more than glow or let light pass."""
    return any(not _dark(shape) for shape in parts(description) if shape.get("type") in SHAPES)


def scatters(description: dict) -> bool:
    """Whether light ever changes direction."""
    return reflects(description) or any(least_albedo(m) > 0 for m in media(description))


def _dark(shape: dict) -> bool:
    """Whether a shape has one BSDF, and that is black or passes light straight through."""
    parts = {k: v for k, v in shape.items() if k not in ("interior", "exterior")}
    found = [v for v in parts.values() if isinstance(v, dict) and _is_black(v) is not None]
    return bool(found) and all(_is_black(v) for v in found)


def _is_black(bsdf: dict) -> bool | None:
    """None for what is known to be no BSDF."""
    kind = bsdf.get("type")
    if kind in MEDIA | LIGHTS or kind in ("srgb", "rgb", "ref"):
        return None if kind != "ref" else False
    if kind == "null":
        return True
    if kind == "mask":
        nested = [v for k, v in bsdf.items() if isinstance(v, dict) and k != "opacity"]
        return bool(nested) and all(bool(_is_black(v)) for v in nested)
    if kind == "diffuse":
        reflectance = bsdf.get("reflectance", {})
        value = reflectance.get("value") if isinstance(reflectance, dict) else reflectance
        return value is not None and not isinstance(value, str) and _zero(value)
    return False


def _zero(value: Any) -> bool:
    if isinstance(value, (list, tuple)):
        return all(v == 0 for v in value)
    return isinstance(value, (int, float)) and value == 0
