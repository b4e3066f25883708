r"""Many orders of scattering as diffusion: light that has lost its way, solved for on a grid ahead of time.

What a renderer with a precomputed volume would take instead of GPU Pro 7, chapter II.4, section 4.4 (Stam
1995, "Multiple scattering as a diffusion process"; the lobe's peak as in Joseph, Wiscombe and Weinman 1976,
"The delta-Eddington approximation"). A share f of what is scattered goes on as if it had not been, which
leaves sigma_s* = (1 - f) sigma_s, sigma_t* = sigma_t - f sigma_s and g* = (g - f) / (1 - f), and
a beam of the sun that falls off by T* = e^(-d*) instead of T = e^-d. The rest, phi (fluence) and F (net
flux), has the first two moments of the transfer equation; E is the sun's irradiance, l the way to it:

    div F + sigma_a phi = sigma_s* E T*,    F = -grad phi / (3 sigma_tr) - g* sigma_s* / sigma_tr E T* l
    sigma_tr = sigma_t - g sigma_s,  whatever f is;    n . F = phi / 2 where the cloud ends (Marshak)

    S(x, w) = E f_g T  +  E f_gg (T* - T)  +  (phi - 3 g w . F) / (4 pi),    w from eye to sample
    f_g = Henyey-Greenstein of g: light scattered once, exactly.

The bake solves for phi with conjugate gradients on finite volumes, harmonic means of 1 / sigma_tr between
cells and half a cell more up to the edge; the frame fetches phi and F, four numbers, at every step.

Chosen here:
- `peak`: f = g^2 ("delta"), f = g, by which g* = 0 ("similar"), or f = 0 ("none").
- `beam`: what the share f was scattered into. Light scattered twice by the lobe has the lobe of g^2, "lobe";
  or all directions alike, "even".
- `moments`: whether F counts ("two") or phi alone ("one").
- Cells that are at least half below THIN of the largest extinction are no cloud: light leaves there and does
  not come back. The edge is stepped; each face counts by |n|_2 / |n|_1, n the way out, so that all faces add
  up to the smooth area.
- The solver runs in NumPy and SciPy: the bake's time, which counts kernels, leaves it out (some 0.2 s).
- Rain multiplies the extinction everywhere, the view ray's as well.
A layer's transmittance comes out to 0.002 at depths of 8 and more under the zenith, its brightness to a tenth
or better. A ball that is few transport lengths 1 / sigma_tr across is a fifth too bright at a depth of 16 and
half too bright at 3, and nothing is right under a sun so low that the beam stays at the edge.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy import ndimage

from approximations.contract import (
    ANGULAR_DETAIL,
    LINEAR_IN_LIGHT,
    MULTIPLE_SCATTERING,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    technique,
)
from approximations.kit.cloud_march import light_depth, view_march
from approximations.kit.diffusion import solve
from approximations.kit.phase import henyey_greenstein
from approximations.kit.volume import Grid, Volume, as_volume, cell_centres, look_up_all, on_grid
from scenes.cloud import CloudSlab, CloudSphere
from scenes.contract import RADIANCE, SOURCE_FUNCTION, Scene, View
from scenes.cumulus import Cumulus

THIN = 1e-3  # of the largest extinction
DEPTH_STEPS = 64  # of the bake's marches to the sun


@dataclass
class Diffused:
    """phi and F's x, y, z where the sun's irradiance is 1, and the share f of light that goes on."""

    volume: Volume
    ahead: float


@technique(
    source="peer: Stam 1995, diffusion; Joseph et al. 1976, delta-Eddington; GPU Pro 7, II.4, sec. 4.4",
    estimates=SOURCE_FUNCTION,
    on=(CloudSlab, Cumulus),
    replaces="the source function of all orders of scattering",
    neglects=(MULTIPLE_SCATTERING, ANGULAR_DETAIL, SPATIAL_DETAIL),
    claims=(LINEAR_IN_LIGHT,),
    stress={"CloudSlab": ("optical_depth", "sun_elevation")},
    baseline=True,
)
def diffusion_source(
    view: View,
    diffused: Diffused,
    *,
    beam: Literal["lobe", "even"] = "lobe",
    moments: Literal["one", "two"] = "two",
    light_steps: Annotated[int, Sweep(6, low=1, high=1024)] = 6,
) -> mi.Color3f:
    """Source function (W m^-2 sr^-1) at the probes: the camera's origins are points in the cloud, its
    directions run from eye to sample. Knobs as in `diffusion_light`."""
    view = _rainy(view)
    depth = light_depth(view, view.camera.origin, light_steps)
    return mi.Color3f(view.sun.irradiance * _source(view, diffused, view.camera.origin, depth, beam, moments))


@technique(
    source="peer: Stam 1995, diffusion; Joseph et al. 1976, delta-Eddington; GPU Pro 7, II.4, sec. 4.4",
    estimates=RADIANCE,
    on=(CloudSlab, CloudSphere, Cumulus),
    replaces="all orders of scattering in a cloud in sunlight",
    neglects=(MULTIPLE_SCATTERING, ANGULAR_DETAIL, SPATIAL_DETAIL),
    claims=(LINEAR_IN_LIGHT,),
    stress={"CloudSphere": ("optical_depth", "g")},
    baseline=True,
)
def diffusion_light(
    view: View,
    diffused: Diffused,
    *,
    beam: Literal["lobe", "even"] = "lobe",
    moments: Literal["one", "two"] = "two",
    light_steps: Annotated[int, Sweep(6, low=1, high=1024)] = 6,
    steps: Annotated[int, Sweep(64, low=1, high=8192)] = 64,
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel, before a black sky.

    beam         where light of the beam goes that was scattered and went on.
    moments      whether the net flux tilts the diffused light.
    light_steps  samples of the march to the sun.
    steps        samples along the view ray.
    """
    view = _rainy(view)

    def source(x: mi.Point3f, active: mi.Bool) -> mi.Float:
        return _source(view, diffused, x, light_depth(view, x, light_steps, active), beam, moments)

    return mi.Color3f(view.sun.irradiance * view.cloud.albedo * view_march(view, steps, source))


@diffusion_source.bake
@diffusion_light.bake
def bake(
    view: View,
    *,
    resolution: Annotated[int, Sweep(16, 48, low=4, high=256)] = 48,
    peak: Literal["delta", "similar", "none"] = "delta",
) -> Diffused:
    """phi and F at the middles of the cells.

    resolution  cells along the longest edge that ends.
    peak        the share f of what is scattered that goes on.
    """
    view = _rainy(view)
    cloud, g = view.cloud, view.cloud.g
    sun = np.array(view.sun.direction, dtype=float).ravel()[::-1]
    ahead = {"delta": g * g, "similar": g, "none": 0.0}[peak]
    grid, axes = _grid(view.bounds, resolution)
    x = cell_centres(grid)
    depth = on_grid(grid, light_depth(view, x, DEPTH_STEPS)).astype(float)
    parts = np.array([on_grid(grid, cloud.extinction(x + grid.cell * c)) for c in _corners(axes)], float)
    sigma, filled = parts.mean(axis=0), (parts > THIN * parts.max()).mean(axis=0) >= 0.5
    phi, flux = solve(np.where(filled, sigma, 0), depth, grid.cell, axes, sun, cloud.albedo, g, ahead)
    away, nearest = ndimage.distance_transform_edt(~filled, return_indices=True)
    values = np.stack([phi, *flux[::-1]], axis=-1)[tuple(nearest)]
    return Diffused(as_volume(grid, np.where(away[..., None] < 2, values, 0)), ahead)


@diffusion_source.domain
@diffusion_light.domain
def domain(scene: Scene) -> Domain:
    """Thick clouds in sunlight; not where another light has a part."""
    if isinstance(scene, Cumulus) and scene.lit_by != "sun":
        return Domain(False, "the light of the sky, which was not diffused")
    if scene.albedo < 0.99:
        return Domain(False, "a medium that absorbs, in which light dies off before it has lost its way")
    if not isinstance(scene, CloudSphere) and scene.sun_elevation < 20:
        return Domain(False, "under a low sun the beam stays at the edge, where no light has lost its way")
    if (1 - scene.g) * scene.optical_depth < 2:
        return Domain(False, "thinner than two transport lengths: light leaves before it has lost its way")
    return Domain(True)


def _source(
    view: View, diffused: Diffused, x: mi.Point3f, depth: mi.Float, beam: str, moments: str
) -> mi.Float:
    """S over the sun's irradiance at points x of light depth d."""
    w, g, albedo = view.camera.direction, view.cloud.g, view.cloud.albedo
    cosine = dr.dot(w, view.sun.direction)
    phi, *flux = look_up_all(diffused.volume, x)
    once = dr.exp(-depth)
    ahead = dr.exp(-(1 - diffused.ahead * albedo) * depth) - once
    broad = henyey_greenstein(cosine, g * g) if beam == "lobe" else dr.inv_four_pi
    tilted = phi - 3 * g * dr.dot(w, mi.Vector3f(*flux)) if moments == "two" else phi
    return henyey_greenstein(cosine, g) * once + broad * ahead + dr.inv_four_pi * dr.maximum(tilted, 0)


def _rainy(view: View) -> View:
    """The view with the rain in its cloud's extinction, and a sun of its own: loops widen what they read."""
    dry, sun = view.cloud, dataclasses.replace(view.sun, direction=mi.Vector3f(view.sun.direction))
    wet = dataclasses.replace(
        dry, extinction=lambda p: dry.precipitation * dry.extinction(p), precipitation=1.0
    )
    return dataclasses.replace(view, cloud=wet, sun=sun)


def _grid(bounds: tuple, resolution: int) -> tuple[Grid, tuple[int, ...]]:
    """Cubic cells over the bounds, one where they do not end; the array's axes along which they do."""
    low, high = (np.array(b, dtype=float) for b in bounds)
    ends = np.isfinite(low) & np.isfinite(high)
    cell = float((high - low)[ends].max()) / resolution
    counts = [math.ceil(round(d / cell, 6)) if e else 1 for d, e in zip(high - low, ends, strict=True)]
    corner = tuple(float(x) if e else 0.0 for x, e in zip(low, ends, strict=True))
    return Grid(corner, cell, tuple(counts[::-1])), tuple(2 - int(i) for i in np.flatnonzero(ends))


def _corners(axes: tuple[int, ...]) -> list[mi.Vector3f]:
    """Places about the middle of a cell, in cells, a quarter off it along the axes given."""
    steps = [(-0.25, 0.25) if a in axes else (0.0,) for a in (2, 1, 0)]
    return [mi.Vector3f(*step) for step in itertools.product(*steps)]
