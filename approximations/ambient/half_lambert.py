r"""Half Lambert: a cosine that is stretched round the ball.

SIGGRAPH 2006 Course 26, section 7.4.4. A local light's cosine is mapped from [-1, 1] to [0, 1] and squared,
so that the side away from it keeps its shape:

    h = (n . l / 2 + 1 / 2)^2,   E = I / d^2 h       instead of     E = I / d^2 max(n . l, 0).

It stands for no integral: it adds what bounced light might bring. Over all normals h has the mean 1/3 where
the cosine has 1/4; the most that it adds is 1/4, where light and surface are at right angles.

In print, and what was done here:
- The source has the exponent 2 and the offset 1/2. Others stretch by w and raise to p: ((x + w) / (1 + w))^p,
  of which w = 1, p = 2 is half Lambert, p = 1 its plain form, and w = 0, p = 1 Lambert's law itself.
- Nothing is said of the added energy. `level` offers the factor that gives the mean of Lambert's law back,
  (p + 1) / (2 (1 + w)), and the one that fits it best, 0.885 for half Lambert.
- Light from behind needs a shadow of its own: the formula lets it through.
"""

from __future__ import annotations

from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import LINEAR_IN_LIGHT, NO_MODEL, Domain, Sweep, exact_when, technique
from scenes.ball_in_room import BallInRoom
from scenes.contract import DIRECT_RADIANCE, RADIANCE, Scene, View


@technique(
    source="SIGGRAPH 2006 Course 26, ch. 7.4.4",
    covers=("source-shading/06",),
    estimates=RADIANCE,
    also=(DIRECT_RADIANCE,),
    on=(BallInRoom,),
    replaces="Lambert's law for point lights, and what light the walls send back",
    neglects=(NO_MODEL,),
    claims=(
        LINEAR_IN_LIGHT,
        exact_when("BallInRoom", 1e-5, knobs={"wrap": 0.0, "exponent": 1.0}, quantity=DIRECT_RADIANCE),
    ),
    stress={"BallInRoom": ("room", "lamp_angle")},
)
def half_lambert(
    view: View,
    *,
    wrap: Annotated[float, Sweep(0, 0.5, low=0, high=1)] = 1.0,
    exponent: Annotated[float, Sweep(1, low=0.5, high=8)] = 2.0,
    level: Literal["none", "energy", "fitted"] = "none",
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel.

    wrap       how far beyond the right angle light reaches, as a cosine.
    exponent   power to which the stretched cosine is raised.
    level      factor on it: "none", the mean over the sphere of Lambert's law ("energy"), or the least
               squares fit to it ("fitted").
    """
    surface, irradiance = view.surface, mi.Color3f(0)
    factor = {"none": 1.0, "energy": energy_factor(wrap, exponent), "fitted": fitted_factor(wrap, exponent)}
    for light in view.points:
        toward = light.position - surface.position
        far = dr.norm(toward)
        stretched = (dr.dot(surface.normal, toward) / far + wrap) / (1 + wrap)
        h = dr.power(dr.maximum(stretched, 0), exponent)
        irradiance += light.intensity * (factor[level] * h / dr.square(far))
    return dr.select(surface.valid, surface.albedo * dr.inv_pi * irradiance, 0)


def energy_factor(w: float, p: float) -> float:
    """Mean of max(x, 0) over the sphere, 1/4, over the mean of the stretched cosine."""
    return (p + 1) / (2 * (1 + w))


def fitted_factor(w: float, p: float) -> float:
    """int max(x, 0) h dx / int h^2 dx over x = n . l, with u = (x + w) / (1 + w) and h = u^p."""
    from_dark = w / (1 + w)
    shared = (1 - from_dark ** (p + 2)) / (p + 2) - from_dark * (1 - from_dark ** (p + 1)) / (p + 1)
    return (1 + w) * shared * (2 * p + 1)


@half_lambert.domain
def domain(scene: Scene) -> Domain:
    """Models in rooms that send light back; declared as a matter of looks (7.4.4)."""
    if scene.room < 0.1:
        return Domain(False, "no light comes back from around: the dark side is dark")
    if scene.lamp_angle > 120:
        return Domain(False, "the lamp stands behind the model, whose shadow the formula lets light through")
    return Domain(True)
