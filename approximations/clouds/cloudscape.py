r"""The renderer of volumetric cloudscapes as a whole, with its parts made exact one after another.

GPU Pro 7, chapter II.4, sections 4.4 to 4.6.
"""

from __future__ import annotations

from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    LINEAR_IN_LIGHT,
    MULTIPLE_SCATTERING,
    PHASE_FUNCTION,
    SAMPLING,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from approximations.kit.adaptive_march import adaptive_march
from approximations.kit.cloud_lighting import cone_depth, light_energy
from approximations.kit.phase import henyey_greenstein
from approximations.kit.reprojection import fetch, pixels, texture
from scenes.contract import RADIANCE, SINGLE_SCATTERING, Camera, Scene, View
from scenes.cumulus import Cumulus

CUT = 0.01  # transmittance at which the march ends
BROAD = 0.2  # mean cosine of the chapter's lobe
FINE_STEPS, FINE_CUT = 256, 1e-3  # of the exact view march
FINE_LIGHT = 32  # samples of the exact march to the sun
DARK = 8.0  # optical depth at which that ends
ONCE_SCATTERED = {"reconstruction": "exact", "march": "exact", "sun": "exact", "lighting": "exact"}


@technique(
    source="GPU Pro 7, II.4, sec. 4.4 to 4.6",
    covers=("cloudscapes/01",),
    estimates=RADIANCE,
    also=(SINGLE_SCATTERING,),
    on=(Cumulus,),
    replaces="all orders of scattering in a cloud in sunlight",
    neglects=(MULTIPLE_SCATTERING, PHASE_FUNCTION, SAMPLING, SPATIAL_DETAIL),
    claims=(LINEAR_IN_LIGHT, exact_when("Cumulus", 0.02, knobs=ONCE_SCATTERED, quantity=SINGLE_SCATTERING)),
)
def cloudscape(
    view: View,
    *,
    reconstruction: Literal["quarter", "exact"] = "quarter",
    march: Literal["adaptive", "exact"] = "adaptive",
    sun: Literal["cone", "exact"] = "cone",
    lighting: Literal["beer-powder", "beer", "exact"] = "beer-powder",
    rule: Literal["energy-conserving", "literal"] = "energy-conserving",
    block: Annotated[int, Sweep(16, low=1, high=64)] = 4,
    steps: Annotated[int, Sweep(low=1, high=8192)] = 128,
    cone_step: Annotated[float, Sweep(low=1.0, high=1000.0)] = 100.0,
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel, before a black sky.

    reconstruction  one pixel of every block is marched and the image filled in between, or all are.
    march           along the view ray: two samplers in `steps` steps, or 256 steps.
    sun             the light depth: by a cone of six samples and a far one, or by 32 to the cloud's end.
    lighting        E(d): twice Beer's factor times the powder, Beer's alone, both with the broad lobe; or
                    "exact" for light that is scattered once, Beer's with the lobe of the cloud.
    rule            how samples of the adaptive march make a radiance; "literal" as worded, with density 1
                    opaque.
    block           pixels along a side of one of which one is marched.
    steps           of the adaptive march.
    cone_step       between samples of the cone, m.
    """
    small = reconstruction == "quarter"
    camera, width, height = _thinned(view, block) if small else (view.camera, view.width, view.height)
    cloud, light = view.cloud, view.sun
    energy = "beer_powder" if lighting == "beer-powder" else "beer"

    def source(x: mi.Point3f, active: mi.Bool) -> mi.Color3f:
        if sun == "exact":
            depth = _whole_depth(view, x, active)
        else:
            depth = cone_depth(view, x, active, step=cone_step)
        return mi.Color3f(light_energy(depth, cloud.precipitation, energy))

    def extinction(x: mi.Point3f, active: mi.Bool) -> mi.Float:
        return cloud.extinction(x)

    span = cloud.span(camera.origin, camera.direction)
    if march == "exact":
        marched = adaptive_march(camera, span, FINE_STEPS, extinction, source=source, cut=FINE_CUT)
    else:
        marched = adaptive_march(
            camera,
            span,
            steps,
            extinction,
            cheap=extinction,
            source=source,
            rule=rule,
            k=cloud.sigma_t,
            cut=CUT,
        )
    lobe = henyey_greenstein(
        dr.dot(camera.direction, light.direction), cloud.g if lighting == "exact" else BROAD
    )
    image = light.irradiance * cloud.albedo * lobe * marched.gathered.x
    return mi.Color3f(_filled(image, width, height, view, block) if small else image)


@cloudscape.domain
def domain(scene: Scene) -> Domain:
    """Low water clouds by day (4.4.1), in sunlight alone, large enough for a cone of some hundred metres."""
    if scene.albedo < 0.99 or not 0.7 <= scene.g <= 0.9:
        return Domain(
            False, "not a cloud of water droplets, which absorb next to nothing and scatter forwards"
        )
    if scene.lit_by != "sun":
        return Domain(False, "the light of the sky, for which the chapter has no term")
    if scene.optical_depth < 4:
        return Domain(False, "a thin veil: the curve takes its light depth for the inside of a cloud")
    if scene.sun_elevation < 10:
        return Domain(False, "under a low sun the way through clouds is many times as long as the cone")
    return Domain(True)


def _whole_depth(view: View, x: mi.Point3f, active: mi.Bool) -> mi.Float:
    """Optical depth from points x (m) to where the cloud ends towards the sun, up to about DARK."""
    cloud, l = view.cloud, view.sun.direction
    _, way_out = cloud.span(x, l)

    def further(i, depth):
        a, b = (way_out * dr.square((mi.Float(i) + k) / FINE_LIGHT) for k in (0, 1))
        return i + 1, depth + (b - a) * cloud.extinction(x + 0.5 * (a + b) * l)

    start = (mi.UInt32(0), dr.zeros(mi.Float, dr.width(x)))
    _, depth = dr.while_loop(start, lambda i, depth: active & (i < FINE_LIGHT) & (depth < DARK), further)
    return depth


def _thinned(view: View, block: int) -> tuple[Camera, int, int]:
    """Rays of the pixels in the middle of blocks, one a block, and how many there are across and down."""
    across, below = -(-view.width // block), -(-view.height // block)
    at = pixels(across, below) * block + block // 2
    i = dr.minimum(at.y, view.height - 1) * view.width + dr.minimum(at.x, view.width - 1)
    whole = view.camera

    def taken(rays):
        return dr.gather(type(rays), rays, i) if dr.width(rays) > 1 else rays

    camera = Camera(taken(whole.origin), taken(whole.direction), whole.forward, whole.near, whole.far)
    return camera, across, below


def _filled(image: mi.Float, width: int, height: int, view: View, block: int) -> mi.Float:
    """The image in full resolution, bilinear between the pixels that were marched."""
    x = mi.Point2f(pixels(view.width, view.height))
    return fetch(texture(image, width, height, "bilinear"), (x - block // 2) / block)[0]
