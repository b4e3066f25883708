r"""Coverage, rain and type of clouds read from one map of the land.

GPU Pro 7, II.4, 4.3.3. A texture that spans 60 km x 60 km holds for every column of air three shares: R, how
much of the sky is covered, G, the chance of rain, B, the type, 0 for stratus, 0.5 for stratocumulus and 1 for
cumulus. A sample at p reads it at (p_x, p_y) / 60 km. Rain makes clouds tall and closes them, towards
cumulonimbus and at least 0.7 of the sky:

    c = max(R, 0.7 G),   t = B + G (1 - B),   density = sampler(p, c, t) of 4.3.4.

It stands for a weather that is defined everywhere; noise is worked out at the point itself, so that nothing
else is measured but the map.

Not given in the chapter, and what was done here:
- Texels along an edge (512, of 117 m) and bits of a channel (8).
- How far rain pulls: the lines above meet both ends that are. `rain="none"` reads R and B as they are.
- What lies beyond the map: it repeats.

What comes of it, in parts of the mean density: 0.9 %, of which a front of 300 m, drawn two texels wide, makes
0.7 % and 8 bits make 0.5 %, since the density grows with c and so takes over its steps one for one. A front
of 3 m makes 4 %, and 1.6 % with 2048 texels. A weather that turns over kilometres is as well served by 256;
the nearest texel instead of four costs four times as much. Beyond 60 km stands the weather of somewhere else
(`extent`), with an edge where the map's sides do not match; the horizon of clouds is 114 to 250 km away. A
rain that is not heeded takes a fifth of the cloud.

R is not the share of the sky that is covered. Under one coverage and type everywhere, and with 0.02 /m where
the density is 1, this share of columns is deeper than 0.1:

    R                0.15   0.2   0.25   0.3   0.35   0.4
    stratus          0      0     0.08   0.44  0.85   0.98
    stratocumulus    0      0.04  0.40   0.88  1      1
    cumulus          0      0.10  0.72   0.99  1      1

so that all of a broken sky lies between a fifth and two fifths. Between stratus and stratocumulus, at
t = 0.25, the profile reaches only two thirds, and nothing stands at R = 0.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.contract import (
    NUMBER_FORMAT,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from approximations.kit.cloud_model import in_bits
from approximations.kit.cloud_sampler import covered, worn
from scenes.broken_field import BrokenField
from scenes.contract import DENSITY, Scene, View

EXTENT = 60e3  # m, edge of the land that the map holds


@dataclass
class WeatherMap:
    """R coverage, G precipitation, B type, 0 to 1."""

    texture: mi.Texture2f


@technique(
    source="GPU Pro 7, II.4, sec. 4.3.3",
    covers=("cloudscapes/05",),
    estimates=DENSITY,
    on=(BrokenField,),
    replaces="a weather that is defined in every column of air",
    neglects=(SPATIAL_DETAIL, NUMBER_FORMAT),
    claims=(exact_when("BrokenField", 1e-4, knobs={"filter": "exact"}),),
    stress={"BrokenField": ("cover", "front", "extent")},
)
def weather_map(
    view: View,
    baked: WeatherMap,
    *,
    rain: Literal["towards cumulonimbus", "none"] = "towards cumulonimbus",
    filter: Literal["linear", "nearest", "exact"] = "linear",
) -> mi.Float:
    """Density, 0 to 1, one number per probe.

    rain    what precipitation does to coverage and type
    filter  of the map's texels, "exact" for the weather itself
    """
    model, p = view.cloud.model, view.camera.origin
    r, g, b = _read(baked, model, p, filter)
    coverage, type_ = (r, b) if rain == "none" else (dr.maximum(r, 0.7 * g), b + g * (1 - b))
    h = dr.clip((p.z - model.base) / (model.top - model.base), 0, 1)
    low = covered(p / model.tile, h, coverage, type_)
    return worn(low, p / model.detail_tile, h, model.curl / model.detail_tile, model.erosion)


@weather_map.bake
def bake(
    view: View,
    *,
    resolution: Annotated[int, Sweep(256, 2048, low=4, high=2048)] = 512,
    storage: Literal["8 bits", "16 bits", "exact"] = "8 bits",
) -> WeatherMap:
    """The map.

    resolution  texels along an edge; the default takes 768 KiB
    storage     bits of a channel, "exact" for float
    """
    i = dr.arange(mi.UInt32, resolution * resolution)
    x, y = (EXTENT / resolution * (mi.Float(n) + 0.5) for n in (i % resolution, i // resolution))
    w = view.cloud.model.weather(x, y)
    channels = np.stack([np.array(c) for c in (w.coverage, w.precipitation, w.type)], axis=1)
    texels = mi.TensorXf(in_bits(channels, storage).reshape(resolution, resolution, 3).astype(np.float32))
    return WeatherMap(mi.Texture2f(texels, use_accel=False, wrap_mode=dr.WrapMode.Repeat))


@weather_map.domain
def domain(scene: Scene) -> Domain:
    """Weather that the map has the texels for, over the land that it holds."""
    if scene.extent > EXTENT:
        return Domain(False, "the map repeats beyond 60 km")
    if scene.front < 2 * EXTENT / 512:
        return Domain(False, "the front is narrower than two texels")
    return Domain(True)


def _read(baked: WeatherMap, model: Any, p: mi.Point3f, filter: str) -> list[mi.Float]:
    """Coverage, precipitation and type of the column of p."""
    if filter == "exact":
        w = model.weather(p.x, p.y)
        return [w.coverage, w.precipitation, w.type]
    at = mi.Point2f(p.x, p.y) / EXTENT
    if filter == "nearest":
        texels = baked.texture.shape[0]
        at = (dr.floor(at * texels) + 0.5) / texels
    return baked.texture.eval(at)
