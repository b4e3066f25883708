"""Small things that hide parts of the sky from each other: where ambient occlusion on the screen is tried."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import mitsuba as mi
import numpy as np

from scenes.contract import SKY_VISIBILITY, Axis, Scene, View, scene
from scenes.mitsuba_parts import (
    camera_rays,
    diffuse,
    direction,
    g_buffer,
    perspective,
    ray_caster,
    ray_tracer,
    uniform_sky,
)


@scene(
    theme="ambient",
    shows="a box, a ball, a thin pole, a corner, a slot and a row of fins that hide the sky",
    quantities=(SKY_VISIBILITY,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class Occluders(Scene):
    """Occluders up to 1.2 m high on a plane of 40 m, under a uniform sky of radiance 1."""

    pole: Annotated[float, Axis(0.005, 0.2, log=True, unit="m")] = 0.02
    """Half width of the pole."""
    slot: Annotated[float, Axis(0.01, 0.6, unit="m")] = 0.12
    """Width between the two blocks in front."""
    camera_elevation: Annotated[float, Axis(10, 85, unit="deg")] = 40.0
    albedo: Annotated[float, Axis(0, 0.9)] = 0.5

    DISTANCE = 6.0  # m, of the camera
    FINS = 6

    def surfaces(self) -> dict:
        half = 0.25
        blocks = {
            f"block_{i}": self._box((0.1 + side * (half + 0.5 * self.slot), -0.8, half), (half, 0.3, half))
            for i, side in enumerate((-1, 1))
        }
        fins = {
            f"fin_{i}": self._box((1.05 + 0.09 * i, -0.6, 0.2), (0.006, 0.16, 0.2)) for i in range(self.FINS)
        }
        return {
            "plane": {
                "type": "rectangle",
                "to_world": mi.ScalarTransform4f().scale(20),
                "bsdf": diffuse(self.albedo),
            },
            "box": self._box((-1.1, -0.3, 0.3), (0.35, 0.35, 0.3)),
            "ball": {
                "type": "sphere",
                "center": [1.1, 0.7, 0.4],
                "radius": 0.4,
                "bsdf": diffuse(self.albedo),
            },
            "pole": self._box((0.2, 0.3, 0.6), (self.pole, self.pole, 0.6)),
            "wall": self._box((-0.7, 1.2, 0.4), (0.6, 0.05, 0.4)),
            "side_wall": self._box((-1.35, 0.75, 0.4), (0.05, 0.5, 0.4)),
            **blocks,
            **fins,
        }

    def sensor(self, size: int) -> dict:
        target = np.array([0.1, 0.0, 0.2])
        origin = target + self.DISTANCE * np.array(direction(self.camera_elevation, -90.0))
        return perspective(list(origin), list(target), 34, size, near_clip=1.0)

    def mitsuba(self, size: int = 128) -> dict:
        return {"type": "scene", **self.surfaces(), "sky": uniform_sky(1.0), "sensor": self.sensor(size)}

    def view(self, size: int = 128) -> View:
        surfaces = mi.load_dict({"type": "scene", **self.surfaces()}, optimize=False)
        camera = camera_rays(mi.load_dict(self.sensor(size)), size)
        return View(
            size,
            size,
            camera,
            surface=g_buffer(surfaces, camera),
            sky=1.0,
            visible=ray_caster(surfaces),
            trace=ray_tracer(surfaces),
        )

    def _box(self, centre: tuple[float, float, float], half: tuple[float, float, float]) -> dict:
        to_world = mi.ScalarTransform4f().translate(centre).scale(half)
        return {"type": "cube", "to_world": to_world, "bsdf": diffuse(self.albedo)}
