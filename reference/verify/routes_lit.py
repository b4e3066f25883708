r"""Surfaces under lamps, suns and skies: Mitsuba against estimators of our own, through pixel centres.

Direct light, in float64 NumPy but for the shadow rays, with x the point seen, n its normal, f the reflection
of `scenes.contract.Surface`, V what `View.trace` finds:

    area lights   L = A / N sum_y f L_e V (n . w)+ (n_y . -w)+ / |y - x|^2,   y uniform in the light's area A
    sun           L = Omega / N sum_w f L_sun V (n . w)+,                     w uniform in its disk
    sky           L = 2 pi / N sum_w f L_sky(w) V (n . w)+,                   w uniform in the hemisphere

All light: paths that scatter as the surfaces do, each meeting lit as in the first line.
Openness: the closed forms against the radiance of white surfaces under a white sky.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from reference.closed_form import fields
from reference.verify.agreement import FLOAT32, Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import SIZE, name, seeds
from reference.verify.routes_closed_form import compared, through_centres
from reference.visibility import light_point
from scenes.area_lit import PictureLitPlane
from scenes.contract import (
    DIRECT_RADIANCE,
    LIGHT_VISIBILITY,
    RADIANCE,
    AreaLight,
    Scene,
    Solid,
    View,
)
from scenes.fields import BallOverFloor, Groove, SolidsUnderLamp
from scenes.mitsuba_parts import diffuse, uniform_sky
from scenes.rooms import BrickWall, ColouredRoom, PolishedFloorRoom
from scenes.terrain import Foliage, Terrain
from scenes.wall_under_sky import WallUnderSky

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
    """(size, size, 3): one batch of direct light from lamps, sun and sky; 0 where the eye meets nothing."""
    view = scene.view(size)
    p, sun = seen(view), view.sun
    total = np.zeros((3, size * size))
    rng = mi.PCG32(size=size * size, initstate=seed)
    endless = np.full(size * size, np.inf)
    for _ in range(samples):
        dr.eval(rng)
        for light in view.lights:
            total += _from_light(view, p, light, rng) / samples
        if sun is not None and sun.angular_radius > 0:
            least, towards = np.cos(sun.angular_radius), mi.Frame3f(mi.Vector3f(sun.direction))
            w = np.array(
                towards.to_world(mi.warp.square_to_uniform_cone(_two(rng), float(least))), np.float64
            )
            total += 2 * np.pi * (1 - least) * sun.radiance * _arrives(view, p, w, endless) / samples
        if view.sky is not None or view.environment is not None:
            w = mi.Frame3f(view.surface.normal).to_world(mi.warp.square_to_uniform_hemisphere(_two(rng)))
            sky = np.array(view.sky if view.environment is None else view.environment(w), np.float64)
            total += 2 * np.pi * sky * _arrives(view, p, np.array(w, np.float64), endless) / samples
    if sun is not None and sun.angular_radius == 0:
        w = np.broadcast_to(np.array(sun.direction, np.float64).reshape(3, 1), p.x.shape)
        total += sun.irradiance * _arrives(view, p, w, endless)
    return np.where(p.valid, total, 0).T.reshape(size, size, 3)


def _two(rng: mi.PCG32) -> mi.Point2f:
    return mi.Point2f(rng.next_float32(), rng.next_float32())


def _from_light(view: View, p: Point, light: AreaLight, rng: mi.PCG32) -> np.ndarray:
    sample = _two(rng)
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
    if view.trace is None:
        return reflection(p, w) * cosine
    start = mi.Point3f((p.x + LIFT * p.n).astype(np.float32))
    blocked = np.array(view.trace(start, mi.Vector3f(w.astype(np.float32)))) < far * (1 - 1e-4) - 2 * LIFT
    return reflection(p, w) * np.where(blocked, 0, cosine)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(axis=0)


DIRECT = (
    (PictureLitPlane(), 64, 0.0),
    (Terrain(), 64, 0.02),
    (Foliage(), 64, 0.0),
    (WallUnderSky(), 128, 0.0),
)
"""Scenes, samples of a batch, and what may differ, as a share of the mean. Hills have smooth normals: Mitsuba
lets in the light that comes to a facet from below, where the smooth surface faces it (1 % of all)."""


@check(
    "route",
    claim="light that met one surface is what own samples of lamps, suns and skies give",
    routes=("direct", "own Monte Carlo"),
    scenes=tuple(type(s).__name__ for s, _, _ in DIRECT),
)
def direct_against_own_samples(seed: int) -> list[Comparison]:
    """Where the eye meets a surface and no lamp."""
    found = []
    for scene, samples, slack in DIRECT:
        kept = _surfaces(scene)[..., None]
        theirs = through_centres(scene, scene.mitsuba(SIZE), DIRECT_RADIANCE, seeds(seed, 0), 256)
        own = Sampled.of([direct(scene, SIZE, samples, s) for s in seeds(seed, 1)])
        theirs, own = (
            Sampled(np.where(kept, s.mean, 0), np.where(kept, s.variance, 0), s.batches)
            for s in (theirs, own)
        )
        found.append(
            Comparison(
                name(scene, DIRECT_RADIANCE),
                theirs,
                own,
                FLOAT32 * np.abs(own.mean) + slack * own.mean.mean(),
            )
        )
    return found


def _surfaces(scene: Scene) -> np.ndarray:
    """(SIZE, SIZE) bool: pixel centres that see a surface and no lamp before it."""
    view, world = scene.view(SIZE), mi.load_dict(scene.mitsuba(SIZE), optimize=False)
    si = world.ray_intersect(mi.Ray3f(view.camera.origin, view.camera.direction))
    dark = dr.max(si.emitter(world).eval(si)) == 0
    return np.array(si.is_valid() & dark).reshape(SIZE, SIZE)


ROOMS = ((ColouredRoom(), 64), (PolishedFloorRoom(), 160), (BrickWall(), 64))
"""Scenes, and own paths of a batch through a pixel centre."""


@check(
    "route",
    claim="light in rooms is what paths bring that look for the lamp from every meeting",
    routes=("path", "own Monte Carlo"),
    scenes=tuple(type(s).__name__ for s, _ in ROOMS),
)
def rooms_against_own_paths(seed: int) -> list[Comparison]:
    """All light, of all orders."""
    return [
        Comparison(
            name(scene, RADIANCE),
            through_centres(scene, scene.mitsuba(SIZE), RADIANCE, seeds(seed, 0), 256),
            Sampled.of([own_paths(scene, SIZE, n, s) for s in seeds(seed, 1)]),
            np.array(FLOAT32),
        )
        for scene, n in ROOMS
    ]


def own_paths(scene: Scene, size: int, count: int, seed: int) -> np.ndarray:
    """(size, size, 3): one batch of all light, by `count` paths from each pixel centre's ray; from the fifth
    meeting on they survive by their weight."""
    view, world = scene.view(size), mi.load_dict(scene.mitsuba(size), optimize=False)
    lane = dr.arange(mi.UInt32, size * size * count) // count
    rng = mi.PCG32(size=size * size * count, initstate=seed)
    o, d = view.camera.origin, view.camera.direction
    ray = mi.Ray3f(dr.gather(mi.Point3f, o, lane), dr.gather(mi.Vector3f, d, lane))
    found, weight, active = mi.Color3f(0), mi.Color3f(1), mi.Bool(True)
    for meeting in range(64):
        si = world.ray_intersect(ray, active)
        if meeting == 0:
            found += dr.select(active, si.emitter(world).eval(si, active), 0)
        active &= si.is_valid()
        for light in view.lights:
            found += dr.select(active, weight * _lit(world, si, light, _two(rng), active), 0)
        drawn, share = si.bsdf().sample(mi.BSDFContext(), si, rng.next_float32(), _two(rng), active)
        weight *= share
        survives = dr.clip(dr.max(weight), 0.05, 0.95) if meeting > 3 else mi.Float(1)
        active &= (rng.next_float32() < survives) & (dr.max(weight) > 0)
        weight /= survives
        ray = si.spawn_ray(si.to_world(drawn.wo))
        dr.eval(found, weight, active, ray, rng)
        if not dr.any(active):
            break
    image = [dr.block_sum(channel, count) / count for channel in found]
    return np.array(image, np.float64).T.reshape(size, size, 3)


def _lit(world: mi.Scene, si: mi.SurfaceInteraction3f, light: AreaLight, sample: mi.Point2f, active: mi.Bool):
    """Radiance that a rectangle's point at `sample` makes a meeting send on."""
    u, v = mi.Vector3f(light.u), mi.Vector3f(light.v)
    across = dr.cross(u, v)
    towards = light_point(light, sample) - si.p
    far = dr.norm(towards)
    w = towards / far
    sent = 4 * dr.maximum(-dr.dot(across, w), 0) / dr.square(far)
    scattered = si.bsdf().eval(mi.BSDFContext(), si, si.to_local(w), active)
    shadow = si.spawn_ray(w)
    shadow.maxt = far * (1 - 1e-3)  # the start is lifted by up to 1e-4 (1 + |p|)
    free = active & (sent > 0) & ~world.ray_test(shadow, active & (sent > 0))
    return dr.select(free, scattered * sent * mi.Color3f(light.radiance), 0)


OPEN = (
    (BallOverFloor(), fields.openness_round_ball),
    (BallOverFloor(gap=0.5), fields.openness_round_ball),
    (Groove(), fields.openness_of_groove),
    (Groove(opening=200.0), fields.openness_of_groove),
)


@check(
    "route",
    claim="the openness of a surface is the radiance of white ones under a white sky",
    routes=("direct", "closed form"),
    scenes=("BallOverFloor", "Groove"),
)
def sky_visibility_against_direct(seed: int) -> list[Comparison]:
    """A ball over a floor, a groove and a ridge."""
    found = []
    for scene, closed in OPEN:
        white = {k: {**s, "bsdf": diffuse(1.0)} for k, s in scene.surfaces().items()}
        sensor = scene.mitsuba(SIZE)["sensor"]
        world = {"type": "scene", **white, "sky": uniform_sky(1.0), "sensor": sensor}
        exact = closed(scene, SIZE)
        found.append(compared(scene, DIRECT_RADIANCE, exact, seed, 256, np.full_like(exact, 1e-4), world))
    return found


RAYS = 256


@check(
    "route",
    claim="the share of a lamp that a point sees is what own rays among solids in float64 find",
    routes=("shadow rays", "own Monte Carlo"),
    scenes=("SolidsUnderLamp",),
)
def light_visibility_against_own_rays(seed: int) -> list[Comparison]:
    """Through pixel centres."""
    scene = SolidsUnderLamp()
    theirs, own = (
        Sampled.of([lamp_share(scene, s, traced) for s in seeds(seed, route)])
        for route, traced in enumerate((True, False))
    )
    return [Comparison(name(scene, LIGHT_VISIBILITY), theirs, own, np.full_like(own.mean, 1e-3))]


def lamp_share(scene: SolidsUnderLamp, seed: int, traced: bool) -> np.ndarray:
    """(SIZE, SIZE, 1): the share of RAYS to the lamp that are free, by Mitsuba or by our own solids."""
    view, rng = scene.view(SIZE), np.random.default_rng(seed)
    p, light = seen(view), view.lights[0]
    total = np.zeros(SIZE * SIZE)
    for _ in range(RAYS):
        up = rng.normal(size=p.x.shape)
        up /= np.linalg.norm(up, axis=0)
        y = np.array(light.centre).reshape(3, 1) + np.linalg.norm(light.u) * up
        start = p.x + LIFT * p.n
        way = y - start
        far = np.linalg.norm(way, axis=0)
        w = way / far
        if traced:
            given = mi.Point3f(start.astype(np.float32)), mi.Vector3f(w.astype(np.float32))
            free = ~(np.array(view.trace(*given)) < far)
        else:
            free = np.all([~meets(s, start, w, far) for s in view.solids], axis=0)
        total += free & (_dot(p.n, w) > 0)
    return np.where(p.valid, total / RAYS, 1).reshape(SIZE, SIZE, 1)


def meets(solid: Solid, o: np.ndarray, w: np.ndarray, far: np.ndarray) -> np.ndarray:
    """(n,) bool: whether rays o + t w, 0 < t < far, enter a ball or a box from outside."""
    axes, half = np.array(solid.axes, np.float64), np.array(solid.half, np.float64).reshape(3, 1)
    o, w = axes @ (o - np.array(solid.centre).reshape(3, 1)), axes @ w
    if solid.shape == "ball":
        b, c = _dot(o, w), _dot(o, o) - half[0] ** 2
        t = -b - np.sqrt(np.maximum(b * b - c, 0))
        return (b * b > c) & (t > 0) & (t < far)
    with np.errstate(divide="ignore"):
        sides = np.sort([(-half - o) / w, (half - o) / w], axis=0)
    enter, leave = sides[0].max(axis=0), sides[1].min(axis=0)
    return (enter < leave) & (enter > 0) & (enter < far)
