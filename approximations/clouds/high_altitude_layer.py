r"""High clouds as one flat picture, read once behind all that was marched.

GPU Pro 7, chapter II.4, sections 4.3 and 4.5.4. Alto- and cirrus clouds are thin, and are drawn from a
scrolling texture of 512 x 512 texels, with a wind of its own, at the end of the march, weighted with the
transmittance that the low clouds have left. Where a ray from o along d crosses the height H,

    x = o + (H - o_z) / d_z d - t wind,   T = 1 - alpha(x),   alpha = 1 - e^-tau of the layer straight up.

It stands for a slab of thickness D that a ray crosses slantwise, tau = integral of sigma along D / d_z.

Not given in the chapter, and what was done here:
- The height of the plane: the middle of the slab. What the texture holds: the opacity straight up, in 8 bits
  ("byte") or unrounded ("exact").
- `slant`: "none" takes the opacity as it is. "exact" takes the longer way, T = (1 - alpha)^(1 / d_z): 2 times
  as deep at 30 degrees and 5.8 times at 10, which the picture's clouds lack.
- `parallax`: "none" reads one place; "exact" the mean depth of 32 places along the way through the slab.
The layer's shadow on what lies below is not treated.

How the layer is lit the chapter leaves out. `lit_cirrus` draws opacity times a phase function, and swaps in
what is scattered once in an even slab: with the depth straight up d, a = 1 / d_z of the eye's ray and
b = 1 / l_z of the way to the sun,

    drawn   L = E f (1 - e^-(a d)),    exact   L = E f a (e^-(b d) - e^-(a d)) / (a - b)

- `phase`: "hg" is section 4.4.3's broad lobe, g = 0.2; "exact" has the ice's own mean cosine.
- `sun`: "none" has all the layer in full sun; "exact" lets it shade itself.
With every stage exact a thin slab comes out to 1 % and 300 m of ice at 30 degrees to 25 %: on the way through
it both rays pass from streak to streak, which a flat picture cannot have.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.contract import (
    HEIGHT_PROFILE,
    LINEAR_IN_LIGHT,
    MEDIUM_SHADOWS,
    NUMBER_FORMAT,
    PHASE_FUNCTION,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    at_most,
    exact_when,
    technique,
)
from approximations.kit.phase import henyey_greenstein
from scenes.contract import SINGLE_SCATTERING, TRANSMITTANCE, Scene, View
from scenes.high_clouds import HighClouds, Sheet

PLACES = 32
LEAST = 1e-6  # transmittance that a depth is still told from
EXACT = {"slant": "exact", "parallax": "exact", "stored": "exact"}
LIT = {"slant": "exact", "sun": "exact", "phase": "exact", "stored": "exact"}
FLAT = {"thickness": 30.0, "elevation": 65.0}  # 30 m thick, seen from near below
BROAD = 0.2


@dataclass
class Picture:
    """Opacity straight up of one tile of the layer."""

    texture: mi.Texture2f


@technique(
    source="GPU Pro 7, II.4, sec. 4.3, 4.5.4",
    covers=("cloudscapes/18",),
    estimates=TRANSMITTANCE,
    on=(HighClouds,),
    replaces="the transmittance of a thin slab of cloud along a slanted ray",
    neglects=(HEIGHT_PROFILE, SPATIAL_DETAIL, NUMBER_FORMAT),
    claims=(at_most(1.0), exact_when("HighClouds", 0.002, knobs=EXACT)),
    stress={"HighClouds": ("elevation", "optical_depth", "thickness")},
)
def high_altitude_layer(
    view: View,
    picture: Picture,
    *,
    slant: Literal["none", "exact"] = "none",
    parallax: Literal["none", "exact"] = "none",
) -> mi.Color3f:
    """Transmittance (0 to 1) of the high layer, one value per pixel.

    slant     whether a slanted ray's way through the layer counts.
    parallax  whether the layer is read at one height or all through.
    """
    sheet, o, d = view.cloud.model, view.camera.origin, view.camera.direction
    if parallax == "none":
        left = _read(picture, sheet, o, d, 0.5)
    else:
        depth = sum(-dr.log(_read(picture, sheet, o, d, (i + 0.5) / PLACES)) for i in range(PLACES))
        left = dr.exp(-depth / PLACES)
    return mi.Color3f(dr.power(left, 1 / d.z) if slant == "exact" else left)


@technique(
    source="GPU Pro 7, II.4, sec. 4.3, 4.4.3, 4.5.4",
    covers=("cloudscapes/18",),
    estimates=SINGLE_SCATTERING,
    on=(HighClouds,),
    replaces="light that a thin slab of cloud scatters once towards the eye",
    neglects=(HEIGHT_PROFILE, MEDIUM_SHADOWS, PHASE_FUNCTION, SPATIAL_DETAIL, NUMBER_FORMAT),
    claims=(LINEAR_IN_LIGHT, exact_when("HighClouds", 0.02, fields=FLAT, knobs=LIT)),
    stress={"HighClouds": ("sun_elevation", "optical_depth")},
)
def lit_cirrus(
    view: View,
    picture: Picture,
    *,
    slant: Literal["none", "exact"] = "none",
    sun: Literal["none", "exact"] = "none",
    phase: Literal["hg", "exact"] = "hg",
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) of the high layer before a black sky, one colour per pixel.

    slant  whether a slanted ray's way through the layer counts.
    sun    whether the layer shades itself.
    phase  the lobe that it scatters by.
    """
    o, d, l = view.camera.origin, view.camera.direction, view.sun.direction
    depth = -dr.log(_read(picture, view.cloud.model, o, d, 0.5))
    a = 1 / d.z if slant == "exact" else mi.Float(1)
    lit = 1 - dr.exp(-a * depth)
    if sun == "exact":
        apart = dr.abs(a - 1 / l.z) * depth
        mean = dr.select(apart > 1e-3, (1 - dr.exp(-apart)) / apart, 1)
        lit = a * depth * dr.exp(-dr.minimum(a, 1 / l.z) * depth) * mean
    lobe = henyey_greenstein(dr.dot(d, l), view.cloud.g if phase == "exact" else BROAD)
    return mi.Color3f(view.sun.irradiance * view.cloud.albedo * lobe * lit)


@lit_cirrus.bake
@high_altitude_layer.bake
def bake(
    view: View,
    *,
    resolution: Annotated[int, Sweep(32, 128, low=4, high=2048)] = 512,
    stored: Literal["byte", "exact"] = "byte",
) -> Picture:
    """The texture.

    resolution  texels along an edge of the tile.
    stored      number format of a texel.
    """
    sheet = view.cloud.model
    i = dr.arange(mi.UInt32, resolution * resolution)
    x, y = (sheet.tile / resolution * (mi.Float(n) + 0.5) for n in (i % resolution, i // resolution))
    middle = mi.Point3f(x, y, sheet.base + sheet.thickness / 2)
    opacity = np.array(1 - dr.exp(-view.cloud.extinction(middle) * sheet.thickness))
    if stored == "byte":
        opacity = np.round(255 * opacity) / 255
    texels = mi.TensorXf(opacity.astype(np.float32).reshape(resolution, resolution, 1))
    return Picture(mi.Texture2f(texels, use_accel=False, wrap_mode=dr.WrapMode.Repeat))


@lit_cirrus.domain
@high_altitude_layer.domain
def domain(scene: Scene) -> Domain:
    """Thin clouds above 4 km (4.3)."""
    if scene.optical_depth > 1 or scene.thickness > 500:
        return Domain(False, "not a thin layer")
    return Domain(True)


def _read(picture: Picture, sheet: Sheet, o: mi.Point3f, d: mi.Vector3f, share: float) -> mi.Float:
    """Transmittance straight up where a ray is at this share of the layer's thickness (4.5.4)."""
    x = o + (sheet.base + share * sheet.thickness - o.z) / d.z * d
    at = mi.Point2f(x.x - sheet.time * sheet.wind[0], x.y - sheet.time * sheet.wind[1])
    return dr.maximum(1 - picture.texture.eval(at / sheet.tile)[0], LEAST)
