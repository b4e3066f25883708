"""A metal inlay in polished stone: where ways to store two kinds of material in one texture are tried."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Annotated

import mitsuba as mi
import numpy as np

from scenes.contract import RADIANCE, Axis, Inlay, Scene, View, scene
from scenes.environment_ball import EnvironmentBall
from scenes.mitsuba_parts import camera_rays, g_buffer, glossy, perspective

# fmt: off
PATTERN = (
    "................",
    ".MMMMMMMMMM.....",
    ".MMMMMMMMMM.....",
    ".MM.............",
    ".MM......MMM....",
    ".MM......MMM....",
    ".MMMMMM..MMM....",
    ".MMMMMM.........",
    ".MM.............",
    ".MM....MM..MM...",
    ".MM.....M.M.M...",
    ".MM......MMMM...",
    ".MM.....MMMMMM..",
    ".MM.......MM....",
    "................",
    "................",
)
# fmt: on


@scene(
    theme="area_lights",
    shows="borders of gold in blue stone, where a filtered texture holds neither",
    quantities=(RADIANCE,),
    exposure=(-3.0, 1.0),
)
@dataclass(frozen=True)
class MaterialBorder(Scene):
    """A square of 2 m at z = 0 of two mirrors, one over a diffuse base, in an environment with one lobe.

    A share t of every spot is gold, which reflects GOLD as a mirror; the rest is stone, of diffuse
    reflectance STONE and specular reflectance POLISH at all angles. t is a texture of 32 x 32 texels, 0 or 1,
    averaged to level `mip` and read bilinearly. sharpness, contrast, turn: of the environment
    (`InEnvironment`). In Mitsuba the mirrors are GGX lobes of width MIRROR: its `blendbsdf` adds the
    probability of a perfect mirror to densities over solid angle, which is 15 % wrong here.
    """

    sharpness: Annotated[float, Axis(0.1, 300, log=True)] = 12.0
    contrast: Annotated[float, Axis(0, 1)] = 0.8
    turn: Annotated[float, Axis(0, 90, unit="deg")] = 47.0
    mip: Annotated[int, Axis(0, 5)] = 0

    GOLD = (0.98, 0.72, 0.28)
    STONE = (0.08, 0.16, 0.42)
    POLISH = 0.04
    MIRROR = 0.002

    def environment(self) -> EnvironmentBall:
        """What is round the square."""
        return EnvironmentBall(sharpness=self.sharpness, contrast=self.contrast, turn=self.turn)

    def mask(self) -> np.ndarray:
        """1 where a texel of the finest level is gold, (32, 32), row 0 at v = 0."""
        pattern = np.array([[c == "M" for c in row] for row in PATTERN[::-1]], np.float64)
        return np.kron(pattern, np.ones((2, 2)))

    def coverage(self) -> np.ndarray:
        """t at the texels of level `mip`, square."""
        t = self.mask()
        for _ in range(self.mip):
            t = t.reshape(len(t) // 2, 2, len(t) // 2, 2).mean(axis=(1, 3))
        return t

    def surfaces(self) -> dict:
        weight = np.ascontiguousarray(self.coverage()[..., None], np.float32)
        share = {
            "type": "bitmap",
            "bitmap": mi.Bitmap(weight),
            "raw": True,
            "wrap_mode": "clamp",
            "filter_type": "bilinear",
        }
        gold = glossy(0.0, self.GOLD, self.MIRROR)
        stone = glossy(self.STONE, self.POLISH, self.MIRROR)
        blend = {"type": "blendbsdf", "weight": share, "stone": stone, "gold": gold}
        return {"square": {"type": "rectangle", "bsdf": blend}}

    def sensor(self, size: int) -> dict:
        """A camera above one corner, which sees the lobe mirrored in the middle of the square."""
        return perspective([1.15, 1.15, 1.5], [-0.05, -0.05, 0.0], 58, size)

    def mitsuba(self, size: int = 128) -> dict:
        lights = self.environment().lights()
        return {"type": "scene", **self.surfaces(), **lights, "sensor": self.sensor(size)}

    def view(self, size: int = 128) -> View:
        square = mi.load_dict({"type": "scene", "square": {"type": "rectangle"}}, optimize=False)
        camera = camera_rays(mi.load_dict(self.sensor(size)), size)
        surface = dataclasses.replace(g_buffer(square, camera), albedo=None)
        inlay = Inlay(self.mask(), self.mip, self.STONE, self.GOLD, self.POLISH)
        return View(size, size, camera, surface=surface, environment=self.environment().radiance, inlay=inlay)
