r"""Many orders of scattering as diffusion: light that has lost its direction, solved for on a grid ahead of time.

A peer of GPU Pro 7, chapter II.4, section 4.4, of which a production renderer with a precomputed volume would
make use (Stam 1995, "Multiple scattering as a diffusion process"; the peak of the lobe by Joseph, Wiscombe and
Weinman 1976, "The delta-Eddington approximation"). A share f of what is scattered goes on as if it had not
been, which leaves sigma_s* = (1 - f) sigma_s, sigma_t* = sigma_t - f sigma_s and g* = (g - f) / (1 - f), and
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
Right in layers of any depth to a few percent; where the cloud is thinner than a few transport lengths
1 / sigma_tr, light arrives from edges that diffusion knows nothing of.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy import ndimage, sparse

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
from approximations.kit.phase import henyey_greenstein
from approximations.kit.volume import Grid, Volume, as_volume, cell_centres, look_up_all, on_grid
from scenes.cloud import CloudSlab, CloudSphere
from scenes.contract import RADIANCE, SOURCE_FUNCTION, Scene, View
from scenes.cumulus import Cumulus

THIN = 1e-3  # of the largest extinction
DEPTH_STEPS = 64  # of the bake's marches to the sun
CLOSE = 1e-6  # residual over right-hand side at which the solver stops
TURNS = 2000


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
    stress={"CloudSphere": ("optical_depth",)},
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
    if (1 - scene.g) * scene.optical_depth < 2:
        return Domain(False, "thinner than two transport lengths: light leaves before it has lost its way")
    return Domain(True)


def solve(
    sigma: np.ndarray,
    depth: np.ndarray,
    cell: float,
    axes: tuple[int, ...],
    sun: np.ndarray,
    albedo: float,
    g: float,
    ahead: float,
) -> tuple[np.ndarray, list[np.ndarray]]:
    """phi (nz, ny, nx) and F's z, y, x in W m^-2, for a sun of irradiance 1.

    sigma, depth: extinction (1/m) and optical depth towards the sun at the middles of the cells, whose edge
    is `cell` m, no extinction outside the cloud; axes: those of the arrays along which anything changes; sun: z, y, x of the way to it.
    """
    cloud = sigma > 0
    r = 1.5 * cell * (1 - albedo * g) * np.where(cloud, sigma, 1.0)  # half a cell over D = 1 / (3 sigma_tr)
    thinner = 1 - ahead * albedo
    chord = cell / sum(abs(sun[a]) for a in axes)
    half = np.minimum(thinner * sigma * chord / 2, 50.0)
    beam = np.where(cloud, np.exp(-thinner * depth), 0.0)
    tilt = (g - ahead) * albedo / (1 - albedo * g)
    right = cell * albedo * (1 - ahead) * sigma * beam * np.sinh(half) / np.maximum(half, 1e-9)
    diagonal = np.where(cloud, cell * (1 - albedo) * sigma, 1.0)
    outward = _outward(cloud, axes)
    between, faces = [], []
    for a in axes:
        here, there = _sides(a)
        linked = cloud[here] & cloud[there]
        k = np.where(linked, 1 / (r[here] + r[there]), 0.0)
        drift = np.where(linked, -tilt * sun[a] * np.sqrt(beam[here] * beam[there]), 0.0)
        right[here] -= drift
        right[there] += drift
        diagonal[here] += k
        diagonal[there] += k
        between.append((a, k, drift))
        for up in (1, -1):
            edge = cloud & ~_shifted(cloud, a, up)
            lit = beam * np.exp(np.sign(up * sun[a]) * half)
            leaves = np.where(edge, outward[a] / (r + 2), 0.0)
            drift = np.where(edge, -tilt * sun[a] * up * np.minimum(lit, 1) * r / (r + 2), 0.0)
            diagonal += leaves
            right -= drift
            faces.append((a, up, leaves, drift))

    phi = np.zeros_like(sigma)
    phi[cloud] = _inverse(cloud, diagonal, between, right[cloud])
    flux = [np.zeros_like(phi) for _ in range(3)]
    for a, k, drift in between:
        here, there = _sides(a)
        through = k * (phi[here] - phi[there]) + drift
        flux[a][here] += through / 2
        flux[a][there] += through / 2
    for a, up, leaves, drift in faces:
        flux[a] += up * (leaves * phi + drift) / 2
    return phi, flux


def _inverse(cloud: np.ndarray, diagonal: np.ndarray, between: list, right: np.ndarray) -> np.ndarray:
    """phi of the cells that are cloud, by conjugate gradients, preconditioned with the diagonal."""
    number = (np.cumsum(cloud) - 1).reshape(cloud.shape)
    rows, columns, values = [number[cloud]], [number[cloud]], [diagonal[cloud]]
    for a, k, _ in between:
        here, there = _sides(a)
        one, other = (number[side][k > 0] for side in (here, there))
        rows += [one, other]
        columns += [other, one]
        values += [-k[k > 0]] * 2
    places = np.concatenate(rows), np.concatenate(columns)
    matrix = sparse.csr_matrix((np.concatenate(values), places), shape=(len(right),) * 2)
    return _conjugate_gradients(matrix, diagonal[cloud], right)


def _conjugate_gradients(matrix: sparse.csr_matrix, diagonal: np.ndarray, right: np.ndarray) -> np.ndarray:
    """x with matrix x = right. Products are summed by einsum: BLAS would set all cores on each of them."""
    x, residual, way, size = np.zeros_like(right), right.copy(), np.zeros_like(right), np.inf
    least = CLOSE**2 * np.einsum("i,i", right, right)
    for _ in range(TURNS):
        z = residual / diagonal
        size, before = np.einsum("i,i", residual, z), size
        way = z + size / before * way
        image = matrix @ way
        step = size / np.einsum("i,i", way, image)
        x += step * way
        residual -= step * image
        if np.einsum("i,i", residual, residual) <= least:
            break
    return x


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
    ends = np.isfinite(high - low)
    cell = float((high - low)[ends].max()) / resolution
    counts = [math.ceil(d / cell - 1e-6) if e else 1 for d, e in zip(high - low, ends, strict=True)]
    corner = tuple(float(x) if e else -cell / 2 for x, e in zip(low, ends, strict=True))
    return Grid(corner, cell, tuple(counts[::-1])), tuple(2 - int(i) for i in np.flatnonzero(ends))


def _corners(axes: tuple[int, ...]) -> list[mi.Vector3f]:
    """Places about the middle of a cell, in cells, a quarter off it along the axes given."""
    places = [(0.0, 0.0, 0.0)]
    for a in axes:
        places = [p[: 2 - a] + (s,) + p[3 - a :] for p in places for s in (-0.25, 0.25)]
    return [mi.Vector3f(*p) for p in places]


def _sides(axis: int) -> tuple[tuple, tuple]:
    """Indices of all cells but the last, and of all but the first, along an axis."""
    before, after = [slice(None)] * 3, [slice(None)] * 3
    before[axis], after[axis] = slice(None, -1), slice(1, None)
    return tuple(before), tuple(after)


def _shifted(cloud: np.ndarray, axis: int, up: int) -> np.ndarray:
    """Whether the neighbour of a cell along an axis, up (1) or down (-1), is cloud; none is beyond the grid."""
    out = np.zeros_like(cloud)
    here, there = _sides(axis)
    if up > 0:
        out[here] = cloud[there]
    else:
        out[there] = cloud[here]
    return out


def _outward(cloud: np.ndarray, axes: tuple[int, ...]) -> dict[int, np.ndarray]:
    """|n|_2 / |n|_1 of the cloud's smoothed edge, by axis: what a stepped face counts for."""
    if len(axes) == 1:
        return {axes[0]: np.ones(cloud.shape)}
    padded = np.pad(cloud.astype(float), 2)
    inner = tuple(slice(2, -2) for _ in range(3))
    n = [np.abs(ndimage.gaussian_filter1d(ndimage.gaussian_filter(padded, 1.0), 1.0, a, 1)) for a in range(3)]
    share = np.sqrt(sum(c * c for c in n)) / np.maximum(sum(n), 1e-12)
    return dict.fromkeys(axes, np.where(share > 0, share, 1.0)[inner])
