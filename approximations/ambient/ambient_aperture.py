r"""Ambient aperture lighting: a round light seen through a round hole.

SIGGRAPH 2006 Course 26, chapter 8. Visibility at a point is compressed to one spherical cap, the
aperture; a round light is another cap; direct light is what the two share.

    bake     A = int V dw            visible solid angle over the hemisphere about n        (8.3)
             r0 = acos(1 - A / 2 pi) radius of the cap of that area
             a  = normalize(int V w dw)
    overlap  area of (cap a, r0) and (cap l, r1): the lens, or a smoothstep                  (8.4.1, 8.4.2)
    cosine   Lambert factor at the average of a and l                                      (8.4.3)
    sky      the rest of the aperture sees a uniform sky                                   (8.4.4)

In print, and what was done here:
- The visible area carries 2 pi in front of an integral over dw; that is right for the *mean* of V,
  which is what is computed. The radius is written as "a cos(...)", an arc cosine.
- The third term of the lens area has the wrong sign: it gives -4.283 sr for two hemispheres 1 rad
  apart, where 2 (pi - 1) = 4.283 is right. `overlap="printed"` keeps the slip, "lens" mends it.
- Whether the averaged direction is normalised is not said: `cosine` offers both readings.
- The Lambert factor of the sky term is not given: `sky_cosine` offers three readings. "none" is what
  stands in print and doubles an open sky.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    COSINE_OVER_LIGHT,
    HORIZON_CLIPPING,
    INTERREFLECTION,
    LINEAR_IN_LIGHT,
    SHAPE_OF_VISIBILITY,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from approximations.kit.caps import (
    cap_area,
    cap_radius,
    lens_area,
    lens_area_printed,
    lens_irradiance,
    smoothstep_area,
)
from approximations.kit.visible_sky import visible_sky
from scenes.contract import DIRECT_RADIANCE, RADIANCE, Scene, View
from scenes.sunlit import SphereOverPlane, Valley


@dataclass
class Apertures:
    """One cap per point: unit axis, radius (rad, 0 to pi/2). 16 bytes a point as stored in float32."""

    axis: mi.Vector3f
    radius: mi.Float


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 8",
    covers=tuple(f"ambient-aperture/0{i}" for i in range(1, 6)),
    estimates=RADIANCE,
    also=(DIRECT_RADIANCE,),
    on=(SphereOverPlane, Valley),
    replaces="visibility times direct light of a round sun and a uniform sky",
    neglects=(SHAPE_OF_VISIBILITY, COSINE_OVER_LIGHT, HORIZON_CLIPPING, INTERREFLECTION),
    claims=(
        LINEAR_IN_LIGHT,
        exact_when(
            "Valley",
            0.01,
            fields={"slope": 5.0, "light_elevation": 90.0, "light_radius": 0.005},
            knobs={"overlap": "exact", "cosine": "exact", "sky_cosine": "exact", "rays": 1024},
        ),
    ),
    stress={"SphereOverPlane": ("light_elevation", "light_radius", "gap"), "Valley": ("slope", "albedo")},
)
def ambient_aperture(
    view: View,
    apertures: Apertures,
    *,
    overlap: Literal["smoothstep", "lens", "printed", "exact"] = "smoothstep",
    cosine: Literal["normalised", "raw", "light", "exact"] = "normalised",
    sky_cosine: Literal["none", "axis", "half", "exact"] = "none",
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel.

    overlap     area shared by aperture and light (sr): "smoothstep", the mended "lens" in float32,
                the lens as "printed", or "exact": the lens in float64.
    cosine      Lambert factor of the sun: at (a + l) normalised, at (a + l)/2 as it is, at the light's
                own direction, or "exact": the mean cosine over the lens, from its vector irradiance.
    sky_cosine  Lambert factor of the sky: "none" (1), "axis" (n . a), "half" (1/2), or "exact":
                pi sin(r0)^2 n . a less what the sun covers.
    """
    surface, sun = view.surface, view.sun
    n, a, r0 = surface.normal, apertures.axis, apertures.radius
    l, r1 = sun.direction, mi.Float(sun.angular_radius if sun.irradiance > 0 else 0)
    d = dr.safe_acos(dr.dot(a, l))

    if overlap == "exact":
        area = mi.Float(lens_area(mi.Float64(r0), mi.Float64(r1), dr.safe_acos(_dot64(a, l))))
    else:
        area = {"smoothstep": smoothstep_area, "lens": lens_area, "printed": lens_area_printed}[overlap](
            r0, r1, d
        )

    if cosine == "exact":
        lambert = _mean_cosine(n, a, r0, l, r1)
    elif cosine == "light":
        lambert = dr.dot(n, l)
    else:
        c = 0.5 * (a + l)
        lambert = dr.dot(n, dr.normalize(c) if cosine == "normalised" else c)
    sunlit = area * dr.maximum(lambert, 0)

    free = cap_area(r0) - area
    if sky_cosine == "exact":
        skylit = dr.maximum(dr.pi * dr.square(dr.sin(r0)) * dr.dot(n, a) - sunlit, 0)
    elif sky_cosine == "axis":
        skylit = free * dr.maximum(dr.dot(n, a), 0)
    else:
        skylit = free * (0.5 if sky_cosine == "half" else 1.0)

    irradiance = sun.radiance * sunlit + view.sky * skylit
    return dr.select(surface.valid, surface.albedo * dr.inv_pi * irradiance, view.sky)


@ambient_aperture.bake
def bake(view: View, *, rays: Annotated[int, Sweep(16, 64, 256, 1024, low=4, high=65536)] = 256) -> Apertures:
    """Ray-cast visibility over the hemisphere of every point, `rays` even directions each (8.3)."""
    n = view.surface.normal
    seen = visible_sky(view, view.surface.position, n, rays)
    area = 2 * dr.pi * seen.share
    axis = dr.select(seen.share > 0, dr.normalize(seen.direction), n)
    baked = Apertures(axis, dr.minimum(cap_radius(area), 0.5 * dr.pi))
    dr.eval(baked.axis, baked.radius)
    return baked


@ambient_aperture.domain
def domain(scene: Scene) -> Domain:
    """Terrain that hides the sky from the sides, and a light well above the horizon (8.1, 8.4.3)."""
    if isinstance(scene, SphereOverPlane):
        return Domain(False, "the visible sky is a band round an occluder above, not one round region")
    if scene.light_elevation < 15:
        return Domain(False, "the light stands close to the horizon")
    if isinstance(scene, Valley) and scene.slope > 60:
        return Domain(False, "the visible sky of a deep valley is a thin lune")
    return Domain(True)


def _dot64(a: mi.Vector3f, b: mi.Vector3f) -> mi.Float64:
    a, b = dr.normalize(mi.Vector3d(a)), dr.normalize(mi.Vector3d(b))
    return dr.dot(a, b)


def _mean_cosine(n: mi.Vector3f, a: mi.Vector3f, r0: mi.Float, l: mi.Vector3f, r1: mi.Float) -> mi.Float:
    """n . Phi over the lens's area, in float64."""
    a, l = dr.normalize(mi.Vector3d(a)), dr.normalize(mi.Vector3d(l))
    r0, r1, d = mi.Float64(r0), mi.Float64(r1), dr.safe_acos(dr.dot(a, l))
    phi = lens_irradiance(a, r0, l, r1, d)
    area = lens_area(r0, r1, d)
    return mi.Float(dr.select(area > 1e-12, dr.dot(mi.Vector3d(n), phi) / area, 0))
