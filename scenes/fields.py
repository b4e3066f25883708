"""Scenes of closed solids under a uniform sky: where distance fields are built and read.

Everything comes from a list of balls and boxes: the shapes for Mitsuba, the solids that a technique
voxelises, the distances of the truth.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Annotated

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.contract import (
    DISTANCE,
    LIGHT_VISIBILITY,
    SKY_VISIBILITY,
    AreaLight,
    Axis,
    Camera,
    Scene,
    Solid,
    View,
    scene,
)
from scenes.mitsuba_parts import (
    area_light,
    camera_rays,
    diffuse,
    g_buffer,
    orthographic,
    ray_caster,
    ray_tracer,
    uniform_sky,
)

FAR = 1000.0  # m, half edge of floors: upright surfaces at height h see 2 h / (pi FAR) under their edge
ALBEDO = 0.5


def shape_of(solid: Solid) -> dict:
    """A solid as a Mitsuba shape."""
    bsdf = diffuse(solid.albedo)
    if solid.shape == "ball":
        return {"type": "sphere", "center": list(solid.centre), "radius": solid.half[0], "bsdf": bsdf}
    edges = np.array(solid.axes).T * np.array(solid.half)
    to_world = np.vstack([np.column_stack([edges, solid.centre]), [0, 0, 0, 1]])
    return {"type": "cube", "to_world": mi.ScalarTransform4f(to_world), "bsdf": bsdf}


def floor() -> Solid:
    """A slab whose top is z = 0."""
    return Solid("box", (0.0, 0.0, -5.0), (FAR, FAR, 5.0))


@dataclass(frozen=True)
class Solids(Scene):
    """What they share. Subclasses give the solids, the box that a volume has to cover, and the camera."""

    def solids(self) -> tuple[Solid, ...]:
        """The bodies."""
        raise NotImplementedError

    def bounds(self) -> tuple[list[float], list[float]]:
        """Lower and upper corner (m) of the part that the camera sees."""
        raise NotImplementedError

    def sensor(self, size: int) -> dict:
        """The camera."""
        raise NotImplementedError

    def surfaces(self) -> dict:
        return {f"solid_{i}": shape_of(s) for i, s in enumerate(self.solids())}

    def mitsuba(self, size: int = 128) -> dict:
        return {"type": "scene", **self.surfaces(), "sky": uniform_sky(1.0), "sensor": self.sensor(size)}

    def view(self, size: int = 128) -> View:
        return self._view(size, camera_rays(mi.load_dict(self.sensor(size)), size), True)

    def _view(self, size: int, camera: Camera, seen: bool) -> View:
        surfaces = mi.load_dict({"type": "scene", **self.surfaces()}, optimize=False)
        return View(
            size,
            size,
            camera,
            surface=g_buffer(surfaces, camera) if seen else None,
            sky=1.0,
            solids=self.solids(),
            bounds=self.bounds(),
            visible=ray_caster(surfaces),
            trace=ray_tracer(surfaces),
        )


@scene(
    theme="ambient",
    shows="a ball over a floor: a contact, an occluder at every distance, an underside",
    quantities=(SKY_VISIBILITY,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class BallOverFloor(Solids):
    """A ball of radius 1 m whose lowest point hangs `gap` above a floor."""

    gap: Annotated[float, Axis(0, 2, unit="m")] = 0.0

    def solids(self) -> tuple[Solid, ...]:
        return floor(), Solid("ball", (0.0, 0.0, 1 + self.gap), (1.0, 1.0, 1.0))

    def bounds(self) -> tuple[list[float], list[float]]:
        return [-4.0, -4.0, -1.0], [4.0, 4.0, 4.5]

    def sensor(self, size: int) -> dict:
        return orthographic([0, -9, 7.5], [0, 0, 0.5 + 0.5 * self.gap], 2.15, size)


@scene(
    theme="ambient",
    shows="a groove, or a ridge, of two flat walls: sharp curvature and nothing else",
    quantities=(SKY_VISIBILITY,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class Groove(Solids):
    """Two walls of 1 m that meet in the y axis with `opening` between them, long as a prism.

    Less than 180 degrees is a groove, 180 a plane, more a ridge.
    """

    opening: Annotated[float, Axis(30, 270, unit="deg")] = 90.0

    WALL = 1.0  # m, from the bottom to the edge
    THICKNESS = 0.5  # m

    def solids(self) -> tuple[Solid, ...]:
        return self._wall(-1), self._wall(1)

    def _wall(self, side: int) -> Solid:
        """Below the bottom the walls of a groove go on, so that no gap is left between them."""
        a = math.radians(0.5 * self.opening)
        along, normal = (side * math.sin(a), 0.0, math.cos(a)), (-side * math.cos(a), 0.0, math.sin(a))
        below = self.THICKNESS if self.opening < 180 else 0.0
        u, n = 0.5 * (self.WALL - below), -0.5 * self.THICKNESS
        centre = tuple(u * along[i] + n * normal[i] for i in range(3))
        half = (0.5 * (self.WALL + below), FAR, 0.5 * self.THICKNESS)
        return Solid("box", centre, half, (along, (0.0, 1.0, 0.0), normal))

    def bounds(self) -> tuple[list[float], list[float]]:
        return [-1.5, -1.5, -1.5], [1.5, 1.5, 1.5]

    def sensor(self, size: int) -> dict:
        return orthographic([0, -2, 6], [0, 0, 0], 1.0, size)


@scene(
    theme="ambient",
    shows="a ball, a thin wall and a turned box on a floor, and the distances in a slice through them",
    quantities=(SKY_VISIBILITY, DISTANCE),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class SolidsUnderSky(Solids):
    """A ball of 0.5 m whose lowest point hangs `gap` above the floor, a wall of `thickness` 1 m high, and a
    box turned by 30 degrees. Wall and box reach below the floor, so that the least of the solids' distances
    is exact in all of the slice y = 0, 0 < z < 2."""

    thickness: Annotated[float, Axis(0.005, 0.5, log=True, unit="m")] = 0.1
    gap: Annotated[float, Axis(0, 0.45, unit="m")] = 0.0

    HEIGHT = 2.0  # m of the slice
    HALF_WIDTH = 2.4  # m of the slice to each side

    def solids(self) -> tuple[Solid, ...]:
        c, s = math.cos(math.radians(30)), math.sin(math.radians(30))
        return (
            floor(),
            Solid("ball", (-1.05, 0.0, 0.5 + self.gap), (0.5, 0.5, 0.5)),
            Solid("box", (0.013, 0.1, 0.2), (0.5 * self.thickness, 0.9, 0.8)),
            Solid("box", (1.1, -0.1, 0.1), (0.45, 0.35, 0.5), ((c, s, 0), (-s, c, 0), (0, 0, 1))),
        )

    def bounds(self) -> tuple[list[float], list[float]]:
        return [-2.4, -2.4, -0.4], [2.4, 2.4, 2.0]

    def sensor(self, size: int) -> dict:
        return orthographic([-2, -6, 6.5], [0, 0, 0.3], 1.5, size)

    def probes(self, size: int) -> View:
        """Points of the slice in camera.origin, row by row from the top: x from left to right, its ends
        included, z upwards."""
        i = dr.arange(mi.UInt32, size * size)
        x = self.HALF_WIDTH * (2 * mi.Float(i % size) / max(size - 1, 1) - 1)
        z = self.HEIGHT * (1 - (mi.Float(i // size) + 0.5) / size)
        along = dr.zeros(mi.Vector3f, size * size) + mi.Vector3f(0, 1, 0)
        return self._view(
            size, Camera(mi.Point3f(x, 0 * x, z), along, mi.Vector3f(0, 1, 0), 0.0, math.inf), False
        )


@scene(
    theme="ambient",
    shows="a ball and a box on a floor in the light of a round lamp: shadows with penumbras",
    quantities=(LIGHT_VISIBILITY,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class SolidsUnderLamp(Solids):
    """The lamp hangs at the left, 1.7 m above the floor."""

    lamp_radius: Annotated[float, Axis(0.02, 0.5, log=True, unit="m")] = 0.2

    LAMP = (-1.5, -1.0, 1.7)  # m
    RADIANCE_OF_LAMP = 10.0

    def solids(self) -> tuple[Solid, ...]:
        c, s = math.cos(math.radians(30)), math.sin(math.radians(30))
        return (
            floor(),
            Solid("ball", (-0.85, 0.2, 0.35), (0.35, 0.35, 0.35)),
            Solid("box", (0.1, -0.4, 0.3), (0.15, 0.4, 0.5), ((c, s, 0), (-s, c, 0), (0, 0, 1))),
        )

    def bounds(self) -> tuple[list[float], list[float]]:
        return [-2.4, -2.4, -0.4], [2.4, 2.4, 2.0]

    def sensor(self, size: int) -> dict:
        return orthographic([-2, -6, 6.5], [0, 0, 0.2], 1.5, size)

    def lamp(self) -> AreaLight:
        """A glowing ball."""
        r = self.lamp_radius
        return AreaLight("sphere", list(self.LAMP), [r, 0.0, 0.0], [0.0, r, 0.0], self.RADIANCE_OF_LAMP)

    def mitsuba(self, size: int = 128) -> dict:
        return {
            "type": "scene",
            **self.surfaces(),
            "lamp": area_light(self.lamp()),
            "sensor": self.sensor(size),
        }

    def view(self, size: int = 128) -> View:
        return dataclasses.replace(super().view(size), sky=None, lights=(self.lamp(),))
