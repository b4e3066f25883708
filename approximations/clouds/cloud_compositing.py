r"""Samples of a view ray made into one radiance: a sum of densities, Beer's law, or the transfer equation.

GPU Pro 7, chapter II.4, sections 4.5.1 and 4.5.2. A ray through cloud takes even steps of length h
with a sample in each, of extinction sigma, which sends S to the eye; what the ray lets through is T, 1 to
begin with. The loop ends early where no more than `cut` is let through.

    literal             L += T S,               T -= sigma / k       densities are summed to an alpha 1 - T
    beer                T *= e^(-sigma h),      L += T S sigma h
    beer entering       L += T S sigma h,       T *= e^(-sigma h)
    energy-conserving   L += T S (1 - e^(-sigma h)),   T *= e^(-sigma h)
    exactly             L = int_0^D e^(-sigma t) sigma S(t) dt

Light is scattered once, S = E_sun albedo f e^-d with d the whole optical depth to the sun, which a cloud of
one density has without error; so what is measured is the compositing alone.

The chapter says that densities are summed along the view, that each result of the light is attenuated by
the sum so far, and that the loop can end early. The blend and the bound are not printed, nor is a length:
- "literal" takes the words as they are. The sum knows of no step, so that the picture depends on how many
  there are: from above, a layer of optical depth 32 is 1.6 times too bright with 64 steps, 2.4 times with
  512, and a sixth of itself with 8, whose first sample already lies in the dark. Nor does a sample's light
  know for how much cloud it stands: a layer of optical depth 1 is 41 times too bright. k, the extinction of
  density 1, is by default what makes a step of 1/64 m as deep as it is dense.
- "beer" attenuates before it adds, so that a step of depth a = sigma h counts a e^-a / (1 - e^-a) of what
  it should: too dark, and black where steps are deep. "beer entering" adds first and counts
  a / (1 - e^-a): too bright, a times where steps are deep (55 m of 0.1 /m: 5.5). Both errors fall as h.
  "energy-conserving" is exact for steps of even source and its error falls as h^2: 6 % at 64 steps.
- The early end costs at most `cut` of what would lie behind.
- Where in the step a sample stands is not said. Amid it all pixels err alike, which makes bands; jitter makes
  noise of them, and blue noise lets neighbours average it out: see `approximations.kit.start_jitter`.
"""

from __future__ import annotations

from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    LINEAR_IN_LIGHT,
    MULTIPLE_SCATTERING,
    NO_MODEL,
    SAMPLING,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from approximations.kit.adaptive_march import adaptive_march
from approximations.kit.cloud_march import light_depth
from approximations.kit.phase import henyey_greenstein
from approximations.kit.start_jitter import blue_table, starts
from scenes.cloud import CloudSlab
from scenes.contract import SINGLE_SCATTERING, Scene, View

FINE = {"rule": "energy-conserving", "steps": 1024, "cut": 0.0}


@technique(
    source="GPU Pro 7, II.4, sec. 4.5.1 and 4.5.2",
    covers=("cloudscapes/17",),
    estimates=SINGLE_SCATTERING,
    on=(CloudSlab,),
    replaces="the transfer integral along the view ray",
    neglects=(NO_MODEL, SAMPLING, MULTIPLE_SCATTERING),
    claims=(LINEAR_IN_LIGHT, exact_when("CloudSlab", 0.001, knobs=FINE)),
    stress={"CloudSlab": ("optical_depth",)},
)
def cloud_compositing(
    view: View,
    table: mi.Float,
    *,
    rule: Literal["literal", "beer", "beer entering", "energy-conserving"] = "literal",
    k: Annotated[float, Sweep(64.0, low=0.1, high=1e4)] = 64.0,
    steps: Annotated[int, Sweep(8, 64, 512, low=1, high=8192)] = 64,
    cut: Annotated[float, Sweep(0.01, low=0.0, high=1.0)] = 0.01,
    jitter: Literal["none", "white", "blue noise"] = "none",
) -> mi.Color3f:
    """Radiance scattered once (W m^-2 sr^-1) towards the camera, one colour per pixel, before a black sky.

    rule    of the sum, as above.
    k       extinction of density 1, 1/m, for the literal rule.
    steps   along the view ray.
    cut     share let through at which the march ends.
    jitter  of where in their steps the samples of a pixel stand.
    """
    cloud, sun = view.cloud, view.sun
    cosine = dr.dot(view.camera.direction, sun.direction)
    once = sun.irradiance * cloud.albedo * henyey_greenstein(cosine, cloud.g)

    def source(x: mi.Point3f, active: mi.Bool) -> mi.Color3f:
        return mi.Color3f(once * dr.exp(-cloud.precipitation * light_depth(view, x, 1, active)))

    marched = adaptive_march(
        view.camera,
        cloud.span(view.camera.origin, view.camera.direction),
        steps,
        lambda x, active: cloud.extinction(x),
        source=source,
        rule=rule,
        k=k,
        cut=cut,
        start=starts(jitter, table, view.width, view.height),
    )
    return marched.gathered


@cloud_compositing.bake
def bake(view: View) -> mi.Float:
    """The square of blue noise."""
    return blue_table()


@cloud_compositing.domain
def domain(scene: Scene) -> Domain:
    """Low water clouds by day, through which a few dozen steps are taken (4.5.1)."""
    if scene.optical_depth < 4:
        return Domain(False, "a thin veil, whose density ought to be summed as a depth")
    if scene.sun_elevation < 10:
        return Domain(False, "under a low sun the lit skin of a layer is thinner than any step")
    return Domain(True)
