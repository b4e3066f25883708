r"""A shell of cloud round the Earth: where the march starts and stops, and in how many steps.

GPU Pro 7, chapter II.4, section 4.5.1. Clouds sink towards the horizon because they fill a shell, from 1.5 to
5 km above the ground, whose crossings a ray finds from two spheres. From height h at the elevation's sine m
the sphere of height k over a ground of radius R is met where

    t^2 + 2 b t + c = 0,   b = (R + h) m,   c = (h - k) (2 R + h + k),   t = -b +- sqrt(b^2 - c).

From the ground the way through the shell is 3.50 km straight up, 6.99 at 30 degrees, 19.8 at 10, 37.7 at 5,
74.6 at 2, 98.4 at 1 and 114.2 at 0, which starts 138 km away. It is marched in up to 64 steps straight up and
up to 128 along the horizon, 55 to 892 m each, with one sample amid each: tau = sum sigma h, T = e^-tau.

Not given in the chapter, and what was done here:
- R: 6371 km. The law between 64 and 128 steps: linear in m, `horizon_steps` at and below the horizon.
- How the spheres are met: "textbook" takes c = |o|^2 - (R + k)^2 in float32 from the centre of the Earth, a
  difference of numbers of 4e13 m^2 with 4e6 m^2 between them. Kilometres in place of metres (`unit`) round
  elsewhere and no less: floating point does not mind the unit. "exact" takes c as the product above and the
  root of two terms of one sign, so that nothing cancels; "planar" is the flat layer that the shell replaces.
- A ray from within or above can dip under the base, miss the ground and cross the shell again. One start and
  one stop ("first") know nothing of that.
- That the march ends early in dense cloud is another technique.
Sheets of cloud as far apart as the steps are long lie all on samples or all between them: at 600 m, 0.65 % of
rms error in T, near 2 degrees. The chapter reads
from distance blurred textures there, which these sheets have not.
"""

from __future__ import annotations

from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    NUMBER_FORMAT,
    SAMPLING,
    Domain,
    Sweep,
    at_most,
    exact_when,
    technique,
)
from scenes.cloud_shell import CloudShell, Shell
from scenes.contract import TRANSMITTANCE, Scene, View

FINE_STEPS = 512
EXACT = {"intersection": "exact", "segments": "exact", "march": "exact"}


@technique(
    source="GPU Pro 7, II.4, sec. 4.5.1",
    covers=("cloudscapes/15",),
    estimates=TRANSMITTANCE,
    on=(CloudShell,),
    replaces="the optical depth of cloud along a ray round the Earth",
    neglects=(SAMPLING, NUMBER_FORMAT),
    claims=(at_most(1.0), exact_when("CloudShell", 0.002, knobs=EXACT)),
    stress={"CloudShell": ("height", "elevation", "wavelength")},
)
def spherical_shell(
    view: View,
    *,
    intersection: Literal["textbook", "planar", "exact"] = "textbook",
    unit: Literal["m", "km"] = "m",
    segments: Literal["first", "exact"] = "first",
    march: Literal["steps", "exact"] = "steps",
    zenith_steps: Annotated[int, Sweep(16, 64, low=1, high=4096)] = 64,
    horizon_steps: Annotated[int, Sweep(8, 32, 128, 1000, low=1, high=4096)] = 128,
) -> mi.Color3f:
    """Transmittance (0 to 1) of the cloud before the ground or the sky, one value per pixel.

    intersection   how the spheres of base and top are met.
    unit           of lengths in the textbook's quadratic.
    segments       "first": from the first entry to the first exit; "exact": all that lies in the shell.
    march          "steps": as many as the elevation asks for; "exact": 512.
    zenith_steps   straight up.
    horizon_steps  at and below the horizon.
    """
    o, d = view.camera.origin, view.camera.direction
    first, second = shell_segments(view.cloud.model, o, d, intersection, unit)
    if march == "exact":
        steps = mi.Float(FINE_STEPS)
    else:
        steps = dr.round(dr.lerp(mi.Float(horizon_steps), mi.Float(zenith_steps), dr.maximum(d.z, 0)))
    depth = _march(view, *first, steps)
    if segments == "exact":
        depth += _march(view, *second, steps)
    return mi.Color3f(dr.exp(-depth))


@spherical_shell.domain
def domain(scene: Scene) -> Domain:
    """Cloud overhead, seen from the ground (4.5.1)."""
    if scene.height > scene.BOTTOM:
        return Domain(False, "start and stop of the march are those of a ray from the ground")
    return Domain(True)


def shell_segments(
    shell: Shell, o: mi.Point3f, d: mi.Vector3f, intersection: str, unit: str = "m"
) -> tuple[tuple[mi.Float, mi.Float], tuple[mi.Float, mi.Float]]:
    """Distances (m) from o along unit directions d between which the ray is in the shell: the first stretch
    and the second, each of no length where there is none. o.z is the height above the ground."""
    if intersection == "planar":
        low, high = _plane(shell.bottom, o, d), _plane(shell.top, o, d)
        nothing = dr.zeros(mi.Float, dr.width(d))
        near, far = dr.minimum(low, high), dr.maximum(low, high)
        return (dr.maximum(near, 0), dr.maximum(far, 0)), (nothing, nothing)

    def crossings(height: float) -> tuple[mi.Float, mi.Float]:
        if intersection == "exact":
            return _stable(shell.radius, height, o.z, d.z)
        return _textbook(shell.radius, height, o, d, 1000.0 if unit == "km" else 1.0)

    top_in, top_out = crossings(shell.top)
    base_in, base_out = crossings(shell.bottom)
    ground, ground_out = crossings(0.0)
    ground = dr.select((ground > 0) & (ground_out > 0), ground, dr.inf)

    under = (base_in <= 0) & (base_out > 0)
    dips = base_in > 0
    start = dr.select(under, base_out, dr.maximum(top_in, 0))
    stop = dr.minimum(dr.select(dips, base_in, top_out), ground)
    again = dr.select(dips & (base_out < ground), base_out, top_out)
    return (start, dr.maximum(stop, start)), (again, dr.maximum(top_out, again))


def _plane(height: float, o: mi.Point3f, d: mi.Vector3f) -> mi.Float:
    """Distance to a flat ceiling; rays nearer the level than 1 in a million count as that."""
    return (height - o.z) / dr.select(d.z < 0, dr.minimum(d.z, -1e-6), dr.maximum(d.z, 1e-6))


def _textbook(
    radius: float, height: float, o: mi.Point3f, d: mi.Vector3f, unit: float
) -> tuple[mi.Float, mi.Float]:
    """Both roots (m), -1 where the sphere is missed; lengths in `unit` metres from the Earth's centre."""
    from_centre = mi.Vector3f(o.x, o.y, o.z + radius) / unit
    b = dr.dot(from_centre, d)
    c = dr.squared_norm(from_centre) - mi.Float((radius + height) / unit) ** 2
    square = b * b - c
    root = dr.safe_sqrt(square)
    return dr.select(square > 0, (-b - root) * unit, -1), dr.select(square > 0, (-b + root) * unit, -1)


def _stable(radius: float, height: float, h: mi.Float, m: mi.Float) -> tuple[mi.Float, mi.Float]:
    """Both roots (m), -1 where the sphere is missed, without a difference of large numbers: with
    b^2 - c = (R + k)^2 - (R + h)^2 (1 - m^2) the discriminant is d (2 R + h + k) + ((R + h) m)^2, d = k - h.
    """
    b = (radius + h) * m
    c = (h - height) * (2 * radius + h + height)
    square = b * b - c
    q = -(b + dr.copysign(dr.safe_sqrt(square), b))
    one, other = q, c / q
    hit = square > 0
    return dr.select(hit, dr.minimum(one, other), -1), dr.select(hit, dr.maximum(one, other), -1)


def _march(view: View, start: mi.Float, stop: mi.Float, steps: mi.Float) -> mi.Float:
    """Optical depth between two distances by one sample amid each step (4.5.1)."""
    o, d, sigma = view.camera.origin, view.camera.direction, view.cloud.extinction
    h = (stop - start) / steps

    def step(i, total):
        return i + 1, total + sigma(o + (start + (i + 0.5) * h) * d)

    begin = (dr.zeros(mi.Float, dr.width(d)), dr.zeros(mi.Float, dr.width(d)))
    _, total = dr.while_loop(begin, lambda i, total: i < steps, step)
    return h * total
