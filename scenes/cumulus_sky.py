"""The cumulus without its sun: what the sky and the ground send into it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from scenes.contract import SOURCE_FUNCTION, scene
from scenes.cumulus import Cumulus


@scene(
    theme="clouds",
    shows="one fair-weather cloud in the light of the sky and the ground alone",
    quantities=(SOURCE_FUNCTION,),
    exposure=(0.0, 4.0),
)
@dataclass(frozen=True)
class CumulusUnderSky(Cumulus):
    """Blue light from above and grey from below meet a cloud that scatters both forwards."""

    lit_by: Literal["sun", "sky", "both"] = "sky"
