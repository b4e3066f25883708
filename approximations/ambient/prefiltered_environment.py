r"""Reflections of a probe: a cube map filtered ahead level by level, and a Fresnel term that knows roughness.

GPU Pro 7, part IV, chapter 2, section 2.3.3. The light that a surface reflects towards v,

    L(v) = int L(l) D F G / (4 n.l n.v) n.l dl,

is taken to be a lobe about the mirrored direction times a reflectance:

    level = mips roughness,   r = 2 (n.v) n - v,
    F     = F0 + (max(1 - roughness, F0) - F0) (1 - n.v)^5,      L = cube(r, level) F.

Offline, level k holds the environment averaged by the lobe of the roughness k / (mips - 1), about every
direction as if n = v = r. So the stretch of a lobe at grazing angles is lost, and with it the masking G: a
rough white metal reflects all (1 where single scattering has 0.31 at roughness 1), a rough dielectric seen
from the front three times too much (0.040 for 0.012).

In print, and what was done here:
- "8 mips" with the factor 8.0 asks for levels 0 to 8, of which there are 0 to 7: every lookup is up to one
  level too rough. `level="mended"` takes (mips - 1) roughness.
- The lobe is that of a modified cube map tool, whose filters are powers of a cosine; the BRDF is GGX. Here
  the power is the one that fits GGX's width a = roughness^2, e = (1 / a^2 - 1) / 2; `lobe` offers GGX itself.
  A power has no tails, and a level too rough makes up for some of them: mended, the image is further off.
- The maps are stored as RGBM, which is left out here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi

from approximations.contract import FRESNEL, SHAPE_OF_LOBE, Domain, Sweep, exact_when, technique
from approximations.kit.cube_map import CubeMap, cube_map, environment_map, lookup, texel_directions
from approximations.kit.sampling import GOLDEN_ANGLE
from scenes.contract import RADIANCE, Scene, View
from scenes.environment_ball import GlossyBall

MIPS = 8


@technique(
    source="GPU Pro 7, part IV, ch. 2.3.3",
    covers=("mobile-pbr/06",),
    estimates=RADIANCE,
    on=(GlossyBall,),
    replaces="reflection of a distant environment by a GGX surface",
    neglects=(SHAPE_OF_LOBE, FRESNEL),
    claims=(exact_when("GlossyBall", 0.03, fields={"roughness": 0.0}),),
    stress={"GlossyBall": ("roughness", "f0")},
)
def prefiltered_environment(
    view: View,
    probe: CubeMap,
    *,
    level: Literal["printed", "mended"] = "printed",
    fresnel: Literal["rough", "schlick"] = "rough",
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel.

    level     roughness to level: "printed", mips times it, or "mended", (mips - 1) times it.
    fresnel   the term above, or Schlick's, which a rough surface keeps at grazing angles.
    """
    surface, v = view.surface, -view.camera.direction
    roughness, f0 = dr.sqrt(surface.alpha), surface.specular
    nv = dr.clip(dr.dot(surface.normal, v), 0, 1)
    light = lookup(probe, mirrored(surface.normal, v), roughness * (MIPS if level == "printed" else MIPS - 1))
    edge = dr.maximum(1 - roughness, f0) if fresnel == "rough" else mi.Color3f(1)
    reflectance = dr.lerp(f0, edge, dr.power(1 - nv, 5))
    return dr.select(surface.valid, light * reflectance, view.environment(view.camera.direction))


def mirrored(n: mi.Vector3f, v: mi.Vector3f) -> mi.Vector3f:
    """v mirrored at n."""
    return 2 * dr.dot(n, v) * n - v


@prefiltered_environment.bake
def bake(
    view: View,
    *,
    lobe: Literal["cosine power", "GGX"] = "cosine power",
    samples: Annotated[int, Sweep(32, low=1, high=65536)] = 256,
) -> CubeMap:
    """The environment filtered for 8 levels of 128^2 texels a face and less, `samples` directions a texel."""
    sizes = [2**k for k in reversed(range(MIPS))]
    levels = [environment_map(sizes[0], view.environment, samples=2)]
    for k, n in list(enumerate(sizes))[1:]:
        a = (k / (MIPS - 1)) ** 2
        levels.append(filtered(view.environment, texel_directions(n)[0], a, lobe, samples))
        dr.eval(levels)
    return cube_map(levels)


def filtered(
    radiance: Callable[[mi.Vector3f], mi.Color3f], r: mi.Vector3f, a: float, lobe: str, samples: int
) -> mi.Color3f:
    """Mean radiance about the directions r, weighted by a lobe of GGX width a seen along its axis."""
    frame = mi.Frame3f(r)
    total, weights, i = dr.zeros(mi.Color3f, dr.width(r)), dr.zeros(mi.Float, dr.width(r)), mi.UInt32(0)
    a = dr.opaque(mi.Float, a)

    def add(i, total, weights):
        u, phi = (mi.Float(i) + 0.5) / samples, mi.Float(i) * GOLDEN_ANGLE
        if lobe == "GGX":  # half vectors by D n.h, mirrored; weight n.l
            h2 = (1 - u) / (1 - u * (1 - a * a))
            c = dr.maximum(2 * h2 - 1, 0)
            weight = c
        else:
            c = dr.power(u, 2 * a * a / (a * a + 1))
            weight = mi.Float(1)
        s = dr.sqrt(1 - c * c)
        w = frame.to_world(mi.Vector3f(s * dr.cos(phi), s * dr.sin(phi), c))
        return i + 1, total + weight * radiance(w), weights + weight

    _, total, weights = dr.while_loop((i, total, weights), lambda i, t, w: i < samples, add)
    return total / weights


@prefiltered_environment.domain
def domain(scene: Scene) -> Domain:
    """Smooth surfaces, for which the lobe is narrow and masking rare."""
    if scene.roughness > 0.7:
        return Domain(False, "a rough surface masks much of what it reflects")
    return Domain(True)
