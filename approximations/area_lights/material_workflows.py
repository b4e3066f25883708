r"""Metal and non-metal in one texture: metallicness against specular colour.

GPU Pro 7, part IV, chapter 2, section 2.2. A surface has a diffuse layer and a specular one,

    L = albedo E / pi + F0 L(r),

E the irradiance and L(r) the light from the mirrored direction (the lobe is taken to be a mirror here).
Metals have no albedo, all insulators about the same F0. Two ways to store that:

    specular      albedo, F0                                    two colours, 48 bits
    metallic      base, m: albedo = base (1 - m),               a colour and a mask, 32 bits
                  F0 = (1 - m) F0_insulator + m base

The texture unit filters what is stored. The first pair enters L linearly, so that a filtered texel is the
average of what its parts reflect. In the second, colour and mask are multiplied after filtering: where a
share t of a texel is metal of colour g and the rest stone of colour s, the result differs from that by

    t (1 - t) (g - s) (E / pi - L(r)),

a halo that is brighter than both or duller, greatest in the middle of a border, none where diffuse and
mirrored light are the same.

In print, and what was done here:
- The halo is to be mended by a mask that is made smaller or larger near borders, by how much is not said:
  `grow`. That moves the border instead.
- F0 of insulators is "the same constant": 0.04, which here is the stone's own value.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion

from approximations.contract import (
    FILTERED_PARAMETERS,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from approximations.kit.cube_map import texel_directions
from scenes.contract import RADIANCE, Scene, View
from scenes.material_border import MaterialBorder


@dataclass
class Textures:
    """A level of each map, read bilinearly: base colour and mask, and the share of metal before the mask was
    changed; and the irradiance of the surface (W m^-2)."""

    base: mi.Texture2f
    mask: mi.Texture2f
    share: mi.Texture2f
    irradiance: mi.Color3f


@technique(
    source="GPU Pro 7, part IV, ch. 2.2",
    covers=("mobile-pbr/01",),
    estimates=RADIANCE,
    on=(MaterialBorder,),
    replaces="average of what metal and stone within a texel reflect",
    neglects=(FILTERED_PARAMETERS,),
    claims=(exact_when("MaterialBorder", 2e-3, knobs={"workflow": "specular"}),),
    stress={"MaterialBorder": ("contrast", "turn")},
)
def material_workflows(
    view: View,
    maps: Textures,
    *,
    workflow: Literal["metallic", "specular", "exact"] = "metallic",
    insulator: Annotated[float, Sweep(0.02, 0.08, low=0, high=1)] = 0.04,
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel.

    workflow   what the textures hold: base and mask ("metallic"), albedo and F0 ("specular"), or "exact":
               each material is shaded and the results are averaged.
    insulator  F0 of what is no metal.
    """
    surface, inlay, w = view.surface, view.inlay, view.camera.direction
    stone, metal, f0 = mi.Color3f(inlay.stone), mi.Color3f(inlay.metal), mi.Color3f(insulator)
    diffuse = maps.irradiance * dr.inv_pi
    mirrored = view.environment(w - 2 * dr.dot(surface.normal, w) * surface.normal)
    t = maps.share.eval(surface.uv)[0]
    if workflow == "exact":
        reflected = dr.lerp(stone * diffuse + f0 * mirrored, metal * mirrored, t)
    else:
        if workflow == "metallic":
            m, base = maps.mask.eval(surface.uv)[0], mi.Color3f(*maps.base.eval(surface.uv))
            albedo, specular = base * (1 - m), dr.lerp(f0, base, m)
        else:
            albedo, specular = dr.lerp(stone, mi.Color3f(0), t), dr.lerp(f0, metal, t)
        reflected = albedo * diffuse + specular * mirrored
    return dr.select(surface.valid, reflected, view.environment(w))


@material_workflows.bake
def bake(view: View, *, grow: Annotated[int, Sweep(-1, 1, low=-4, high=4)] = 0) -> Textures:
    """Textures at the level that is read.

    grow  texels of the finest level by which the mask is larger than the metal in the colour map, smaller
          where negative.
    """
    inlay = view.inlay
    metal = np.asarray(inlay.mask) > 0
    change = binary_dilation if grow > 0 else binary_erosion
    mask = change(metal, iterations=abs(grow)) if grow else metal
    base = np.where(metal[..., None], inlay.metal, inlay.stone)
    level = inlay.level
    return Textures(
        texture(base, level),
        texture(mask[..., None], level),
        texture(metal[..., None], level),
        irradiance(view),
    )


def texture(texels: np.ndarray, level: int) -> mi.Texture2f:
    """Texels (n, n, channels), averaged over 2^level x 2^level, repeated at the edges."""
    k = 2**level
    n, channels = len(texels) // k, texels.shape[2]
    mean = texels.astype(np.float64).reshape(n, k, n, k, channels).mean(axis=(1, 3))
    return mi.Texture2f(mi.TensorXf(mean.astype(np.float32)), wrap_mode=dr.WrapMode.Clamp)


def irradiance(view: View) -> mi.Color3f:
    """E of the surface, which is flat: over the texels of a cube map of the environment."""
    w, solid_angle = texel_directions(64)
    n = dr.normalize(dr.sum(dr.select(view.surface.valid, view.surface.normal, 0), axis=1))
    seen = view.environment(w) * (dr.maximum(dr.dot(mi.Vector3f(n), w), 0) * solid_angle)
    return mi.Color3f(dr.sum(seen, axis=1))


@material_workflows.domain
def domain(scene: Scene) -> Domain:
    """Textures seen near the size they were painted at (2.2)."""
    if scene.mip > 2:
        return Domain(False, "hardly a texel is of one material")
    return Domain(True)
