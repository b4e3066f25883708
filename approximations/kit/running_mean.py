"""A mean over frames kept in one buffer: a <- a (1 - 1/n) + c / n, n = 1, 2, ..., in the buffer's format.

GPU Pro 7, III.3.2.2. A change of less than half a step of the format is lost at every frame, so that coarse
buffers stop moving long before the mean is reached, and one that rounds towards zero sinks below it.
"""

from __future__ import annotations

from typing import Any, Literal

import drjit as dr
import mitsuba as mi

Format = Literal["unorm8", "unorm16", "half", "half_truncated", "float32"]
"""Integers of 8 or 16 bits over [0, 1]; floats of 16 bits, rounded to nearest or towards zero; float32."""

LEVELS = {"unorm8": 255, "unorm16": 65535}


def updated(a: Any, c: Any, n: mi.Float, format: Format) -> Any:
    """The mean of n frames from the mean of n - 1, as stored, and the frame c."""
    return stored(a * (1 - 1 / n) + c / n, format)


def stored(x: Any, format: Format) -> Any:
    """What a buffer holds of x >= 0."""
    if format == "float32":
        return x
    if format in LEVELS:
        return dr.round(dr.clip(x, 0, 1) * LEVELS[format]) / LEVELS[format]
    if format == "half":
        return type(x)(dr.float16_array_t(type(x))(x))
    bits = dr.reinterpret_array(dr.uint32_array_t(type(x)), x) & 0xFFFFE000
    return type(x)(dr.reinterpret_array(dr.float_array_t(type(bits)), bits))
