r"""The light curve of a cloud: how much of the light of all orders a function of one light depth can give.

GPU Pro 7, chapter II.4, section 4.4.4, offers 2 e^-d (1 - e^(-2 d)) as a thought experiment and leaves it to
others to fit such a curve to computed clouds. Here that is done, for the peer to compare with, by

    S(x, w) = E_sun f(d) phase(cos)

d        optical depth from x towards the sun, with rain, by LIGHT_STEPS even steps
f        printed   2 e^-d (1 - e^(-2 d)), slope 4 at 0, at most 4 / (3 sqrt 3) = 0.770 at d = ln(3) / 2
         fitted    a e^(-k d) (1 - e^(-b d)): the best a, b and k
         oracle    straight between KNOTS values of log d: but for its knots, the best function of d that is
phase    Henyey-Greenstein of g = 0.2, or of the cloud's own g

Best is least squares of S itself, which weighs a bright point more than a dark one, so that the oracle tends
to <S phase> / <phase^2> over all points of one depth, and not to the mean of S / phase. What it leaves is
what no function of d alone can take away. The curves are fitted to the source function of `CloudSlab` or of
`Cumulus` with their default fields by `tools/fit_light_curves.py`, which keeps them in `kit/light_curves.npz`
and prints:

                                    CloudSlab           Cumulus
    phase                           0.2     own         0.2     own
    printed                         2.07    1.45        0.87    1.12
    printed, with the best gain     1.89    1.40        0.72    0.73
    fitted                          1.76    0.77        0.43    0.41
    oracle                          1.76    0.77        0.41    0.38
    a                               4.41    0.987       1.56    10.9
    b                               235     (1000)      5.16    3.76
    k                               0.058   0.584       0.114   0.098
    f(d) h(cos), h free as well     0.48                0.27
    octaves, b = 0.5                0.68                0.70
    octaves, b = 0.7                0.53                0.66
    a constant                      1.88                0.60

(root mean square error over the mean of S, the noise of the truth taken off)

- In the layer all points of one depth are alike, and a function of depth and angle would be exact: what the
  oracle leaves is owed to the lobe. The peak of light scattered once or a few times is most of the error,
  so that with the broad lobe no curve is worth much more than a constant, and with the cloud's own the
  curve is that of the peak, which ends within two mean free paths. No one lobe can follow light that
  forgets where it came from; even the best leaves 0.48. Octaves, each with its own lobe and reach, come
  near to that.
- The heap of clouds is seen from the side, where any lobe is flat: depth decides. Half of what print is
  wrong by is owed to its constants, and 0.4 stays for any function of depth: points of one depth get light
  of the next orders from thick and thin surroundings. (That a free h takes a third off it says where in the
  picture a point is rather than at what angle.) Octaves with the usual constants lose to a fitted curve.
- With the broad lobe the extinction that fits is 0.06 to 0.11 of the cloud's, near to the 1 - g = 0.15 of
  the similar cloud that scatters evenly; in print it is all of it. In the layer b is without bound: no dark
  skin is found where no light is lost sideways. In the heaps the skin is 1 / b, a fifth to a quarter of a
  mean free path deep, half of what is printed: it is there, but the oracle's lit side has two thirds of the
  most that it reaches.
- A curve fitted to one cloud is no law. The layer's, with the broad lobe, makes the heaps 3.6 times as
  bright as they are, since they lose most of their light sideways; the heaps' own leaves the layer 77 % too
  dark.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.contract import (
    LINEAR_IN_LIGHT,
    MULTIPLE_SCATTERING,
    PHASE_FUNCTION,
    SAMPLING,
    Domain,
    technique,
)
from approximations.kit.cloud_march import light_depth
from approximations.kit.phase import henyey_greenstein
from scenes.cloud import CloudSlab
from scenes.contract import SOURCE_FUNCTION, Scene, View
from scenes.cumulus import Cumulus

TABLE = Path(__file__).parents[1] / "kit/light_curves.npz"
PRINTED = (2.0, 2.0, 1.0)  # gain a, inner factor b, extinction scale k
BROAD = 0.2  # mean cosine of the printed lobe
LIGHT_STEPS = 64
KNOTS, FIRST, LAST = 25, 0.01, 40.0  # of the oracle, even in the logarithm of the depth


class Curve(NamedTuple):
    """What was fitted to one cloud with one lobe: a, b and k; the oracle's values at its knots."""

    constants: tuple[float, float, float]
    values: mi.Texture1f


@technique(
    source="peer: fits of the curve of GPU Pro 7, II.4, sec. 4.4.4, to computed clouds",
    estimates=SOURCE_FUNCTION,
    on=(CloudSlab, Cumulus),
    replaces="the source function of all orders of scattering",
    neglects=(MULTIPLE_SCATTERING, PHASE_FUNCTION, SAMPLING),
    claims=(LINEAR_IN_LIGHT,),
    stress={"CloudSlab": ("optical_depth", "sun_elevation")},
    baseline=True,
)
def light_curve(
    view: View,
    curves: dict[str, Curve],
    *,
    constants: Literal["printed", "fitted", "oracle"] = "fitted",
    fitted_to: Literal["slab", "cumulus"] = "slab",
    phase: Literal["hg", "exact"] = "hg",
) -> mi.Color3f:
    """Source function (W m^-2 sr^-1) at the probes: the camera's origins are points in the cloud, its
    directions run from eye to sample.

    constants  which f(d).
    fitted_to  the cloud that "fitted" and "oracle" know.
    phase      of mean cosine 0.2, or "exact": of the cloud's own.
    """
    depth = view.cloud.precipitation * light_depth(view, view.camera.origin, LIGHT_STEPS)
    cosine = dr.dot(view.camera.direction, view.sun.direction)
    lobe = henyey_greenstein(cosine, view.cloud.g if phase == "exact" else BROAD)
    curve = curves[f"{fitted_to} {phase}"]
    if constants == "oracle":
        f = _between_knots(curve.values, depth)
    else:
        a, b, k = PRINTED if constants == "printed" else curve.constants
        f = a * dr.exp(-k * depth) * (1 - dr.exp(-b * depth))
    return mi.Color3f(view.sun.irradiance * f * lobe)


@light_curve.bake
def bake() -> dict[str, Curve]:
    """The fits kept in TABLE, by cloud and lobe."""

    def texture(values: np.ndarray) -> mi.Texture1f:
        return mi.Texture1f(mi.TensorXf(values[:, None]), use_accel=False, wrap_mode=dr.WrapMode.Clamp)

    return {name: Curve(tuple(map(float, x[:3])), texture(x[3:])) for name, x in np.load(TABLE).items()}


@light_curve.domain
def domain(scene: Scene) -> Domain:
    """Thick water clouds in sunlight, as those that the curves were fitted to."""
    if scene.albedo < 0.99 or not 0.7 <= scene.g <= 0.9:
        return Domain(
            False, "not a cloud of water droplets, which absorb next to nothing and scatter forwards"
        )
    if scene.optical_depth < 4:
        return Domain(False, "a thin veil: the curve takes its light depth for the inside of a cloud")
    if isinstance(scene, Cumulus) and scene.lit_by != "sun":
        return Domain(False, "the light of the sky, for which the curve has no term")
    if scene.sun_elevation < 10:
        return Domain(False, "under a low sun the light's way through a cloud is many times its thickness")
    return Domain(True)


def _between_knots(values: mi.Texture1f, depth: mi.Float) -> mi.Float:
    """The oracle at a depth, level beyond its first and last knots."""
    share = dr.log(dr.maximum(depth, FIRST) / FIRST) / np.log(LAST / FIRST)
    return values.eval((share * (KNOTS - 1) + 0.5) / KNOTS)[0]
