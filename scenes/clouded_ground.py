"""A round hill under heaped clouds: their shadows, the hill's own dark side, and sky over all."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import drjit as dr
import mitsuba as mi
import numpy as np

from scenes.contract import DIRECT_RADIANCE, Axis, Cloud, Scene, Sun, View, scene
from scenes.mitsuba_parts import camera_rays, diffuse, direction, g_buffer, perspective, point_sun

WAVES = ((2, 1, 0.4), (-1, 2, 1.7), (1, 0, 2.6))
"""Cycles along x and y in a tile, and phase, of the factors 1 + cos that make the heaps."""


@dataclass(frozen=True)
class Layer:
    """Height of the middle of a layer of cloud and its thickness, and the tile that it repeats, m."""

    middle: float
    thickness: float
    tile: float


@scene(
    theme="clouds",
    shows="a hill in the shadows of clouds, on its own dark side and under an open sky",
    quantities=(DIRECT_RADIANCE,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class CloudedGround(Scene):
    """The top of a ball of 4 km, under cloud of extinction

        sigma(p) = optical_depth / (sqrt(2 pi) b) e^(-(z - 2000 m)^2 / (2 b^2)) prod (1 + cos(k . p + f)),

    b a quarter of the thickness: heaps up to 8 times as deep as the mean. A sun that is a point gives
    1 - sky_share to a surface that faces it (W m^-2), a uniform sky below the clouds pi sky_share.
    The ground is convex: it shades what it turns away from the sun, and sees half a sphere of sky everywhere.
    The camera stands under the clouds. For Mitsuba they absorb and do not scatter, and the sky, which they
    would shade too, is a glow of the ground.
    """

    sun_elevation: Annotated[float, Axis(5, 90, unit="deg")] = 45.0
    sky_share: Annotated[float, Axis(0, 0.9)] = 0.2
    thickness: Annotated[float, Axis(40, 1200, log=True, unit="m")] = 200.0
    optical_depth: Annotated[float, Axis(0.1, 20, log=True)] = 0.8  # mean, straight up

    RADIUS = 4000.0  # m
    MIDDLE = 2000.0  # m above the top of the hill
    TILE = 1000.0  # m
    ALBEDO = 0.5
    AZIMUTH = 160.0  # deg
    FIELD_OF_VIEW = 40.0  # deg
    EYE = (0.0, -1800.0, 400.0)
    TILT = 35.0  # deg downwards
    REACH = 1.25  # of the thickness that Mitsuba's grid holds to each side of the middle: 5 b
    CELLS = 48  # of Mitsuba's grid, in a tile and through the layer
    SEEN = 1400.0  # m from the top that the ground seen lies within, sideways
    DROP = 130.0  # m below the top, half of how deep it lies at most

    def to_sun(self) -> list[float]:
        """Unit direction to the sun."""
        return direction(self.sun_elevation, self.AZIMUTH)

    def sensor(self, size: int) -> dict:
        """The camera."""
        _, y, z = direction(-self.TILT, 90.0)
        target = [self.EYE[0], self.EYE[1] + 1e3 * y, self.EYE[2] + 1e3 * z]
        return perspective(list(self.EYE), target, self.FIELD_OF_VIEW, size)

    def surfaces(self) -> dict:
        ground = {"type": "sphere", "center": [0.0, 0.0, -self.RADIUS], "radius": self.RADIUS}
        return {"ground": {**ground, "bsdf": diffuse(self.ALBEDO)}}

    def extinction(self, p: mi.Point3f) -> mi.Float:
        """sigma(p), 1/m."""
        b = self.thickness / 4
        z = (p.z - self.MIDDLE) / b
        sigma = self.optical_depth / (math.sqrt(2 * math.pi) * b) * dr.exp(-0.5 * z * z)
        for kx, ky, phase in WAVES:
            sigma *= 1 + dr.cos(2 * dr.pi / self.TILE * (kx * p.x + ky * p.y) + phase)
        return sigma

    def span(self, o: mi.Point3f, d: mi.Vector3f) -> tuple[mi.Float, mi.Float]:
        """Distances (m) between which a ray is within 5 b of the middle, both 0 where it misses."""
        half = self.REACH * self.thickness
        low, high = (self.MIDDLE - half - o.z) / d.z, (self.MIDDLE + half - o.z) / d.z
        near, far = dr.maximum(dr.minimum(low, high), 0), dr.maximum(low, high)
        return dr.select(far > near, near, 0), dr.select(far > near, far, 0)

    def view(self, size: int = 128) -> View:
        surfaces = mi.load_dict({"type": "scene", **self.surfaces()})
        camera = camera_rays(mi.load_dict(self.sensor(size)), size)
        layer = Layer(self.MIDDLE, self.thickness, self.TILE)
        return View(
            size,
            size,
            camera,
            surface=g_buffer(surfaces, camera),
            sun=Sun(mi.Vector3f(self.to_sun()), 0.0, 1 - self.sky_share),
            sky=self.sky_share,
            cloud=Cloud(self.extinction, self.span, 0.0, 0.0, 1.0, model=layer),
        )

    def mitsuba(self, size: int = 128) -> dict:
        """The clouds are a grid over the part of the layer that the sun shines through onto what is seen."""
        l, half = self.to_sun(), self.REACH * self.thickness
        slope = np.array(l[:2]) / l[2]
        wide = self.SEEN + (self.DROP + half) * float(np.abs(slope).max())
        middle = np.array([*((self.MIDDLE + self.DROP) * slope), self.MIDDLE])
        across = math.ceil(2 * wide / self.TILE * self.CELLS)
        x = ((np.arange(across) + 0.5) / across * 2 - 1) * wide
        z = ((np.arange(self.CELLS) + 0.5) / self.CELLS * 2 - 1) * half
        at = [m.ravel().astype(np.float32) for m in np.meshgrid(z, x, x, indexing="ij")]
        p = mi.Point3f(at[2] + middle[0], at[1] + middle[1], at[0] + middle[2])
        density = np.array(self.extinction(p), np.float32).reshape(self.CELLS, across, across, 1)
        box = mi.ScalarTransform4f().translate(list(middle)).scale([wide, wide, half])
        medium = {
            "type": "heterogeneous",
            "sigma_t": {
                "type": "gridvolume",
                "grid": mi.VolumeGrid(np.ascontiguousarray(density)),
                "use_grid_bbox": False,
                "wrap_mode": "clamp",
                "to_world": box.translate([-1, -1, -1]).scale(2),
            },
            "albedo": 0.0,
        }
        glow = {"type": "area", "radiance": {"type": "rgb", "value": self.ALBEDO * self.sky_share}}
        ground = {**self.surfaces()["ground"], **({"emitter": glow} if self.sky_share else {})}
        return {
            "type": "scene",
            "ground": ground,
            "cloud": {"type": "cube", "to_world": box, "bsdf": {"type": "null"}, "interior": medium},
            "sun": point_sun(l, 1 - self.sky_share),
            "sensor": self.sensor(size),
        }
