"""Coloured glass, a coloured room and a clear sky: where three channels do not stand for a spectrum.

Every coloured quantity is a Mitsuba `regular` spectrum of 95 values, 360 to 830 nm in steps of 5 nm, linear
in between. Emission is scaled to the unit of Mitsuba's films: a light of luminance 1 has Y = 1, and as linear
sRGB the value (1, 1, 1) if it is daylight.
"""

from __future__ import annotations

import functools
import math
import warnings
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import mitsuba as mi
import numpy as np

from scenes.contract import RADIANCE, Axis, Scene, View, scene
from scenes.mitsuba_parts import camera_rays, diffuse, direction, orthographic, perspective

WAVELENGTHS = np.arange(360.0, 831.0, 5.0)  # nm
FILM_Y = 106.7502593994140625
"""nm; Mitsuba's spectral film divides the integrals by it. The observer's own integral of y is 106.856917, so
that a spectrum of value 1 has Y = 1.000999 there."""
SUN_TEMPERATURE = 5772.0  # K, nominal effective temperature of the sun (IAU 2015 resolution B3)

Light = Literal["daylight", "incandescent"]


def spectrum(values: np.ndarray) -> dict:
    """The Mitsuba spectrum with these values at WAVELENGTHS."""
    return {
        "type": "regular",
        "wavelength_min": float(WAVELENGTHS[0]),
        "wavelength_max": float(WAVELENGTHS[-1]),
        "values": ", ".join(f"{x:.9g}" for x in np.broadcast_to(values, WAVELENGTHS.shape)),
    }


def colour_science():
    """The package `colour`, imported when it is needed (2 s) and without its word on missing plots."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour
    return colour


def of_luminance(values: np.ndarray, luminance: float = 1.0) -> np.ndarray:
    """The spectrum scaled to Y = (integral of values y-bar) / FILM_Y = `luminance`."""
    observer = colour_science().MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    fine = np.interp(observer.wavelengths, WAVELENGTHS, values)
    return luminance * values * FILM_Y / float(fine @ observer.values[:, 1])


@functools.cache
def light(kind: Light) -> np.ndarray:
    """CIE standard illuminant D65 (daylight) or A (incandescent, 2856 K) at luminance 1."""
    table = colour_science().SDS_ILLUMINANTS[{"daylight": "D65", "incandescent": "A"}[kind]]
    return of_luminance(np.interp(WAVELENGTHS, table.wavelengths, table.values))


@functools.cache
def sunlight() -> np.ndarray:
    """Planck's law at 5772 K at luminance 1: the sun above the air, without its absorption lines."""
    metres = WAVELENGTHS * 1e-9
    return of_luminance(metres**-5 / np.expm1(0.014387769 / (metres * SUN_TEMPERATURE)))


@functools.cache
def patch(name: str) -> np.ndarray:
    """Reflectance of a ColorChecker patch (N. Ohta's measurement of 1997), constant beyond 380 to 780 nm."""
    table = colour_science().SDS_COLOURCHECKERS["ColorChecker N Ohta"][name]
    return np.interp(WAVELENGTHS, table.wavelengths, table.values)


def band(centre: float, width: float) -> np.ndarray:
    """A Gaussian absorption band of height 1; centre and standard deviation in nm."""
    return np.exp(-0.5 * ((WAVELENGTHS - centre) / width) ** 2)


def toward_grey(values: np.ndarray, saturation: float) -> np.ndarray:
    """The spectrum with its deviation from its mean over wavelength scaled by `saturation`."""
    return values.mean() + saturation * (values - values.mean())


DYES = {
    "cobalt": 2.0 * (0.75 * band(540, 17) + 0.95 * band(592, 20) + 0.9 * band(645, 22)) + 0.03,
    "ruby": 1.6 * band(528, 32) + 0.45 * band(400, 60) + 0.02,
    "amber": 3.2 * np.exp(-(WAVELENGTHS - 400) / 55) + 0.03,
    "two-hued": 3.0 * band(430, 45) + 0.5 * band(515, 22) + 1.1 * band(590, 28) + 0.55 * band(640, 22) + 0.05,
}
"""Absorption coefficients in 1/cm at WAVELENGTHS. Smooth models, no measured samples: cobalt has its three
bands, gold ruby its plasmon band, amber an edge that rises towards the blue; "two-hued" has a narrow window
in the green and a wide, clearer one in the red, as pumpkin seed oil does, and turns from green to red with
depth (S. Kreft and M. Kreft, Naturwissenschaften 94, 2007)."""


@scene(
    theme="colour",
    shows="four balls of coloured glass before a white panel, each holding all thicknesses from zero up",
    quantities=(RADIANCE,),
    exposure=(-2.0, 2.0),
)
@dataclass(frozen=True)
class ColouredGlass(Scene):
    """Balls of absorbing matter without refraction; along a ray L = L_panel exp(-sigma(lambda) s).

    A ball is `thickness` across; `saturation` 0 makes every dye grey. Parallel camera along +y.
    """

    thickness: Annotated[float, Axis(0.01, 30, log=True, unit="cm")] = 3.0
    saturation: Annotated[float, Axis(0, 1)] = 1.0
    light: Light = "daylight"

    spectral: ClassVar[bool] = True
    RADIUS, HALF_WIDTH = 1.0, 2.2  # scene units; half the picture
    CENTRES = {
        "cobalt": (-1.1, 0.0, 1.1),
        "ruby": (1.1, 0.0, 1.1),
        "amber": (-1.1, 0.0, -1.1),
        "two-hued": (1.1, 0.0, -1.1),
    }

    def absorption(self, dye: str) -> np.ndarray:
        """Absorption per scene unit at WAVELENGTHS; the diameter is 2 units."""
        return toward_grey(DYES[dye], self.saturation) * self.thickness / (2 * self.RADIUS)

    def panel(self) -> np.ndarray:
        """Radiance of the panel at WAVELENGTHS."""
        return light(self.light)

    def sensor(self, size: int) -> dict:
        """A parallel camera."""
        return orthographic([0, -3, 0], [0, 0, 0], self.HALF_WIDTH, size)

    def mitsuba(self, size: int = 128) -> dict:
        balls = {f"ball_{dye.replace('-', '_')}": self._ball(dye) for dye in self.CENTRES}
        panel = {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().look_at([0, 3, 0], [0, 0, 0], [0, 0, 1]).scale([3, 3, 1]),
            "bsdf": diffuse(0.0),
            "emitter": {"type": "area", "radiance": spectrum(self.panel())},
        }
        return {"type": "scene", "panel": panel, **balls, "sensor": self.sensor(size)}

    def _ball(self, dye: str) -> dict:
        return {
            "type": "sphere",
            "center": list(self.CENTRES[dye]),
            "radius": self.RADIUS,
            "bsdf": {"type": "null"},
            "interior": {"type": "homogeneous", "albedo": 0.0, "sigma_t": spectrum(self.absorption(dye))},
        }

    def view(self, size: int = 128) -> View:
        return View(size, size, camera_rays(mi.load_dict(self.sensor(size)), size))


@scene(
    theme="colour",
    shows="a closed room of saturated walls, where most light has bounced many times",
    quantities=(RADIANCE,),
    exposure=(-3.0, 2.0),
)
@dataclass(frozen=True)
class DeepInterreflection(Scene):
    """A cube of edge 2 m with a lamp under its ceiling, seen from inside. Every wall is a ColorChecker patch,
    scaled so that its reflectance is `albedo` where it is highest; `saturation` 0 makes the walls grey.

    The lamp's luminance is LAMP (1 - albedo), so that the picture keeps its level. Where the lamp's own black
    back and the other walls take little, an RGB reflectance above the highest of the spectrum shows strongly.
    """

    albedo: Annotated[float, Axis(0.02, 0.98)] = 0.85
    saturation: Annotated[float, Axis(0, 1)] = 1.0
    light: Light = "daylight"

    spectral: ClassVar[bool] = True
    LAMP, LAMP_HALF = 30.0, 0.5  # W m^-2 sr^-1, m
    FOV = 85.0  # deg
    WALLS = {  # patch, centre, and the way that the wall faces
        "floor": ("orange yellow", (0, 0, -1), (0, 0, 1)),
        "ceiling": ("orange yellow", (0, 0, 1), (0, 0, -1)),
        "back": ("orange yellow", (0, 1, 0), (0, -1, 0)),
        "front": ("orange yellow", (0, -1, 0), (0, 1, 0)),
        "left": ("red", (-1, 0, 0), (1, 0, 0)),
        "right": ("cyan", (1, 0, 0), (-1, 0, 0)),
    }

    def reflectance(self, name: str) -> np.ndarray:
        """Reflectance of a patch at WAVELENGTHS."""
        mixed = toward_grey(patch(name), self.saturation)
        return self.albedo * mixed / mixed.max()

    def sensor(self, size: int) -> dict:
        """A camera just inside the front wall."""
        return perspective([0, -0.95, 0], [0, 0, 0], self.FOV, size)

    def mitsuba(self, size: int = 128) -> dict:
        walls = {
            f"wall_{name}": {
                "type": "rectangle",
                "to_world": _facing(centre, normal),
                "bsdf": {"type": "diffuse", "reflectance": spectrum(self.reflectance(colour))},
            }
            for name, (colour, centre, normal) in self.WALLS.items()
        }
        lamp = {
            "type": "rectangle",
            "to_world": _facing((0, 0, 0.98), (0, 0, -1)).scale([self.LAMP_HALF, self.LAMP_HALF, 1]),
            "bsdf": diffuse(0.0),
            "emitter": {
                "type": "area",
                "radiance": spectrum(self.LAMP * (1 - self.albedo) * light(self.light)),
            },
        }
        return {"type": "scene", **walls, "lamp": lamp, "sensor": self.sensor(size)}

    def view(self, size: int = 128) -> View:
        return View(size, size, camera_rays(mi.load_dict(self.sensor(size)), size))


def _facing(centre: tuple, normal: tuple) -> mi.ScalarTransform4f:
    up = [0, 1, 0] if normal[2] else [0, 0, 1]
    target = [c + n for c, n in zip(centre, normal, strict=True)]
    return mi.ScalarTransform4f().look_at(list(centre), target, up)


def rayleigh_depth(nanometres: np.ndarray) -> np.ndarray:
    """Vertical optical depth of the molecules of the air above sea level (Hansen & Travis 1974, eq. 2.30):
    tau = 0.008569 l^-4 (1 + 0.0113 l^-2 + 0.00013 l^-4), l in micrometres."""
    l = nanometres / 1000
    return 0.008569 * l**-4 * (1 + 0.0113 * l**-2 + 0.00013 * l**-4)


@scene(
    theme="colour",
    shows="a clear sky over flat ground, seen towards the sun's side",
    quantities=(RADIANCE,),
    exposure=(-2.0, 3.0),
)
@dataclass(frozen=True)
class Atmosphere(Scene):
    """A flat layer of air, HEIGHT thick and of one density, over Lambertian ground; all orders of scattering.

    tau(lambda) = density tau_R(550 nm) (tau_R(lambda) / tau_R(550 nm))^(exponent / 4): exponent 4 is
    molecules alone, 0 is grey. Scattering is Rayleigh's and absorbs nothing; there is no ozone, whose bands
    keep a real zenith blue at dusk, and no curvature: the air mass is 1 / sin(elevation), 29 at 2 degrees
    where the round Earth has 20. The sun is a point of Planck's spectrum that gives a facing surface above
    the air an irradiance of luminance pi; the camera does not see its disk. The ground is grey.
    The camera stands GAP under the air, looks 25 degrees up and sees 20 degrees below the horizon.
    """

    sun_elevation: Annotated[float, Axis(2, 90, unit="deg")] = 20.0
    density: Annotated[float, Axis(0.05, 10, log=True)] = 1.0
    exponent: Annotated[float, Axis(0, 4)] = 4.0
    ground: Annotated[float, Axis(0, 1)] = 0.2

    spectral: ClassVar[bool] = True
    HEIGHT, HALF_WIDTH, GAP, EYE = 8.0, 1000.0, 0.02, 0.01  # km
    FOV = 90.0  # deg
    AZIMUTH = 30.0  # deg from the sun's to the camera's

    def optical_depth(self) -> np.ndarray:
        """Vertical optical depth at WAVELENGTHS."""
        middle = rayleigh_depth(np.array(550.0))
        return self.density * middle * (rayleigh_depth(WAVELENGTHS) / middle) ** (self.exponent / 4)

    def sensor(self, size: int) -> dict:
        """A camera near the ground."""
        eye = [0.0, 0.0, self.EYE]
        toward = direction(25.0, self.AZIMUTH)
        return perspective(
            eye, [a + b for a, b in zip(eye, toward, strict=True)], self.FOV, size, near_clip=1e-4
        )

    def mitsuba(self, size: int = 128) -> dict:
        w, h = self.HALF_WIDTH, self.HEIGHT / 2
        air = {
            "type": "cube",
            "to_world": mi.ScalarTransform4f().translate([0.2 * w, 0.1 * w, h + self.GAP]).scale([w, w, h]),
            "bsdf": {"type": "null"},
            "interior": {
                "type": "homogeneous",
                "albedo": 1.0,
                "sigma_t": spectrum(self.optical_depth() / self.HEIGHT),
                "phase": {"type": "rayleigh"},
            },
        }
        ground = {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().scale([2 * w, 2 * w, 1]),
            "bsdf": diffuse(self.ground),
        }
        sun = {
            "type": "directional",
            "direction": [-x for x in direction(self.sun_elevation)],
            "irradiance": spectrum(math.pi * sunlight()),
        }
        return {"type": "scene", "air": air, "ground": ground, "sun": sun, "sensor": self.sensor(size)}

    def view(self, size: int = 128) -> View:
        return View(size, size, camera_rays(mi.load_dict(self.sensor(size)), size))
