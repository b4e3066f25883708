"""What of the sky a surface point sees, by rays cast offline over its hemisphere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from approximations.kit.sampling import hemisphere_direction, random_turn
from scenes.contract import View


@dataclass
class VisibleSky:
    """Per point, of the visibility V(w) over the hemisphere about the normal n."""

    share: mi.Float  # mean of V, 0..1
    direction: mi.Vector3f  # mean of V w, not of unit length
    openness: mi.Float  # int V cos dw / pi, 0..1


def visible_sky(view: View, p: mi.Point3f, n: mi.Vector3f, rays: int) -> VisibleSky:
    """Cast `rays` even directions from every point p of normal n, turned at random from point to point."""
    share, direction, weighted = mean_over_visible(view, p, n, rays, lambda w: [mi.Float(1), w, dr.dot(n, w)])
    return VisibleSky(share, direction, 2 * weighted)


def mean_over_visible(
    view: View, p: mi.Point3f, n: mi.Vector3f, rays: int, of: Callable[[mi.Vector3f], list[Any]]
) -> list[Any]:
    """Means over the hemisphere about n of V(w) times each function of direction in the list `of(w)`."""
    frame, turn = mi.Frame3f(n), random_turn(dr.width(p), seed=1)
    sums = [dr.zeros(type(x), dr.width(p)) for x in of(n)]

    def cast(i, sums):
        w = frame.to_world(hemisphere_direction(i, rays, turn))
        seen = dr.select(view.visible(p, n, w), mi.Float(1), 0)
        return i + 1, [s + seen * x for s, x in zip(sums, of(w), strict=True)]

    _, sums = dr.while_loop((mi.UInt32(0), sums), lambda i, _: i < rays, cast)
    return [s / rays for s in sums]
