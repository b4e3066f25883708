r"""Light maps: values at luxels, the points of an even grid over every chart, looked up bilinearly.

A chart with edges |u| x |v| has ceil(|u| / luxel) x ceil(|v| / luxel) luxels; luxel (i, j) of m x n stands at
s = (i + 1/2) / m, t = (j + 1/2) / n. Beyond the outermost luxels a lookup is clamped.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.kit.gathered_light import meets
from scenes.contract import Chart, View
from scenes.mitsuba_parts import chart_index


@dataclass
class Atlas:
    """The charts' frames (corner in m, unit u and v, edges in m), their grids, where in the list of all
    luxels each one's begin, and their reflectances."""

    corner: mi.Point3f
    u: mi.Vector3f
    v: mi.Vector3f
    edges: mi.Vector2f
    columns: mi.UInt32
    rows: mi.UInt32
    first: mi.UInt32
    albedo: mi.Color3f
    luxels: int

    def frame(self, chart: mi.UInt32) -> mi.Frame3f:
        """Tangent frame of the chart of each point: s along u, t along v, n its lit side."""
        u, v = dr.gather(mi.Vector3f, self.u, chart), dr.gather(mi.Vector3f, self.v, chart)
        return mi.Frame3f(u, v, dr.cross(u, v))


@dataclass
class Place:
    """Four luxels round each point, and where between them it stands."""

    corners: tuple[mi.UInt32, mi.UInt32, mi.UInt32, mi.UInt32]
    s: mi.Float
    t: mi.Float

    def fetch(self, values: Any) -> Any:
        """A map (mi.Float or mi.Color3f, one value a luxel) at each point."""
        a, b, c, d = (dr.gather(type(values), values, k) for k in self.corners)
        return dr.lerp(dr.lerp(a, b, self.s), dr.lerp(c, d, self.s), self.t)


def atlas(charts: tuple[Chart, ...], luxel: float) -> Atlas:
    """Grids of luxels at most `luxel` (m) apart on all charts."""
    u, v = (np.array([getattr(c, e) for c in charts], float) for e in "uv")
    edges = np.stack([np.linalg.norm(u, axis=1), np.linalg.norm(v, axis=1)])
    columns, rows = (np.ceil(edges / luxel).astype(np.uint32).clip(1) for edges in edges)
    first = np.cumsum(columns * rows) - columns * rows
    return Atlas(
        mi.Point3f(np.array([c.corner for c in charts], np.float32).T.copy()),
        mi.Vector3f((u / edges[0][:, None]).astype(np.float32).T.copy()),
        mi.Vector3f((v / edges[1][:, None]).astype(np.float32).T.copy()),
        mi.Vector2f(edges.astype(np.float32)),
        mi.UInt32(columns),
        mi.UInt32(rows),
        mi.UInt32(first.astype(np.uint32)),
        mi.Color3f(np.array([np.ones(3) * c.albedo for c in charts], np.float32).T.copy()),
        int((columns * rows).sum()),
    )


def luxels(grid: Atlas) -> tuple[mi.Point3f, mi.UInt32]:
    """Point (m) and chart of every luxel."""
    grids = list(zip(np.array(grid.columns), np.array(grid.rows), strict=True))
    s = np.concatenate([np.tile((np.arange(m) + 0.5) / m, n) for m, n in grids])
    t = np.concatenate([np.repeat((np.arange(n) + 0.5) / n, m) for m, n in grids])
    chart = mi.UInt32(np.repeat(np.arange(len(grids), dtype=np.uint32), [m * n for m, n in grids]))
    edges, frame = dr.gather(mi.Vector2f, grid.edges, chart), grid.frame(chart)
    offset = mi.Float(s) * edges.x * frame.s + mi.Float(t) * edges.y * frame.t
    return mi.Point3f(dr.gather(mi.Point3f, grid.corner, chart) + offset), chart


def place(grid: Atlas, p: mi.Point3f, chart: mi.UInt32) -> Place:
    """The luxels round points p of charts."""
    m, n, first = (dr.gather(mi.UInt32, x, chart) for x in (grid.columns, grid.rows, grid.first))
    local = grid.frame(chart).to_local(p - dr.gather(mi.Point3f, grid.corner, chart))
    at = mi.Point2f(local.x, local.y) / dr.gather(mi.Vector2f, grid.edges, chart)
    last_i, last_j = m - 1, n - 1
    x = dr.clip(at.x * mi.Float(m) - 0.5, 0, mi.Float(last_i))
    y = dr.clip(at.y * mi.Float(n) - 0.5, 0, mi.Float(last_j))
    i, j = mi.UInt32(x), mi.UInt32(y)
    right, up = dr.minimum(i + 1, last_i), dr.minimum(j + 1, last_j)
    corners = (first + j * m + i, first + j * m + right, first + up * m + i, first + up * m + right)
    return Place(corners, x - mi.Float(i), y - mi.Float(j))


def seen_along(view: View, grid: Atlas, irradiance: mi.Color3f, p: mi.Point3f, w: mi.Vector3f) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) that arrives at points p from unit directions w in a world that is lit by its
    light map: a light, or albedo / pi E of the surface that a ray meets."""
    far = view.trace(p, w)
    hits = dr.isfinite(far)
    hit = mi.Point3f(p + dr.select(hits, far, 0) * w)
    chart = chart_index(hit, view.charts)
    met = dr.inv_pi * dr.gather(mi.Color3f, grid.albedo, chart) * place(grid, hit, chart).fetch(irradiance)
    met = dr.select(hits, met, 0)
    for light in view.lights:
        met = dr.select(meets(view, light, p, w), mi.Color3f(light.radiance), met)
    return met
