r"""Visibility of a horizontal light past the straight edge of a horizontal sheet, in float64.

Light point (l_x, l_y, H), ground point (x, y, 0), sheet z = h for x' < 0. The ray between them crosses the
sheet's plane at x' = x + (l_x - x) h / H, so that the point sees what of the light lies beyond

    l_x > -x (H - h) / h.

Points of the sheet's upper side see all of it.
"""

from __future__ import annotations

import numpy as np

from reference.closed_form.caps import half_plane_share
from reference.surface_monte_carlo import eye_rays
from reference.truth import closed_form
from scenes.contract import LIGHT_VISIBILITY
from scenes.shadow_casters import HalfPlane


@closed_form(HalfPlane, LIGHT_VISIBILITY)
def visibility(scene: HalfPlane, size: int) -> np.ndarray:
    """(size, size, 1): share of the light's surface, 0 to 1."""
    h, full = scene.height, scene.LIGHT
    o, w = eye_rays(scene.sensor(size), size)
    on_sheet = (o + (h - o[2]) / w[2] * w)[0] < 0
    x = (o - o[2] / w[2] * w)[0]
    beyond = 0.5 + 0.5 * x * (full - h) / (h * scene.light_size)  # of the light's width
    beyond = np.clip(beyond, 0, 1)
    share = half_plane_share(beyond) if scene.light_shape == "disk" else beyond
    return np.where(on_sheet, 1.0, share).reshape(size, size, 1)
