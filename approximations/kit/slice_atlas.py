"""A volume as slices tiled on a 2D texture, with trilinear fetches put together by hand.

SIGGRAPH 2006 Course 26, 9.6 (listing) and 9.8 (figure 8): uv scaled to a tile, z moved by half a slice, a
table of the corners of slices k and k + 1, two bilinear fetches and a blend by what z is past slice k.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.kit.volume import Grid


@dataclass
class Atlas:
    """texture: the tiles. low, span: corner and edges of the volume (m). across, down: tiles. table: for each
    slice the corners of its tile and of the next one's, in texture coordinates."""

    texture: mi.Texture2f
    low: mi.Point3f
    span: mi.Vector3f
    cells: tuple[int, int, int]  # along x, y, z
    across: int
    down: int
    table: mi.Vector4f


def as_atlas(grid: Grid, values: np.ndarray, table_bits: int = 32) -> Atlas:
    """Values of a grid as tiles, row by row; the table in so many bits, 32 for float."""
    nz, ny, nx = grid.shape
    across = math.ceil(math.sqrt(nz))
    down = math.ceil(nz / across)
    k = np.arange(nz)
    tiles = np.zeros((down, ny, across, nx), np.float32)
    tiles[k // across, :, k % across] = values
    corner = np.stack([k % across / across, k // across / down])
    corners = np.concatenate([corner, np.roll(corner, -1, axis=1)])
    if table_bits < 32:
        corners = np.round(corners * (2**table_bits - 1)) / (2**table_bits - 1)
    texels = mi.TensorXf(tiles.reshape(down * ny, across * nx, 1))
    return Atlas(
        mi.Texture2f(texels, use_accel=False, wrap_mode=dr.WrapMode.Clamp),
        mi.Point3f(grid.low),
        grid.cell * mi.Vector3f(nx, ny, nz),
        (nx, ny, nz),
        across,
        down,
        mi.Vector4f(corners.astype(np.float32)),
    )


def fetch(atlas: Atlas, p: mi.Point3f, half_slice: bool = True, clamped: bool = True) -> mi.Float:
    """Trilinear value at p. Without `half_slice` slice k is taken to lie at its lower face; without `clamped`
    the outer half texel of a tile mixes with the neighbouring tile's."""
    nx, ny, nz = atlas.cells
    uvw = (p - atlas.low) / atlas.span
    border = mi.Vector2f(0.5 / nx, 0.5 / ny) if clamped else mi.Vector2f(0)
    uv = dr.clip(mi.Vector2f(uvw.x, uvw.y), border, 1 - border)
    z = dr.clip(nz * uvw.z - (0.5 if half_slice else 0.0), 0, nz - 1)
    k = mi.UInt32(z)
    at = dr.gather(mi.Vector4f, atlas.table, k)
    uv /= mi.Vector2f(atlas.across, atlas.down)
    below, above = (atlas.texture.eval(mi.Point2f(corner) + uv)[0] for corner in (at.xy, at.zw))
    return dr.lerp(below, above, z - mi.Float(k))
