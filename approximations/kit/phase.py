"""Phase functions: the share of scattered light per solid angle, 1/sr, whose integral is 1."""

from __future__ import annotations

from typing import Any

import drjit as dr


def henyey_greenstein(cosine: Any, g: float) -> Any:
    """(1 - g^2) / (4 pi (1 + g^2 - 2 g cos)^1.5), g its mean cosine in (-1, 1).

    cosine: between the way to the light and the way from eye to sample, 1 where the eye looks into
    the light.
    """
    return dr.inv_four_pi * (1 - g * g) * dr.power(1 + g * g - 2 * g * cosine, -1.5)
