r"""Area lights by two representative points, one for diffuse and one for specular reflection.

GPU Pro 5, II.1 (lights of Killzone: Shadow Fall). The digest holds no more than its title; the model is put
together from what is public about it: the notes of Lagarde and de Rousiers, "Moving Frostbite to physically
based rendering" (SIGGRAPH 2014), which retell its diffuse part, and engines that implement it.

A light of radiance L is flat: centre c, half extents a and b, m the normal of its plane away from the floor.
A sphere is a disk that faces the receiver p. n is the receiver's normal, v the way to the eye, w_q the unit
way to a point q of the light, r_q the distance.

    diffuse    d0 = m - k n, d1 = n - k m, k = min(n . m, 0)     towards the plane and along the normal
               q_d = the point of the light nearest to where d0/|d0| + d1/|d1| meets its plane
               E   = L n . w_d Omega, Omega the solid angle of the whole light
    specular   cone of half angle A about the mirror direction: A = 2 atan(x), x = alpha sqrt(s / (1 - s)),
               of which D sends back the share s of its energy; A = 2 alpha for a small alpha and s = 1/2
               it meets the plane in a disk (a square of the same area for a rectangle), which the light
               overlaps in an area A_S of centre q_s
               L_s = L f(v, w_s) n . w_s A_S (w_s . m) / r_s^2
    texture    the picture blurred over the footprint, looked up at q_d and q_s

Ambiguous:
- Omega of the whole "light" suits a point in its middle; q_d is the brightest point and not the mean one, so
  that E is 20 to 40 % too high where a light is not small. Omega can also be taken at q_d, as w_d . m times
  that of a "right" pyramid or cone at r_d, or times the light's area over r_d^2 ("differential").
- How the overlap normalises the highlight: by the solid angle of A_S, or ("share") by the share of the cone
  that is covered, which leaves f out and is right for mirrors.
- The share s of the cone. Accounts of the Phong form have 2 sqrt(2 / (m + 2)), which is 2 alpha for the
  exponent m = 2 / alpha^2 - 2; with s = 1/2, D(n) times the cone's solid angle is the lobe's whole energy,
  seen from above. From aside a lobe of half vectors fills only n . v of that solid angle, and the cone's
  section of the plane is an ellipse, 1 / (r . m) times the disk, r the mirror direction. So a light that
  fills the cone is reflected (r . m) / (n . v) times too brightly, which is right for a ceiling alone.
  `cone` "lobe" gives the disk the area of the lobe's section.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.contract import (
    HORIZON_CLIPPING,
    LINEAR_IN_LIGHT,
    REPRESENTATIVE_POINT,
    SHAPE_OF_LOBE,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from approximations.kit.ggx_cosine import ggx_cosine
from approximations.kit.light_shapes import FlatLight, flat_light, integrate
from scenes.area_lit import AreaLitPlane, PictureLitPlane, RoundLitPlane
from scenes.contract import DIRECT_RADIANCE, AreaLight, Scene, View

TEXELS = 32  # to a side of a filtered picture
LEVELS = 6  # of the picture, each twice as blurred as the one before
FINEST = 1 / 32  # radius of the first blur over the light's longer half extent
ROUGHEST = 0.7  # of x: cones of 70 degrees
SMOOTHEST = 1e-3  # alpha of the highlight of a mirror
Picture = mi.Texture3f | None


@technique(
    source="GPU Pro 5, II.1, from public accounts of it",
    covers=("area-lights/00",),
    estimates=DIRECT_RADIANCE,
    on=(AreaLitPlane, RoundLitPlane, PictureLitPlane),
    replaces="integral of reflected light over an area light",
    neglects=(REPRESENTATIVE_POINT, SHAPE_OF_LOBE, HORIZON_CLIPPING),
    claims=(
        LINEAR_IN_LIGHT,
        exact_when("DiffuseAreaLitPlane", 0.002, knobs={"diffuse": "exact"}),
        exact_when("DiffuseAreaLitPlane", 0.003, fields={"shape": "sphere"}, knobs={"diffuse": "exact"}),
        exact_when("DiffuseAreaLitPlane", 0.02, fields={"size": 0.02}),
        exact_when("AreaLitPlane", 0.01, knobs={"diffuse": "exact", "specular": "exact"}),
    ),
    stress={"AreaLitPlane": ("roughness", "view_elevation", "size"), "RoundLitPlane": ("height",)},
)
def representative_point(
    view: View,
    pictures: tuple[Picture, ...],
    *,
    diffuse: Literal["halfway", "centre", "exact"] = "halfway",
    solid_angle: Literal["light", "right", "differential"] = "light",
    specular: Literal["area", "share", "exact"] = "area",
    cone: Literal["round", "lobe"] = "round",
    energy: Annotated[float, Sweep(0.25, 0.5, low=0.05, high=0.95)] = 0.5,
    texture: Literal["filtered", "mean", "point"] = "filtered",
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel.

    diffuse      q_d: "halfway", or the light's "centre"; or "exact": Gauss points all over the light.
    solid_angle  Omega: of the whole "light", or at q_d: of a "right" pyramid or cone, or "differential".
    specular     highlight at q_s times the solid angle of the overlap ("area"), the "share" of the cone
                 that the light covers, or "exact": Gauss points, for alpha of 0.1 and more.
    cone         its disk as wide from every side ("round"), or as large as the "lobe" makes it.
    energy       s, the share of the lobe's energy inside the cone.
    texture      of the light: "filtered" over the footprint, its "mean", or what is at the "point" itself.
    """
    surface = view.surface
    n, v = surface.normal, -view.camera.direction
    total = dr.zeros(mi.Color3f, dr.width(surface.position))
    for light, picture in zip(view.lights, pictures, strict=True):
        flat = flat_light(light, surface.position)
        look = looker(light, picture, flat, texture)
        if diffuse == "exact":
            irradiance = integrate(flat, lambda w, q, look=look: look(q, 0) * dr.maximum(dr.dot(n, w), 0))
        else:
            irradiance = diffuse_light(flat, n, look, diffuse, solid_angle)
        reflected = surface.albedo * dr.inv_pi * irradiance
        if surface.specular is not None:
            reflected += surface.specular * highlight(flat, n, v, surface.alpha, look, specular, cone, energy)
        total += dr.select(flat.ahead > 0, light.radiance * reflected, 0)
    return dr.select(surface.valid, total, 0)


@representative_point.bake
def bake(view: View) -> tuple[Picture, ...]:
    """Each light's picture blurred by Gaussians of as much variance as disks of radius 1, 2, 4 ... times
    FINEST, normalised on the light."""
    return tuple(filtered(light) if light.texture else None for light in view.lights)


@representative_point.domain
def domain(scene: Scene) -> Domain:
    """Spheres, disks and rectangles of moderate size whose light arrives from above the horizon."""
    if scene.shape == "tube":
        return Domain(False, "the source has no tubes")
    if scene.size > 2 * scene.height:
        return Domain(False, "the light is larger than its distance")
    if scene.tilt > 90 or (scene.shape == "sphere" and scene.size > scene.height):
        return Domain(False, "the light dips below the horizon or faces away")
    return Domain(True)


def diffuse_light(flat: FlatLight, n: mi.Vector3f, look, point: str, solid_angle: str) -> mi.Color3f:
    """Irradiance for a radiance of 1."""
    q = mi.Point2f(0)
    if point == "halfway":
        k = dr.minimum(dr.dot(n, flat.m), 0)
        d0, d1 = dr.normalize(flat.m - k * n), dr.normalize(n - k * flat.m)
        q = flat.nearest(flat.where(dr.normalize(d0 + d1))[0])
    to = flat.at(q)
    r = dr.norm(to)
    w = to / r
    facing = dr.dot(w, flat.m)
    if solid_angle == "light":
        facing, omega = 1, flat.solid_angle()
    elif solid_angle == "differential":
        omega = flat.area / dr.square(r)
    elif flat.round:
        omega = dr.two_pi * (1 - r * dr.rsqrt(dr.square(r) + dr.square(flat.a)))
    else:
        t = dr.rsqrt((dr.square(r) + dr.square(flat.a)) * (dr.square(r) + dr.square(flat.b)))
        omega = 4 * dr.safe_asin(flat.a * flat.b * t)
    return look(q, r) * (dr.maximum(dr.dot(n, w), 0) * facing * omega)


def highlight(
    flat: FlatLight, n: mi.Vector3f, v: mi.Vector3f, alpha: mi.Float, look, how: str, cone: str, energy: float
) -> mi.Color3f:
    """Specular radiance for a reflectance of 1 and a radiance of 1."""
    alpha = dr.maximum(alpha, SMOOTHEST)
    if how == "exact":
        return integrate(flat, lambda w, q: look(q, 0) * ggx_cosine(n, v, w, alpha))
    x = dr.minimum(alpha * math.sqrt(energy / (1 - energy)), ROUGHEST)
    mirror = 2 * dr.dot(n, v) * n - v
    middle, t = flat.where(mirror)
    reach = t * 2 * x / (1 - x * x)
    if cone == "lobe":
        reach *= dr.safe_sqrt(dr.dot(n, v) * t / flat.ahead)
    q, area = overlap(flat, middle, reach)
    if how == "share":
        covered = area / (dr.pi * dr.square(reach))
    else:
        to = flat.at(q)
        w = dr.normalize(to)
        covered = ggx_cosine(n, v, w, alpha) * area * dr.dot(w, flat.m) / dr.squared_norm(to)
    return look(q, reach) * covered


def overlap(flat: FlatLight, middle: mi.Point2f, reach: mi.Float) -> tuple[mi.Point2f, mi.Float]:
    """Centre and area (m^2) of what the light shares with the cone's disk of that middle and radius.

    Two disks: the smaller, times a smoothstep of how far they have parted (SIGGRAPH 2006 Course 26, 8.4.2).
    """
    if flat.round:
        d = dr.norm(middle)
        x, _ = shared(flat.a, d, reach)
        apart = dr.abs(flat.a - reach)
        part = 1 - dr.clip((d - apart) / (flat.a + reach - apart), 0, 1)
        area = dr.pi * dr.square(dr.minimum(flat.a, reach)) * part * part * (3 - 2 * part)
        return x * middle / dr.maximum(d, 1e-6), area
    side = 0.5 * math.sqrt(math.pi) * reach
    x, width = shared(flat.a, middle.x, side)
    y, height = shared(flat.b, middle.y, side)
    return mi.Point2f(x, y), width * height


def shared(half: mi.Float, middle: mi.Float, reach: mi.Float) -> tuple[mi.Float, mi.Float]:
    """Middle and length of what [-half, half] and [middle - reach, middle + reach] share."""
    low, high = dr.clip(middle - reach, -half, half), dr.clip(middle + reach, -half, half)
    return 0.5 * (low + high), high - low


def looker(light: AreaLight, picture: Picture, flat: FlatLight, texture: str):
    """f(q, footprint): the factor on the radiance at a point of the light, blurred over a radius (m)."""
    if light.texture is None:
        return lambda q, footprint: mi.Color3f(1)

    def look(q: mi.Point2f, footprint: mi.Float) -> mi.Color3f:
        st = flat.texture_coordinates(q)
        if texture == "point" or isinstance(footprint, int):
            return light.texture(st)
        finest = FINEST * dr.maximum(flat.a, flat.b)
        level = dr.log2(dr.maximum(footprint / finest, 1)) if texture == "filtered" else LEVELS
        return mi.Color3f(picture.eval(mi.Point3f(st.x, st.y, (level + 0.5) / LEVELS)))

    return look


def filtered(light: AreaLight) -> mi.Texture3f:
    """The picture in LEVELS blurs, the last one its mean."""
    s = np.linspace(0, 1, 2 * TEXELS + 1)[1::2]
    grid = np.stack(np.meshgrid(s, s), axis=0).reshape(2, -1).astype(np.float32)
    texels = np.array(light.texture(mi.Point2f(grid))).T.reshape(TEXELS, TEXELS, 3)
    width, height = (2 * float(np.linalg.norm(np.array(e))) for e in (light.u, light.v))
    levels = []
    for k in range(LEVELS):
        radius = FINEST * 0.5 * max(width, height) * 2**k if k < LEVELS - 1 else np.inf
        across, up = (np.exp(-2 * (e * (s[:, None] - s) / radius) ** 2) for e in (width, height))
        across, up = (m / m.sum(axis=1, keepdims=True) for m in (across, up))
        levels.append(np.einsum("ij,kl,jlc->ikc", up, across, texels))
    stack = np.ascontiguousarray(np.stack(levels), np.float32)
    return mi.Texture3f(mi.TensorXf(stack), wrap_mode=dr.WrapMode.Clamp, use_accel=False)
