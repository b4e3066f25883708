"""Balls in a distant environment: where ways to keep an environment in a few numbers are tried."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Annotated

import drjit as dr
import mitsuba as mi

from scenes.ball import Ball, DiffuseBall
from scenes.contract import RADIANCE, Axis, View, scene
from scenes.mitsuba_parts import environment_light, rgb


@dataclass(frozen=True)
class InEnvironment(Ball):
    """A fill of constant radiance and one lobe, a von Mises-Fisher distribution p of sharpness k:

    L(w) = (1 - contrast) FILL + contrast pi LAMP p(w . a),   p(c) = k e^(k (c - 1)) / (2 pi (1 - e^(-2 k))).

    Both give a surface that faces them at most the irradiance pi times their colour. The lobe's direction a
    stands at `turn` from +z towards (-1, -1, 0), which passes a diagonal of the axes at 54.7 deg.
    """

    sharpness: Annotated[float, Axis(0.1, 300, log=True)] = 3.0
    contrast: Annotated[float, Axis(0, 1)] = 0.8
    turn: Annotated[float, Axis(0, 180, unit="deg")] = 40.0

    FILL = (0.30, 0.42, 0.60)
    LAMP = (1.0, 0.86, 0.62)
    ROWS = 512

    def toward(self) -> list[float]:
        """Unit direction of the lobe."""
        t = math.radians(self.turn)
        return [-math.sqrt(0.5) * math.sin(t), -math.sqrt(0.5) * math.sin(t), math.cos(t)]

    def radiance(self, w: mi.Vector3f) -> mi.Color3f:
        """From unit directions, W m^-2 sr^-1."""
        k = self.sharpness
        peak = k / (2 * math.pi * (1 - math.exp(-2 * k)))
        lobe = peak * dr.exp(k * (dr.dot(mi.Vector3f(self.toward()), w) - 1))
        fill, lamp = mi.Color3f(self.FILL), mi.Color3f(self.LAMP)
        return (1 - self.contrast) * fill + self.contrast * math.pi * lobe * lamp

    def lights(self) -> dict:
        return {"environment": environment_light(self.radiance, self.ROWS)}

    def view(self, size: int = 128) -> View:
        return self.seen(size, environment=self.radiance)


@scene(
    theme="ambient",
    shows="a white ball under a lobe of light, from a glow all round to nearly a point",
    quantities=(RADIANCE,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class EnvironmentBall(InEnvironment, DiffuseBall):
    """A diffuse ball."""


@scene(
    theme="ambient",
    shows="a reflecting ball, from mirror to rough, in the same surroundings",
    quantities=(RADIANCE,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class GlossyBall(InEnvironment):
    """A ball that reflects by one GGX lobe of width roughness^2 with Schlick's Fresnel term, and no more.

    Mitsuba's `principled` metal: single scattering, Smith's masking, and a lobe no narrower than 0.001.
    """

    roughness: Annotated[float, Axis(0, 1)] = 0.4
    f0: Annotated[float, Axis(0.02, 1)] = 0.3  # reflectance at normal incidence
    sharpness: Annotated[float, Axis(0.1, 300, log=True)] = 30.0

    def material(self) -> dict:
        return {
            "type": "principled",
            "base_color": rgb(self.f0),
            "metallic": 1.0,
            "roughness": self.roughness,
        }

    def view(self, size: int = 128) -> View:
        seen = super().view(size)
        surface = dataclasses.replace(
            seen.surface,
            albedo=mi.Color3f(0),
            specular=mi.Color3f(self.f0),
            alpha=mi.Float(self.roughness**2),
        )
        return dataclasses.replace(seen, surface=surface)
