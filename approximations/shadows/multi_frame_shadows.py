r"""Multi-frame soft shadows: one point of the light and one plain shadow map a frame, averaged over frames.

GPU Pro 7, chapter III.3, section 3.3.3, after the framework of 3.2. Direct light of an area light,

    L(x) = rho / pi int_A V(x, y) L_e cos(theta_x) cos(theta_y) / |x - y|^2 dA_y,

is a mean over frames k = 1..N, each lit from one point y_k of the light:

    map_k    depth from y_k, M x M texels
    V_k      1 where map_k holds nothing nearer than the point by more than the bias
    c_k      rho / pi V_k A L_e cos(theta_x) cos(theta_y) / r^2 at y_k
    a <- a (1 - 1/k) + c_k / k

The points are one even set over the light, made for N frames and shared by all pixels, so that too few
frames show N hard shadows and not noise. What is left after many frames is the bias of the map.

In print, and what was done here:
- What a point of the light shines with is not printed, only that shading is done from it and not from the
  middle. `weight="area"` is the integrand above; "omni" is a point light of intensity A L_e, without the
  light's own cosine; "centre" moves nothing but the map.
- Large lights may be taken from the middle outwards. A set that is complete does not care about its order;
  one that is stopped early (`finished` below 1) then holds only the inner share of the light.
- Buffers of 8 bits up to float32 are shown; their formats are options, without the tone mapping before them.
- The cost of a frame that is reported is that of all `frames` together: what the viewer waits for. Each
  picture on the way costs that over `frames`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.contract import (
    COSINE_OVER_LIGHT,
    LINEAR_IN_LIGHT,
    NUMBER_FORMAT,
    SAMPLING,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    at_most,
    exact_when,
    technique,
)
from approximations.kit.point_sets import best_candidates, random_points
from approximations.kit.running_mean import Format, updated
from approximations.kit.shadow_map import bounds, light_point, render
from scenes.contract import DIRECT_RADIANCE, LIGHT_VISIBILITY, AreaLight, Scene, View
from scenes.shadow_casters import HalfPlane, PoleAndBars


@technique(
    source="GPU Pro 7, III.3, 3.2 and 3.3.3",
    covers=("multi-frame/06",),
    estimates=LIGHT_VISIBILITY,
    on=(HalfPlane,),
    replaces="share of an area light that a point sees",
    neglects=(SAMPLING, SPATIAL_DETAIL, NUMBER_FORMAT),
    claims=(at_most(1), exact_when("HalfPlane", 0.005, knobs={"frames": 1024, "visibility": "exact"})),
    stress={"HalfPlane": ("light_size", "height")},
)
def multi_frame_visibility(
    view: View,
    points: mi.Vector2f,
    *,
    visibility: Literal["map", "exact"] = "map",
    map_size: Annotated[int, Sweep(64, 128, 256, low=8, high=2048)] = 128,
    bias: Annotated[float, Sweep(0.02, 0.1, 0.3, low=0, high=5)] = 0.1,
    accumulator: Format = "float32",
) -> mi.Float:
    """Share of the light that is seen, 0 to 1, one number per pixel. Knobs as in `multi_frame_shadows`."""
    surface = view.surface

    def frame(d: mi.Vector3f, seen: mi.Bool) -> mi.Float:
        return dr.select(seen & (dr.dot(surface.normal, d) > 0), mi.Float(1), 0)

    found = accumulated(view, points, frame, mi.Float, visibility, map_size, bias, accumulator)
    return dr.select(surface.valid, found, 1)


@technique(
    source="GPU Pro 7, III.3, 3.2 and 3.3.3",
    covers=("multi-frame/06",),
    estimates=DIRECT_RADIANCE,
    on=(PoleAndBars,),
    replaces="visibility times direct light of an area light",
    neglects=(SAMPLING, SPATIAL_DETAIL, COSINE_OVER_LIGHT, NUMBER_FORMAT),
    claims=(
        LINEAR_IN_LIGHT,
        exact_when("PoleAndBars", 0.02, knobs={"frames": 256, "visibility": "exact"}),
    ),
    stress={"PoleAndBars": ("light_size", "light_elevation", "gap")},
)
def multi_frame_shadows(
    view: View,
    points: mi.Vector2f,
    *,
    visibility: Literal["map", "exact"] = "map",
    weight: Literal["area", "omni", "centre"] = "area",
    map_size: Annotated[int, Sweep(64, 128, 256, low=8, high=2048)] = 128,
    bias: Annotated[float, Sweep(0.02, 0.1, 0.3, low=0, high=5)] = 0.1,
    accumulator: Format = "float32",
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel.

    visibility   V_k from the shadow map, or "exact": by a ray.
    weight       what y_k shines with: the light's share, a point light, or the light's middle.
    map_size     texels along a side of a frame's shadow map.
    bias         m along the map's axis.
    accumulator  format of the buffer that holds the mean.
    """
    surface, light = view.surface, view.lights[0]
    glow = dr.normalize(dr.cross(light.u, light.v))
    power = light.radiance * area(light)

    def frame(d: mi.Vector3f, seen: mi.Bool) -> mi.Color3f:
        if weight == "centre":
            d = light.centre - surface.position
        w = dr.normalize(d)
        at_x, at_y = dr.maximum(dr.dot(surface.normal, w), 0), dr.maximum(dr.dot(glow, -w), 0)
        light_cosine = mi.Float(1) if weight == "omni" else at_y
        falloff = dr.select(seen, at_x * light_cosine * dr.rcp(dr.squared_norm(d)), 0)
        return dr.inv_pi * surface.albedo * (power * falloff)

    found = accumulated(view, points, frame, mi.Color3f, visibility, map_size, bias, accumulator)
    return dr.select(surface.valid, found, 0)


@multi_frame_visibility.bake
@multi_frame_shadows.bake
def bake(
    view: View,
    *,
    frames: Annotated[int, Sweep(1, 4, 16, 64, 256, low=1, high=1024)] = 64,
    finished: Annotated[float, Sweep(0.25, 1.0, low=0.01, high=1)] = 1.0,
    kernel: Literal["poisson", "random"] = "poisson",
    order: Literal["shuffled", "centre_out"] = "shuffled",
) -> mi.Vector2f:
    """Points of the light by frame, as shares of u and v.

    frames    how many are averaged.
    finished  share that they are of the set.
    kernel    a set that keeps apart, the middle first, or independent points.
    order     of the points after the middle: "shuffled", or by distance from it.
    """
    planned = int(np.ceil(frames / finished))
    shape = "square" if view.lights[0].shape == "rectangle" else "disk"
    points = (random_points if kernel == "random" else best_candidates)(planned, shape, seed=1)
    np.random.default_rng(7).shuffle(points[1:])
    if order == "centre_out":
        points = points[np.linalg.norm(points, axis=1).argsort()]
    return mi.Vector2f(points[:frames].T.astype(np.float32))


@multi_frame_visibility.domain
@multi_frame_shadows.domain
def domain(scene: Scene) -> Domain:
    """Lights with some surface, since the spread of y is what hides the texels of small maps (3.3.3)."""
    if scene.light_size < 0.05:
        return Domain(False, "the light is so small that the texels of its maps are not averaged away")
    if isinstance(scene, PoleAndBars) and scene.light_elevation < 20:
        return Domain(False, "the light grazes the ground, which then shades itself")
    return Domain(True)


def area(light: AreaLight) -> mi.Float:
    """Of a rectangle or disk, m^2."""
    return dr.norm(light.u) * dr.norm(light.v) * (4 if light.shape == "rectangle" else dr.pi)


def accumulated(
    view: View,
    points: mi.Vector2f,
    frame: Callable,
    kind: type,
    visibility: str,
    map_size: int,
    bias: float,
    accumulator: Format,
) -> mi.Float | mi.Color3f:
    """The running mean of frame(y_k - x, whether x sees y_k) over all points (3.2.2)."""
    light, p = view.lights[0], view.surface.position
    eyes = light_point(light, points)
    if visibility == "map":
        maps = render(view.trace, eyes, light.u, *bounds(view.surface), size=map_size)

    def seen(k: mi.UInt32, d: mi.Vector3f) -> mi.Bool:
        if visibility == "exact":
            return view.trace(p + 1e-4 * view.surface.normal, dr.normalize(d)) > dr.norm(d) * 0.999
        frustum = maps.at(k)
        ab, z = frustum.project(p)
        return frustum.fetch(ab, k) >= z - bias

    def turn(k: mi.UInt32, mean: mi.Color3f) -> tuple:
        d = dr.gather(mi.Point3f, eyes, k) - p
        return k + 1, updated(mean, frame(d, seen(k, d)), mi.Float(k + 1), accumulator)

    dr.eval(eyes)
    start = (mi.UInt32(0), dr.zeros(kind, dr.width(p)))
    _, mean = dr.while_loop(start, lambda k, mean: k < dr.width(points), turn)
    return mean
