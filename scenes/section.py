"""Plane sections through fields that have no light of their own.

Mitsuba, which renders light, has of them a picture that glows: a square of 2 m whose radiance (W m^-2 sr^-1)
is the field.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.contract import AreaLight, Camera, Scene, View
from scenes.mitsuba_parts import area_light, camera_rays, orthographic


@dataclass(frozen=True)
class Section(Scene):
    """Subclasses say where the points lie, what the field is there, and what a technique is given."""

    TEXELS = 128  # of the picture, along an edge

    def points(self, size: int) -> np.ndarray:
        """(3, size size) float64: middles of pixels, row by row from the top."""
        raise NotImplementedError

    def values(self, size: int) -> np.ndarray:
        """(size, size, 1) float64: the field at the points."""
        raise NotImplementedError

    def given(self, size: int, camera: Camera) -> View:
        """What a technique has."""
        raise NotImplementedError

    def sensor(self, size: int) -> dict:
        """A camera that sees the picture from edge to edge."""
        return orthographic([0, -2, 0], [0, 0, 0], 1.0, size)

    def mitsuba(self, size: int = 128) -> dict:
        picture = np.repeat(self.values(self.TEXELS), 3, axis=2)
        light = AreaLight("rectangle", [0, 0, 0], [1, 0, 0], [0, 0, 1], 1.0)
        return {"type": "scene", "picture": area_light(light, picture), "sensor": self.sensor(size)}

    def view(self, size: int = 128) -> View:
        return self.given(size, camera_rays(mi.load_dict(self.sensor(size)), size))

    def probes(self, size: int = 128) -> View:
        """The points as origins of the camera's rays."""
        ahead = mi.Vector3f(0, 1, 0)
        points = mi.Point3f(self.points(size).astype(np.float32))
        return self.given(size, Camera(points, dr.repeat(ahead, size * size), ahead, 0.0, math.inf))
