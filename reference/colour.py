r"""From spectra to linear sRGB, as a renderer with three channels is given them.

Observer: CIE 1931 2 degree. Illuminant: D65. Both, and the matrix from XYZ to linear sRGB (IEC 61966-2-1),
come from colour-science. Sums run over 360 to 830 nm in steps of 1 nm; spectra are linear in between and 0
outside theirs.

emission      XYZ = sum E(l) xyz(l) / 106.7502594, the divisor of Mitsuba's spectral film (FILM_Y)
reflectance   XYZ = sum R(l) D65(l) xyz(l) / sum D65(l) y(l), so that R = 1 is (1, 1, 1); also for
              transmittance and albedo
extinction    in 1/m, by one of three rules:

  "band"         as a reflectance: the mean of sigma over each channel's response to daylight. Renderers do
                 this with a spectrum in a scene file (pbrt-v3 and Mitsuba 0.6 built for RGB). It is exact to
                 first order in depth for daylight where nothing is clipped. The default.
  "depth"        -ln(rgb of exp(-sigma d)) / d at the depth d where the mean optical depth is 1: the artist's
                 colour at a distance (glTF, KHR_materials_volume). Exact for daylight at that depth alone.
  "wavelengths"  sigma at 680, 550 and 440 nm, as real-time skies take it (Bruneton and Neyret 2008).

Saturated spectra lie outside sRGB. Negative channels become 0, reflectances above 1 become 1, and
`conversions` says where. Mitsuba's film reads the observer from a table of 5 nm, linear in between: for
smooth spectra the two agree to 2e-4 of white, behind narrow bands of absorption to 1e-3.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from scenes.coloured import FILM_Y, colour_science
from scenes.contract import BadInput

OBSERVER = "CIE 1931 2 Degree Standard Observer"
ILLUMINANT = "D65"
THREE_WAVELENGTHS = (680.0, 550.0, 440.0)  # nm
LEAST_TRANSMITTANCE = 1e-4  # of an out-of-gamut channel, for the rule "depth"

Kind = Literal["emission", "reflectance", "extinction"]
Extinction = Literal["band", "depth", "wavelengths"]

KINDS: dict[str, Kind] = {
    **dict.fromkeys(("radiance", "irradiance", "intensity"), "emission"),
    **dict.fromkeys(("reflectance", "diffuse_reflectance", "specular_reflectance"), "reflectance"),
    **dict.fromkeys(("specular_transmittance", "opacity", "albedo"), "reflectance"),
    "sigma_t": "extinction",
}
"""What a spectrum stands for, by the name of the parameter that holds it or holds its texture."""


@functools.cache
def observer() -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths (nm, steps of 1) and the responses of X, Y, Z there, (471, 3)."""
    cmfs = colour_science().MSDS_CMFS[OBSERVER]
    return cmfs.wavelengths, cmfs.values


@functools.cache
def illuminant() -> np.ndarray:
    """D65 at the observer's wavelengths."""
    table = colour_science().SDS_ILLUMINANTS[ILLUMINANT]
    return np.interp(observer()[0], table.wavelengths, table.values)


def xyz_to_rgb(xyz: np.ndarray) -> np.ndarray:
    """Linear sRGB of XYZ (Y = 1 for white), not clipped; last axis holds the three."""
    return np.asarray(xyz) @ np.array(colour_science().RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB).T


def film_response() -> np.ndarray:
    """Weights (471, 3): E @ weights is the linear sRGB of an emission E at the observer's wavelengths."""
    return xyz_to_rgb(observer()[1] / FILM_Y)


def spectrum_to_rgb(
    wavelengths: np.ndarray, values: np.ndarray, kind: Kind, extinction: Extinction = "band"
) -> np.ndarray:
    """Linear sRGB of a spectrum, not clipped. wavelengths in nm, rising."""
    fine = np.interp(observer()[0], wavelengths, values, left=0, right=0)
    if kind == "emission":
        return fine @ film_response()
    if kind == "reflectance" or extinction == "band":
        return _seen_by_daylight(fine)
    if extinction == "wavelengths":
        return np.interp(THREE_WAVELENGTHS, wavelengths, values)
    depth = 1 / max(_mean(fine), 1e-30)
    seen = _seen_by_daylight(np.exp(-fine * depth))
    return -np.log(np.maximum(seen, LEAST_TRANSMITTANCE)) / depth


def _seen_by_daylight(ratio: np.ndarray) -> np.ndarray:
    """colour-science's integration of a reflectance under D65, as linear sRGB."""
    colour = colour_science()
    nm = observer()[0]
    xyz = colour.sd_to_XYZ(
        colour.SpectralDistribution(ratio, nm),
        colour.MSDS_CMFS[OBSERVER],
        colour.SpectralDistribution(illuminant(), nm),
        method="Integration",
    )
    return xyz_to_rgb(xyz / 100)


def _mean(values: np.ndarray) -> float:
    """The Y of a ratio under D65."""
    weight = illuminant() * observer()[1][:, 1]
    return float(values @ weight / weight.sum())


@dataclass(frozen=True)
class Conversion:
    """One spectrum of a scene: its place, what it stands for, its linear sRGB, and what is used of it."""

    where: str
    kind: Kind
    exact: tuple[float, float, float]
    used: tuple[float, float, float]

    @property
    def clipped(self) -> bool:
        """Whether the colour lay outside what RGB can hold."""
        return self.exact != self.used


def conversions(description: dict, extinction: Extinction = "band") -> list[Conversion]:
    """Every spectrum of a scene dictionary with its linear sRGB value, before and after clipping."""
    found: list[Conversion] = []
    _convert(description, "", None, extinction, found)
    return found


def to_rgb(description: dict, extinction: Extinction = "band") -> dict:
    """The scene dictionary with each `regular` or `irregular` spectrum replaced by its linear sRGB value.

    Raises BadInput for a spectrum whose parameter is not in KINDS.
    """
    return _convert(description, "", None, extinction, [])


def _convert(value: Any, where: str, kind: Kind | None, rule: Extinction, found: list[Conversion]) -> Any:
    if not isinstance(value, dict):
        return value
    if value.get("type") in ("regular", "irregular"):
        if kind is None:
            raise BadInput(f"{where}: what the spectrum stands for is not known; expected {', '.join(KINDS)}")
        exact = spectrum_to_rgb(*parse(value), kind, rule)
        used = np.clip(exact, 0, 1 if kind == "reflectance" else None)
        found.append(Conversion(where, kind, tuple(map(float, exact)), tuple(map(float, used))))
        return _rgb(kind, list(found[-1].used))
    return {
        k: _convert(v, f"{where}.{k}" if where else k, KINDS.get(k, kind), rule, found)
        for k, v in value.items()
    }


def _rgb(kind: Kind, value: list[float]) -> dict:
    """A Mitsuba colour; extinction needs one that may exceed 1."""
    if kind == "extinction":
        return {"type": "srgb", "color": value, "unbounded": True}
    return {"type": "rgb", "value": value}


def parse(spectrum: dict) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths (nm) and values of a Mitsuba `regular` or `irregular` spectrum dictionary."""

    def numbers(text: str) -> np.ndarray:
        return np.array([float(x) for x in text.replace(",", " ").split()])

    values = numbers(spectrum["values"])
    if spectrum["type"] == "irregular":
        return numbers(spectrum["wavelengths"]), values
    return np.linspace(spectrum["wavelength_min"], spectrum["wavelength_max"], len(values)), values
