r"""Closed forms against Monte Carlo, where the closed forms are exact: along rays through pixel centres.

Mitsuba's own sensors give the rays and its integrators the radiance along them. The sun, which a closed form
takes to be at infinity, stands SUN_DISTANCE away in Mitsuba: from a point p off the origin it is seen turned
by up to |p| / SUN_DISTANCE, and what its shifted disk uncovers changes the irradiance by at most

    within = rho / pi |L_sun - L_sky| 2 sin(r) |p| / SUN_DISTANCE.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np

from reference.closed_form import caps, coloured_glass, fog, glass, valley
from reference.render import load_description, to_array, variant_of
from reference.source_function import once_scattered_by_slab, once_scattered_by_sphere
from reference.surface_monte_carlo import eye_rays, first_hits, shapes
from reference.toolchain import other_variant
from reference.transport import transport
from reference.verify.agreement import FLOAT32, Sampled
from reference.verify.checks import Comparison, check
from reference.verify.routes import BATCHES, SIZE, name, seeds
from scenes.cloud import CloudSlab, CloudSphere
from scenes.coloured import ColouredGlass
from scenes.contract import DIRECT_RADIANCE, RADIANCE, SINGLE_SCATTERING, TRANSMITTANCE, Quantity, Scene
from scenes.fog import FogOverGround
from scenes.glass import GlassSheets
from scenes.mitsuba_parts import SUN_DISTANCE, diffuse, direction, uniform_sky
from scenes.sunlit import SphereOverPlane, Sunlit, Valley

HEMISPHERE = np.array(0.5 * np.pi)


def through_centres(
    scene: Scene, description: dict, quantity: Quantity, drawn: tuple[int, ...], samples: int
) -> Sampled:
    """What Mitsuba's integrator sees along the sensor's rays through the centres of SIZE x SIZE pixels, in
    linear sRGB (SIZE, SIZE, 3), `samples` times for each seed."""
    how = replace(transport(description, quantity, SIZE), sampler="independent", spp=samples)
    with other_variant(variant_of(scene)):
        loaded = load_description(description, how)
        return Sampled.of([_centres(loaded, samples, s) for s in drawn])


def _centres(loaded: mi.Scene, samples: int, seed: int) -> np.ndarray:
    sensor, random = loaded.sensors()[0], mi.load_dict({"type": "independent"})
    random.seed(seed, SIZE * SIZE * samples)
    i = dr.arange(mi.UInt32, SIZE * SIZE * samples) // samples
    at = mi.Point2f(i % SIZE + 0.5, i // SIZE + 0.5) / SIZE
    ray, weight = sensor.sample_ray_differential(0.0, random.next_1d(), at, mi.Point2f(0.5))
    light, _, _ = loaded.integrator().sample(loaded, random, ray, sensor.get_medium())
    film = sensor.film()
    film.prepare([])
    block = film.create_block()
    block.put(SIZE * at, ray.wavelengths, weight * light, 1.0)
    film.put_block(block)
    return to_array(film.develop())


def compared(
    scene: Scene,
    quantity: Quantity,
    closed: np.ndarray,
    seed: int,
    samples: int,
    within: np.ndarray | float = 0.0,
    description: dict | None = None,
) -> Comparison:
    """Mitsuba through pixel centres against the closed form there; grey ones in one channel."""
    with other_variant(variant_of(scene)):
        description = description or scene.mitsuba(SIZE)
    found = through_centres(scene, description, quantity, seeds(seed, 0), samples)
    c = closed.shape[2]
    found = Sampled(found.mean[..., :c], found.variance[..., :c], found.batches)
    return Comparison(name(scene, quantity), found, Sampled.exact(closed), FLOAT32 * np.abs(closed) + within)


def parallax(scene: Sunlit) -> np.ndarray:
    """`within` (SIZE, SIZE, 1) of a scene's direct radiance; see the head of the module."""
    o, w = eye_rays(scene.sensor(SIZE), SIZE)
    t, _, rho = first_hits(shapes(scene.surfaces()), o, w)
    reach = np.where(np.isfinite(t), np.linalg.norm(o + np.where(np.isfinite(t), t, 0) * w, axis=0), 0)
    sun = scene.sun_irradiance / (math.pi * math.sin(scene.light_radius) ** 2)
    shift = rho / math.pi * abs(sun - scene.sky) * 2 * math.sin(scene.light_radius) * reach / SUN_DISTANCE
    return shift.reshape(SIZE, SIZE, 1)


@check(
    "route",
    claim="direct light of a round sun and a uniform sky is what spherical caps and polygons say",
    routes=("direct", "closed form"),
    scenes=("Valley", "SphereOverPlane"),
)
def caps_against_direct(seed: int) -> list[Comparison]:
    """Valley: lunes and a cap. SphereOverPlane: a cap behind a cap."""
    return [
        *(
            compared(v, DIRECT_RADIANCE, valley.valley_direct(v, SIZE), seed, 256, parallax(v))
            for v in (Valley(), Valley(slope=75.0, light_radius=0.05, light_elevation=60.0))
        ),
        *(
            compared(s, DIRECT_RADIANCE, sphere_over_plane(s), seed, 256, parallax(s))
            for s in (SphereOverPlane(), SphereOverPlane(light_elevation=10.0, gap=0.5))
        ),
    ]


def sphere_over_plane(scene: SphereOverPlane) -> np.ndarray:
    """Direct radiance (SIZE, SIZE, 1) at pixel centres. With H the hemisphere about the normal n, c the sun's
    disk and B what blocks the sky (the sphere's cap from the plane, four hemispheres round the plane's edges
    from the sphere),

        E_all = pi - n . Phi(B H),   E_sun = n . [Phi(c H) - Phi(c B H)],
        L     = rho / pi [L_sky E_all + (L_sun - L_sky) E_sun].
    """
    o, w = eye_rays(scene.sensor(SIZE), SIZE)
    t, n, rho = first_hits(shapes(scene.surfaces()), o, w)
    met = np.isfinite(t)
    p, n = (o + np.where(met, t, 0) * w).T, np.where(met, n, [[0.0], [0.0], [1.0]]).T
    image = np.full(len(p), scene.sky)
    for at, blocker in ((met & (p[:, 2] < 1e-6), _sphere_cap), (met & (p[:, 2] >= 1e-6), _plane_edges)):
        image[at] = rho[at] / math.pi * _irradiance(scene, n[at], blocker(scene, p[at]))
    return image.reshape(SIZE, SIZE, 1)


def _irradiance(scene: SphereOverPlane, n: np.ndarray, blocker: list[caps.Cap]) -> np.ndarray:
    own = (n, HEMISPHERE)
    sun = (
        np.array(direction(scene.light_elevation, scene.light_azimuth)),
        np.array(scene.light_radius),
    )
    blocked = caps.vector_irradiance(*blocker, own)
    seen = caps.vector_irradiance(sun, own) - caps.vector_irradiance(sun, *blocker, own)
    sun_radiance = scene.sun_irradiance / (math.pi * math.sin(scene.light_radius) ** 2)
    e_all, e_sun = math.pi - (n * blocked).sum(axis=1), (n * seen).sum(axis=1)
    return scene.sky * e_all + (sun_radiance - scene.sky) * e_sun


def _sphere_cap(scene: SphereOverPlane, p: np.ndarray) -> list[caps.Cap]:
    toward = np.array([0.0, 0.0, 1 + scene.gap]) - p
    far = np.linalg.norm(toward, axis=1)
    return [(toward / far[:, None], np.arcsin(1 / far))]


def _plane_edges(scene: SphereOverPlane, p: np.ndarray) -> list[caps.Cap]:
    half = np.array(scene.surfaces()["plane"]["to_world"].matrix, np.float64)[0, 0]
    corners = [np.array([x, y, 0.0]) * half - p for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    edges = [np.cross(a, b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    inner = [e * np.sign((e * sum(corners)).sum(axis=1, keepdims=True)) for e in edges]
    return [(e / np.linalg.norm(e, axis=1, keepdims=True), HEMISPHERE) for e in inner]


@check(
    "route",
    claim="sheets in any order are composited as rays that pass them at random find",
    routes=("volpath", "closed form"),
    scenes=("GlassSheets",),
)
def glass_against_volpath(seed: int) -> list[Comparison]:
    """Crossing sheets before a checkered wall, but for pixels within Mitsuba's reach of an edge."""
    found = []
    for scene in (GlassSheets(), GlassSheets(sheets=24, alpha=0.1, tilt=45.0, arrangement=7)):
        closed, edge = glass.radiance(scene, SIZE), near_an_edge(scene)
        pair = compared(scene, RADIANCE, closed, seed, 256)
        mean, variance = np.where(edge, closed, pair.first.mean), np.where(edge, 0, pair.first.variance)
        found.append(replace(pair, first=Sampled(mean, variance, BATCHES)))
    return found


def near_an_edge(scene: GlassSheets) -> np.ndarray:
    """Pixels (SIZE, SIZE, 1) whose centre lies so near an edge or a crossing that Mitsuba may miss it.

    Every sheet that a ray passes lifts it off along the sheet's normal by RayEpsilon (1 + |p|), so that a
    ray through n of them runs aside by at most n times that (0.3 mm was seen after two sheets).
    """
    rays, sheets = glass.pinhole(scene, SIZE), scene.layers()
    depth = np.stack([glass.hits(sheet, rays) for sheet in sheets])
    met = np.isfinite(depth)
    reach = 1 + np.where(met, depth, 0).max(axis=0) * np.linalg.norm(rays, axis=-1)
    aside = mi.math.RayEpsilon * reach * met.sum(axis=0)
    ordered = np.sort(np.where(met, depth, 1e9 * np.arange(1, len(sheets) + 1)[:, None, None]), axis=0)
    edge = (np.diff(ordered, axis=0) < aside).any(axis=0)
    for sheet in sheets:
        wide, narrow = (
            np.isfinite(glass.hits(replace(sheet, half=sheet.half + k * aside.max()), rays)) for k in (1, -1)
        )
        edge |= wide != narrow
    for turn in (rays + np.array(step) * aside.max() / scene.WALL for step in ((1, 0, 1), (1, 0, -1))):
        edge |= (glass.wall(scene, turn) != glass.wall(scene, 2 * rays - turn)).any(axis=-1)
    return edge[..., None]


@check(
    "route",
    claim="coloured balls obey Beer's law wavelength by wavelength",
    routes=("volpathmis, spectral", "closed form"),
    scenes=("ColouredGlass",),
)
def coloured_glass_against_volpathmis(seed: int) -> Comparison:
    """Linear sRGB of four dyes."""
    scene = ColouredGlass()
    return compared(scene, RADIANCE, coloured_glass.radiance(scene, SIZE), seed, 512)


@check(
    "route",
    claim="height fog dims a ray as free flights through its voxels find",
    routes=("volpath", "closed form"),
    scenes=("FogOverGround",),
)
def fog_against_volpath(seed: int) -> list[Comparison]:
    """With every surface and the sky a light of radiance 1 and no albedo, radiance is transmittance."""
    found = []
    for scene in (FogOverGround(), FogOverGround(density=0.1, falloff=1.0)):
        lamp = {"type": "area", "radiance": {"type": "rgb", "value": 1.0}}
        lit = {k: {**s, "bsdf": diffuse(0.0), "emitter": lamp} for k, s in scene.surfaces().items()}
        parts = {k: v for k, v in scene.mitsuba(SIZE).items() if k != "sun"}
        description = {**parts, **lit, "sky": uniform_sky(1.0), "fog": {**scene.medium(), "albedo": 0.0}}
        closed = fog.fog_transmittance(scene, SIZE)
        found.append(compared(scene, TRANSMITTANCE, closed, seed, 320, voxels(scene) * closed, description))
    return found


def voxels(scene: FogOverGround) -> float:
    """Largest relative error that the fog's voxels make in a transmittance; see the head of `scenes.fog`."""
    k = scene.falloff * scene.HEIGHT / scene.VOXELS
    return 0.125 * k**2 * -math.log(max(fog.fog_transmittance(scene, SIZE).min(), 1e-300))


@check(
    "route",
    claim="light scattered once in layers and balls is a plain integral along the ray",
    routes=("volpath at depth 2", "closed form"),
    scenes=("CloudSlab", "CloudSphere"),
)
def once_scattered_against_volpath(seed: int) -> list[Comparison]:
    """Layer from above, also with the sun at 2 degrees, which lights its skin alone (`reference.entry`);
    layer from below; ball lit from the side and from behind."""
    cases = [
        (CloudSlab(optical_depth=4.0, g=0.5), once_scattered_by_slab),
        (CloudSlab(optical_depth=32.0, g=0.0, sun_elevation=2.0), once_scattered_by_slab),
        (CloudSlab(optical_depth=2.0, g=0.5, seen="below"), once_scattered_by_slab),
        (CloudSphere(optical_depth=4.0), once_scattered_by_sphere),
        (CloudSphere(optical_depth=2.0, sun_angle=150.0, albedo=0.9), once_scattered_by_sphere),
    ]
    return [compared(s, SINGLE_SCATTERING, f(s, SIZE), seed, 512) for s, f in cases]


@check(
    "route",
    claim="areas and irradiance of caps are what uniform directions find",
    routes=("uniform directions", "closed form"),
)
def caps_against_directions(seed: int) -> list[Comparison]:
    """Every function of `closed_form.caps` that no scene above exercises, at 8 settings each."""
    rng = np.random.default_rng(seed)
    r0, r1, d = rng.uniform(0.4, 1.5, 8), rng.uniform(0.4, 1.5, 8), rng.uniform(0.0, 0.9, 8)
    theta, share, far = rng.uniform(0, 0.5 * np.pi, 8), rng.uniform(0.2, 1, 8), rng.uniform(0.2, 3, 8)
    first, second = np.array([0.0, 0, 1]), np.stack([np.sin(d), 0 * d, np.cos(d)])
    normal = np.stack([np.sin(theta), 0 * d, np.cos(theta)])

    def cap(w: np.ndarray) -> np.ndarray:
        return 4 * np.pi * (first @ w > np.cos(r0)[:, None])

    def lens(w: np.ndarray) -> np.ndarray:
        return cap(w) * (second.T @ w > np.cos(r1)[:, None])

    def horizon(w: np.ndarray) -> np.ndarray:
        return cap(w) * np.maximum(normal.T @ w, 0)

    def open_sky(w: np.ndarray) -> np.ndarray:
        toward = np.stack([far, 0 * far, 1 + 0 * far]) / np.hypot(far, 1)
        free = toward.T @ w < (far / np.hypot(far, 1))[:, None]
        return 4 * free * np.maximum(w[2], 0)

    def segment(w: np.ndarray) -> np.ndarray:
        return (w[0] < 2 * share[:, None] - 1) * (w[2] > 0) * 4 * np.maximum(w[2], 0)

    answers: dict[str, tuple[Callable, np.ndarray]] = {
        "cap_area": (cap, caps.cap_area(r0)),
        "lens_area": (lens, caps.lens_area(r0, r1, d)),
        "horizon_irradiance": (horizon, caps.horizon_irradiance(theta, r0)),
        "openness_beside_sphere": (open_sky, caps.openness_beside_sphere(far, np.ones(8))),
        "half_plane_share": (segment, caps.half_plane_share(share)),
    }
    batches = {k: [] for k in answers}
    for _ in range(BATCHES):
        z, azimuth = rng.uniform(-1, 1, 200_000), rng.uniform(0, 2 * np.pi, 200_000)
        s = np.sqrt(1 - z * z)
        w = np.stack([s * np.cos(azimuth), s * np.sin(azimuth), z])
        for label, (function, _) in answers.items():
            batches[label].append(function(w).mean(axis=1))
    return [Comparison(k, Sampled.of(batches[k]), Sampled.exact(v)) for k, (_, v) in answers.items()]
