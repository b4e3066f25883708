r"""Light depth from six samples in a cone and one far out, whatever the way to the sun.

GPU Pro 7, chapter II.4, end of section 4.5.2 and section 4.5.3. The march to the sun takes few samples,
strewn in a cone that opens towards the sun, so that neighbours count that a ray would miss and no bands show;
one more, three times as far as the cone is long, catches clouds that stand between. With l the unit direction
to the sun and h the step (m):

    q_i = x + (i + 1) h l + spread h i n_i,   i = 0..5,  n_i fixed, at random in [-1, 1]^3
    q_L = x + 3 (6 h) l
    d   = h sum_i sigma(q_i) + h_L sigma(q_L),   T = e^-d

Held here against the share of the sun's light that comes to x along one straight line. That is what the
depth is fed into (Beer's law); the mean over a cone of directions would be another truth, and never below
e^-(mean d).

In print, and what was done here:
- The listing adds each offset to the running position, which is a random walk: q_i wanders by
  h sum_{k <= i} k n_k and the cone is wider than said, and it turns seven times over six vectors.
  `path="printed"` keeps both; its seventh turn takes the first vector again. "cone" is as the text says.
- The step is not given: 100 m makes a cone of 600 m, whose far sample stands 1800 m out.
- No weight is given for the far sample. Alike with the others ("step", h_L = h) it stands for one step of the
  way that it is alone on; `far="interval"` lets it stand for what lies between the end of the cone and as far
  behind it again, h_L = 4 (6 h): d no longer depends on the resolution, but one sample now decides. Default:
  the sum as it stands, "step".
- Samples stand at the ends of their steps, so that the first lies a whole step away and the thin skin round x
  does not shade itself; `at="middles"` is the midpoint rule.
- The chapter reads a coarser mip level, and beyond an optical depth of 0.3 along the view ray a density
  without detail: neither is here, where the density is a grid with no detail under its voxels.
- The vectors of the chapter are not given: these are from a hash, and their mean is not zero, which turns the
  axis of the cone a little, as six vectors will.
"""

from __future__ import annotations

from typing import Annotated

import drjit as dr
import mitsuba as mi

from approximations.contract import (
    PRINTED_SLIP,
    SAMPLING,
    SPATIAL_DETAIL,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from approximations.kit.cloud_lighting import At, Far, Path, cone_depth
from scenes.contract import SUN_TRANSMITTANCE, Scene, View
from scenes.cumulus import Cumulus

EVERY_STEP = {"path": "straight", "samples": 1024, "step": 4.0, "far": "none", "at": "middles"}


@technique(
    source="GPU Pro 7, II.4, sec. 4.5.2 and 4.5.3",
    covers=("cloudscapes/14",),
    estimates=SUN_TRANSMITTANCE,
    on=(Cumulus,),
    replaces="the optical depth of the whole way to the sun",
    neglects=(SAMPLING, SPATIAL_DETAIL, PRINTED_SLIP),
    claims=(exact_when("Cumulus", 0.002, knobs=EVERY_STEP),),
    stress={"Cumulus": ("sun_elevation", "optical_depth")},
)
def cone_light(
    view: View,
    *,
    path: Path = "cone",
    samples: Annotated[int, Sweep(1, 6, 24, low=1, high=4096)] = 6,
    step: Annotated[float, Sweep(25.0, 50.0, 100.0, low=1.0, high=1000.0)] = 100.0,
    spread: Annotated[float, Sweep(0.5, 1.0, low=0.0, high=4.0)] = 1.0,
    far: Far = "step",
    at: At = "ends",
) -> mi.Float:
    """Share of the sun's light, 0 to 1, that comes unscattered to the probes, the camera's origins.

    path     of the samples: the cone of the text, the random walk of the listing, or a straight line.
    samples  in the cone, without the far one.
    step     h, m.
    spread   how far samples stray, in steps.
    far      what the far sample stands for: nothing (it is not taken), a step, or its own interval.
    at       where in its step a sample stands along the axis.
    """
    how = {"path": path, "samples": samples, "step": step, "spread": spread, "far": far, "at": at}
    return dr.exp(-view.cloud.precipitation * cone_depth(view, view.camera.origin, **how))


@cone_light.domain
def domain(scene: Scene) -> Domain:
    """One cloud under a sun that is not too low for a few hundred metres of cone (4.5.3)."""
    if scene.sun_elevation < 10:
        return Domain(False, "under a low sun the way through clouds is many times as long as the cone")
    return Domain(True)
