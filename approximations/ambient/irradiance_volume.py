r"""Irradiance volume: ambient cubes on a grid, for models that move through a level.

SIGGRAPH 2006 Course 26, section 7.4.2. Cells of 4 x 4 x 8 feet, no hierarchy; each holds the irradiance C on
its six half axes (see ambient_cube) at its middle, light that came by another surface only. A model takes the
one cell that its centroid is in; the jump from cell to cell is hidden by an average over time; the main light
is added at the model itself:

    C^(t) = C^(t - dt) + (1 - e^(-dt / tau)) (C(x(t)) - C^(t - dt)),
    E(n)  = sum_k n_k^2 C^_k + I max(n . l, 0) / d^2 V(x).

So the light lags behind the model by v tau, and shines through walls by up to half a cell. Models that
matter most (heroes) have the ambient term raised with the direct light, so that this does not swamp it.

In print, and what was done here:
- The average is only named; the recursion above is the usual one. tau is not given: 0.3 s here.
- How much a hero gains is not given: `boost` b raises E_ambient to at least b times the direct irradiance of
  a facing surface, by one factor for all normals; it makes light from nothing.
- The lamp is a point for models ("point"): I = 4 |u x v| L cos_l of a rectangle, V from a ray to its middle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.contract import (
    ANGULAR_DETAIL,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from approximations.kit.gathered_light import from_lights, from_surfaces
from scenes.contract import IRRADIANCE, Scene, View
from scenes.rooms import IrradianceTrack

FRAME = 1 / 30  # s
FORGOTTEN = 1e-3
"""Of the time average: frames that weigh less in all are left out."""


@dataclass
class Volume:
    """colours: irradiance (W m^-2) on +x, -x, +y, -y, +z, -z, all cells of a direction before the next, x
    fastest. exact: irradiance by other surfaces at every probe instead."""

    low: mi.Point3f
    cell: mi.Vector3f
    counts: tuple[int, int, int]
    colours: mi.Color3f
    exact: mi.Color3f | None = None


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 7.4.2",
    covers=("source-shading/04",),
    estimates=IRRADIANCE,
    on=(IrradianceTrack,),
    replaces="irradiance along the way of a model",
    neglects=(SPATIAL_DETAIL, ANGULAR_DETAIL),
    claims=(exact_when("IrradianceTrack", 0.05, knobs={"field": "exact", "lamp": "exact", "paths": 512}),),
    stress={"IrradianceTrack": ("speed", "door")},
)
def irradiance_volume(
    view: View,
    volume: Volume,
    *,
    filter: Literal["nearest", "trilinear"] = "nearest",
    tau: Annotated[float, Sweep(0.0, 1.0, low=0, high=10)] = 0.3,
    boost: Annotated[float, Sweep(0.25, low=0, high=10)] = 0.0,
    lamp: Literal["point", "exact"] = "point",
) -> mi.Color3f:
    """Irradiance (W m^-2), one colour per probe.

    filter  the cell that the model is in, or the eight round it.
    tau     time constant of the average, s.
    boost   least ambient irradiance, in units of the direct one on a facing surface.
    lamp    a point with one shadow ray, or "exact": its surface, 8 x 8 points.
    """
    p, n = view.surface.position, view.surface.normal
    direct, facing = point_lamp(view, p, n)
    if lamp == "exact":
        direct = from_lights(view, p, n, 8).on(n)
    if volume.exact is not None:
        return direct + volume.exact
    ambient = time_average(volume, p, n, view.velocity, tau, filter)
    if boost > 0:
        mean = sum(time_average(volume, p, mi.Vector3f(a), view.velocity, tau, filter) for a in half_axes())
        wanted = boost * dr.mean(facing) / dr.maximum(dr.mean(mean) / 6, 1e-9)
        ambient *= dr.maximum(wanted, 1)
    return direct + ambient


def half_axes() -> list[list[float]]:
    """+x, -x, +y, -y, +z, -z."""
    return [[side * (k == axis) for k in range(3)] for axis in range(3) for side in (1.0, -1.0)]


def point_lamp(view: View, p: mi.Point3f, n: mi.Vector3f) -> tuple[mi.Color3f, mi.Color3f]:
    """Irradiance on normals n and on facing surfaces from the first light's middle."""
    light = view.lights[0]
    towards = mi.Point3f(light.centre) - p
    far = dr.norm(towards)
    l = towards / far
    leaving = dr.maximum(-dr.dot(dr.cross(mi.Vector3f(light.u), mi.Vector3f(light.v)), l), 0) * 4
    seen = view.trace(p, l) > 0.999 * far
    facing = dr.select(seen, leaving / dr.square(far) * mi.Color3f(light.radiance), 0)
    return facing * dr.maximum(dr.dot(n, l), 0), facing


def time_average(
    volume: Volume, p: mi.Point3f, n: mi.Vector3f, velocity: mi.Vector3f, tau: float, filter: str
) -> mi.Color3f:
    """E(n) of the cubes that a model has passed, newest first: share a (1 - a)^k of the one k frames ago."""
    a = 1 - math.exp(-FRAME / tau) if tau > 0 else 1.0
    frames = math.ceil(math.log(FORGOTTEN) / math.log(1 - a)) if a < 1 else 1

    def past(k, share, total):
        before = p - mi.Float(k) * FRAME * velocity
        return k + 1, share * (1 - a), total + share * a * sample(volume, before, n, filter)

    start = mi.UInt32(0), mi.Float(1), dr.zeros(mi.Color3f, dr.width(p))
    return dr.while_loop(start, lambda k, share, total: k < frames, past)[2]


def sample(volume: Volume, p: mi.Point3f, n: mi.Vector3f, filter: str) -> mi.Color3f:
    """E(n) of the ambient cube at p: of the cell whose middle is nearest, or linear between middles."""
    at = within(volume, (p - volume.low) / volume.cell - 0.5)
    if filter == "nearest":
        return cube(volume, [dr.round(x) for x in at], n)
    first = [dr.floor(x) for x in at]
    total = mi.Color3f(0)
    for corner in range(8):
        up = [(corner >> k) & 1 for k in range(3)]
        share = [(x - f) if u else (1 - (x - f)) for x, f, u in zip(at, first, up, strict=True)]
        place = within(volume, [f + u for f, u in zip(first, up, strict=True)])
        total += share[0] * share[1] * share[2] * cube(volume, place, n)
    return total


def within(volume: Volume, place: list[mi.Float]) -> list[mi.Float]:
    """Coordinates in cells from the first one's middle, kept between the first and the last."""
    return [dr.clip(place[k], 0, m - 1) for k, m in enumerate(volume.counts)]


def cube(volume: Volume, place: list[mi.Float], n: mi.Vector3f) -> mi.Color3f:
    """The cell's six colours weighted by the squares of a unit normal (listing 1 of 7.4.1)."""
    nx, ny, nz = volume.counts
    x, y, z = (mi.UInt32(k) for k in place)
    cell, cells = (z * ny + y) * nx + x, nx * ny * nz
    return sum(
        dr.square(n[k])
        * dr.gather(mi.Color3f, volume.colours, cell + dr.select(n[k] < 0, 2 * k + 1, 2 * k) * cells)
        for k in range(3)
    )


@irradiance_volume.bake
def bake(
    view: View,
    *,
    field: Literal["grid", "exact"] = "grid",
    cell: Annotated[float, Sweep(0.6, 2.4, low=0.1, high=10)] = 1.22,
    paths: Annotated[int, Sweep(32, low=4, high=65536)] = 256,
) -> Volume:
    """Ambient cubes in the middles of cells of cell x cell x 2 cell (m) that fill the level.

    field  the grid, or "exact": what arrives at every probe itself.
    paths  light paths into each half space of a cell; half of them for each probe where exact.
    """
    corners = [
        np.add(c.corner, s * np.array(c.u) + t * np.array(c.v))
        for c in view.charts
        for s in (0, 1)
        for t in (0, 1)
    ]
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    counts = np.ceil((high - low) / np.array([cell, cell, 2 * cell])).astype(int).clip(1)
    size = (high - low) / counts
    volume = Volume(mi.Point3f(low), mi.Vector3f(size), tuple(counts.tolist()), mi.Color3f(0))
    if field == "exact":
        p, n = view.surface.position, view.surface.normal
        volume.exact = from_surfaces(view, p, n, paths // 2, 1).on(n)
        dr.eval(volume.exact)
        return volume
    z, y, x = (c.ravel() for c in np.meshgrid(*(np.arange(m) + 0.5 for m in counts[::-1]), indexing="ij"))
    p = mi.Point3f((low[:, None] + size[:, None] * np.stack([x, y, z])).astype(np.float32))
    poles = [mi.Vector3f(0, 0, dr.full(mi.Float, z, dr.width(p))) for z in (1.0, -1.0)]
    halves = [from_surfaces(view, p, n, paths, 1) for n in poles]
    each = [
        sum(half.on(mi.Vector3f(a) * dr.ones(mi.Float, dr.width(p))) for half in halves) for a in half_axes()
    ]
    volume.colours = mi.Color3f(*(dr.concat([c[k] for c in each]) for k in range(3)))
    dr.eval(volume.colours)
    return volume


@irradiance_volume.domain
def domain(scene: Scene) -> Domain:
    """Models at walking speed (7.4.2): what lags behind by the time average stays within a cell."""
    if scene.speed > 4:
        return Domain(False, "the model crosses a cell while the average forgets the last one")
    return Domain(True)
