r"""World specular from the nearest cube map: reflections without a sum over lights.

SIGGRAPH 2006 Course 26, section 7.3.2. Designers place probes; the light-mapped world is rendered to a cube
map about each. A surface takes the cube map whose probe is nearest, as if all that it shows were far away:

    r = 2 (n . v) n - v,      L = albedo / pi E(x) + F cube(r).

F is the surface's reflectance (mask times Fresnel term), E its light map. Reflections slide, since they do
not know where on the surface they are; where two surfaces with different probes meet there is a seam.

In print, and what was done here:
- Surfaces are whole faces, the nearest probe is that of their middle: `assign="surface"`. "pixel" takes each
  pixel's own, which puts a seam across the floor.
- The Fresnel curve is not given; `fresnel` offers Schlick's. The scene's lobe has none.
- Roughness is not mentioned: a sharp cube map on every material ("sharp"). "mip" takes the level whose texels
  are about as wide as the lobe, 2 alpha.
- `parallax="box"` is what came after: the ray from the surface is followed to the walls of a box, here the
  room's, and the cube map is asked for what the probe sees there. Exact for what is on the walls. "exact"
  follows the rays of the lobe through the light-mapped world.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.contract import (
    DISTANT_LIGHT,
    FRESNEL,
    SHAPE_OF_LOBE,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from approximations.kit.cube_map import CubeMap, cube_map, halved, lookup, mip_chain, texel_directions
from approximations.kit.gathered_light import LIFT, irradiance_on
from approximations.kit.light_map import Atlas, atlas, luxels, place, seen_along
from scenes.contract import RADIANCE, Scene, View
from scenes.rooms import PolishedFloorRoom

EYE_HEIGHT = 1.4  # m, of probes
LUXEL, PATHS = 0.1016, 64
LOBE_RAYS = 8
"""Rays of the exact lobe at each point."""


@dataclass
class Captured:
    """Cube maps of radiance (W m^-2 sr^-1) and where they were taken (m); the box round the level and the
    middles of its charts (m); its light map (W m^-2)."""

    at: list[mi.Point3f]
    cubes: list[CubeMap]
    low: mi.Point3f
    high: mi.Point3f
    middles: mi.Point3f
    grid: Atlas
    irradiance: mi.Color3f


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 7.3.2",
    covers=("source-shading/02",),
    estimates=RADIANCE,
    on=(PolishedFloorRoom,),
    replaces="reflection of the room by a polished surface",
    neglects=(DISTANT_LIGHT, SHAPE_OF_LOBE, FRESNEL),
    claims=(exact_when("PolishedFloorRoom", 0.16, knobs={"parallax": "exact"}),),
    stress={"PolishedFloorRoom": ("roughness",)},
)
def nearest_cube_map(
    view: View,
    world: Captured,
    *,
    assign: Literal["surface", "pixel"] = "surface",
    fresnel: Literal["none", "schlick"] = "none",
    level: Literal["sharp", "mip"] = "sharp",
    parallax: Literal["none", "box", "exact"] = "none",
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel.

    assign    the probe nearest to the middle of the surface, or to the pixel.
    fresnel   reflectance as it is, or rising to 1 at grazing angles.
    level     the cube map as it is, or blurred by mips.
    parallax  everything far away, on the walls of the box, or where it is.
    """
    surface = view.surface
    n, v = surface.normal, -view.camera.direction
    irradiance = place(world.grid, surface.position, surface.chart).fetch(world.irradiance)
    diffuse = surface.albedo * dr.inv_pi * irradiance
    f = surface.specular
    if fresnel == "schlick":
        f = dr.select(f != 0, f + (1 - f) * dr.power(1 - dr.clip(dr.dot(n, v), 0, 1), 5), 0)
    if parallax == "exact":
        return diffuse + f * lobe_traced(view, world, n, v)
    r = 2 * dr.dot(n, v) * n - v
    anchor = surface.position if assign == "pixel" else dr.gather(mi.Point3f, world.middles, surface.chart)
    found, nearest = mi.Color3f(0), mi.Float(dr.inf)
    for at, cube in zip(world.at, world.cubes, strict=True):
        w = box_projected(world, surface.position, r, at) if parallax == "box" else r
        k = dr.log2(dr.maximum(surface.alpha * cube.sizes[0], 1)) if level == "mip" else 0.0
        away = dr.squared_norm(anchor - at)
        found = dr.select(away < nearest, lookup(cube, w, k), found)
        nearest = dr.minimum(away, nearest)
    return diffuse + f * found


def box_projected(world: Captured, p: mi.Point3f, r: mi.Vector3f, at: mi.Point3f) -> mi.Vector3f:
    """Direction from a probe to where a ray from p along r meets the box from inside."""
    walls = dr.select(r > 0, mi.Vector3f(world.high), mi.Vector3f(world.low))
    t = dr.select(r == 0, dr.inf, (walls - mi.Vector3f(p)) / r)
    return p + dr.min(t) * r - at


def lobe_traced(view: View, world: Captured, n: mi.Vector3f, v: mi.Vector3f) -> mi.Color3f:
    """Mean over GGX rays of what the light-mapped world sends along them, less what masking takes."""
    frame, lobe = mi.Frame3f(n), mi.MicrofacetDistribution(mi.MicrofacetType.GGX, view.surface.alpha, True)
    wi = frame.to_local(v)
    random = mi.PCG32(size=dr.width(n), initstate=5)
    total = mi.Color3f(0)
    for i in range(LOBE_RAYS):
        at = mi.Point2f((i + random.next_float32()) / LOBE_RAYS, random.next_float32())
        m, _ = lobe.sample(wi, at)
        wo = mi.reflect(wi, m)
        kept = dr.select(wo.z > 0, lobe.smith_g1(wo, m), 0) / LOBE_RAYS
        start = mi.Point3f(view.surface.position + LIFT * n)
        total += kept * seen_along(view, world.grid, world.irradiance, start, frame.to_world(wo))
    return total


@nearest_cube_map.bake
def bake(
    view: View,
    *,
    probes: Annotated[int, Sweep(2, low=1, high=16)] = 3,
    texels: Annotated[int, Sweep(16, low=4, high=512)] = 64,
) -> Captured:
    """Cube maps in a row along the longer side of the level, and its light map.

    probes  how many, in the middles of equal parts of that side.
    texels  along an edge of a face, a power of two.
    """
    grid = atlas(view.charts, LUXEL)
    points, chart = luxels(grid)
    n = grid.frame(chart).n
    irradiance = irradiance_on(view, points, n, [n], 6, PATHS)[0]
    corner, u, v = np.array([(c.corner, c.u, c.v) for c in view.charts], float).transpose(1, 0, 2)
    low, high = (f([corner, corner + u, corner + v, corner + u + v], axis=(0, 1)) for f in (np.min, np.max))
    row = int(np.argmax((high - low)[:2]))
    found = Captured(
        [], [], mi.Point3f(low), mi.Point3f(high), mi.Point3f((corner + (u + v) / 2).T), grid, irradiance
    )
    w = texel_directions(2 * texels)[0]
    for k in range(probes):
        at = (low + high) / 2
        at[row], at[2] = low[row] + (high - low)[row] * (k + 0.5) / probes, EYE_HEIGHT
        start = mi.Point3f(at)
        found.at.append(start)
        found.cubes.append(cube_map(mip_chain(halved(seen_along(view, grid, irradiance, start, w)))))
    return found


@nearest_cube_map.domain
def domain(scene: Scene) -> Domain:
    """Polished surfaces (7.3.2); the cube map is as sharp on any other."""
    if scene.roughness > 0.2:
        return Domain(False, "a sharp cube map on a rough surface")
    return Domain(True)
