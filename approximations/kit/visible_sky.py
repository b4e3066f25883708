"""What of the sky a surface point sees, by rays cast offline over its hemisphere."""

from __future__ import annotations

from dataclasses import dataclass

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
    frame, turn = mi.Frame3f(n), random_turn(dr.width(p), seed=1)
    zero = dr.zeros(mi.Float, dr.width(p))

    def cast(i, count, total, weighted):
        local = hemisphere_direction(i, rays, turn)
        w = frame.to_world(local)
        seen = dr.select(view.visible(p, n, w), mi.Float(1), 0)
        return i + 1, count + seen, total + seen * w, weighted + seen * local.z

    state = (mi.UInt32(0), zero, dr.zeros(mi.Vector3f, dr.width(p)), zero)
    _, count, total, weighted = dr.while_loop(state, lambda i, *_: i < rays, cast)
    return VisibleSky(count / rays, total / rays, 2 * weighted / rays)
