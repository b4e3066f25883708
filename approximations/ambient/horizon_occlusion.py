r"""Ambient occlusion from horizons: what the depth buffer shows along a few lines across the screen.

Two peers of sampling a ball. From x, with V the unit vector to the eye and T a unit vector across it along a
line on the screen, the horizon of a side is the highest elevation of what the line meets within R.

HBAO    L. Bavoil, M. Sainz, R. Dimitrov, "Image-space horizon-based ambient occlusion", SIGGRAPH 2008:
            A = mean over lines of sum_j W(d_j) (sin h_j - sin h_(j-1))
        over the samples that raise the horizon, from the tangent plane's own elevation (and a bias) on, with
        W = 1 - (d / R)^2. Directions count alike, without a cosine, and elevation is from the plane across V.
GTAO    J. Jimenez, X. Wu, A. Pesce, A. Jarabo, "Practical real-time strategies for accurate indirect
        occlusion", SIGGRAPH 2016 course: the cosine-weighted integral in closed form between the horizons
        h1 < 0 < h2 of a slice, angles from V, with n' the normal's projection and g its angle:
            a(h) = (-cos(2 h - g) + cos g + 2 h sin g) / 4,   A = mean of |n'| (a(h1) + a(h2))
        It is exact for the sky above a height field on the screen, as far as R and the samples go.

Lines are turned at random from pixel to pixel, and sampled at even steps from a random start; there is no
blur. Off the screen nothing occludes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    COSINE_OVER_LIGHT,
    HIDDEN_GEOMETRY,
    SAMPLING,
    SPATIAL_DETAIL,
    Sweep,
    at_most,
    technique,
)
from approximations.kit.depth_buffer import DepthBuffer, depth_buffer
from approximations.kit.sampling import random_turn
from scenes.contract import SKY_VISIBILITY, View
from scenes.occluders import Occluders


@technique(
    source="peer: Bavoil, Sainz, Dimitrov, Image-space horizon-based ambient occlusion, SIGGRAPH 2008",
    estimates=SKY_VISIBILITY,
    on=(Occluders,),
    replaces="cosine-weighted share of the sky that a point sees",
    neglects=(COSINE_OVER_LIGHT, HIDDEN_GEOMETRY, SPATIAL_DETAIL, SAMPLING),
    claims=(at_most(1),),
    stress={"Occluders": ("camera_elevation",)},
    baseline=True,
)
def hbao(
    view: View,
    noise: mi.Vector2f,
    *,
    radius: Annotated[float, Sweep(0.4, 1.5, low=0.001, high=100)] = 1.5,
    lines: Annotated[int, Sweep(2, 4, low=1, high=64)] = 4,
    steps: Annotated[int, Sweep(4, 8, low=1, high=256)] = 8,
    bias: Annotated[float, Sweep(0.0, 0.1, low=0, high=1.5)] = 0.1,
) -> mi.Float:
    """Share of the sky that is seen, 0 to 1, one number per pixel.

    radius  R, m.
    lines   across the screen, two directions each.
    steps   samples in a direction.
    bias    elevation over the tangent plane below which nothing occludes, rad.
    """
    march = Lines(view, radius, steps, noise)

    def side(t: mi.Vector3f, along: mi.Vector2f) -> mi.Float:
        lift = dr.atan2(-dr.dot(march.n, t), dr.maximum(dr.dot(march.n, march.v), 1e-3))

        def raised(sine, distance, top, total):
            higher = dr.maximum(sine, top)
            return higher, total + (1 - dr.square(distance / radius)) * (higher - top)

        tangent = dr.sin(dr.minimum(lift + bias, 0.5 * dr.pi))
        return march.side(along, raised, tangent, dr.zeros(mi.Float, march.lanes))[1]

    total = mi.Float(0)
    for t, along in march.lines(lines):
        total += side(t, along) + side(-t, -along)
    return march.image(1 - total / (2 * lines))


@technique(
    source="peer: Jimenez et al., Practical real-time strategies for accurate indirect occlusion, 2016",
    estimates=SKY_VISIBILITY,
    on=(Occluders,),
    replaces="cosine-weighted share of the sky that a point sees",
    neglects=(HIDDEN_GEOMETRY, SPATIAL_DETAIL, SAMPLING),
    claims=(at_most(1),),
    stress={"Occluders": ("camera_elevation", "pole")},
    baseline=True,
)
def gtao(
    view: View,
    noise: mi.Vector2f,
    *,
    radius: Annotated[float, Sweep(0.4, 1.5, low=0.001, high=100)] = 1.5,
    lines: Annotated[int, Sweep(2, 4, low=1, high=64)] = 4,
    steps: Annotated[int, Sweep(4, 8, 32, low=1, high=256)] = 8,
    falloff: Literal["none", "end"] = "none",
) -> mi.Float:
    """Share of the sky that is seen, 0 to 1, one number per pixel.

    radius   R, m.
    lines    slices through V.
    steps    samples in a direction.
    falloff  what lies within R counts in full, or fades over the last 40 % of it ("end").
    """
    march = Lines(view, radius, steps, noise)

    def highest(sine, distance, top):
        if falloff == "end":
            fade = dr.clip((1 - distance / radius) / 0.4, 0, 1)
            sine = dr.lerp(mi.Float(-1), sine, fade)
        return (dr.maximum(sine, top),)

    total = mi.Float(0)
    for t, along in march.lines(lines):
        low = dr.full(mi.Float, -1, march.lanes)
        h1 = -dr.safe_acos(march.side(-along, highest, low)[0])
        h2 = dr.safe_acos(march.side(along, highest, low)[0])
        up, across = dr.dot(march.n, march.v), dr.dot(march.n, t)
        g = dr.atan2(across, up)
        h1 = dr.maximum(h1, g - 0.5 * dr.pi)
        h2 = dr.minimum(h2, g + 0.5 * dr.pi)
        total += dr.sqrt(up * up + across * across) * (arc(h1, g) + arc(h2, g))
    return march.image(total / lines)


def arc(h: mi.Float, g: mi.Float) -> mi.Float:
    """a(h): cosine-weighted visibility of a slice from V to the horizon h."""
    return 0.25 * (dr.cos(g) - dr.cos(2 * h - g) + 2 * h * dr.sin(g))


@hbao.bake
@gtao.bake
def bake(view: View) -> mi.Vector2f:
    """Two angles per pixel: one turns its lines, the other moves the samples along them."""
    pixels = view.width * view.height
    return mi.Vector2f(random_turn(pixels, seed=1), random_turn(pixels, seed=2))


class Lines:
    """Straight lines on the screen through every pixel; lanes are pixels."""

    def __init__(self, view: View, radius: float, steps: int, noise: mi.Vector2f) -> None:
        self.buffer: DepthBuffer = depth_buffer(view)
        self.valid, self.x, self.n = view.surface.valid, view.surface.position, view.surface.normal
        self.v = dr.normalize(self.buffer.eye - self.x)
        self.lanes, self.radius, self.steps = dr.width(self.x), radius, steps
        self.turn, self.start = 0.5 * noise.x, 0.5 * noise.y / dr.pi
        self.at, z = self.buffer.project(self.x)
        self.reach = self.buffer.pixels(radius, z)

    def lines(self, count: int) -> list[tuple[mi.Vector3f, mi.Vector2f]]:
        """For each line, T and its direction on the screen."""
        right, down = dr.normalize(self.buffer.right), dr.normalize(self.buffer.down)
        first = mi.Complex2f(dr.cos(self.turn), dr.sin(self.turn))
        found = []
        for i in range(count):
            z = first * mi.Complex2f(math.cos(math.pi * i / count), math.sin(math.pi * i / count))
            along = mi.Vector2f(z.real, z.imag)
            t = along.x * right + along.y * down
            found.append((dr.normalize(dr.cross(self.v, dr.cross(t, self.v))), along))
        return found

    def side(self, along: mi.Vector2f, take: Callable, *state: mi.Float) -> tuple[mi.Float, ...]:
        """state = take(sine of the elevation over the plane across V, distance, *state) over the samples
        within R."""

        def step(i, state):
            at = self.at + along * self.reach * (mi.Float(i) + self.start) / self.steps
            p, seen = self.buffer.point(at)
            d = p - self.x
            distance = dr.norm(d)
            seen &= (distance > 1e-4) & (distance < self.radius)
            taken = take(dr.dot(d, self.v) / dr.maximum(distance, 1e-4), distance, *state)
            return i + 1, tuple(dr.select(seen, a, b) for a, b in zip(taken, state, strict=True))

        return dr.while_loop((mi.UInt32(0), state), lambda i, state: i < self.steps, step)[1]

    def image(self, share: mi.Float) -> mi.Float:
        """The share where there is a surface, 1 elsewhere."""
        return dr.select(self.valid, dr.clip(share, 0, 1), 1)
