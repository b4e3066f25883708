"""A cloud's density under a given weather, its noise worked out where it is asked for (GPU Pro 7, 4.3.4).

The steps are those of `approximations.clouds.cloud_density` at its defaults; techniques that read the weather
or the noise at places of their own share them from here.
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from approximations.kit.cloud_model import (
    curl_noise,
    detail_noise,
    octave_sum,
    profile,
    remap,
    shape_noise,
)


def covered(q: Any, h: Any, coverage: Any, type: Any) -> Any:
    """Low frequencies, 0 to 1: at places q in tiles of the first texture and shares h of the height."""
    first, *octaves = shape_noise(q)
    base = remap(first, octave_sum(*octaves) - 1, 1, 0, 1) * profile(h, type)
    return dr.maximum(base - (1 - coverage), 0)


def worn(low: Any, at: Any, h: Any, push: float, erosion: float) -> Any:
    """What the second texture leaves of them, 0 to 1: at places in its tiles, torn aside by up to `push`
    times the curl, in tiles."""
    x, y = curl_noise(at)
    torn = at + (1 - h) * push * type(at)(x, y, 0)
    detail = octave_sum(*detail_noise(torn))
    m = erosion * dr.lerp(detail, 1 - detail, dr.clip(10 * h, 0, 1))
    return dr.clip(remap(low, m, 1, 0, 1), 0, 1)
