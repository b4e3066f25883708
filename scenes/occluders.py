"""Objects on a floor before a wall, under a white sky: what ambient occlusion from a depth buffer sees of
them, and what it does not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import mitsuba as mi

from scenes.contract import SKY_VISIBILITY, Axis, Scene, View, scene
from scenes.mitsuba_parts import (
    camera_rays,
    diffuse,
    direction,
    g_buffer,
    perspective,
    ray_caster,
    ray_tracer,
)


@scene(
    theme="ambient",
    shows="a box, a ball, thin poles and a shelf on a floor before a wall, under a white sky",
    quantities=(SKY_VISIBILITY,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class Occluders(Scene):
    """Lengths in m. The ball's lowest point hangs `gap` above the floor; `pole` is the radius of three poles;
    `shelf` the thickness of a board that hides the floor below it from the eye but not from the sky; the
    camera looks down at `elevation` and stays 7 m away."""

    elevation: Annotated[float, Axis(3, 89, unit="deg")] = 35.0
    gap: Annotated[float, Axis(0, 1.5, unit="m")] = 0.0
    pole: Annotated[float, Axis(0.002, 0.3, log=True, unit="m")] = 0.04

    def surfaces(self) -> dict:
        grey = diffuse(0.5)

        def block(centre: list[float], half: list[float]) -> dict:
            place = mi.ScalarTransform4f().translate(centre).scale(half)
            return {"type": "cube", "to_world": place, "bsdf": grey}

        poles = {
            f"pole{i}": {
                "type": "cylinder",
                "p0": [x, -0.6, 0],
                "p1": [x, -0.6, 1.6],
                "radius": self.pole,
                "bsdf": grey,
            }
            for i, x in enumerate((0.35, 0.75, 1.15))
        }
        return {
            "floor": {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(60), "bsdf": grey},
            "wall": block([0, 2.2, 1.0], [2.5, 0.2, 1.0]),
            "box": block([-1.2, 1.0, 0.5], [0.5, 0.5, 0.5]),
            "shelf": block([1.3, 1.2, 0.6], [0.6, 0.5, 0.04]),
            "ball": {"type": "sphere", "center": [-0.7, -0.9, 0.5 + self.gap], "radius": 0.5, "bsdf": grey},
            **poles,
        }

    def sensor(self, size: int) -> dict:
        """The camera."""
        away = direction(self.elevation, -90.0)
        target = [0.0, 0.4, 0.4]
        return perspective([t + 7 * a for t, a in zip(target, away, strict=True)], target, 36, size)

    def mitsuba(self, size: int = 128) -> dict:
        sky = {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}}
        return {"type": "scene", **self.surfaces(), "sky": sky, "sensor": self.sensor(size)}

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
