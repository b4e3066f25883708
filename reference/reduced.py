r"""Scenes with less light transport: what may be dropped from a scene, part by part, and how it is rendered.

A family is one kind of thing that a scene may do without; its levels run from the least transport up. A
family that a scene has nothing of has no levels. Each level changes the scene dictionary or limits the path:

bounces, orders       paths end at Mitsuba's max_depth: 1 is light seen directly, 2 is light that met one
                      surface or was scattered once
spectral rendering    linear sRGB by `reference.colour.to_rgb`
light size            a sphere of radiance L and radius r becomes a point of intensity pi r^2 L: the same
                      irradiance on whatever faces it unhidden, at any distance. A flat light shrinks by
                      SHRINK to the radiance L / SHRINK^2: the same intensity in every direction
refraction            light goes straight on, through nothing or through thin panes
scattering in media   albedo 0, extinction as it was
phase function        isotropic, by similarity: sigma_s' = (1 - g) sigma_s and sigma_a' = sigma_a, so that
                      sigma_t' = (1 - w g) sigma_t,   w' = w (1 - g) / (1 - w g)
texture, volume detail   box-filtered to a part of the resolution, down to the mean

A light's image goes with its size: a point has none, a flat light's is as bright as it is small.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import mitsuba as mi
import numpy as np

from reference.coarser import Factors, coarser_textures, coarser_volumes, texture_factors, volume_factors
from reference.colour import to_rgb
from reference.render import Draw, load_description, render_once
from reference.toolchain import other_variant, spectral_twin
from reference.transport import MEDIA, Transport, least_albedo, media, parts, reflects, scatters, transport
from scenes.contract import RADIANCE, BadInput, Scene

DEPTHS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024)
SHRINK = 0.01
FLAT = ("rectangle", "disk")
MEAN_COSINE = {"isotropic": 0.0, "rayleigh": 0.0, "hg": None}
"""Phase functions whose mean cosine is known; None: it is the parameter g."""

Change = Callable[[dict], dict]


@dataclass(frozen=True)
class Reduction:
    """One level of a family. assumes: what must hold for nothing to be lost. depth: Mitsuba's max_depth.
    rgb: rendered in three channels."""

    family: str
    level: str
    assumes: str
    change: Change = lambda description: description
    depth: int | None = None
    rgb: bool = False

    @property
    def label(self) -> str:
        """Family and level."""
        return f"{self.family} ({self.level})"


Family = tuple[Reduction, ...]


def families(description: dict, spectral: bool) -> dict[str, Family]:
    """What a scene may do without, by name, each family from the least transport up; empty where the scene
    has nothing of the kind."""
    return {
        _name_of_depth(description): _depth(description),
        "spectral rendering": _spectral_rendering(spectral),
        "light size": _light_size(description),
        "refraction": _refraction(description),
        "scattering in media": _scattering(description),
        "phase function": _phase_function(description),
        "texture detail": _detail("texture", texture_factors(description), coarser_textures),
        "volume detail": _detail("volume", volume_factors(description), coarser_volumes),
    }


def reduced(description: dict, size: int, reductions: Iterable[Reduction]) -> tuple[dict, Transport]:
    """The scene dictionary without what the reductions drop, and the transport that is left."""
    chosen = sorted(reductions, key=lambda r: r.rgb)
    for reduction in chosen:
        description = reduction.change(description)
    how = transport(description, RADIANCE, size)
    limits = [r.depth for r in chosen if r.depth is not None]
    limits += [d for d in (how.integrator.get("max_depth", -1),) if d >= 0]
    return description, replace(how, integrator={**how.integrator, "max_depth": min(limits, default=-1)})


def sample_reduced(scene: Scene, size: int, reductions: Iterable[Reduction] = ()) -> tuple[Draw, Transport]:
    """f(spp, seed) -> (size, size, C) float64, one batch of the scene's radiance without what is dropped, and
    its transport. Raises BadInput if Mitsuba rejects the scene."""
    chosen = list(reductions)
    spectral = scene.spectral and not any(r.rgb for r in chosen)
    variant = spectral_twin(mi.variant()) if spectral else mi.variant()
    description, how = reduced(scene.mitsuba(size), size, chosen)
    with other_variant(variant):
        try:
            loaded = load_description(description, how)
        except Exception as error:
            reason = " ".join(str(error).split())
            dropped = f" without {', '.join(r.family for r in chosen)}" if chosen else ""
            raise BadInput(
                f"Mitsuba rejects the scene {type(scene).__name__}{dropped}: {reason}; mend its mitsuba()"
            ) from error

    return lambda spp, seed: render_once(loaded, spp, seed), how


def _name_of_depth(description: dict) -> str:
    if not any(least_albedo(m) > 0 for m in media(description)):
        return "bounces"
    return "bounces and scattering orders" if reflects(description) else "scattering orders"


def _depth(description: dict) -> Family:
    if not scatters(description):
        return ()
    name = _name_of_depth(description)
    return tuple(
        Reduction(name, f"beyond depth {d}", f"light that was turned {d} times or more is faint", depth=d)
        for d in DEPTHS
    )


def _scattering(description: dict) -> Family:
    if not reflects(description) or not any(least_albedo(m) > 0 for m in media(description)):
        return ()
    change = replaced(lambda p: p.get("type") in MEDIA, lambda medium: {**medium, "albedo": 0.0})
    assumes = "light that media scatter into the view is faint"
    return (Reduction("scattering in media", "none", assumes, change),)


def _phase_function(description: dict) -> Family:
    if not any(_anisotropic(m) for m in media(description)):
        return ()
    assumes = "light is scattered many times before it is seen"
    return (Reduction("phase function", "isotropic", assumes, replaced(_anisotropic, isotropic)),)


def _anisotropic(part: dict) -> bool:
    """Whether a part is a medium that is not isotropic, and whose similar medium is known."""
    phase, albedo = part.get("phase"), part.get("albedo", 0.75)
    if part.get("type") not in MEDIA or not isinstance(phase, dict) or not isinstance(albedo, (int, float)):
        return False
    return albedo > 0 and phase.get("type") in MEAN_COSINE and phase["type"] != "isotropic"


def isotropic(medium: dict) -> dict:
    """The medium with isotropic scattering that is similar to it."""
    phase, w = medium["phase"], float(medium.get("albedo", 0.75))
    g = MEAN_COSINE[phase["type"]]
    g = float(phase.get("g", 0.8)) if g is None else g
    return {
        **medium,
        "phase": {"type": "isotropic"},
        "scale": float(medium.get("scale", 1.0)) * (1 - w * g),
        "albedo": w * (1 - g) / (1 - w * g),
    }


def _refraction(description: dict) -> Family:
    def refracts(part: dict) -> bool:
        return part.get("type") == "dielectric"

    if not any(refracts(p) for p in parts(description)):
        return ()
    gone = replaced(refracts, lambda _: {"type": "null"})
    panes = replaced(refracts, lambda interface: {**interface, "type": "thindielectric"})
    return (
        Reduction("refraction", "no interface", "nothing is seen bent or mirrored", gone),
        Reduction("refraction", "thin panes", "nothing is seen bent", panes),
    )


def _light_size(description: dict) -> Family:
    if not scatters(description) or not any(_shrinks(p) for p in parts(description)):
        return ()
    assumes = "lights are small where they are seen from, and out of the picture"
    return (Reduction("light size", "points", assumes, replaced(_shrinks, without_size)),)


def _area_light(shape: dict) -> tuple[str, dict] | None:
    return next(
        ((k, v) for k, v in shape.items() if isinstance(v, dict) and v.get("type") == "area"),
        None,
    )


def _shrinks(part: dict) -> bool:
    """Whether a part is a shape that does nothing but glow, and has a point for its limit."""
    found = _area_light(part)
    if found is None or reflects(part) or scaled(found[1].get("radiance"), 1.0) is None:
        return False
    even = (
        found[1]["radiance"].get("type") != "checkerboard" if isinstance(found[1]["radiance"], dict) else True
    )
    return part.get("type") in FLAT or (
        part.get("type") == "sphere" and even and not part.get("flip_normals", False)
    )


def without_size(light: dict) -> dict:
    """The point that a spherical light shrinks to, or a flat light at SHRINK of its size."""
    name, emitter = _area_light(light)
    to_world = light.get("to_world", mi.ScalarTransform4f())
    if light["type"] in FLAT:
        glowing = {**emitter, "radiance": scaled(emitter["radiance"], SHRINK**-2)}
        return {**light, "to_world": to_world @ mi.ScalarTransform4f().scale(SHRINK), name: glowing}
    matrix = np.asarray(to_world.matrix, np.float64)
    centre = matrix[:3, :3] @ np.asarray(light.get("center", [0, 0, 0]), np.float64) + matrix[:3, 3]
    radius = light.get("radius", 1.0) * np.linalg.norm(matrix[:3, 0])
    intensity = scaled(emitter["radiance"], float(math.pi * radius**2))
    return {"type": "point", "position": centre.tolist(), "intensity": intensity}


def scaled(value: Any, k: float) -> Any:
    """A spectrum, or a checkerboard of two, times k; None for what is not known."""
    if isinstance(value, (int, float)):
        return k * value
    kind = value.get("type") if isinstance(value, dict) else None
    if kind in ("rgb", "srgb", "uniform"):
        name = "color" if "color" in value else "value"
        old = value[name]
        new = [k * x for x in old] if isinstance(old, (list, tuple)) else k * old
        return {**value, name: new, **({"unbounded": True} if kind == "srgb" else {})}
    if kind in ("regular", "irregular"):
        numbers = value["values"].replace(",", " ").split()
        return {**value, "values": ", ".join(f"{k * float(x):.9g}" for x in numbers)}
    if kind == "checkerboard":
        colours = {name: scaled(value.get(name), k) for name in ("color0", "color1")}
        return None if None in colours.values() else {**value, **colours}
    return None


def _spectral_rendering(spectral: bool) -> Family:
    if not spectral:
        return ()
    assumes = "colours are soft, and few meet on a path"
    return (Reduction("spectral rendering", "linear sRGB", assumes, to_rgb, rgb=True),)


def _detail(name: str, factors: Factors, coarser: Callable[[dict, int | None], dict]) -> Family:
    return tuple(
        Reduction(
            f"{name} detail",
            "mean" if factor is None else f"1/{factor} of the resolution",
            f"{name}s vary little over a texel",
            lambda description, factor=factor: coarser(description, factor),
        )
        for factor in factors
    )


def replaced(chosen: Callable[[dict], bool], make: Change) -> Change:
    """A change of a scene dictionary: make(part) in the place of every part that is chosen."""

    def change(value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        return make(value) if chosen(value) else {k: change(v) for k, v in value.items()}

    return change
