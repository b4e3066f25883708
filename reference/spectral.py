"""A spectral scene in three channels: what RGB rendering makes of it is held against its spectral truth.

Both are linear sRGB. The spectral film weighs each of a path's four wavelengths by the observer's response
over the density that it was drawn with, so that its mean is `reference.colour`'s integral of the exact
spectrum of radiance. Channels of its pixels may be negative: colours outside sRGB, and noise.
"""

from __future__ import annotations

from dataclasses import replace

import mitsuba as mi

from reference.colour import Extinction, to_rgb
from reference.render import load_description
from reference.transport import transport
from scenes.contract import Quantity, Scene


def load_rgb(
    scene: Scene,
    quantity: Quantity,
    size: int,
    extinction: Extinction = "band",
    sampler: str | None = None,
) -> mi.Scene:
    """The scene with every spectrum as linear sRGB (`to_rgb`), and the transport that this needs.

    sampler: the name of one in the place of that which `transport` chooses.
    """
    description = to_rgb(scene.mitsuba(size), extinction)
    how = transport(description, quantity, size)
    return load_description(description, replace(how, sampler=sampler or how.sampler))
