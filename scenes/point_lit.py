"""A glossy ball under point lights: every angle of light and eye at once, highlights on a curved surface."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Annotated

import mitsuba as mi
import numpy as np

from scenes.contract import DIRECT_RADIANCE, Axis, PointLight, Scene, View, scene
from scenes.mitsuba_parts import camera_rays, diffuse, g_buffer, orthographic, rgb

HALF = 1.1  # m, half the width of the picture
MIRROR = 1e-3  # alpha under which the lobe is a mirror's, in which a point light is not seen


@scene(
    theme="shading",
    shows="highlights of point lights on a glossy ball",
    quantities=(DIRECT_RADIANCE,),
    exposure=(-2.0, 1.0),
)
@dataclass(frozen=True)
class PointLitBall(Scene):
    """A ball of radius 1 m, seen level from -y, under `lights` equal lights that share `intensity`.

    It reflects albedo / pi plus a single-scattering GGX lobe of width roughness^2 with separable Smith
    masking and the Fresnel reflectance of a dielectric that reflects `f0` head on. The lights stand 3 m from
    its middle, spread over the eye's side of it.
    """

    roughness: Annotated[float, Axis(0, 1)] = 0.3
    f0: Annotated[float, Axis(0.02, 0.5)] = 0.04
    albedo: Annotated[float, Axis(0, 0.5)] = 0.2
    lights: Annotated[int, Axis(1, 65)] = 4
    intensity: Annotated[float, Axis(0.1, 1000, log=True, unit="W/sr")] = 60.0

    FAR = 3.0  # m, from the middle of the ball to a light

    def positions(self) -> np.ndarray:
        """Of the lights, (lights, 3): a spiral from above the eye's side to its edge."""
        i = np.arange(self.lights)
        y = -1 + (i + 0.5) / self.lights
        phi = 2.399963229728653 * i + 1.0
        r = np.sqrt(1 - y * y)
        return self.FAR * np.stack([r * np.cos(phi), y, r * np.sin(phi)], axis=1)

    def surfaces(self) -> dict:
        index = (1 + math.sqrt(self.f0)) / (1 - math.sqrt(self.f0))
        rough = {"type": "roughconductor", "distribution": "ggx", "alpha": self.roughness**2}
        kind = rough if self.roughness**2 > MIRROR else {"type": "conductor"}
        lobe = {**kind, "eta": index, "k": 0.0, "specular_reflectance": {"type": "uniform", "value": 2.0}}
        base = diffuse(2 * self.albedo)
        ball = {"type": "sphere", "bsdf": {"type": "blendbsdf", "weight": 0.5, "base": base, "lobe": lobe}}
        return {"ball": ball}

    def sensor(self, size: int) -> dict:
        """The camera."""
        return orthographic([0, -5, 0], [0, 0, 0], HALF, size)

    def mitsuba(self, size: int = 128) -> dict:
        power = rgb(self.intensity / self.lights)
        lights = {
            f"light_{i:02d}": {"type": "point", "position": list(map(float, p)), "intensity": power}
            for i, p in enumerate(self.positions())
        }
        return {"type": "scene", **self.surfaces(), **lights, "sensor": self.sensor(size)}

    def view(self, size: int = 128) -> View:
        surfaces = mi.load_dict({"type": "scene", **self.surfaces()})
        camera = camera_rays(mi.load_dict(self.sensor(size)), size)
        hit = dataclasses.replace(
            g_buffer(surfaces, camera),
            albedo=mi.Color3f(self.albedo),
            specular=mi.Float(self.f0),
            alpha=mi.Float(self.roughness**2),
        )
        share = self.intensity / self.lights
        points = tuple(PointLight(mi.Point3f(*map(float, p)), share) for p in self.positions())
        return View(size, size, camera, surface=hit, points=points)
