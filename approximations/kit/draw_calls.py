"""Fragments one draw call at a time, for stages that depend on the order of drawing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from scenes.contract import Fragments


@dataclass
class Draw:
    """The fragments of one primitive, at most one per pixel: arrays as in `Fragments`."""

    pixel: mi.UInt32
    depth: mi.Float
    distance: mi.Float64
    colour: mi.Color3f
    alpha: mi.Float


def draw_calls(fragments: Fragments) -> Iterator[Draw]:
    """The primitives in the order drawn. What one writes must be evaluated before the next is asked for."""
    start = 0
    for count in fragments.draws:
        i = dr.opaque(mi.UInt32, start) + dr.arange(mi.UInt32, count)
        yield Draw(
            dr.gather(mi.UInt32, fragments.pixel, i),
            dr.gather(mi.Float, fragments.depth, i),
            dr.gather(mi.Float64, fragments.distance, i),
            dr.gather(mi.Color3f, fragments.colour, i),
            dr.gather(mi.Float, fragments.alpha, i),
        )
        start += count
