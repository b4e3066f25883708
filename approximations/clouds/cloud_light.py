r"""Real-time light of clouds: Beer, powder, a broad forward lobe and a rain gain on one light depth.

GPU Pro 7, chapter II.4, section 4.4. Light that meets a cloud many times is left to one curve over the
optical depth d from a point towards the sun; what the point sends to the eye is E_sun E(d) f(cos).

    E = e^-d                               Beer: exact for light that is scattered once           (4.4.2)
    f = (1 - g^2) / (4 pi (1 + g^2 - 2 g cos)^1.5),  g = 0.2                                     (4.4.3)
    P = 1 - e^(-2 d)                       in-scattering probability, the "powder" of dark edges  (4.4.4)
    E = 2 e^-d (1 - e^(-2 d))              Beer and powder in one: at most 0.770, at d = 0.549    (4.4.4)
    E = 2 e^(-d p) (1 - e^(-2 d))          rain: the precipitation p >= 1 multiplies d            (4.4.5)
    d = h sum_{i=1..n} sigma(x + (i - 1/2) h l),  h = way out of the cloud / n                  (4.4.2)

The view ray is cut in even steps with one sample amid each. Over a step of optical depth a the source is
taken as constant, L += T albedo E_sun E f (1 - e^-a), T *= e^-a, which solves the transfer equation as the
steps shrink; the sums of the chapter's own listing depend on the number of steps.

In print, and what was done here:
- The listing of f divides by 4 and multiplies by 3.1415: pi^2 times too much. The displayed equation is
  right. `phase="printed"` keeps the slip.
- The powder curve stands alone as P and inside the product; `energy="powder"` is P with neither the gain
  of 2 nor Beer's factor.
- The text lets rain increase the density of both factors, the summary only Beer's exponent: `rain_in`.
  Along the view ray it does neither, so that silhouettes stay as they are without rain.
- The sum of densities is printed without a length; here sigma is an extinction (1/m) and h a length.
- How far the march to the sun goes is not given in 4.4: here it leaves the cloud, so that in clouds of one
  density every number of samples is exact, and what is measured is the model of light alone. The short
  cone of samples is section 4.5's, another technique.
- There is no light of the sky.
- Powder is shown as what darkens edges and lights creases. On two balls that touch, of optical depth 16, a
  free limb has 0.4 of a bulge's radiance with the sun behind the eye and 0.6 with the sun overhead; this has
  1.0 and 2.6 (Beer alone 1.0 and 2.8). For the crease it has 1.0 and 3.5, where the truth has 0.8 and 1.3.
  Both are owed to light that leaves sideways, of which no depth towards the sun knows.
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
    Domain,
    Sweep,
    exact_when,
    technique,
)
from approximations.kit.cloud_lighting import light_energy
from approximations.kit.cloud_march import light_depth, view_march
from approximations.kit.phase import henyey_greenstein
from scenes.cloud import CloudSlab, CloudSphere
from scenes.contract import RADIANCE, SINGLE_SCATTERING, SOURCE_FUNCTION, Scene, View
from scenes.cumulus import Cumulus
from scenes.two_balls import TwoBalls

ONCE_SCATTERED = {"energy": "beer", "phase": "exact", "steps": 1024}


@technique(
    source="GPU Pro 7, II.4, sec. 4.4",
    covers=tuple(f"cloudscapes/{i:02d}" for i in range(8, 13)),
    estimates=SOURCE_FUNCTION,
    on=(CloudSlab, Cumulus),
    replaces="the source function of all orders of scattering",
    neglects=(MULTIPLE_SCATTERING, PHASE_FUNCTION, SAMPLING),
    claims=(LINEAR_IN_LIGHT,),
    stress={"CloudSlab": ("optical_depth", "sun_elevation")},
)
def cloud_source(
    view: View,
    *,
    energy: Literal["beer", "powder", "beer_powder"] = "beer_powder",
    phase: Literal["hg", "printed", "exact"] = "hg",
    g: Annotated[float, Sweep(-0.5, 0.0, 0.2, 0.5, 0.85, low=-0.95, high=0.95)] = 0.2,
    rain_in: Literal["beer", "both"] = "beer",
    light_steps: Annotated[int, Sweep(1, 6, 16, low=1, high=1024)] = 6,
) -> mi.Color3f:
    """Source function E_sun E f (W m^-2 sr^-1) at the probes: the camera's origins are points in the
    cloud, its directions run from eye to sample. Knobs as in `cloud_light`."""
    depth = light_depth(view, view.camera.origin, light_steps)
    lobe = _lobe(view, phase, g)
    return mi.Color3f(
        view.sun.irradiance * light_energy(depth, view.cloud.precipitation, energy, rain_in) * lobe
    )


@technique(
    source="GPU Pro 7, II.4, sec. 4.4",
    covers=tuple(f"cloudscapes/{i:02d}" for i in range(8, 13)),
    estimates=RADIANCE,
    also=(SINGLE_SCATTERING,),
    on=(CloudSlab, CloudSphere, Cumulus, TwoBalls),
    replaces="all orders of scattering in a cloud in sunlight",
    neglects=(MULTIPLE_SCATTERING, PHASE_FUNCTION, SAMPLING),
    claims=(
        LINEAR_IN_LIGHT,
        exact_when("CloudSlab", 0.002, knobs=ONCE_SCATTERED, quantity=SINGLE_SCATTERING),
        exact_when("CloudSphere", 0.002, knobs=ONCE_SCATTERED, quantity=SINGLE_SCATTERING),
    ),
    stress={
        "CloudSphere": ("sun_angle", "optical_depth", "precipitation"),
        "CloudSlab": ("optical_depth", "sun_elevation"),
        "TwoBalls": ("sun_angle",),
    },
)
def cloud_light(
    view: View,
    *,
    energy: Literal["beer", "powder", "beer_powder"] = "beer_powder",
    phase: Literal["hg", "printed", "exact"] = "hg",
    g: Annotated[float, Sweep(-0.5, 0.0, 0.2, 0.5, 0.85, low=-0.95, high=0.95)] = 0.2,
    rain_in: Literal["beer", "both"] = "beer",
    light_steps: Annotated[int, Sweep(1, 6, 16, low=1, high=1024)] = 6,
    steps: Annotated[int, Sweep(16, 64, 128, 512, low=1, high=8192)] = 128,
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel, before a black sky.

    energy       E(d): Beer alone, the powder P alone, or their product with the gain 2.
    phase        Henyey-Greenstein of `g`, the same as "printed" (pi^2 too much), or "exact": of the cloud's
                 own mean cosine.
    g            mean cosine of the broad lobe.
    rain_in      whether the precipitation multiplies the depth in Beer's factor only or in "both".
    light_steps  samples of the march to the sun.
    steps        samples along the view ray.
    """
    cloud = view.cloud

    def source(x: mi.Point3f, active: mi.Bool) -> mi.Float:
        depth = light_depth(view, x, light_steps, active)
        return light_energy(depth, cloud.precipitation, energy, rain_in)

    gathered = view_march(view, steps, source)
    return mi.Color3f(view.sun.irradiance * (cloud.albedo * (_lobe(view, phase, g) * gathered)))


@cloud_source.domain
@cloud_light.domain
def domain(scene: Scene) -> Domain:
    """Low water clouds by day, thick enough to have a dark side, with or without rain (4.4.1, 4.4.5)."""
    if scene.albedo < 0.99 or not 0.7 <= scene.g <= 0.9:
        return Domain(
            False, "not a cloud of water droplets, which absorb next to nothing and scatter forwards"
        )
    if scene.optical_depth < 4:
        return Domain(False, "a thin veil: the curve takes its light depth for the inside of a cloud")
    if isinstance(scene, Cumulus) and scene.lit_by != "sun":
        return Domain(False, "the light of the sky, for which the chapter has no term")
    if isinstance(scene, CloudSlab | Cumulus) and scene.sun_elevation < 10:
        return Domain(False, "under a low sun the light's way through a layer is many times its thickness")
    return Domain(True)


def _lobe(view: View, phase: str, g: float) -> mi.Float:
    """Phase function between the view ray and the way to the sun (4.4.3)."""
    cosine = dr.dot(view.camera.direction, view.sun.direction)
    lobe = henyey_greenstein(cosine, view.cloud.g if phase == "exact" else g)
    return lobe * (3.1415 * dr.pi) if phase == "printed" else lobe
