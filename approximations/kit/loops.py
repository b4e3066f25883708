"""One kernel for many turns."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi


def repeat(count: int, body: Callable[..., tuple], *state: Any) -> tuple:
    """state after state = body(i, *state) for i = 0 ... count - 1, i a mi.UInt32. Every part of the state
    keeps its type and width."""
    ended = dr.while_loop(
        (mi.UInt32(0), *state), lambda i, *_: i < count, lambda i, *now: (i + 1, *body(i, *now))
    )
    return ended[1:]
