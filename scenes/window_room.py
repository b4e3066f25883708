"""Rooms that a round sun lights through a window: where shadows kept in a cube map are tried.

The room is the box LOW to HIGH, which is also the proxy that an artist would put round it. The sun stands
beyond the wall at the end of x; that wall may stand inside the proxy, and have a thickness.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.contract import LIGHT_VISIBILITY, AreaLight, Axis, Scene, Sun, View, scene
from scenes.mitsuba_parts import (
    SUN_DISTANCE,
    camera_rays,
    diffuse,
    direction,
    g_buffer,
    perspective,
    ray_tracer,
    rgb,
    round_sun,
)

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class SunlitRoom(Scene):
    """A room of 6 x 6 x 3 m with one square window, `window` m wide.

    The sun's `azimuth` is counted from +x. wall_inset: how far the window's wall stands inside the proxy.
    wall_thickness: depth of the window's frame, outwards from there.
    """

    sun_radius: Annotated[float, Axis(0.1, 10, log=True, unit="deg")] = 2.0
    sun_elevation: Annotated[float, Axis(15, 80, unit="deg")] = 35.0
    sun_azimuth: Annotated[float, Axis(-60, 60, unit="deg")] = 20.0
    window: Annotated[float, Axis(0.1, 2.4, unit="m")] = 1.8
    wall_inset: Annotated[float, Axis(0, 1.8, unit="m")] = 0.06
    wall_thickness: Annotated[float, Axis(0, 0.6, unit="m")] = 0.0
    albedo: Annotated[float, Axis(0, 0.9)] = 0.5
    sun_irradiance: Annotated[float, Axis(0, 100, unit="W/m^2")] = math.pi

    LOW = (-3.0, -3.0, 0.0)
    HIGH = (3.0, 3.0, 3.0)
    SILL = 1.7  # m, height of the window's middle

    def wall(self) -> float:
        """x of the window's wall (m)."""
        return self.HIGH[0] - self.wall_inset

    def opening(self) -> tuple[float, float, float, float]:
        """y from and to, z from and to, of the window (m)."""
        half = 0.5 * self.window
        return -half, half, self.SILL - half, self.SILL + half

    def toward_sun(self) -> list[float]:
        """Unit direction to the sun's centre."""
        return direction(self.sun_elevation, self.sun_azimuth)

    def surfaces(self) -> dict:
        return {**self.room(), **self.furniture()}

    def room(self) -> dict:
        """The walls, with their fronts inwards."""
        (x0, y0, z0), (_, y1, z1) = self.LOW, self.HIGH
        x1 = self.wall()
        a, b, c, d = self.opening()
        walls = {
            "floor": ((x0, y0, z0), (x1 - x0, 0, 0), (0, y1 - y0, 0)),
            "ceiling": ((x0, y0, z1), (0, y1 - y0, 0), (x1 - x0, 0, 0)),
            "back": ((x0, y0, z0), (0, y1 - y0, 0), (0, 0, z1 - z0)),
            "right": ((x0, y0, z0), (0, 0, z1 - z0), (x1 - x0, 0, 0)),
            "left": ((x0, y1, z0), (x1 - x0, 0, 0), (0, 0, z1 - z0)),
            "under": ((x1, y0, z0), (0, 0, c - z0), (0, y1 - y0, 0)),
            "over": ((x1, y0, d), (0, 0, z1 - d), (0, y1 - y0, 0)),
            "beside": ((x1, y0, c), (0, 0, d - c), (0, a - y0, 0)),
            "beyond": ((x1, b, c), (0, 0, d - c), (0, y1 - b, 0)),
        }
        if self.wall_thickness > 0:
            out = (self.wall_thickness, 0, 0)
            walls |= {
                "frame_bottom": ((x1, a, c), out, (0, b - a, 0)),
                "frame_top": ((x1, a, d), (0, b - a, 0), out),
                "frame_right": ((x1, a, c), (0, 0, d - c), out),
                "frame_left": ((x1, b, c), out, (0, 0, d - c)),
            }
        return {name: self.plate(*where) for name, where in walls.items()}

    def furniture(self) -> dict:
        """What stands in the room and never moves."""
        return {}

    def plate(self, corner: Vector, u: Vector, v: Vector) -> dict:
        """A rectangle of whole edges u and v, its front where u x v points."""
        half_u, half_v = 0.5 * np.array(u, float), 0.5 * np.array(v, float)
        n = np.cross(half_u, half_v)
        columns = np.column_stack([half_u, half_v, n / np.linalg.norm(n), corner + half_u + half_v])
        to_world = mi.ScalarTransform4f(np.vstack([columns, [0, 0, 0, 1]]))
        return {"type": "rectangle", "to_world": to_world, "bsdf": diffuse(self.albedo)}

    def mitsuba(self, size: int = 128) -> dict:
        sun = round_sun(self.toward_sun(), math.radians(self.sun_radius), self.sun_irradiance)
        return {"type": "scene", **self.surfaces(), "sun": sun, "sensor": self.sensor(size)}

    def sensor(self, size: int) -> dict:
        """A camera at the right wall that looks across the room."""
        return perspective([-0.4, -2.9, 2.7], [0.1, 0.2, 0.5], 84, size)

    def view(self, size: int = 128) -> View:
        return self.seen(size)

    def seen(self, size: int, **more) -> View:
        """The view, with what a room has besides. Rays of `trace` meet what never moves."""
        radius, s = math.radians(self.sun_radius), mi.Vector3f(self.toward_sun())
        u = SUN_DISTANCE * math.tan(radius) * dr.normalize(dr.cross(mi.Vector3f(0, 0, 1), s))
        everything = mi.load_dict({"type": "scene", **self.surfaces()}, optimize=False)
        still = mi.load_dict({"type": "scene", **self.room(), **self.furniture()}, optimize=False)
        camera = camera_rays(mi.load_dict(self.sensor(size)), size)
        radiance = Sun(s, radius, self.sun_irradiance).radiance
        disk = AreaLight("disk", mi.Point3f(SUN_DISTANCE * s), u, dr.cross(u, s), radiance)
        return View(
            size,
            size,
            camera,
            surface=g_buffer(everything, camera),
            sun=Sun(s, radius, self.sun_irradiance),
            lights=(disk,),
            bounds=(mi.Point3f(self.LOW), mi.Point3f(self.HIGH)),
            trace=ray_tracer(still),
            **more,
        )


@scene(
    theme="shadows",
    shows="the patch of sun that a window lets into an empty room, sharp near it and soft far away",
    quantities=(LIGHT_VISIBILITY,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class WindowRoom(SunlitRoom):
    """An empty room."""


@scene(
    theme="shadows",
    shows="a pillar between the window and the room, which a cube map takes to stand in the wall",
    quantities=(LIGHT_VISIBILITY,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class PillarRoom(SunlitRoom):
    """A square pillar from floor to ceiling, `pillar_gap` from the window's wall."""

    wall_inset: Annotated[float, Axis(0, 0.5, unit="m")] = 0.0
    pillar_gap: Annotated[float, Axis(0, 2, unit="m")] = 0.7

    HALF = 0.15  # m
    MIDDLE = -0.25  # m, y of its axis

    def pillar(self) -> tuple[Vector, Vector]:
        """Lower and upper corner (m)."""
        x = self.wall() - self.pillar_gap
        low = (x - 2 * self.HALF, self.MIDDLE - self.HALF, self.LOW[2])
        return low, (x, self.MIDDLE + self.HALF, self.HIGH[2])

    def furniture(self) -> dict:
        low, high = np.array(self.pillar())
        to_world = mi.ScalarTransform4f().translate(0.5 * (low + high)).scale(0.5 * (high - low))
        return {"pillar": {"type": "cube", "to_world": to_world, "bsdf": diffuse(self.albedo)}}


@scene(
    theme="shadows",
    shows="a window of four deep colours, whose light keeps them",
    quantities=(LIGHT_VISIBILITY,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class StainedRoom(SunlitRoom):
    """Panes that let through `TINTS` of the light, at any angle, and reflect none: thin sheets without a
    jump of the refractive index."""

    wall_inset: Annotated[float, Axis(0, 1.8, unit="m")] = 0.0

    TINTS = (((0.9, 0.05, 0.05), (0.95, 0.7, 0.05)), ((0.05, 0.15, 0.9), (0.05, 0.8, 0.2)))

    def panes(self) -> list[tuple[tuple[float, float, float, float], Vector]]:
        """y from and to, z from and to (m), and the tint of each."""
        a, b, c, d = self.opening()
        ys, zs = (a, 0.5 * (a + b), b), (c, 0.5 * (c + d), d)
        return [((ys[i], ys[i + 1], zs[j], zs[j + 1]), self.TINTS[i][j]) for j in range(2) for i in range(2)]

    def mitsuba(self, size: int = 128) -> dict:
        glass = {}
        for k, ((a, b, c, d), tint) in enumerate(self.panes()):
            sheet = self.plate((self.wall(), a, c), (0, b - a, 0), (0, 0, d - c))
            material = {
                "type": "thindielectric",
                "int_ior": 1.0,
                "ext_ior": 1.0,
                "specular_transmittance": rgb(tint),
            }
            glass[f"pane{k}"] = sheet | {"bsdf": material}
        return {**super().mitsuba(size), **glass}

    def view(self, size: int = 128) -> View:
        trace = ray_tracer(mi.load_dict({"type": "scene", **self.room()}, optimize=False))

        def transmittance(o: mi.Point3f, w: mi.Vector3f) -> mi.Color3f:
            at = o + (self.wall() - o.x) / w.x * w
            right, low = at.y < 0, at.z < self.SILL
            t = self.TINTS
            below = dr.select(right, mi.Color3f(t[0][0]), mi.Color3f(t[1][0]))
            above = dr.select(right, mi.Color3f(t[0][1]), mi.Color3f(t[1][1]))
            pane = dr.select(low, below, above)
            return dr.select(dr.isinf(trace(o, w)), pane, 0)

        return self.seen(size, transmittance=transmittance)


@scene(
    theme="shadows",
    shows="a ball that moves through the sun beam, whose penumbra crosses that of the window",
    quantities=(LIGHT_VISIBILITY,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class BallRoom(SunlitRoom):
    """A ball 1.2 m from the window's middle along the beam, moved aside by `aside`; it moves, the room does
    not."""

    wall_inset: Annotated[float, Axis(0, 0.5, unit="m")] = 0.0
    sun_radius: Annotated[float, Axis(0.1, 10, log=True, unit="deg")] = 4.0
    aside: Annotated[float, Axis(0, 1.2, unit="m")] = 0.6

    RADIUS = 0.35  # m

    def ball(self) -> dict:
        """The ball."""
        middle = np.array([self.wall(), 0, self.SILL]) - 1.2 * np.array(self.toward_sun())
        at = [float(x) for x in middle + [0, self.aside, 0]]
        return {"type": "sphere", "center": at, "radius": self.RADIUS, "bsdf": diffuse(self.albedo)}

    def surfaces(self) -> dict:
        return {**self.room(), "ball": self.ball()}

    def view(self, size: int = 128) -> View:
        ball = mi.load_dict({"type": "scene", "ball": self.ball()})
        low, high = (np.array(self.ball()["center"]) + k * self.RADIUS for k in (-1, 1))
        return self.seen(size, moving=ray_tracer(ball), moving_bounds=(mi.Point3f(low), mi.Point3f(high)))
