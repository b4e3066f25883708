r"""Cloud density from two textures, a height profile and a weather map.

GPU Pro 7, II.4, 4.3.2 and 4.3.4. R(v, a, b, c, d) brings v from [a, b] to [c, d] without clamping; with a
signal for its old minimum it wears a field down by the signal and stretches what is left. At a point p at the
share h of the layer's height, where the map gives the coverage c, the precipitation r and the type t:

    c <- max(c, 0.7 r),  t <- t + r (1 - t)                         rain grows tall and wide clouds    (4.3.3)
    F = 5/8 G + 1/4 B + 1/8 A,  base = R(R_, F - 1, 1, 0, 1)         first texture, channels R_ G B A  (4.3.4)
    base <- base g(h, t)                                            profile of the type               (4.3.2)
    covered = c R(base, 1 - c, 1, 0, 1)                                                               (4.3.4)
    D = 5/8 r + 1/4 g + 1/8 b of the second texture, at p moved sideways by (1 - h) curl             (4.3.4)
    m = 1/5 lerp(D, 1 - D, clamp(10 h)),  density = R(covered, m, 1, 0, 1)     wisps below, billows above

A cheap sample stops at `covered`; what detail takes away it lacks, so it is nowhere the lower one.

Of a cumulus, 0.107 dense on average over a section, the textures miss 0.003 (128^3, 64^3: 0.007, 32^3:
0.012), and rounding to 8 bits adds 1 % to that; what is read differently counts twenty times as much.
Without detail there is 44 % more cloud.

In print, and what was done here:
- Coverage itself is the old minimum, so that more of it leaves less cloud, against the text
  (`coverage="printed"`). With 1 - c instead the two steps come to base - (1 - c), which grows with c, is all
  of the base at c = 1 and nothing at c = 0; that is the default.
- Nothing is clamped, yet the march asks whether a density is exactly 0; the default clamps at the end, once,
  which is as good as after each step. `clamp=False` is print: negative round every cloud.
- The detail is read at a tenth of p. Were p that of the first texture, the detail would repeat ten times less
  often than the shape that it is to refine (`detail="printed"`), so a scale must be hidden in the first
  read; by default each texture has a tile of its own, as the model says.
- Profiles are drawn, not given: `approximations.kit.cloud_model` says what stands for them, and that blending
  values makes two decks between two types, where blending heights makes one in between (`blend`).
- How far rain pulls the type and the coverage is not given; the lines above meet both ends that are.
- h is used before it is worked out, and z is up in one listing and y in the other.
- Sizes of the curl texture and of its push are not given: 128^2 texels, and the model's, in m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    NUMBER_FORMAT,
    PRINTED_SLIP,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from approximations.kit.cloud_model import (
    curl_noise,
    detail_noise,
    octave_sum,
    packed,
    packed_curl,
    profile,
    remap,
    shape_noise,
)
from scenes.contract import DENSITY, Scene, View
from scenes.density_section import DensitySection

DETAIL_SIZE, CURL_SIZE = 32, 128
LEAST = 1e-6  # width that a remap divides by


@dataclass
class Textures:
    """Shape (four channels), detail (three) and curl (two)."""

    shape: Any
    detail: Any
    curl: Any


@technique(
    source="GPU Pro 7, II.4, sec. 4.3.2 to 4.3.4",
    covers=("cloudscapes/03", "cloudscapes/04", "cloudscapes/06"),
    estimates=DENSITY,
    on=(DensitySection,),
    replaces="density modelled with octaves of noise that are computed where they are asked for",
    neglects=(SPATIAL_DETAIL, NUMBER_FORMAT, PRINTED_SLIP),
    claims=(
        exact_when("DensitySection", 1e-5, knobs={"lookup": "exact"}),
        exact_when("DensitySection", 2e-4, fields={"type": 0.3}, knobs={"lookup": "exact"}),
    ),
    stress={"DensitySection": ("cover", "type")},
)
def cloud_density(
    view: View,
    textures: Textures,
    *,
    sampler: Literal["full", "cheap"] = "full",
    coverage: Literal["reconstructed", "printed"] = "reconstructed",
    clamp: bool = True,
    wispy: Annotated[float, Sweep(0, 10, low=0, high=1000)] = 10.0,
    detail: Literal["own tile", "printed"] = "own tile",
    blend: Literal["functions", "parameters"] = "functions",
    lookup: Literal["textures", "exact"] = "textures",
) -> mi.Float:
    """Density, 0 to 1, one number per probe.

    sampler   "cheap" leaves the second texture, and all that wears at edges, aside
    coverage  the old minimum: 1 - c, or c as printed
    clamp     of the result, to [0, 1]
    wispy     1 over the share of the height below which detail is turned over
    detail    where the second texture is read: in a tile of its own, or at a tenth of where the first is
    blend     whether the three profiles or their heights are mixed
    lookup    the textures, or "exact": noise at the point itself
    """
    model, p = view.cloud.model, view.camera.origin
    exact = lookup == "exact"
    h = dr.clip((p.z - model.base) / (model.top - model.base), 0, 1)
    weather = model.weather(p.x, p.y)
    rain = weather.precipitation
    c = dr.maximum(weather.coverage, 0.7 * rain)
    type_ = weather.type + rain * (1 - weather.type)

    q = p / model.tile
    first, *octaves = shape_noise(q) if exact else textures.shape.eval(q)
    base = remap(first, octave_sum(*octaves) - 1, 1, 0, 1) * profile(h, type_, blend)
    least = c if coverage == "printed" else 1 - c
    density = c * (base - least) / dr.maximum(1 - least, LEAST)
    if sampler == "full":
        at = p / model.detail_tile
        push = curl_noise(at) if exact else textures.curl.eval(mi.Point2f(at.x, at.y))
        torn = p + (1 - h) * model.curl * mi.Vector3f(push[0], push[1], 0)
        at = torn / model.detail_tile if detail == "own tile" else 0.1 * torn / model.tile
        worn = octave_sum(*(detail_noise(at) if exact else textures.detail.eval(at)))
        m = model.erosion * dr.lerp(worn, 1 - worn, dr.clip(wispy * h, 0, 1))
        density = remap(density, m, 1, 0, 1)
    return dr.clip(density, 0, 1) if clamp else density


@cloud_density.bake
def bake(
    *,
    resolution: Annotated[int, Sweep(32, 64, 128, low=4, high=256)] = 128,
    storage: Literal["8 bits", "16 bits", "exact"] = "8 bits",
) -> Textures:
    """The textures.

    resolution  texels along an edge of the first; the default makes 8 MiB
    storage     bits of every channel, "exact" for float
    """
    return Textures(
        packed(shape_noise, resolution, storage),
        packed(detail_noise, DETAIL_SIZE, storage),
        packed_curl(CURL_SIZE, storage),
    )


@cloud_density.domain
def domain(scene: Scene) -> Domain:
    """Low clouds that stand apart: some of the sky covered, and some not."""
    if scene.cover < 0.7:
        return Domain(False, "so little coverage leaves shreds as thin as the textures' error")
    return Domain(True)
