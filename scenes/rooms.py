"""Closed rooms, where most light has met several surfaces: for techniques that bake or gather it."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.contract import (
    DIRECT_RADIANCE,
    INDIRECT_RADIANCE,
    IRRADIANCE,
    ONE_BOUNCE,
    RADIANCE,
    AreaLight,
    Axis,
    Camera,
    Chart,
    Scene,
    Solid,
    Surface,
    View,
    scene,
)
from scenes.mitsuba_parts import (
    area_light,
    camera_rays,
    chart_index,
    diffuse,
    flat,
    g_buffer,
    glossy,
    light_solver,
    orthographic,
    perspective,
    ray_caster,
    ray_tracer,
)


def box(low: list[float], high: list[float], turn_deg: float = 0.0) -> dict[str, Chart]:
    """Five sides of a box that stands on the ground, seen from outside, turned about its vertical axis."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    w, d, h = x1 - x0, y1 - y0, z1 - z0
    sides = {
        "top": ([x0, y0, z1], [w, 0, 0], [0, d, 0]),
        "front": ([x0, y0, z0], [w, 0, 0], [0, 0, h]),
        "back": ([x1, y1, z0], [-w, 0, 0], [0, 0, h]),
        "left": ([x0, y1, z0], [0, -d, 0], [0, 0, h]),
        "right": ([x1, y0, z0], [0, d, 0], [0, 0, h]),
    }
    a, middle = math.radians(turn_deg), np.array([(x0 + x1) / 2, (y0 + y1) / 2, 0])
    turn = np.array([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]])
    return {
        name: Chart(
            *((turn @ (np.array(c) - middle) + middle).tolist(), *((turn @ e).tolist() for e in (u, v)))
        )
        for name, (c, u, v) in sides.items()
    }


def hall(low: list[float], high: list[float]) -> dict[str, Chart]:
    """Six sides of a box seen from inside; left and right are those of one who looks along +y."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    w, d, h = x1 - x0, y1 - y0, z1 - z0
    return {
        "floor": Chart([x0, y0, z0], [w, 0, 0], [0, d, 0]),
        "ceiling": Chart([x0, y1, z1], [w, 0, 0], [0, -d, 0]),
        "left": Chart([x0, y0, z0], [0, d, 0], [0, 0, h]),
        "right": Chart([x1, y1, z0], [0, -d, 0], [0, 0, h]),
        "far": Chart([x0, y1, z0], [w, 0, 0], [0, 0, h]),
        "near": Chart([x1, y0, z0], [-w, 0, 0], [0, 0, h]),
    }


def slab(chart: Chart, thickness: float, albedo: float | list[float]) -> Solid:
    """What lies behind a chart, so much wider that slabs overlap in corners."""
    u, v = np.array(chart.u, float), np.array(chart.v, float)
    axes = [u / np.linalg.norm(u), v / np.linalg.norm(v)]
    axes.append(np.cross(*axes))
    half = (*(0.5 * float(np.linalg.norm(e)) + thickness for e in (u, v)), 0.5 * thickness)
    centre = np.array(chart.corner) + 0.5 * (u + v - thickness * axes[2])
    return Solid("box", tuple(centre.tolist()), half, tuple(tuple(a.tolist()) for a in axes), albedo)


def turned(low: list[float], high: list[float], turn_deg: float, albedo: float) -> Solid:
    """The body of `box`."""
    a = math.radians(turn_deg)
    axes = ((math.cos(a), math.sin(a), 0.0), (-math.sin(a), math.cos(a), 0.0), (0.0, 0.0, 1.0))
    pairs = list(zip(low, high, strict=True))
    centre, half = tuple(0.5 * (a + b) for a, b in pairs), tuple(0.5 * (b - a) for a, b in pairs)
    return Solid("box", centre, half, axes, albedo)


@dataclass(frozen=True)
class Room(Scene):
    """Flat surfaces with light maps and one rectangular light, which the camera does not see."""

    def charts(self) -> dict[str, Chart]:
        """The flat surfaces by name."""
        raise NotImplementedError

    def reflectance(self, name: str) -> float | list[float]:
        """Diffuse reflectance of a chart."""
        raise NotImplementedError

    def light(self) -> AreaLight:
        """The light."""
        raise NotImplementedError

    def sensor(self, size: int) -> dict:
        """The camera."""
        raise NotImplementedError

    def surfaces(self) -> dict:
        return {name: flat(chart, diffuse(self.reflectance(name))) for name, chart in self.charts().items()}

    def world(self) -> dict:
        """Surfaces and light."""
        return {"type": "scene", **self.surfaces(), "light": area_light(self.light())}

    def mitsuba(self, size: int = 128) -> dict:
        return {**self.world(), "sensor": self.sensor(size)}

    def view(self, size: int = 128) -> View:
        opaque = mi.load_dict({"type": "scene", **self.surfaces()}, optimize=False)
        camera = camera_rays(mi.load_dict(self.sensor(size)), size)
        charts = tuple(
            dataclasses.replace(chart, albedo=self.reflectance(name)) for name, chart in self.charts().items()
        )
        surface = g_buffer(opaque, camera)
        return View(
            size,
            size,
            camera,
            surface=dataclasses.replace(surface, chart=chart_index(surface.position, charts)),
            lights=(self.light(),),
            charts=charts,
            visible=ray_caster(opaque),
            trace=ray_tracer(opaque),
            gather=light_solver(mi.load_dict(self.world(), optimize=False)),
        )


@scene(
    theme="ambient",
    shows="a room with a red and a green wall, whose colours the light carries on",
    quantities=(RADIANCE, DIRECT_RADIANCE, INDIRECT_RADIANCE, ONE_BOUNCE),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class ColouredRoom(Room):
    """A room of 2 m x 3 m x 2 m with a square light under the ceiling, and two blocks that hide it in part.

    The light gives FLUX whatever its size. The left wall is red and the right one green: `saturation` is what
    they take from the other channels of `albedo`.
    """

    light_size: Annotated[float, Axis(0.02, 0.6, log=True, unit="m")] = 0.3  # half an edge
    albedo: Annotated[float, Axis(0.05, 0.9)] = 0.6
    saturation: Annotated[float, Axis(0, 1)] = 0.9
    blocks: bool = True

    FLUX = 50.0  # W
    BELOW_CEILING = 0.01  # m
    THICKNESS = 0.2  # m, of the walls as solids
    BLOCKS: ClassVar = {
        "tall": ([-0.65, 0.05, 0], [-0.05, 0.65, 1.2], 17),
        "low": ([0.05, -0.65, 0], [0.65, -0.05, 0.6], -18),
    }

    def charts(self) -> dict[str, Chart]:
        found = hall([-1, -2, 0], [1, 1, 2])
        for name, block in self.BLOCKS.items() if self.blocks else ():
            found |= {f"{name}_{side}": chart for side, chart in box(*block).items()}
        return found

    def solids(self) -> tuple[Solid, ...]:
        """Six walls behind their charts, and the blocks."""
        walls = [
            slab(chart, self.THICKNESS, self.reflectance(name))
            for name, chart in hall([-1, -2, 0], [1, 1, 2]).items()
        ]
        blocks = [turned(*block, self.albedo) for block in self.BLOCKS.values()] if self.blocks else []
        return (*walls, *blocks)

    def view(self, size: int = 128) -> View:
        t = self.THICKNESS
        bounds = [-1 - t, -2 - t, -t], [1 + t, 1 + t, 2 + t]
        return dataclasses.replace(super().view(size), solids=self.solids(), bounds=bounds)

    def reflectance(self, name: str) -> float | list[float]:
        less = self.albedo * (1 - self.saturation)
        return {"left": [self.albedo, less, less], "right": [less, self.albedo, less]}.get(name, self.albedo)

    def light(self) -> AreaLight:
        half = self.light_size
        radiance = self.FLUX / (math.pi * 4 * half**2)
        return AreaLight(
            "rectangle", [0.0, -0.3, 2 - self.BELOW_CEILING], [half, 0.0, 0.0], [0.0, -half, 0.0], radiance
        )

    def sensor(self, size: int) -> dict:
        return perspective([0, -1.9, 1.0], [0, 1, 0.6], 60, size)


@scene(
    theme="ambient",
    shows="a polished floor that shows the room again, sharp or blurred",
    quantities=(RADIANCE,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class PolishedFloorRoom(ColouredRoom):
    """The coloured room with a floor that also reflects `specular` of the light in a GGX lobe, seen flat.

    For light maps it is a diffuse floor that reflects as much in all.
    """

    light_size: Annotated[float, Axis(0.2, 0.6, log=True, unit="m")] = 0.4
    roughness: Annotated[float, Axis(0, 0.8)] = 0.05  # GGX alpha
    specular: Annotated[float, Axis(0.05, 0.4)] = 0.4

    FLOOR = 0.1  # diffuse albedo

    def reflectance(self, name: str) -> float | list[float]:
        return self.FLOOR if name == "floor" else super().reflectance(name)

    def surfaces(self) -> dict:
        floor = flat(self.charts()["floor"], glossy(self.FLOOR, self.specular, self.roughness))
        return {**super().surfaces(), "floor": floor}

    def sensor(self, size: int) -> dict:
        return perspective([0, -1.95, 0.6], [0, 0, 0.1], 60, size)

    def view(self, size: int = 128) -> View:
        view = super().view(size)
        dull = flat(self.charts()["floor"], diffuse(self.FLOOR + self.specular))
        floor = view.surface.chart == 0
        polished = dataclasses.replace(
            view.surface,
            albedo=dr.select(floor, self.FLOOR, view.surface.albedo),
            specular=mi.Color3f(dr.select(floor, mi.Float(self.specular), 0)),
            alpha=mi.Float(self.roughness),
        )
        gather = light_solver(mi.load_dict({**self.world(), "floor": dull}, optimize=False))
        return dataclasses.replace(view, surface=polished, gather=gather)


@scene(
    theme="ambient",
    shows="a wall of bossed stones beside a window, over a floor of another colour",
    quantities=(RADIANCE,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class BrickWall(Room):
    """The far wall of a room of 2.4 m x 2 m x 2.4 m, seen by a parallel camera, its normals from a texture.

    Stones of 0.4 m x 0.2 m lean away from their middles by an angle that grows with the square of the way to
    their edges, to `tilt` there. A square window in the left wall stands `light_distance` from the wall.
    """

    tilt: Annotated[float, Axis(0, 80, unit="deg")] = 45.0
    light_distance: Annotated[float, Axis(0.35, 1.6, unit="m")] = 0.9

    SIDE = 2.4  # m, of the wall
    TEXELS = 512
    WINDOW = 0.3  # m, half an edge
    RADIANCE_OF_WINDOW = 20.0
    STONE, FLOOR, PLASTER = 0.6, [0.8, 0.35, 0.1], 0.4  # albedo

    def charts(self) -> dict[str, Chart]:
        return hall([-self.SIDE / 2, -2, 0], [self.SIDE / 2, 0, self.SIDE])

    def reflectance(self, name: str) -> float | list[float]:
        return {"far": self.STONE, "floor": self.FLOOR}.get(name, self.PLASTER)

    def light(self) -> AreaLight:
        half, x = self.WINDOW, 0.01 - self.SIDE / 2
        return AreaLight(
            "rectangle",
            [x, -self.light_distance, 1.3],
            [0.0, half, 0.0],
            [0.0, 0.0, half],
            self.RADIANCE_OF_WINDOW,
        )

    def normals(self) -> np.ndarray:
        """Unit normals (TEXELS, TEXELS, 3) in the frame of the wall's chart, row 0 at t = 0."""
        at = self.SIDE * (np.arange(self.TEXELS) + 0.5) / self.TEXELS
        x, z = np.meshgrid(at, at)
        course = np.floor(z / 0.2)
        a, b = 2 * ((x / 0.4 + 0.5 * (course % 2)) % 1) - 1, 2 * ((z / 0.2) % 1) - 1
        lean = math.radians(self.tilt) * np.maximum(np.abs(a), np.abs(b)) ** 2
        r = np.hypot(a, b) + 1e-12
        return np.stack([np.sin(lean) * a / r, np.sin(lean) * b / r, np.cos(lean)], axis=-1)

    def surfaces(self) -> dict:
        texels = mi.Bitmap(np.ascontiguousarray(self.normals() / 2 + 0.5, np.float32))
        bossed = {
            "type": "normalmap",
            "normalmap": {"type": "bitmap", "bitmap": texels, "raw": True, "filter_type": "nearest"},
            "use_shadowing_function": False,
            "flip_invalid_normals": False,
            "bsdf": diffuse(self.STONE),
        }
        return {**super().surfaces(), "far": flat(self.charts()["far"], bossed)}

    def sensor(self, size: int) -> dict:
        return orthographic([0, -1.99, self.SIDE / 2], [0, 0, self.SIDE / 2], self.SIDE / 2, size)

    def view(self, size: int = 128) -> View:
        view, wall = super().view(size), self.charts()["far"]
        texel = mi.Point2u(dr.clip(self.TEXELS * view.surface.uv, 0, self.TEXELS - 1))
        u, v = (mi.Vector3f(e) / self.SIDE for e in (wall.u, wall.v))
        texels = mi.Vector3f(self.normals().reshape(-1, 3).T)
        local = dr.gather(mi.Vector3f, texels, texel.y * self.TEXELS + texel.x)
        normal = local.x * u + local.y * v + local.z * dr.cross(u, v)
        surface = dataclasses.replace(
            view.surface, normal=normal, albedo=mi.Color3f(self.STONE), chart=dr.zeros(mi.UInt32, size * size)
        )
        return dataclasses.replace(
            view, surface=surface, charts=(dataclasses.replace(wall, albedo=self.STONE),)
        )


@scene(
    theme="ambient",
    shows="a way from a bright room through a door into a dark one, and the light on a model that goes it",
    quantities=(IRRADIANCE,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class IrradianceTrack(Room):
    """Two rooms of 4 m x 4 m x 2.6 m with a wall between them, and a lamp under the ceiling of the first.

    Probes stand along the middle of both, 1 m above the floor, where a model moves towards +x at `speed`.
    """

    speed: Annotated[float, Axis(0, 8, unit="m/s")] = 1.5
    door: Annotated[float, Axis(0.2, 3.6, unit="m")] = 1.0  # width

    HEIGHT, LINTEL, THICKNESS = 2.6, 2.0, 0.1  # m
    START, END, ABOVE_FLOOR = -3.9, 3.9, 1.0  # m
    LAMP, RADIANCE_OF_LAMP = 0.4, 30.0  # m, half an edge
    TURNS = 3

    def charts(self) -> dict[str, Chart]:
        found = hall([-4, -2, 0], [4, 2, self.HEIGHT])
        side, jamb, top = 2 - self.door / 2, self.door / 2, self.HEIGHT - self.LINTEL
        for name, facing in (("bright", -1), ("dark", 1)):
            x = facing * self.THICKNESS / 2
            start = -2 * facing
            pieces = (
                ("one", [x, start, 0], [0, facing * side, 0], [0, 0, self.LINTEL]),
                ("other", [x, facing * jamb, 0], [0, facing * side, 0], [0, 0, self.LINTEL]),
                ("top", [x, start, self.LINTEL], [0, 4 * facing, 0], [0, 0, top]),
            )
            found |= {f"{name}_{piece}": Chart(*frame) for piece, *frame in pieces}
        half, deep = self.THICKNESS / 2, [self.THICKNESS, 0, 0]
        found["jamb_one"] = Chart([-half, jamb, 0], deep, [0, 0, self.LINTEL])
        found["jamb_other"] = Chart([half, -jamb, 0], [-self.THICKNESS, 0, 0], [0, 0, self.LINTEL])
        found["lintel"] = Chart([-half, jamb, self.LINTEL], deep, [0, -self.door, 0])
        return found

    def reflectance(self, name: str) -> float | list[float]:
        return [0.6, 0.4, 0.25] if name == "floor" else 0.5

    def light(self) -> AreaLight:
        half = self.LAMP
        centre = [-2.5, 1.2, self.HEIGHT - 0.01]
        return AreaLight("rectangle", centre, [half, 0.0, 0.0], [0.0, -half, 0.0], self.RADIANCE_OF_LAMP)

    def sensor(self, size: int) -> dict:
        return perspective([-3.8, -1.8, 1.4], [0.5, 0.6, 1.0], 70, size)

    def probes(self, size: int) -> View:
        """Column j of n: the place START + (j + 1/2) / n of the way to END. Row i: a normal on a spiral of
        TURNS turns from +z to -z. The camera looks at the side that the normal leaves."""
        k = dr.arange(mi.UInt32, size * size)
        row, column = (mi.Float(k // size) + 0.5) / size, (mi.Float(k % size) + 0.5) / size
        point = mi.Point3f(dr.lerp(self.START, self.END, column), 0, self.ABOVE_FLOOR)
        polar, turn = dr.pi * row, 2 * dr.pi * self.TURNS * row
        normal = mi.Vector3f(dr.sin(polar) * dr.cos(turn), dr.sin(polar) * dr.sin(turn), dr.cos(polar))
        white = dr.ones(mi.Color3f, size * size)
        surface = Surface(
            dr.full(mi.Bool, True, size * size), point, normal, white, dr.zeros(mi.Float, size * size)
        )
        return dataclasses.replace(
            self.view(1),
            width=size,
            height=size,
            camera=Camera(point, -normal, mi.Vector3f(1, 0, 0), 0.0, math.inf),
            surface=surface,
            velocity=mi.Vector3f(self.speed, 0, 0),
        )
