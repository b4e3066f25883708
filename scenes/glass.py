"""Coloured glass sheets in any order before a checkered wall: where transparency techniques are tried."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from typing import Annotated

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.contract import RADIANCE, Axis, Fragments, Scene, View, scene
from scenes.mitsuba_parts import camera_rays, diffuse, perspective


@dataclass(frozen=True)
class Sheet:
    """A square: centre (m), unit edge directions u and v, unit normal u x v towards the camera, half the
    edge (m), radiance per channel (W m^-2 sr^-1)."""

    centre: tuple[float, float, float]
    u: tuple[float, float, float]
    v: tuple[float, float, float]
    normal: tuple[float, float, float]
    half: float
    colour: tuple[float, float, float]


@scene(
    theme="transparency",
    shows="sheets of coloured glass that cross, so that their order differs from pixel to pixel",
    quantities=(RADIANCE,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class GlassSheets(Scene):
    """Glowing sheets of one opacity, drawn in an order that has nothing to do with depth.

    Two sheets make a pane of double glazing: parallel, `spacing` apart. The panes stand 0.4 m behind one
    another and each leans by `tilt` in a direction of its own, so that they cross. `arrangement` seeds
    places, colours and drawing order. Light is emitted alone, none is reflected: radiance is the ordered
    composition C = sum_i a c_i (1 - a)^(i-1) + C_wall (1 - a)^n, i = 1 nearest.

    Every sheet covers a sample of a picture of 8 x 8 samples or more.

    Depth precision hangs on `near`: at distance d a step of NDC z is a step of d^2 dz (far - near) /
    (2 near far) in depth, which moving the far plane out from 100 m would change by less than 1 %.
    """

    sheets: Annotated[int, Axis(1, 32)] = 8
    alpha: Annotated[float, Axis(0.02, 1)] = 0.5
    spacing: Annotated[float, Axis(1e-6, 1, log=True, unit="m")] = 0.02
    tilt: Annotated[float, Axis(0, 60, unit="deg")] = 20.0
    near: Annotated[float, Axis(1e-5, 1, log=True, unit="m")] = 0.1
    brightness: Annotated[float, Axis(0.01, 100, log=True)] = 1.0
    arrangement: Annotated[int, Axis(0, 1000)] = 0

    FAR = 100.0  # m, the far plane
    FOV = 30.0  # deg, across the picture
    FIRST, STEP = 5.0, 0.4  # m: distance of the nearest pane, and from each pane to the next
    WALL, WALL_HALF, CHECKS = 16.0, 5.0, 6  # m, m, periods of the checker across the wall
    WALL_COLOURS = ((0.9, 0.85, 0.7), (0.1, 0.2, 0.25))

    def layers(self) -> list[Sheet]:
        """The sheets in drawing order, in the frame of the camera: eye at 0, y forward, z up."""
        rng = random.Random(self.arrangement)
        placed = []
        for pane in range((self.sheets + 1) // 2):
            distance = self.FIRST + self.STEP * pane
            scale = distance * math.tan(math.radians(self.FOV / 2))
            x, z = (scale * (1.1 * rng.random() - 0.55) for _ in range(2))
            half = scale * (0.4 + 0.4 * rng.random())
            turn, lean = 2 * math.pi * rng.random(), math.radians(self.tilt)
            u = (math.cos(turn), 0.0, math.sin(turn))
            normal = (
                -math.sin(lean) * math.sin(turn),
                -math.cos(lean),
                math.sin(lean) * math.cos(turn),
            )
            v = _cross(normal, u)
            for back in (0.0, self.spacing):
                centre = (x - back * normal[0], distance - back * normal[1], z - back * normal[2])
                colour = tuple(self.brightness * rng.random() for _ in range(3))
                placed.append((rng.random(), Sheet(centre, u, v, normal, half, colour)))
        return [sheet for _, sheet in sorted(placed[: self.sheets], key=lambda p: p[0])]

    def sensor(self, size: int) -> dict:
        """A pinhole camera at the origin that looks along y."""
        return perspective([0, 0, 0], [0, 1, 0], self.FOV, size, near_clip=self.near, far_clip=self.FAR)

    def wall(self) -> dict:
        """The checkered wall, as a light."""
        first, second = (
            {"type": "srgb", "color": [self.brightness * c for c in colour], "unbounded": True}
            for colour in self.WALL_COLOURS
        )
        return {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f()
            .look_at([0, self.WALL, 0], [0, 0, 0], [0, 0, 1])
            .scale([self.WALL_HALF, self.WALL_HALF, 1]),
            "bsdf": diffuse(0.0),
            "emitter": {
                "type": "area",
                "radiance": {
                    "type": "checkerboard",
                    "color0": first,
                    "color1": second,
                    "to_uv": mi.ScalarTransform4f().scale([self.CHECKS, self.CHECKS, 1]),
                },
            },
        }

    def mitsuba(self, size: int = 128) -> dict:
        glass = {f"sheet{i}": self._glass(sheet) for i, sheet in enumerate(self.layers())}
        return {"type": "scene", "wall": self.wall(), **glass, "sensor": self.sensor(size)}

    def _glass(self, sheet: Sheet) -> dict:
        """A square whose mask lets 1 - alpha through. Mitsuba counts emission at masked hits in full, so
        the light's radiance carries the alpha."""
        columns = [*(([sheet.half * x for x in e]) for e in (sheet.u, sheet.v)), sheet.normal, sheet.centre]
        rows = [[column[i] for column in columns] for i in range(3)]
        return {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f([*rows, [0, 0, 0, 1]]),
            "bsdf": {"type": "mask", "opacity": self.alpha, "nested": diffuse(0.0)},
            "emitter": {
                "type": "area",
                "radiance": {"type": "rgb", "value": [self.alpha * c for c in sheet.colour]},
            },
        }

    def view(self, size: int = 128) -> View:
        camera = camera_rays(mi.load_dict(self.sensor(size)), size)
        d = mi.Vector3d(camera.direction)
        d /= d.y
        sheets = self.layers()
        covered = [_cover(sheet, d) for sheet in sheets]
        draws = [dr.width(pixel) for pixel, _ in covered]
        pixel, depth = (dr.concat(parts) for parts in zip(*covered, strict=True))
        palette = mi.Color3f(np.array([sheet.colour for sheet in sheets]).T)
        sheet = dr.concat([dr.full(mi.UInt32, i, n) for i, n in enumerate(draws)])
        n, f = self.near, self.FAR
        fragments = Fragments(
            pixel=pixel,
            depth=mi.Float((f + n) / (f - n) - 2 * f * n / ((f - n) * depth)),
            distance=depth * dr.norm(dr.gather(mi.Vector3d, d, pixel)),
            colour=dr.gather(mi.Color3f, palette, sheet),
            alpha=dr.full(mi.Float, self.alpha, dr.width(pixel)),
            background=self._background(camera),
            draws=tuple(draws),
        )
        dr.eval(vars(fragments))
        return View(size, size, camera, fragments=fragments)

    def _background(self, camera) -> mi.Color3f:
        """Radiance of the wall along each ray."""
        wall = mi.load_dict({"type": "scene", "wall": self.wall()})
        si = wall.ray_intersect(mi.Ray3f(camera.origin, camera.direction))
        return mi.Color3f(si.emitter(wall).eval(si))


def _cover(sheet: Sheet, d: mi.Vector3d) -> tuple[mi.UInt32, mi.Float64]:
    """Samples whose ray t d from the eye meets the sheet, and t there. Exact to float64: the depth of an
    ideal rasteriser, whose only loss is the rounding of what it stores."""
    normal, centre = mi.Vector3d(sheet.normal), mi.Vector3d(sheet.centre)
    t = dr.dot(normal, centre) / dr.dot(normal, d)
    on = t * d - centre
    inside = (dr.abs(dr.dot(on, mi.Vector3d(sheet.u))) <= sheet.half) & (
        dr.abs(dr.dot(on, mi.Vector3d(sheet.v))) <= sheet.half
    )
    pixel = dr.compress(inside)
    return mi.UInt32(pixel), dr.gather(mi.Float64, t, pixel)


def _cross(a: tuple, b: tuple) -> tuple[float, float, float]:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
