r"""Cloud shadows in one pass over the finished frame: a map of attenuation, fetched where the sun's ray
crosses the layer.

SIGGRAPH 2006 Course 26, chapter 6.9.1. For each pixel the position X is had from depth; from there along the
sun's direction l lies, in a plane at height H in the layer,

    X_c = X + (H - X_z) / l_z l,    frame *= A(X_c),   A = e^-tau of the cloud there.

It stands for the sun's transmittance, which belongs to the sun's direct light alone:

    L = albedo / pi [E_sun max(n . l, 0) A + pi L_sky].

Not given in the chapter, and what was done here:
- The map's projection. "planar": tau straight up, which knows neither the longer way of a low sun, tau / l_z,
  nor that it passes base and top at different places. "exact": tau along the sun, drawn anew when it moves.
- The plane (`plane`: 0 the base, 1/2 the middle, 1 the top). With tau straight up the middle is nearest the
  truth; with tau along the sun it does not matter where the ray is met, and all are exact.
- Resolution and filter of the map, of one tile of the repeating layer.
The pass multiplies what is already there (`darkens="frame"`, the chapter's), and with it the light of the sky
and what the ground shades itself: in the shadow of opaque cloud all of the sky's share is lost (rms error
23.5 % with a fifth of sky under a sun at 45 degrees, 6.8 % where the sun's light alone is multiplied).
The frame before the pass is the exact one of an open convex ground. Transparent things are not treated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.contract import (
    LINEAR_IN_LIGHT,
    MEDIUM_SHADOWS,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from scenes.clouded_ground import CloudedGround
from scenes.contract import DIRECT_RADIANCE, Scene, View

MARCH = 128
EXACT = {"darkens": "exact", "projection": "exact", "resolution": 512}


@dataclass
class ShadowMap:
    """Attenuation of one tile of a layer, its edge (m), and the height of the plane that it lies in (m)."""

    texture: mi.Texture2f
    tile: float
    height: float


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 6.9.1",
    covers=("atmosphere/11",),
    estimates=DIRECT_RADIANCE,
    on=(CloudedGround,),
    replaces="the sun's transmittance through the clouds, in its direct light",
    neglects=(MEDIUM_SHADOWS, SPATIAL_DETAIL),
    claims=(LINEAR_IN_LIGHT, exact_when("CloudedGround", 0.002, knobs=EXACT)),
    stress={"CloudedGround": ("sun_elevation", "sky_share", "thickness")},
)
def cloud_shadow_pass(
    view: View, shadows: ShadowMap, *, darkens: Literal["frame", "exact"] = "frame"
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) of the ground, one colour per pixel.

    darkens  what the map multiplies: all of the finished "frame", or the sun's direct light ("exact").
    """
    surface, l = view.surface, view.sun.direction
    sun = view.sun.irradiance / dr.pi * dr.maximum(dr.dot(surface.normal, l), 0)
    kept = _fetch(shadows, surface.position, l)
    lit = kept * (sun + view.sky) if darkens == "frame" else kept * sun + view.sky
    return dr.select(surface.valid, surface.albedo * lit, 0)


@cloud_shadow_pass.bake
def bake(
    view: View,
    *,
    projection: Literal["planar", "exact"] = "planar",
    plane: Annotated[float, Sweep(0.0, 0.5, low=0, high=1)] = 0.5,
    resolution: Annotated[int, Sweep(16, 64, low=4, high=1024)] = 256,
    filter: Literal["nearest", "linear"] = "linear",
) -> ShadowMap:
    """The map.

    projection  along which way tau is taken: straight up, or towards the sun.
    plane       where in the layer the map lies, from base (0) to top (1).
    resolution  texels along an edge of the tile.
    filter      of fetches.
    """
    layer = view.cloud.model
    height = layer.middle + (plane - 0.5) * layer.thickness
    i = dr.arange(mi.UInt32, resolution * resolution)
    x, y = (layer.tile / resolution * (mi.Float(n) + 0.5) for n in (i % resolution, i // resolution))
    along = view.sun.direction if projection == "exact" else mi.Vector3f(0, 0, 1)
    depth = _depth(view, mi.Point3f(x, y, height), along)
    texels = np.array(dr.exp(-depth)).reshape(resolution, resolution, 1)
    how = dr.FilterMode.Nearest if filter == "nearest" else dr.FilterMode.Linear
    texture = mi.Texture2f(
        mi.TensorXf(texels), use_accel=False, filter_mode=how, wrap_mode=dr.WrapMode.Repeat
    )
    return ShadowMap(texture, layer.tile, height)


@cloud_shadow_pass.domain
def domain(scene: Scene) -> Domain:
    """Moving shadows over a landscape by day (6.9.1)."""
    if scene.sun_elevation < 15:
        return Domain(False, "under a low sun the map is stretched and the way through the clouds long")
    return Domain(True)


def _fetch(shadows: ShadowMap, x: mi.Point3f, l: mi.Vector3f) -> mi.Float:
    """Attenuation where the sun's rays to x cross the map's plane (6.9.1)."""
    crossing = x + (shadows.height - x.z) / l.z * l
    return shadows.texture.eval(mi.Point2f(crossing.x, crossing.y) / shadows.tile)[0]


def _depth(view: View, x: mi.Point3f, w: mi.Vector3f) -> mi.Float:
    """Optical depth of all the layer along the line through x of unit direction w, w.z > 0."""
    below = x - 4 * view.cloud.model.thickness / w.z * w
    near, far = view.cloud.span(below, w)
    h = (far - near) / MARCH

    def step(i, total):
        return i + 1, total + view.cloud.extinction(below + (near + (mi.Float(i) + 0.5) * h) * w)

    start = (mi.UInt32(0), dr.zeros(mi.Float, dr.width(x)))
    _, total = dr.while_loop(start, lambda i, total: i < MARCH, step)
    return h * total
