"""The march of a view ray through cloud: cheap samples between clouds, full ones in them, and compositing.

GPU Pro 7, II.4, sections 4.5.1 and 4.5.2. A march looks for cloud with a cheap sampler; where that meets any,
the same place is sampled in full, and so is what follows until so many full samples in a row were empty.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import drjit as dr
import mitsuba as mi

from scenes.contract import Camera

Sampler = Callable[[mi.Point3f, mi.Bool], mi.Float]
"""(points in m, active) -> extinction, 1/m."""
Rule = Literal["literal", "beer", "beer entering", "energy-conserving"]


@dataclass(frozen=True)
class Marched:
    """What a ray gathered (W m^-2 sr^-1), the share of light from behind that is left, and how many steps
    it came; fewer than there are where it was cut short."""

    gathered: mi.Color3f
    through: mi.Float
    came: mi.UInt32


def adaptive_march(
    camera: Camera,
    span: tuple[mi.Float, mi.Float],
    steps: int,
    full: Sampler,
    *,
    cheap: Sampler | None = None,
    source: Callable[[mi.Point3f, mi.Bool], mi.Color3f] | None = None,
    rule: Rule = "energy-conserving",
    k: float = 1.0,
    turns: int | None = None,
    zeros: int = 6,
    in_a_row: bool = True,
    stride: int = 1,
    step_back: bool = False,
    cut: float = 0.0,
    start: mi.Float | float = 0.5,
) -> Marched:
    """March the camera's rays through their span (near and far distance, m) in equal steps.

    full       extinction in all detail; `cheap`: where it is 0 nothing is looked for; None: always in full.
    source     radiance that a point sends to the eye, asked for where there is cloud; None: nothing shines.
    rule, k    as in `composite`.
    turns      of the loop, of which a change of sampler takes one; None: as many as steps.
    zeros      full samples without cloud that end a stretch of them; `in_a_row`: cloud in between starts
               the count afresh.
    stride     steps that a cheap sample without cloud skips; `step_back`: after a hit, back to the first
               place that was skipped.
    cut        the march ends where less than this is let through.
    start      where in its step a sample stands, 0 to 1.
    """
    near, far = span
    ds = (far - near) / steps
    n = dr.width(ds)
    most = steps if turns is None else turns

    def turn(i, at, looking, skipped, empty, through, gathered):
        x = camera.origin + (near + (mi.Float(at) + start) * ds) * camera.direction
        hit = looking & (cheap(x, looking) > 0) if cheap else mi.Bool(looking)
        missed = looking & ~hit
        sampled = ~looking
        sigma = dr.select(sampled, full(x, sampled), 0)
        cloud = sigma > 0
        met = sampled & ~cloud
        empty = dr.select(met, empty + 1, dr.select(cloud & in_a_row, 0, empty))
        given_up = met & (empty == zeros) if cheap else mi.Bool(False)
        lit = source(x, cloud) if source else mi.Color3f(0)
        through, gathered = composite(rule, through, gathered, sigma, ds, k, dr.select(cloud, lit, 0))
        forth = dr.select(missed, stride, dr.select(sampled & ~given_up, 1, 0))
        back = dr.select(hit & skipped & step_back, stride - 1, 0)
        looking = missed | given_up
        return i + 1, at + forth - back, looking, missed, dr.select(given_up, 0, empty), through, gathered

    state = (
        mi.UInt32(0),
        dr.zeros(mi.UInt32, n),
        dr.full(mi.Bool, cheap is not None, n),
        dr.full(mi.Bool, False, n),
        dr.zeros(mi.UInt32, n),
        dr.ones(mi.Float, n),
        dr.zeros(mi.Color3f, n),
    )

    def going(i, at, looking, skipped, empty, through, gathered):
        return (i < most) & (at < steps) & (through > cut) & (ds > 0)

    _, at, *_, through, gathered = dr.while_loop(state, going, turn)
    return Marched(gathered, through, at)


def composite(
    rule: str,
    through: mi.Float,
    gathered: mi.Color3f,
    sigma: mi.Float,
    ds: mi.Float,
    k: float,
    lit: mi.Color3f,
) -> tuple[mi.Float, mi.Color3f]:
    """What is let through and what is gathered after a step of ds (m) in cloud of extinction sigma (1/m)
    where samples send the radiance `lit` to the eye.

    "literal"            L += T lit, T -= sigma / k: densities are summed, k (1/m) being that of density 1.
    "beer"               with a = sigma ds: T *= e^-a, L += T lit a.
    "beer entering"      L += T lit a, T *= e^-a.
    "energy-conserving"  L += T lit (1 - e^-a), T *= e^-a: exact where sigma and lit are even.
    """
    a = sigma * ds
    after = dr.maximum(through - sigma / k, 0) if rule == "literal" else through * dr.exp(-a)
    weight = {
        "literal": lambda: through,
        "beer": lambda: after * a,
        "beer entering": lambda: through * a,
        "energy-conserving": lambda: through - after,
    }[rule]()
    return after, gathered + weight * lit
