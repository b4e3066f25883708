"""RGB rendering of spectral scenes, measured as a technique against their spectral truth.

It is a reference renderer with its spectra cut to three channels, so it sees more than a technique may and
is declared here instead of among `approximations`. Its image is a mean of independent frames: the errors are
those of the limit that they have, freed of their noise, which is reported apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Annotated, Any

import mitsuba as mi
import numpy as np

from approximations.contract import SPECTRUM, Sweep, Technique
from compare.stochastic import frame_seeds
from reference.colour import Extinction
from reference.moments import from_batches, join
from reference.render import to_array
from reference.spectral import load_rgb
from reference.truth import Truth
from scenes.contract import RADIANCE, Quantity, Scene, all_scenes

FRAMES, MOST_FRAMES = 4, 256
"""Independent frames behind an image, even numbers."""
SAMPLER = "independent"
"""At few samples a pixel `multijitter` is biased, since its permutations of few strata are not independent:
at 4 by -0.9 % in a grey room and by +1.3 % in grey air."""
SHOWN_NOISE = 0.1
"""Pixel noise of an image whose figures are shown or judged, where MOST_FRAMES suffice for it."""
COLOURLESS = {"ground"}
"""Axes of spectral scenes along which no colour changes."""


class Rendering(Technique):
    """A renderer that is measured as a technique."""

    theme = "colour"


def rgb_rendering(
    scene: Scene,
    quantity: Quantity,
    size: int,
    *,
    extinction: Extinction = "band",
    spp: Annotated[int, Sweep(low=1, high=1024)] = 4,
) -> Callable[[int], Any]:
    """seed -> a frame (size, size, 3) in linear sRGB, W m^-2 sr^-1, of the scene in three channels.

    Every spectrum becomes one linear sRGB value (`reference.colour`), and products of spectra products of
    channels: exact for one interaction of white light with an unclipped colour, worse with each further one.
    extinction: the rule for participating media. spp: samples a pixel of a frame.
    """
    loaded = load_rgb(scene, quantity, size, extinction, SAMPLER)
    return lambda seed: mi.render(loaded, spp=spp, seed=seed)


@cache
def declared() -> Rendering:
    """RGB rendering on every spectral scene, stressed along the axes that change its colours."""
    scenes = tuple(s for s in all_scenes().values() if s.spectral)
    return Rendering(
        rgb_rendering,
        source="C. F. Borges, Trichromatic approximation for computer graphics illumination models, "
        "SIGGRAPH 1991",
        covers=(),
        estimates=RADIANCE,
        on=scenes,
        replaces="spectral rendering",
        neglects=(SPECTRUM,),
        stress={s.__name__: tuple(a for a in s.axes() if a not in COLOURLESS) for s in scenes},
    )


def sampled(draw: Callable[[int], Any], seed: int, noise: float = math.inf) -> Truth:
    """The mean of FRAMES frames draw(seed), or of as many as the pixel noise takes, with its variance."""
    seeds = frame_seeds(seed)

    def batches() -> Truth:
        return from_batches(np.stack([to_array(draw(next(seeds))) for _ in range(FRAMES)]))

    estimate = batches()
    while estimate.pixel_noise > noise and estimate.batches < MOST_FRAMES:
        estimate = join(estimate, batches())
    return estimate
