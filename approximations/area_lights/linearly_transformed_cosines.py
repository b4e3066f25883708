r"""Polygonal lights by linearly transformed cosines.

Heitz, Dupuy, Hill and Neubelt, "Real-Time Polygonal-Light Shading with Linearly Transformed Cosines" (ACM
Transactions on Graphics 35(4), 2016). A clamped cosine about z has a closed integral over a polygon (Lambert
1760). A matrix M that moves its directions makes it as wide, stretched and aslant as a GGX lobe, and the
integral stays the same, so that the polygon is moved back instead:

    lobe       f(v, w) cos  ~  A D(w),  D_o(M^-1 w / |M^-1 w|) |det M^-1| / |M^-1 w|^3
    table      M^-1 and the albedo A by roughness and view, fitted offline by `kit.ltc_fit`
    polygon    P_o = M^-1 P, cut at the horizon z = 0
    edges      F = 1 / (2 pi) sum angle(a, b) (a x b) / |a x b|,   int_P D = F_z
    light      L_o = L (specular A F_z(M^-1 P) + albedo F_z(P))
    texture    the picture blurred by a Gaussian of deviation r / sqrt(2), r the distance to the plane of P_o
               over the root of its area, looked up at the foot of the perpendicular from the receiver; that
               Gaussian has the peak of the cosine's footprint on the plane (reconstructed: other factors
               between 1/2 and 1 do as well)

The frame has z = n and x towards the eye. A disk is a polygon of its area; a sphere a disk that faces the
receiver; a tube, which the source leaves out, a rectangle that does.

Ambiguous or left out:
- M tilts the lobe, so that its own horizon is not the surface's: cut at that alone, as in the source, light
  from below the surface is reflected, and a white furnace loses the part of the lobe that points there, up to
  12 % (`horizon` "both" cuts the polygon at the surface, too).
- The lookup at the foot of the perpendicular misses the middle of the polygon seen aslant; later accounts
  look along F (`lookup` "along F").
- One deviation serves both sides of the picture, though M^-1 squeezes it along one: where a lobe that is long
  in the plane of incidence leaves streaks, this gives spots.
- The table holds no Fresnel term: `specular` scales the lobe as a whole, as it does in the truth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import drjit as dr
import mitsuba as mi
import numpy as np

from approximations.contract import (
    ANGULAR_DETAIL,
    HORIZON_CLIPPING,
    LINEAR_IN_LIGHT,
    SHAPE_OF_LOBE,
    Domain,
    Sweep,
    exact_when,
    technique,
)
from approximations.kit.ggx_cosine import ggx_cosine
from approximations.kit.light_shapes import FlatLight, flat_light, integrate
from approximations.kit.ltc_fit import TABLE
from scenes.area_lit import AreaLitPlane, PictureLitPlane, RoundLitPlane
from scenes.contract import DIRECT_RADIANCE, AreaLight, Scene, View

TEXELS = 64  # to a side of a blurred picture
BLURS = (1, 2, 4, 8, 16, 32, np.inf)  # texels of deviation of a picture's levels, the last one its mean
SMOOTHEST = 1e-3  # alpha of the exact highlight of a mirror


@dataclass
class Tables:
    """lobe: a, b, c, d of M^-1 = [[a, 0, b], [0, 1, 0], [c, 0, d]] and A, at (sqrt(1 - n.v), roughness).
    pictures: of each light, (s, t, level); None where it has none."""

    lobe: mi.Texture2f
    pictures: tuple[mi.Texture3f | None, ...]


@technique(
    source="Heitz, Dupuy, Hill and Neubelt, ACM Transactions on Graphics 35(4), 2016",
    estimates=DIRECT_RADIANCE,
    on=(AreaLitPlane, RoundLitPlane, PictureLitPlane),
    replaces="integral of reflected light over a polygon",
    neglects=(SHAPE_OF_LOBE, HORIZON_CLIPPING, ANGULAR_DETAIL),
    claims=(
        LINEAR_IN_LIGHT,
        exact_when("AreaLitPlane", 0.003, fields={"specular": 0.0}),
        exact_when("DiffuseAreaLitPlane", 0.002),
        exact_when("DiffuseAreaLitPlane", 0.003, fields={"shape": "sphere"}),
        exact_when("AreaLitPlane", 0.01, knobs={"lobe": "exact"}),
    ),
    stress={"AreaLitPlane": ("roughness", "view_elevation", "height")},
    baseline=True,
)
def linearly_transformed_cosines(
    view: View,
    tables: Tables,
    *,
    lobe: Literal["fitted", "exact"] = "fitted",
    horizon: Literal["clipped", "both", "sphere", "none"] = "clipped",
    edges: Annotated[int, Sweep(6, 16, low=3, high=64)] = 16,
    lookup: Literal["perpendicular", "along F", "mean"] = "perpendicular",
) -> mi.Color3f:
    """Radiance (W m^-2 sr^-1) towards the camera, one colour per pixel.

    lobe     "fitted", or "exact": Gauss points all over the light, for alpha of 0.1 and more.
    horizon  the polygon is "clipped" at the lobe's own, at that and the surface's ("both"), not at all
             ("none"), or F is cut as that of a "sphere" of the same size: (|F|^2 + F_z) / (|F| + 1).
    edges    of a disk.
    lookup   of a picture: at the foot of the "perpendicular", "along F", or its "mean".
    """
    surface = view.surface
    n, v = surface.normal, -view.camera.direction
    nv = dr.maximum(dr.dot(n, v), 0)
    along = v - nv * n
    x = dr.select(dr.squared_norm(along) > 1e-8, dr.normalize(along), mi.Frame3f(n).s)
    frame = mi.Frame3f(x, dr.cross(n, x), n)
    glossy = surface.specular is not None
    if glossy:
        at = mi.Point2f(dr.safe_sqrt(1 - nv), dr.sqrt(surface.alpha))
        side = tables.lobe.shape[0]
        a, b, c, d, albedo = tables.lobe.eval((at * (side - 1) + 0.5) / side)
        inverse = mi.Matrix3f([[a, 0, b], [0, 1, 0], [c, 0, d]])
    total = dr.zeros(mi.Color3f, dr.width(surface.position))
    for light, picture in zip(view.lights, tables.pictures, strict=True):
        flat = flat_light(light, surface.position)
        corners = [frame.to_local(corner) for corner in outline(flat, edges)]
        reflected = surface.albedo * polygon(flat, frame, corners, mi.Matrix3f(1), picture, horizon, lookup)
        if glossy and lobe == "exact":
            reflected += surface.specular * exact_lobe(light, flat, n, v, surface.alpha)
        elif glossy:
            reflected += (
                surface.specular * albedo * polygon(flat, frame, corners, inverse, picture, horizon, lookup)
            )
        total += dr.select(flat.ahead > 0, light.radiance * reflected, 0)
    return dr.select(surface.valid, total, 0)


@linearly_transformed_cosines.bake
def bake(view: View) -> Tables:
    """The fitted table, and each light's picture in BLURS."""
    kept = np.load(TABLE)
    lobe = np.concatenate([kept["inverse"], kept["albedo"][..., None]], axis=2)
    return Tables(
        mi.Texture2f(mi.TensorXf(lobe), use_accel=False, wrap_mode=dr.WrapMode.Clamp),
        tuple(blurred(light) if light.texture else None for light in view.lights),
    )


@linearly_transformed_cosines.domain
def domain(scene: Scene) -> Domain:
    """Polygons, and what looks like one, over a surface that is no mirror."""
    if scene.shape == "tube":
        return Domain(False, "a tube is no polygon")
    if getattr(scene, "roughness", 1) < 0.05:
        return Domain(False, "the table's first cells are wider than the lobe")
    return Domain(True)


def outline(flat: FlatLight, edges: int) -> list[mi.Vector3f]:
    """Corners from the receiver, so that F points to the lit side; of the disk's area where it is round."""
    x, y = flat.a * flat.x, flat.b * dr.cross(flat.m, flat.x)
    if not flat.round:
        return [flat.towards + s * x + t * y for s, t in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    turn = 2 * np.pi / edges
    wide = float(np.sqrt(turn / np.sin(turn)))
    angles = turn * np.arange(edges)
    around = wide * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return [flat.towards + float(s) * x + float(t) * y for s, t in around]


def polygon(
    flat: FlatLight,
    frame: mi.Frame3f,
    corners: list[mi.Vector3f],
    inverse: mi.Matrix3f,
    picture: mi.Texture3f | None,
    horizon: str,
    lookup: str,
) -> mi.Color3f:
    """int D over the polygon times the picture, 0 to 1 for a picture of 1."""
    sides = list(zip(corners, corners[1:] + corners[:1], strict=True))
    if horizon == "both":
        sides = above(sides)
    sides = [(inverse @ a, inverse @ b) for a, b in sides]
    if horizon in ("clipped", "both"):
        sides = above(sides)
    f = sum(arc(a, b) for a, b in sides) * (0.5 * dr.inv_pi)
    size = dr.norm(f)
    share = (dr.square(size) + f.z) / (size + 1) if horizon == "sphere" else f.z
    colour = shine(flat, frame, inverse, f, picture, lookup) if picture else mi.Color3f(1)
    return dr.select(share > 0, share * colour, 0)


def arc(a: mi.Vector3f, b: mi.Vector3f) -> mi.Vector3f:
    """angle(a, b) (a x b) / |a x b|, 0 where the two point the same way."""
    m = dr.cross(a, b)
    sine = dr.norm(m)
    return m * (dr.atan2(sine, dr.dot(a, b)) / dr.maximum(sine, 1e-20))


def above(sides: list[tuple[mi.Vector3f, mi.Vector3f]]) -> list[tuple[mi.Vector3f, mi.Vector3f]]:
    """A convex polygon's part with z > 0: its edges cut, and the edge that closes the gap."""
    kept = []
    leaves = enters = dr.zeros(mi.Vector3f)
    for a, b in sides:
        starts, ends = a.z > 0, b.z > 0
        crossing = dr.select(starts ^ ends, a + a.z / (a.z - b.z) * (b - a), 0)
        leaves = dr.select(starts & ~ends, crossing, leaves)
        enters = dr.select(ends & ~starts, crossing, enters)
        kept.append((dr.select(starts, a, crossing), dr.select(ends, b, crossing)))
    return [*kept, (leaves, enters)]


def shine(
    flat: FlatLight,
    frame: mi.Frame3f,
    inverse: mi.Matrix3f,
    f: mi.Vector3f,
    picture: mi.Texture3f,
    lookup: str,
) -> mi.Color3f:
    """The picture as the cosine sees it: blurred with the distance to the moved rectangle's plane."""
    if lookup == "mean":
        return mi.Color3f(picture.eval(mi.Point3f(0.5, 0.5, 1)))
    c, x, y = (inverse @ frame.to_local(w) for w in (flat.towards, flat.a * flat.x, flat.b * flat.y))
    m = dr.cross(x, y)
    w = m if lookup == "perpendicular" else f
    foot = w * (dr.dot(c, m) / dr.dot(w, m))
    q = foot - c
    s, t = dr.dot(dr.cross(q, y), m), dr.dot(dr.cross(x, q), m)
    st = 0.5 + 0.5 * mi.Point2f(s, t) / dr.squared_norm(m)
    deviation = dr.norm(foot) * dr.rsqrt(8 * dr.norm(m))
    level = dr.log2(dr.maximum(TEXELS * deviation, 1))
    return mi.Color3f(picture.eval(mi.Point3f(st.x, st.y, (level + 0.5) / len(BLURS))))


def exact_lobe(
    light: AreaLight, flat: FlatLight, n: mi.Vector3f, v: mi.Vector3f, alpha: mi.Float
) -> mi.Color3f:
    """Specular radiance for a reflectance of 1 and a radiance of 1."""
    alpha = dr.maximum(alpha, SMOOTHEST)

    def reflected(w: mi.Vector3f, q: mi.Point2f) -> mi.Color3f:
        colour = light.texture(flat.texture_coordinates(q)) if light.texture else mi.Color3f(1)
        return colour * ggx_cosine(n, v, w, alpha)

    return integrate(flat, reflected)


def blurred(light: AreaLight) -> mi.Texture3f:
    """The picture blurred by Gaussians, normalised on the light."""
    s = np.linspace(0, 1, 2 * TEXELS + 1)[1::2]
    grid = np.stack(np.meshgrid(s, s), axis=0).reshape(2, -1).astype(np.float32)
    texels = np.array(light.texture(mi.Point2f(grid))).T.reshape(TEXELS, TEXELS, 3)
    levels = []
    for wide in BLURS:
        kernel = np.exp(-0.5 * (TEXELS * (s[:, None] - s) / wide) ** 2)
        kernel /= kernel.sum(axis=1, keepdims=True)
        levels.append(np.einsum("ij,kl,jlc->ikc", kernel, kernel, texels, optimize=True))
    stack = np.ascontiguousarray(np.stack(levels), np.float32)
    return mi.Texture3f(mi.TensorXf(stack), use_accel=False, wrap_mode=dr.WrapMode.Clamp)
