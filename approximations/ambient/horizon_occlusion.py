r"""Ambient occlusion from horizons in the depth buffer: HBAO and GTAO.

Peers of the screen-space methods. Both walk the depth buffer from a point x in several directions of the
screen and keep the highest horizon; they differ in how a horizon becomes light.

HBAO, L. Bavoil and M. Sainz, "Screen Space Ambient Occlusion", NVIDIA 2008. In direction phi the tangent
plane rises by t, the horizon by h, from the screen's plane:

    A = 1 - 1/N sum_phi (sin h - sin t) W,     W = 1 - (r / R)^2 at the horizon's sample

GTAO, J. Jimenez, X. Wu, A. Pesce and A. Jarabo, "Practical Realtime Strategies for Accurate Indirect
Occlusion", SIGGRAPH 2016 course. A slice holds the view direction v and a direction of the screen; p is n
projected into it, at the angle gamma from v; h1 <= 0 <= h2 are the horizons' angles from v, clamped to the
half circle about p:

    A = 1/N sum_slices |p| sum_i 1/4 (-cos(2 h_i - gamma) + cos gamma + 2 h_i sin gamma)

which is the exact cosine-weighted openness of a height field seen from v, where R has no end. With a finite
R, horizons fade to the plane at right angles to v between `fade` R and R.
"""

from __future__ import annotations

from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.ambient.multi_frame_ssao import domain
from approximations.contract import (
    COSINE_OVER_LIGHT,
    HIDDEN_GEOMETRY,
    SAMPLING,
    SHAPE_OF_VISIBILITY,
    Sweep,
    at_most,
    technique,
)
from approximations.kit.depth_buffer import depth_buffer
from approximations.kit.loops import repeat
from approximations.kit.sampling import random_turn
from scenes.contract import SKY_VISIBILITY, View
from scenes.occluders import Occluders

BIAS = 0.1
"""rad: HBAO's horizons lower than this above the tangent count as flat, as published."""
Radius = Annotated[float, Sweep(0.1, 0.5, 2.0, 8.0, low=1e-3, high=1000.0)]
Steps = Annotated[int, Sweep(4, 12, 32, low=1, high=256)]


@technique(
    source="L. Bavoil and M. Sainz, Screen Space Ambient Occlusion, NVIDIA 2008 (a peer)",
    estimates=SKY_VISIBILITY,
    on=(Occluders,),
    replaces="cosine-weighted visibility of the sky",
    neglects=(COSINE_OVER_LIGHT, HIDDEN_GEOMETRY, SHAPE_OF_VISIBILITY, SAMPLING),
    claims=(at_most(1.0),),
    stress={"Occluders": ("elevation", "gap", "pole")},
    baseline=True,
)
def hbao(
    view: View,
    *,
    directions: Annotated[int, Sweep(4, 8, 16, low=1, high=64)] = 8,
    steps: Steps = 12,
    radius: Radius = 2.0,
    bias: Literal["published", "none"] = "published",
) -> mi.Float:
    """Openness A (0 to 1), 1 where the camera sees no surface. radius is R (m)."""
    surface, buffer = view.surface, depth_buffer(view)
    x, n, f = surface.position, surface.normal, buffer.forward
    at, z = buffer.project(x)
    reach = buffer.reach(radius, z)
    turn = random_turn(view.width * view.height, seed=1)
    least = dr.sin(BIAS) if bias == "published" else 0.0
    occluded = mi.Float(0)
    for k in range(directions):
        sin, cos = dr.sincos((turn + 2 * dr.pi * k) / directions)
        along = dr.normalize(cos * buffer.right + sin * buffer.down)
        tangent = -dr.dot(n, along) / dr.dot(n, -f)
        sin_t = tangent * dr.rsqrt(1 + tangent * tangent)

        def step(i, sin_h, lost, cos=cos, sin=sin, sin_t=sin_t):
            away = 1 + reach * (mi.Float(i) + 0.5) / steps
            d = buffer.surface_at(at + away * mi.Vector2f(cos, sin)) - x
            r = dr.norm(d)
            s = dr.dot(d, -f) / r
            higher = (s > sin_h) & (r < radius)
            fade = 1 - dr.square(r / radius)
            lost = dr.select(higher, lost + fade * (s - sin_h), lost)
            return dr.select(higher, s, sin_h), lost

        none = dr.zeros(mi.Float, dr.width(z))
        occluded += repeat(steps, step, none + sin_t + least, none)[1]
    return dr.select(surface.valid, dr.clip(1 - occluded / directions, 0, 1), 1)


@technique(
    source="J. Jimenez et al., Practical Realtime Strategies for Accurate Indirect Occlusion, 2016 (a peer)",
    estimates=SKY_VISIBILITY,
    on=(Occluders,),
    replaces="cosine-weighted visibility of the sky",
    neglects=(HIDDEN_GEOMETRY, SHAPE_OF_VISIBILITY, SAMPLING),
    claims=(at_most(1.0),),
    stress={"Occluders": ("elevation", "gap", "pole")},
    baseline=True,
)
def gtao(
    view: View,
    *,
    slices: Annotated[int, Sweep(1, 4, 16, low=1, high=64)] = 4,
    steps: Steps = 12,
    radius: Radius = 2.0,
    fade: Annotated[float, Sweep(0.0, 0.5, 1.0, low=0.0, high=1.0)] = 0.5,
) -> mi.Float:
    """Openness A (0 to 1), 1 where the camera sees no surface. radius is R (m); fade 1: none."""
    surface, buffer = view.surface, depth_buffer(view)
    x, n = surface.position, surface.normal
    v = dr.normalize(buffer.origin - x)
    at, z = buffer.project(x)
    reach = buffer.reach(radius, z)
    turn = random_turn(view.width * view.height, seed=1)
    total = mi.Float(0)
    for k in range(slices):
        sin, cos = dr.sincos((0.5 * turn + dr.pi * k) / slices)
        towards = dr.normalize(cos * buffer.right + sin * buffer.down)
        across = dr.normalize(dr.cross(towards, v))
        side = dr.cross(v, across)
        p = n - across * dr.dot(n, across)
        length = dr.norm(p)
        gamma = dr.atan2(dr.dot(p, side), dr.dot(p, v))
        inner = mi.Float(0)
        for sign in (-1.0, 1.0):

            def step(i, c_h, sign=sign, cos=cos, sin=sin):
                away = 1 + reach * dr.square((mi.Float(i) + 0.5) / steps)
                d = buffer.surface_at(at + sign * away * mi.Vector2f(cos, sin)) - x
                r = dr.norm(d)
                far = dr.clip((r / radius - fade) / (1.001 - fade), 0, 1)
                return (dr.maximum(c_h, dr.select(far < 1, dr.lerp(dr.dot(d, v) / r, -1, far), -1)),)

            c_h = repeat(steps, step, dr.full(mi.Float, -1, dr.width(z)))[0]
            h = sign * dr.safe_acos(c_h)
            h = gamma + dr.clip(h - gamma, -0.5 * dr.pi, 0.5 * dr.pi)
            inner += 0.25 * (dr.cos(gamma) - dr.cos(2 * h - gamma) + 2 * h * dr.sin(gamma))
        total += length * inner
    return dr.select(surface.valid, dr.clip(total / slices, 0, 1), 1)


hbao.domain(domain)
gtao.domain(domain)
