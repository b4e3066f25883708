r"""Many orders of scattering as a sum of octaves: the first order again, each time brighter deep inside.

The peer that GPU Pro 7, chapter II.4, refers to for what its own curve leaves out (M. Wrenninge, 2015,
"Art-Directable Multiple Volumetric Scattering"): light that was scattered i times more is taken to be light
scattered once in a cloud that is thinner towards the sun, scatters less, and scatters more evenly.

    S(x, w) = E_sun sum_{i=0..N-1} b^i phase(cos, g c^i) e^(-a^i d)
    d       = optical depth from x towards the sun, by even steps, as in `cloud_light`
    phase   = Henyey-Greenstein, or two lobes, (HG(g c^i) + HG(back c^i)) / 2, the second towards the sun

a = b = c = 1/2 and the cloud's own g are the usual choice. Octave 0 alone is single scattering, exactly.
At the lit side (d = 0) the sum scatters sum b^i = (1 - b^N) / (1 - b) times the sun's irradiance, under 2 for
b = 1/2, where a thick layer of albedo 1 has 2.4 times it. Along the sun's ray octave i integrates to
(b / a)^i, so that with b = a every octave sends out the same again, N in all, and more where b > a: N is a
brightness as well as an accuracy. The usual choice leaves thick clouds a good half too dark; b = 0.7 comes
nearer and is no bound any more.

Read as intended: the extinction along the view ray is the cloud's own in all octaves. Rain multiplies d and
nothing else, as in `cloud_light`.
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
from approximations.kit.cloud_march import light_depth, view_march
from approximations.kit.phase import henyey_greenstein
from scenes.cloud import CloudSlab, CloudSphere
from scenes.contract import RADIANCE, SINGLE_SCATTERING, SOURCE_FUNCTION, Scene, View
from scenes.cumulus import Cumulus
from scenes.two_balls import TwoBalls

ONCE_SCATTERED = {"octaves": 1, "steps": 1024}


@technique(
    source="peer: Wrenninge 2015, octaves of scattering; GPU Pro 7, II.4, sec. 4.4",
    estimates=SOURCE_FUNCTION,
    on=(CloudSlab, Cumulus),
    replaces="the source function of all orders of scattering",
    neglects=(MULTIPLE_SCATTERING, PHASE_FUNCTION, SAMPLING),
    claims=(LINEAR_IN_LIGHT,),
    stress={"CloudSlab": ("optical_depth", "sun_elevation")},
    baseline=True,
)
def octave_source(
    view: View,
    *,
    octaves: Annotated[int, Sweep(1, 3, 8, low=1, high=16)] = 8,
    attenuation: Annotated[float, Sweep(0.25, 0.5, low=0.0, high=1.0)] = 0.5,
    contribution: Annotated[float, Sweep(0.5, 0.7, low=0.0, high=1.0)] = 0.5,
    eccentricity: Annotated[float, Sweep(0.5, 0.8, low=0.0, high=1.0)] = 0.5,
    lobes: Literal["one", "two"] = "one",
    back: Annotated[float, Sweep(-0.5, low=-0.95, high=0.0)] = -0.5,
    light_steps: Annotated[int, Sweep(6, 16, low=1, high=1024)] = 6,
) -> mi.Color3f:
    """Source function (W m^-2 sr^-1) at the probes: the camera's origins are points in the cloud, its
    directions run from eye to sample. Knobs as in `octave_light`."""
    terms = _terms(view, octaves, attenuation, contribution, eccentricity, lobes, back)
    depth = light_depth(view, view.camera.origin, light_steps)
    return mi.Color3f(view.sun.irradiance * _sum(terms, view.cloud.precipitation * depth))


@technique(
    source="peer: Wrenninge 2015, octaves of scattering; GPU Pro 7, II.4, sec. 4.4",
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
    stress={"CloudSphere": ("sun_angle", "optical_depth"), "TwoBalls": ("sun_angle",)},
    baseline=True,
)
def octave_light(
    view: View,
    *,
    octaves: Annotated[int, Sweep(1, 3, 8, low=1, high=16)] = 8,
    attenuation: Annotated[float, Sweep(0.25, 0.5, low=0.0, high=1.0)] = 0.5,
    contribution: Annotated[float, Sweep(0.5, 0.7, low=0.0, high=1.0)] = 0.5,
    eccentricity: Annotated[float, Sweep(0.5, 0.8, low=0.0, high=1.0)] = 0.5,
    lobes: Literal["one", "two"] = "one",
    back: Annotated[float, Sweep(-0.5, low=-0.95, high=0.0)] = -0.5,
    light_steps: Annotated[int, Sweep(6, 16, low=1, high=1024)] = 6,
    steps: Annotated[int, Sweep(64, 128, low=1, high=8192)] = 128,
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel, before a black sky.

    octaves       N.
    attenuation   a, by which the light depth shrinks from octave to octave.
    contribution  b, by which the octaves' weights shrink.
    eccentricity  c, by which their mean cosines shrink.
    lobes         the cloud's own lobe alone, or with it, in equal shares, a second one of mean cosine `back`.
    light_steps   samples of the march to the sun.
    steps         samples along the view ray.
    """
    terms = _terms(view, octaves, attenuation, contribution, eccentricity, lobes, back)

    def source(x: mi.Point3f, active: mi.Bool) -> mi.Float:
        return _sum(terms, view.cloud.precipitation * light_depth(view, x, light_steps, active))

    return mi.Color3f(view.sun.irradiance * view.cloud.albedo * view_march(view, steps, source))


@octave_source.domain
@octave_light.domain
def domain(scene: Scene) -> Domain:
    """Clouds in sunlight, thin or thick; not where another light has a part."""
    if isinstance(scene, Cumulus) and scene.lit_by != "sun":
        return Domain(False, "the light of the sky, which the sum has no term for")
    if scene.albedo < 0.99:
        return Domain(False, "a medium that absorbs, whose orders of scattering die off faster")
    return Domain(True)


def _terms(
    view: View, n: int, a: float, b: float, c: float, lobes: str, back: float
) -> list[tuple[float, mi.Float]]:
    """(a^i, b^i phase_i) of the octaves, at every pixel."""
    cosine = dr.dot(view.camera.direction, view.sun.direction)

    def lobe(i: int) -> mi.Float:
        own = henyey_greenstein(cosine, view.cloud.g * c**i)
        return own if lobes == "one" else 0.5 * (own + henyey_greenstein(cosine, back * c**i))

    return [(a**i, b**i * lobe(i)) for i in range(n)]


def _sum(terms: list[tuple[float, mi.Float]], depth: mi.Float) -> mi.Float:
    """sum weight e^(-thinness depth) over the octaves."""
    total = dr.zeros(mi.Float, dr.width(depth))
    for thinness, weight in terms:
        total += weight * dr.exp(-thinness * depth)
    return total
