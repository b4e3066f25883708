r"""Surfaces under lamps and environments: Mitsuba against estimators of our own, through pixel centres.

Direct light, in float64 NumPy but for the shadow rays, with x the point seen, n its normal, f the reflection
of `scenes.contract.Surface`, V what `View.trace` finds:

    area lights   L = A / N sum_y f L_e V (n . w)+ (n_y . -w)+ / |y - x|^2,   y uniform in the light's area A
    points        L = f I V (n . w)+ / |y - x|^2
    environment   L = 4 pi / N sum_w f L_env(w) V (n . w)+,                   w uniform in the sphere

All light: paths without light sampling, which are scattered by cosine and find the lamps by themselves.
Openness: shadow rays against the radiance of white surfaces under a white sky.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from reference.render import load_description, render_once
from reference.transport import Transport
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import SIZE, name, seeds
from reference.visibility import light_point, sky_visibility
from scenes.contract import SKY_VISIBILITY, AreaLight, Scene, View
from scenes.mitsuba_parts import diffuse, uniform_sky
from scenes.occluders import Occluders

LIFT = 1e-4
"""m: shadow rays start this far above the surface."""


@dataclass(frozen=True)
class Point:
    """What is seen through the pixel centres, in float64: (3, n) each, but alpha and valid (n,)."""

    valid: np.ndarray
    x: np.ndarray
    n: np.ndarray
    out: np.ndarray
    albedo: np.ndarray
    specular: np.ndarray
    alpha: np.ndarray


def seen(view: View) -> Point:
    """The first hits of a view."""
    s = view.surface
    count = view.width * view.height

    def spread(value: object) -> np.ndarray:
        return np.broadcast_to(np.atleast_2d(np.array(value, np.float64)), (3, count))

    return Point(
        np.array(s.valid),
        spread(s.position),
        spread(s.normal),
        -spread(view.camera.direction),
        spread(s.albedo),
        spread(0.0 if s.specular is None else s.specular),
        spread(1.0 if s.alpha is None else s.alpha)[0],
    )


def reflection(p: Point, w: np.ndarray) -> np.ndarray:
    """albedo / pi + specular D G1 G1 / (4 (n . w)(n . out)), (3, n) in 1/sr; w unit, (3, n)."""
    c_in, c_out = (np.maximum(_dot(p.n, v), 1e-9) for v in (w, p.out))
    h = w + p.out
    c_h = _dot(p.n, h) / np.linalg.norm(h, axis=0)
    a2 = np.maximum(p.alpha, 1e-6) ** 2
    density = a2 / (np.pi * (c_h**2 * (a2 - 1) + 1) ** 2)
    masking = [2 / (1 + np.sqrt(1 + a2 * (1 / c**2 - 1))) for c in (c_in, c_out)]
    return p.albedo / np.pi + p.specular * density * masking[0] * masking[1] / (4 * c_in * c_out)


def direct(scene: Scene, size: int, samples: int, seed: int) -> np.ndarray:
    """(size, size, 3): one batch of direct light from lights, points and environment."""
    view = scene.view(size)
    p = seen(view)
    total = np.zeros((3, size * size))
    for light in view.points:
        towards = np.array(light.position, np.float64).reshape(3, 1) - p.x
        far = np.linalg.norm(towards, axis=0)
        intensity = np.array(light.intensity, np.float64).reshape(-1, 1)
        total += _arrives(view, p, towards / far, far) * intensity / far**2
    rng = mi.PCG32(size=size * size, initstate=seed)
    for _ in range(samples):
        for light in view.lights:
            total += _from_light(view, p, light, rng) / samples
        if view.environment is not None:
            w = mi.warp.square_to_uniform_sphere(mi.Point2f(rng.next_float32(), rng.next_float32()))
            arrived = _arrives(view, p, np.array(w, np.float64), np.full(size * size, np.inf))
            total += 4 * np.pi * arrived * np.array(view.environment(w), np.float64) / samples
    return np.where(p.valid, total, 0).T.reshape(size, size, 3)


def _from_light(view: View, p: Point, light: AreaLight, rng: mi.PCG32) -> np.ndarray:
    sample = mi.Point2f(rng.next_float32(), rng.next_float32())
    y = np.array(light_point(light, sample), np.float64)
    c, u, v = (np.array(a, np.float64).reshape(3, 1) for a in (light.centre, light.u, light.v))
    ru, rv = np.linalg.norm(u), np.linalg.norm(v)
    if light.shape == "sphere":
        n, area = (y - c) / ru, 4 * np.pi * ru**2
    elif light.shape == "tube":
        off = y - c
        n, area = (off - u * (off * u).sum(axis=0) / ru**2) / rv, 4 * np.pi * ru * rv
    else:
        across = np.cross(u, v, axis=0)
        n, area = across / np.linalg.norm(across), (np.pi if light.shape == "disk" else 4) * ru * rv
    towards = y - p.x
    far = np.linalg.norm(towards, axis=0)
    w = towards / far
    radiance = np.array(light.radiance, np.float64).reshape(-1, 1)
    if light.texture is not None:
        radiance = radiance * np.array(light.texture(sample), np.float64)
    return _arrives(view, p, w, far) * radiance * area * np.maximum(-_dot(n, w), 0) / far**2


def _arrives(view: View, p: Point, w: np.ndarray, far: np.ndarray) -> np.ndarray:
    """f V (n . w)+."""
    cosine = np.maximum(_dot(p.n, w), 0)
    start = mi.Point3f((p.x + LIFT * p.n).astype(np.float32))
    blocked = np.array(view.trace(start, mi.Vector3f(w.astype(np.float32)))) < far * (1 - 1e-4) - 2 * LIFT
    return reflection(p, w) * np.where(blocked, 0, cosine)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(axis=0)


def whole(scene: Scene, size: int, samples: int, seed: int, *, lamps: bool = True) -> np.ndarray:
    """(size, size, 3): one batch of all light among diffuse surfaces by paths without light sampling. lamps:
    whether the light that the eye sees directly counts."""
    view, world = scene.view(size), mi.load_dict(scene.mitsuba(size), optimize=False)
    lane = dr.arange(mi.UInt32, size * size * samples) // samples
    rng = mi.PCG32(size=size * size * samples, initstate=seed)
    ray = mi.Ray3f(
        dr.gather(mi.Point3f, view.camera.origin, lane), dr.gather(mi.Vector3f, view.camera.direction, lane)
    )
    found, weight, active = mi.Color3f(0), mi.Color3f(1), mi.Bool(True)
    for depth in range(64):
        si = world.ray_intersect(ray, active)
        if depth or lamps:
            found += dr.select(active, weight * si.emitter(world).eval(si, active), 0)
        active &= si.is_valid()
        weight *= si.bsdf().eval_diffuse_reflectance(si, active)
        survives = dr.minimum(dr.max(weight), 0.95) if depth > 3 else mi.Float(1)
        active &= (rng.next_float32() < survives) & (dr.max(weight) > 0)
        weight /= survives
        local = mi.warp.square_to_cosine_hemisphere(mi.Point2f(rng.next_float32(), rng.next_float32()))
        active &= si.wi.z > 0
        ray = si.spawn_ray(si.to_world(local))
        dr.eval(found, weight, active, ray, rng)
        if not dr.any(active):
            break
    image = [dr.block_sum(channel, samples) / samples for channel in found]
    return np.array(image, np.float64).T.reshape(size, size, 3)


SKIES = (Occluders(), Occluders(elevation=10.0, gap=0.5))


@check(
    "route",
    claim="the openness of a surface is the radiance of white ones under a white sky",
    routes=("own Monte Carlo", "direct"),
    scenes=tuple({type(s).__name__ for s in SKIES}),
)
def sky_visibility_against_direct(seed: int) -> list[Comparison]:
    """Shadow rays spread by cosine, and Mitsuba's estimator with light and BSDF samples."""
    return [
        Comparison(
            name(scene, SKY_VISIBILITY),
            Sampled.of([sky_visibility(scene, SIZE, 256, s) for s in seeds(seed, 0)]),
            Sampled.of([white_under_white(scene, s) for s in seeds(seed, 1)]),
        )
        for scene in SKIES
    ]


def white_under_white(scene: Scene, seed: int) -> np.ndarray:
    """(SIZE, SIZE, 1): a scene's surfaces in white under a white sky, light that met one of them."""
    white = {k: {**s, "bsdf": diffuse(1.0)} for k, s in scene.surfaces().items()}
    sensor = scene.mitsuba(SIZE)["sensor"]
    world = {"type": "scene", **white, "sky": uniform_sky(1.0), "sensor": sensor}
    loaded = load_description(world, Transport({"type": "direct"}, "independent", 256))
    return render_once(loaded, 256, seed)[..., :1]
