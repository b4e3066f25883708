"""Unsorted blending: the baseline that order-independent transparency is held against.

Every fragment is blended over the frame as it arrives, C <- a c + (1 - a) C. That is right only where the
sheets happen to be drawn from back to front.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from approximations.contract import DEPTH_ORDER, LINEAR_IN_LIGHT, exact_when, technique
from approximations.kit.draw_calls import draw_calls
from scenes.contract import RADIANCE, View
from scenes.glass import GlassSheets


@technique(
    source="baseline of GPU Pro 5, ch. I.1",
    estimates=RADIANCE,
    on=(GlassSheets,),
    replaces="compositing of all layers in the order of depth",
    neglects=(DEPTH_ORDER,),
    claims=(LINEAR_IN_LIGHT, exact_when("GlassSheets", 1e-5, fields={"sheets": 1})),
    stress={"GlassSheets": ("sheets", "alpha")},
    baseline=True,
)
def unsorted_blending(view: View) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel, blended in float32."""
    frame = mi.Color3f(view.fragments.background)
    for draw in draw_calls(view.fragments):
        below = dr.gather(mi.Color3f, frame, draw.pixel)
        dr.scatter(frame, dr.lerp(below, draw.colour, draw.alpha), draw.pixel)
        dr.eval(frame)
    return frame
