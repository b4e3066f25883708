r"""The renderer of volumetric cloudscapes as a whole, with its parts made exact one after another.

GPU Pro 7, chapter II.4, sections 4.4 to 4.6. One pixel of every block of 4 x 4 is marched and the image
filled in between (4.6). A view ray takes 128 steps, the chapter's number along the horizon, with two samplers
and an early end at a transmittance of 0.01 (4.5). Where there is cloud, six samples in a cone and one far out
give the light depth d towards the sun (4.5.3), and the light that goes to the eye is (4.4.6)

    E_sun albedo f E(d),   E = 2 e^-(d p) (1 - e^(-2 d)),   f Henyey-Greenstein's lobe of g = 0.2

The parts stand in modules of their own: `cloud_light`, `cone_light`, `adaptive_march`, `cloud_compositing`,
`cloud_reprojection`. Here each has an exact counterpart, so that its share of the error is what goes when it
is made exact, on a cloud whose density is the very grid that the truth is rendered from. Against all orders
of scattering, on Cumulus (rmse in means of the truth, raw and after the one gain that fits best):

                                                          bias    rmse    gain   rmse after it
    R5  as the chapter has it                           - 83 %    1.68     3.3      1.32
    R4  all pixels marched                              - 83 %    1.68     3.3      1.33
    R3  and in 256 steps, to a transmittance of 1e-3    - 83 %    1.68     3.3      1.33
    R2  and 32 samples on the whole way to the sun      - 71 %    1.52     2.6      1.12
    R1  and Beer's law with the cloud's own lobe        - 96 %    1.92    14        1.39

R1 is light that is scattered once, and is so to 0.6 % of its mean: the march and the way to the sun have
converged (twice and six times as many samples move R1 by 0.3 % and R2 by 0.4 %). What it lacks of the truth,
96 % of the light, is scattered more often. The chapter's curve makes up for a quarter of that, and leaves an
error of shape that no gain mends. Seven samples to the sun, 100 m apart in the cone, meet more cloud than the
way there has (of light scattered once they leave 26 % too little); 25 m apart they do better than all of the
way, - 51 % and 0.85 after the gain, since to see too little cloud makes up for light that the curve lacks.
The march of 128 steps owns nothing that can be seen beside these, nor does a jitter of where its steps begin
change anything; nor does the filled-in image, which takes a seventh of the time (a tenth, says the chapter)
and is off by 3.7 % where it is held, all else exact, against R1's truth.

In print, and what was done here:
- "Temporal reprojection" is all that is said of 4.6. With nothing in motion it ends after 16 frames at the
  full march, which is `reconstruction="exact"`; "quarter" is the image of one frame alone, as where history
  fails. A block is one pixel of the picture that is judged, 4 x 4 of whose samples are averaged, which is
  kind; with `block=16` a quarter of the judged resolution is marched, 37 % off R1's truth.
- How samples are composited is not printed. The default solves the transfer equation; `rule="literal"` takes
  the words, a sum of densities until it is 1: 2.9 times too bright for having as many steps as that.
- The cheap sampler of the chapter sees the first texture alone. The grid has one density, so that it is also
  what is looked for: no read is saved, and no cloud missed that a full sample would have met.
- The lobe's listing, pi^2 too bright, is in `cloud_light`; here stands the displayed equation.
- No light of the sky, as in the chapter. Rain is as in `cloud_light`: along the view ray it does nothing, so
  that with rain "exact" is not R1.
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
    claims=(LINEAR_IN_LIGHT, exact_when("Cumulus", 0.01, knobs=ONCE_SCATTERED, quantity=SINGLE_SCATTERING)),
    stress={"Cumulus": ("sun_azimuth", "optical_depth")},
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
    lighting        E(d): twice Beer's factor times the powder, or Beer's alone, both with the broad lobe;
                    "exact": of light that is scattered once, Beer's with the lobe of the cloud.
    rule            how samples of the adaptive march make a radiance; "literal" as worded, with density 1
                    opaque.
    block           pixels along a side of one of which one is marched.
    steps           of the adaptive march.
    cone_step       between samples of the cone, m.
    """
    small, block = reconstruction == "quarter", min(block, view.width, view.height)
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
    """Rays of the pixels in the middle of whole blocks, one a block, and how many there are across and
    down."""
    across, below = view.width // block, view.height // block
    at = pixels(across, below) * block + block // 2
    i = dr.fma(at.y, view.width, at.x)
    whole = view.camera

    def taken(rays):
        return dr.gather(type(rays), rays, i) if dr.width(rays) > 1 else rays

    camera = Camera(taken(whole.origin), taken(whole.direction), whole.forward, whole.near, whole.far)
    return camera, across, below


def _filled(image: mi.Float, width: int, height: int, view: View, block: int) -> mi.Float:
    """The image in full resolution: bilinear between marched pixels, beyond them the nearest."""
    x = mi.Point2f(pixels(view.width, view.height))
    return fetch(texture(image, width, height, "bilinear"), (x - block // 2) / block)[0]
