"""Light of clouds that techniques share: the curve over the light depth, and the depth by a cone of samples.

GPU Pro 7, II.4, sections 4.4 and 4.5.
"""

from __future__ import annotations

from typing import Literal

import drjit as dr
import mitsuba as mi

from scenes.contract import View

FAR = 3.0  # lengths of the cone at which the far sample stands
INTERVAL = 4.0  # lengths of the cone that it stands for: from 1 to 5
Path = Literal["cone", "printed", "straight"]
Far = Literal["none", "step", "interval"]
At = Literal["ends", "middles"]


def light_energy(d: mi.Float, p: float, energy: str, rain_in: str = "beer") -> mi.Float:
    """E(d) over the light depth d with the rain gain p (4.4.2, 4.4.4, 4.4.5).

    energy: "beer" e^-(d p), "powder" 1 - e^(-2 d), or "beer_powder", twice their product; rain_in: whether
    p multiplies d in Beer's factor only or in "both".
    """
    beer = dr.exp(-d * p)
    powder = 1 - dr.exp(-2 * d * (p if rain_in == "both" else 1))
    return {"beer": beer, "powder": powder, "beer_powder": 2 * beer * powder}[energy]


def cone_depth(
    view: View,
    x: mi.Point3f,
    active: mi.Bool | bool = True,
    *,
    path: Path = "cone",
    samples: int = 6,
    step: float = 100.0,
    spread: float = 1.0,
    far: Far = "step",
    at: At = "ends",
) -> mi.Float:
    """Optical depth from points x (m) towards the sun, without rain, by samples strewn in a cone and one far
    out (4.5.2, 4.5.3); 0 where not active.

    path     of the samples: the cone of the text, the random walk of the listing, or a straight line.
    samples  in the cone, without the far one; `step`: apart (m); `spread`: how far they stray, in steps.
    far      what the far sample stands for: nothing (it is not taken), a step, or its own interval.
    at       where in its step a sample stands along the axis.
    """
    cloud, l = view.cloud, view.sun.direction
    turns = samples + 1 if path == "printed" else samples
    width = 0.0 if path == "straight" else spread * step
    first = 1.0 if at == "ends" else 0.5

    def march(i, strayed, total):
        off = width * mi.Float(i) * cone_vector(i, samples)
        strayed = strayed + off if path == "printed" else off
        q = x + (mi.Float(i) + first) * step * l + strayed
        return i + 1, strayed, total + cloud.extinction(q)

    n = dr.width(x)
    start = (mi.UInt32(0), dr.zeros(mi.Vector3f, n), dr.zeros(mi.Float, n))
    _, _, total = dr.while_loop(start, lambda i, strayed, total: active & (i < turns), march)
    if far != "none":
        weight = 1.0 if far == "step" else INTERVAL * samples
        total += dr.select(active, weight * cloud.extinction(x + FAR * samples * step * l), 0)
    return step * total


def cone_vector(i: mi.UInt32, samples: int) -> mi.Vector3f:
    """The i-th of the fixed vectors, in [-1, 1]^3; after the last comes the first again."""
    a, b = mi.sample_tea_32(i % samples, 0)
    c, _ = mi.sample_tea_32(i % samples, 1)
    return mi.Vector3f(*(mi.Float(k >> 8) / (1 << 23) - 1 for k in (a, b, c)))
