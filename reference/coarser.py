r"""Textures and volumes at a part of their resolution, by a box filter: each new texel is the mean of what it
covers.

For n texels in steps of 1 and m new ones, with F the running sum, linear in between,

    new_i = (F(i n / m) - F((i - 1) n / m)) m / n,   m = ceil(n / factor)

along one axis after another; factor None makes m = 1. A checkerboard has only its mean. A medium of
which every volume has become one value is homogeneous.
"""

from __future__ import annotations

import math
from typing import Any

import mitsuba as mi
import numpy as np

from reference.transport import MEDIA, parts, plugin_types
from scenes.contract import BadInput

Factors = tuple[int | None, ...]
FACTORS: Factors = (None, 8, 2)
"""Texels of a side that become one, coarsest first; None: all."""


def texture_factors(description: dict) -> Factors:
    """By how much the textures of a scene may be made coarser; none where it has no texture."""
    found = plugin_types(description)
    return FACTORS if "bitmap" in found else (None,) if "checkerboard" in found else ()


def volume_factors(description: dict) -> Factors:
    """By how much the voxel grids of a scene may be made coarser; none where it has no grid."""
    return FACTORS if "gridvolume" in plugin_types(description) else ()


def box_filtered(values: np.ndarray, factor: int | None, axes: tuple[int, ...]) -> np.ndarray:
    """The array with every `factor` values along each of the axes as one, or all as one where it is None."""
    values = np.asarray(values, np.float64)
    for axis in axes:
        n = values.shape[axis]
        m = 1 if factor is None else math.ceil(n / factor)
        rows = np.moveaxis(values, axis, 0)
        running = np.concatenate([np.zeros_like(rows[:1]), np.cumsum(rows, axis=0)])
        edges = np.arange(m + 1) * n / m
        low = np.minimum(edges.astype(int), n - 1)
        share = (edges - low).reshape(-1, *[1] * (rows.ndim - 1))
        at = running[low] + share * rows[low]
        values = np.moveaxis(np.diff(at, axis=0) * (m / n), 0, axis)
    return values


def coarser_textures(description: Any, factor: int | None) -> Any:
    """The scene dictionary with bitmaps at 1 / factor of their resolution, or at their mean; a checkerboard
    keeps its squares unless factor is None."""
    if not isinstance(description, dict):
        return description
    if description.get("type") == "bitmap":
        return _bitmap(description, factor)
    if description.get("type") == "checkerboard" and factor is None:
        defaults = {"color0": 0.4, "color1": 0.2}
        return _between(*(description.get(k, v) for k, v in defaults.items()))
    return {k: coarser_textures(v, factor) for k, v in description.items()}


def _bitmap(texture: dict, factor: int | None) -> dict:
    plain = {k: v for k, v in texture.items() if k not in ("filename", "bitmap", "data")}
    if "data" in texture:
        data = np.asarray(texture["data"])
        return {**plain, "data": mi.TensorXf(box_filtered(data, factor, (0, 1)).astype(np.float32))}
    bitmap = texture["bitmap"] if "bitmap" in texture else mi.Bitmap(str(texture["filename"]))
    bitmap = mi.Bitmap(bitmap)
    if texture.get("raw", False):
        bitmap.set_srgb_gamma(False)
    linear = np.array(bitmap.convert(component_format=mi.Struct.Type.Float32, srgb_gamma=False))
    linear = linear if linear.ndim == 3 else linear[..., None]
    return {**plain, "bitmap": mi.Bitmap(box_filtered(linear, factor, (0, 1)).astype(np.float32))}


def _between(a: Any, b: Any) -> Any:
    """The mean of two colours of one form."""
    if isinstance(a, (int, float)) and isinstance(b, (int, float)):
        return (a + b) / 2
    alike = isinstance(a, dict) and isinstance(b, dict) and a.get("type") == b.get("type")
    if alike and a["type"] in ("rgb", "srgb"):
        name = "color" if "color" in a else "value"
        mean = np.mean(np.broadcast_arrays(a[name], b[name]), axis=0)
        return {**a, name: mean.tolist()}
    if alike and a["type"] == "regular" and _range(a) == _range(b):
        values = [np.array([float(x) for x in c["values"].replace(",", " ").split()]) for c in (a, b)]
        if values[0].shape == values[1].shape:
            return {**a, "values": ", ".join(f"{x:.9g}" for x in (values[0] + values[1]) / 2)}
    raise BadInput(
        "a checkerboard of two kinds of colour has no mean here: give both as numbers, rgb, srgb or regular"
    )


def _range(spectrum: dict) -> tuple:
    return spectrum["wavelength_min"], spectrum["wavelength_max"]


def coarser_volumes(description: Any, factor: int | None) -> Any:
    """The scene dictionary with grids of voxels at 1 / factor of their resolution, or at their mean."""
    if not isinstance(description, dict):
        return description
    if description.get("type") == "gridvolume":
        return _grid(description, factor)
    found = {k: coarser_volumes(v, factor) for k, v in description.items()}
    if found.get("type") not in MEDIA or factor is not None:
        return found
    uneven = any(
        p.get("type") not in (None, "constvolume") for k in ("sigma_t", "albedo") for p in parts(found.get(k))
    )
    return found if uneven else {**found, "type": "homogeneous"}


def _grid(volume: dict, factor: int | None) -> dict:
    if "data" in volume:
        grid = np.asarray(volume["data"])
    else:
        grid = np.array(volume["grid"] if "grid" in volume else mi.VolumeGrid(str(volume["filename"])))
    grid = grid if grid.ndim == 4 else grid[..., None]
    smaller = box_filtered(grid, factor, (0, 1, 2)).astype(np.float32)
    plain = {k: v for k, v in volume.items() if k not in ("filename", "grid", "data")}
    if factor is None:
        return _value(smaller.ravel())
    return {**plain, "grid": mi.VolumeGrid(np.ascontiguousarray(smaller))}


def _value(channels: np.ndarray) -> Any:
    """A number, or three of them as a colour that may exceed 1."""
    if len(channels) == 1:
        return float(channels[0])
    return {"type": "srgb", "color": channels.tolist(), "unbounded": True}
