r"""Exponential height fog: one closed form of transmittance, one colour for all in-scattered light.

SIGGRAPH 2006 Course 26, chapter 6.4 with listing 1. Density f = b exp(-c z); the camera stands at O and
sees X = O + d.

    tau = b exp(-c O_z) |d| (1 - exp(-t)) / t,   t = c d_z         exact for this density
    T   = exp(-tau)
    L   = T L_surface + (1 - T) C_fog                              in-scattered light taken as constant

Per frame k0 = exp(-c O_z); per pixel the factor (1 - exp(-t)) / t is left out where |d_z| <= 0.01.

In print, and what was done here:
- The result is called fog density; it is the transmittance, 1 where there is no fog.
- The threshold keeps 0/0 out but is set on d_z (m), not on t, where the digits go: float32 is off by 3% at
  c = 1e-4, d_z = 0.011. `slope_threshold` moves it.
- High above dense fog k0 underflows while exp(-t) overflows. In float32 the fog is gone (T = 1) at
  c O_z = 88 and the result is NaN from 88.7. evaluation="two_exponentials" cures that and keeps the
  cancellation.
- What C_fog should be is not said; the scene sets it, see `Fog.colour`.

The light is exact to one scattering when every stage is "exact". Seen as an average,

    L = T L_surface + (1 - T) <J(s)>,   s spread along the ray as extinction is: T(s) = 1 - u (1 - T)

with J(s) = albedo (E_sun V T_sun / 4 pi + mean over directions of L_sky V T), V the visibility and T the
transmittance to the end of the fog. So C_fog stands for the mean of J over u, and nothing else.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    INSCATTERED_LIGHT,
    INTERREFLECTION,
    LINEAR_IN_LIGHT,
    MEDIUM_SHADOWS,
    MULTIPLE_SCATTERING,
    NUMBER_FORMAT,
    OCCLUSION,
    Domain,
    Sweep,
    at_most,
    exact_when,
    technique,
)
from approximations.kit.sampling import random_turn
from scenes.contract import RADIANCE, SINGLE_SCATTERING, TRANSMITTANCE, Fog, Scene, View
from scenes.fog import FogOverGround

Evaluation = Literal["threshold", "naive", "two_exponentials", "exact"]
SlopeThreshold = Annotated[float, Sweep(0.001, 0.01, 0.1, 1.0, low=0, high=100)]

SOURCE = "SIGGRAPH 2006 Course 26, ch. 6.4"


@technique(
    source=SOURCE,
    covers=("atmosphere/03",),
    estimates=TRANSMITTANCE,
    on=(FogOverGround,),
    replaces="transmittance of fog that thins out with height",
    neglects=(NUMBER_FORMAT,),
    claims=(
        at_most(1),
        exact_when("FogOverGround", 1e-3, knobs={"evaluation": "exact"}),
        exact_when("FogOverGround", 1e-3, fields={"falloff": 1e-5}, knobs={"evaluation": "exact"}),
        exact_when(
            "FogOverGround",
            1e-3,
            fields={"falloff": 5.0, "camera_height": 45.0},
            knobs={"evaluation": "exact"},
        ),
    ),
    stress={"FogOverGround": ("density", "falloff", "camera_height")},
)
def fog_transmittance(
    view: View,
    *,
    evaluation: Evaluation = "threshold",
    slope_threshold: SlopeThreshold = 0.01,
    number: Literal["float16", "float32"] = "float32",
) -> mi.Float:
    """Share of radiance (0 to 1) that reaches the camera from the surface, or from the fog's end.

    evaluation       how tau is computed, see `optical_depth`.
    slope_threshold  least |d_z| (m) at which the height factor is applied.
    number           format of O_z, |d|, d_z and of all that follows ("exact" goes on in float64).
    """
    o, w = view.camera.origin, view.camera.direction
    length = fogged_length(view)
    form = {"float16": mi.Float16, "float32": mi.Float}[number]
    tau = optical_depth(view.fog, form(o.z), form(length), form(length * w.z), evaluation, slope_threshold)
    return mi.Float(dr.exp(-tau))


@technique(
    source=SOURCE,
    covers=("atmosphere/03",),
    estimates=RADIANCE,
    also=(SINGLE_SCATTERING,),
    on=(FogOverGround,),
    replaces="light scattered by the fog, and the fog's shade on what it holds",
    neglects=(
        INSCATTERED_LIGHT,
        MEDIUM_SHADOWS,
        MULTIPLE_SCATTERING,
        OCCLUSION,
        INTERREFLECTION,
        NUMBER_FORMAT,
    ),
    claims=(
        LINEAR_IN_LIGHT,
        exact_when(
            "FogOverGround",
            0.035,  # what is left stands on the silhouettes, at 4 x 4 samples a pixel
            fields={"albedo": 0.0, "ground_albedo": 0.02},
            knobs={"evaluation": "exact", "surface_light": "exact"},
        ),
        exact_when(
            "FogOverGround",
            0.01,
            fields={"albedo": 1.0, "ground_albedo": 1.0, "sun_irradiance": 0.0},
        ),
    ),
    stress={"FogOverGround": ("density", "falloff", "sun_elevation", "albedo")},
)
def height_fog(
    view: View,
    *,
    evaluation: Evaluation = "threshold",
    slope_threshold: SlopeThreshold = 0.01,
    surface_light: Literal["unfogged", "exact"] = "unfogged",
    inscatter: Literal["constant", "exact"] = "constant",
    samples: Annotated[int, Sweep(4, 16, 64, low=1, high=4096)] = 16,
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel.

    evaluation, slope_threshold  how T is computed, see `optical_depth`.
    surface_light  light that meets the surface: sun with a hard shadow and the whole sky, "unfogged" on
                   their way; or "exact": through the fog, and the sky only where nothing hides it.
    inscatter      the "constant" C_fog, or "exact": the mean of J along the ray.
    samples        directions and depths per pixel in the exact stages.
    """
    o, w, length = view.camera.origin, view.camera.direction, fogged_length(view)
    tau = optical_depth(view.fog, o.z, length, length * w.z, evaluation, slope_threshold)
    lit = fogged_surface(view, samples) if surface_light == "exact" else unfogged_surface(view)
    colour = mean_source(view, samples) if inscatter == "exact" else view.fog.colour
    return blend(tau, lit, colour)


@fog_transmittance.domain
def domain(scene: Scene) -> Domain:
    """Where float32 keeps the digits of the closed form."""
    if scene.falloff * scene.camera_height > 80:
        return Domain(False, "the camera is so high above the fog that its density there underflows")
    if scene.falloff < 1e-3:
        return Domain(False, "the fog is so even that 1 - exp(-c d_z) cancels at eye level")
    return Domain(True)


@height_fog.domain
def radiance_domain(scene: Scene) -> Domain:
    """Where one colour may stand for the in-scattered light."""
    vertical = scene.density * min(1 / scene.falloff, scene.HEIGHT)
    if vertical > math.sin(math.radians(scene.sun_elevation)):
        return Domain(False, "the sun's optical depth to the ground exceeds 1: little of its light arrives")
    return domain(scene)


def fogged_length(view: View) -> mi.Float:
    """|d| (m): how far each camera ray runs in fog."""
    camera, surface = view.camera, view.surface
    return dr.select(surface.valid, surface.distance, view.fog.box_exit(camera.origin, camera.direction))


def optical_depth(
    fog: Fog, o_z, length, d_z, evaluation: Evaluation, slope_threshold: float
) -> mi.Float | mi.Float64:
    """tau from a height o_z (m) over a length |d| (m) that climbs d_z (m); any float type.

    "naive"             b |d| exp(-c O_z) (1 - exp(-t)) / t: NaN at d_z = 0.
    "threshold"         the same without the last factor where |d_z| <= slope_threshold: as published.
    "two_exponentials"  b |d| (exp(-c O_z) - exp(-c X_z)) / (c d_z), with the same threshold.
    "exact"             from the lower end, in float64: b |d| exp(-c z) (1 - exp(-c |d_z|)) / (c |d_z|).
    """
    b, c = fog.b, fog.c
    if evaluation == "exact":
        o_z, length, d_z = mi.Float64(o_z), mi.Float64(length), mi.Float64(d_z)
        t = c * dr.abs(d_z)
        low = dr.minimum(o_z, o_z + d_z)
        return b * length * dr.exp(-c * low) * dr.select(t > 1e-6, (1 - dr.exp(-t)) / t, 1)
    t = c * d_z
    level = dr.exp(-c * o_z)
    if evaluation == "two_exponentials":
        slanted = (level - dr.exp(-c * (o_z + d_z))) / t
    else:
        slanted = level * ((1 - dr.exp(-t)) / t)
    if evaluation != "naive":
        slanted = dr.select(dr.abs(d_z) > slope_threshold, slanted, level)
    return b * (length * slanted)


def blend(tau, lit: mi.Color3f, colour) -> mi.Color3f:
    """T L_surface + (1 - T) C_fog."""
    return dr.lerp(mi.Color3f(colour), lit, mi.Float(dr.exp(-tau)))


def unfogged_surface(view: View) -> mi.Color3f:
    """L_surface as if the air were clear: rho / pi (E_sun V max(n . l, 0) + pi L_sky), or the sky itself."""
    surface, sun = view.surface, view.sun
    seen = view.visible(surface.position, surface.normal, sun.direction)
    cosine = dr.maximum(dr.dot(surface.normal, sun.direction), 0)
    irradiance = dr.select(seen, sun.irradiance * cosine, 0) + dr.pi * view.sky
    return dr.select(surface.valid, surface.albedo * dr.inv_pi * irradiance, view.sky)


def fogged_surface(view: View, samples: int) -> mi.Color3f:
    """L_surface by light that crossed the fog: the sun along one ray, the sky along `samples` of them."""
    surface, sun = view.surface, view.sun
    p, n = surface.position, surface.normal
    frame, turn = mi.Frame3f(n), _turns(view, 1, 2)

    def add(i, skylit):
        w = frame.to_world(mi.warp.square_to_cosine_hemisphere(_spread(i, turn)))
        return i + 1, skylit + _clear(view, p, n, w)

    _, skylit = dr.while_loop((mi.UInt32(0), dr.zeros(mi.Float, dr.width(n))), lambda i, _: i < samples, add)
    sunlit = sun.irradiance * dr.maximum(dr.dot(n, sun.direction), 0) * _clear(view, p, n, sun.direction)
    irradiance = sunlit + dr.pi * view.sky * skylit / samples
    return dr.select(surface.valid, surface.albedo * dr.inv_pi * irradiance, view.sky)


def mean_source(view: View, samples: int) -> mi.Float:
    """<J> along each camera ray: `samples` depths of equal share in the extinction, at each of them the
    sun's ray and one direction of the sphere."""
    fog, sun = view.fog, view.sun
    o, w, length = view.camera.origin, view.camera.direction, fogged_length(view)
    tau = optical_depth(fog, o.z, length, length * w.z, "exact", 0)
    offset, turn = random_turn(view.width * view.height, seed=3) / dr.two_pi, _turns(view, 4, 5)
    nowhere = dr.zeros(mi.Vector3f)

    def add(i, total):
        p = o + w * distance_at(fog, o.z, w.z, tau, (i + offset) / samples)
        to_sky = mi.warp.square_to_uniform_sphere(_spread(i, turn))
        sunlit = sun.irradiance * dr.inv_four_pi * _clear(view, p, nowhere, sun.direction)
        return i + 1, total + sunlit + view.sky * _clear(view, p, nowhere, to_sky)

    state = (mi.UInt32(0), dr.zeros(mi.Float, dr.width(length)))
    _, total = dr.while_loop(state, lambda i, _: i < samples, add)
    return fog.albedo * total / samples


def distance_at(fog: Fog, o_z, w_z, tau: mi.Float64, u: mi.Float) -> mi.Float:
    """Distance (m) at which a share u of a ray's extinction is behind it; w_z is its climb per metre.

    T(s) = 1 - u (1 - T) gives tau(s), and s = -tau(s) / k log(1 - x) / x with x = c w_z tau(s) / k,
    k = b exp(-c O_z).
    """
    passed = -dr.log(1 - mi.Float64(u) * (1 - dr.exp(-tau)))
    level = passed / (fog.b * dr.exp(-fog.c * mi.Float64(o_z)))
    x = fog.c * mi.Float64(w_z) * level
    return mi.Float(level * dr.select(dr.abs(x) > 1e-6, -dr.log(1 - x) / x, 1))


def _clear(view: View, p: mi.Point3f, n: mi.Vector3f, w: mi.Vector3f) -> mi.Float:
    """V T from p along w to the end of the fog."""
    length = view.fog.box_exit(p, w)
    tau = optical_depth(view.fog, p.z, length, length * w.z, "exact", 0)
    return dr.select(view.visible(p, n, w), mi.Float(dr.exp(-tau)), 0)


def _turns(view: View, *seeds: int) -> mi.Point2f:
    """Two uniform numbers in [0, 1) per pixel, from two seeds."""
    return mi.Point2f(*(random_turn(view.width * view.height, seed) for seed in seeds)) / dr.two_pi


def _spread(i: mi.UInt32, turn: mi.Point2f) -> mi.Point2f:
    """Point i of a sequence that fills the unit square evenly (steps 1/g and 1/g^2, g^3 = g + 1)."""
    x = dr.fma(mi.Point2f(mi.Float(i)), mi.Point2f(0.7548776662466927, 0.5698402909980532), turn)
    return x - dr.floor(x)
