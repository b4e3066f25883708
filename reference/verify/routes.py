"""Mitsuba against itself: integrators, variants and colour modes that must give the same picture.

What several checks of routes share stands here too: seeds, renders with a changed transport, and pictures
whose pixels are not independent.
"""

from __future__ import annotations

from dataclasses import replace

import mitsuba as mi
import numpy as np

from reference.colour import film_response, observer, to_rgb
from reference.render import batch_seed, load_description, load_scene, to_array, variant_of
from reference.toolchain import other_variant, spectral_twin
from reference.transport import NO_ROULETTE, Transport, transport
from reference.verify.agreement import Sampled
from reference.verify.checks import Comparison, check
from scenes.cloud import CloudSlab, CloudSphere
from scenes.coloured import (
    WAVELENGTHS,
    Atmosphere,
    ColouredGlass,
    DeepInterreflection,
    light,
    sunlight,
)
from scenes.contract import DIRECT_RADIANCE, RADIANCE, Quantity, Scene
from scenes.fog import FogOverGround
from scenes.glass import GlassSheets
from scenes.mitsuba_parts import film
from scenes.sunlit import SphereOverPlane, Valley

BATCHES = 16
SIZE = 16
"""Pixels a side: whatever is wrong with a route shows in 256 pixels."""


def seeds(seed: int, route: int) -> tuple[int, ...]:
    """Seeds of the batches of one of a check's routes; no two routes or runs share any."""
    return tuple(batch_seed(2 * seed + route, k) for k in range(BATCHES))


def rendered(
    scene: Scene,
    quantity: Quantity,
    drawn: tuple[int, ...],
    spp: int,
    variant: str | None = None,
    **changes: str | int,
) -> Sampled:
    """A scene by Mitsuba, with our transport but for `changes` to the integrator, one batch for each seed.
    In a variant that is named, rays enter media as Mitsuba lets them, since scalar ones run no Python."""
    with other_variant(variant or variant_of(scene)):
        how = transport(scene.mitsuba(SIZE), quantity, SIZE)
        inside = how.starts_inside and variant is None
        how = replace(how, integrator={**how.integrator, **changes}, spp=spp, starts_inside=inside)
        loaded = load_scene(scene, quantity, SIZE, how)
        return Sampled.of([to_array(mi.render(loaded, spp=spp, seed=s)) for s in drawn])


def comparison(label: str, first: Sampled, second: Sampled, within: object = None) -> Comparison:
    """Of two images, in one channel where both are grey."""
    if all(np.allclose(s.mean, s.mean[..., :1], rtol=1e-5, atol=1e-7) for s in (first, second)):
        first, second = (Sampled(s.mean[..., :1], s.variance[..., :1], s.batches) for s in (first, second))
    return Comparison(label, first, second, within)


def name(scene: Scene, quantity: Quantity = RADIANCE) -> str:
    """A scene with the fields that are not at their defaults, and the quantity."""
    fields = [f"{k}={v}" for k, v in scene.fields().items() if v != getattr(type(scene), k)]
    return f"{type(scene).__name__}{'(' + ', '.join(fields) + ')' if fields else ''} {quantity.name}"


@check(
    "route",
    claim="light that met one surface is what `path` gives at depth 2",
    routes=("direct", "path at depth 2"),
    scenes=("SphereOverPlane", "Valley"),
)
def direct_against_path(seed: int) -> list[Comparison]:
    """Direct radiance by Mitsuba's two surface integrators."""
    return [
        comparison(
            name(scene, DIRECT_RADIANCE),
            rendered(scene, DIRECT_RADIANCE, seeds(seed, 0), 256),
            rendered(scene, RADIANCE, seeds(seed, 1), 256, type="path", max_depth=2),
        )
        for scene in (SphereOverPlane(), Valley())
    ]


LIGHT_PATHS = (("path", "multijitter", 144), ("ptracer", "independent", 1152))
"""Integrator, sampler, samples a pixel; particles are cheaper and rarer."""


@check(
    "route",
    claim="light traced from the camera and from the lamp makes the same picture of a Cornell box",
    routes=("path", "ptracer"),
)
def path_against_ptracer(seed: int) -> list[Comparison]:
    """Means of each channel over the image, and over tiles of 4 x 4 pixels.

    A particle lands on several pixels, which are thus correlated: each mean has its own statistics.
    """
    box = mi.cornell_box()
    box = {**box, "sensor": {**box["sensor"], "film": film(SIZE)}}
    images = [
        draws(box, {"type": kind, "max_depth": -1, "rr_depth": 8}, seeds(seed, route), spp, sampler)
        for route, (kind, sampler, spp) in enumerate(LIGHT_PATHS)
    ]
    return [
        Comparison(f"Cornell box: mean over {what}", *(Sampled.of(tile_means(i, side)) for i in images))
        for what, side in (("the image", SIZE), ("4 x 4 pixels", 4))
    ]


def draws(
    description: dict, integrator: dict, drawn: tuple[int, ...], spp: int, sampler: str = "independent"
) -> np.ndarray:
    """Batches (K, H, W, C) of a description with that integrator and sampler."""
    loaded = load_description(description, Transport(integrator, sampler, spp))
    return np.stack([to_array(mi.render(loaded, spp=spp, seed=s)) for s in drawn])


def tile_means(images: np.ndarray, side: int) -> np.ndarray:
    """Means (K, n) of images (K, H, W, C) over tiles of side x side pixels, channel by channel."""
    k, height, width, channels = images.shape
    tiles = images.reshape(k, height // side, side, width // side, side, channels)
    return tiles.mean(axis=(2, 4)).reshape(k, -1)


@check(
    "route",
    claim="two estimators of light in media agree: distances drawn for one channel, or weighed over all",
    routes=("volpath", "volpathmis"),
    scenes=("CloudSphere", "CloudSlab", "FogOverGround"),
)
def volpath_against_volpathmis(seed: int) -> list[Comparison]:
    """Grey media with the same seeds, whose walks differ in their weights alone; and a ball whose extinction
    differs between channels, in which the two estimators differ, with seeds of their own."""
    found = []
    for scene in (CloudSphere(), CloudSlab(optical_depth=8.0), FogOverGround()):
        how = transport(scene.mitsuba(SIZE), RADIANCE, SIZE).integrator
        a, b = (
            draws(scene.mitsuba(SIZE), {**how, "type": kind}, seeds(seed, 0), 16)[..., :1]
            for kind in ("volpath", "volpathmis")
        )
        paired = Sampled(a.mean(axis=0), Sampled.of(a - b).variance, BATCHES)
        found.append(Comparison(f"{name(scene)}, same walks", paired, Sampled.exact(b.mean(axis=0))))
    ball = CloudSphere(optical_depth=4.0, g=0.2).mitsuba(SIZE)
    colour = {"type": "rgb", "value": [0.6, 0.8, 1.0]}
    ball["cloud"]["interior"] |= {"sigma_t": colour, "scale": 2.5}
    deep = {"max_depth": -1, "rr_depth": NO_ROULETTE}
    a, b = (
        Sampled.of(draws(ball, {"type": kind, **deep}, seeds(seed, route), 256))
        for route, kind in enumerate(("volpath", "volpathmis"))
    )
    return [*found, Comparison("CloudSphere of coloured extinction radiance", a, b)]


SCALAR = (
    (SphereOverPlane(), 16),
    (Valley(), 16),
    (GlassSheets(), 16),
    (FogOverGround(), 36),
    (CloudSlab(optical_depth=4.0, g=0.2), 36),
    (CloudSphere(optical_depth=4.0, g=0.2), 36),
    (ColouredGlass(), 64),
    (DeepInterreflection(), 36),
    (Atmosphere(), 64),
)
"""Scenes and samples a pixel of the variant that runs one ray at a time."""


@check(
    "route",
    claim="compiled array code and plain C++ render the same picture",
    routes=("array variant", "scalar variant"),
    scenes=tuple(type(scene).__name__ for scene, _ in SCALAR),
)
def arrays_against_scalar(seed: int) -> list[Comparison]:
    """Radiance of every scene in both kinds of variant."""
    found = []
    for scene, spp in SCALAR:
        array, scalar = variant_of(scene), f"scalar_{variant_of(scene).rpartition('_')[2]}"
        found.append(
            comparison(
                name(scene),
                rendered(scene, RADIANCE, seeds(seed, 0), 4 * spp, array),
                rendered(scene, RADIANCE, seeds(seed, 1), spp, scalar),
            )
        )
    return found


GREY = (
    (SphereOverPlane(), 100),
    (Valley(), 100),
    (FogOverGround(), 100),
    (CloudSphere(optical_depth=4.0, g=0.2), 400),
    (DeepInterreflection(saturation=0.0), 100),
    (Atmosphere(exponent=0.0), 256),
)


@check(
    "route",
    claim="what is grey is the same in three channels and wavelength by wavelength",
    routes=("RGB", "spectral"),
    scenes=tuple(type(scene).__name__ for scene, _ in GREY),
)
def grey_rgb_against_spectral(seed: int) -> list[Comparison]:
    """Radiance of grey scenes in both colour modes; coloured scenes lose their spectra by `to_rgb`, which
    agrees with Mitsuba's film `within` the film's coarser observer."""
    found = []
    for scene, spp in GREY:
        description, twin = scene.mitsuba(SIZE), spectral_twin(mi.variant())
        within = None
        if scene.spectral:
            description, within = to_rgb(description), coarse_observer()
        how = transport(description, RADIANCE, SIZE)
        rgb = Sampled.of(draws(description, how.integrator, seeds(seed, 0), spp, how.sampler))
        spectral = rendered(scene, RADIANCE, seeds(seed, 1), spp, twin)
        found.append(comparison(name(scene), rgb, spectral, within and within * np.abs(spectral.mean)))
    return found


def coarse_observer() -> float:
    """Largest relative difference, over channels and lights, between an emission seen by the observer of 1 nm
    and by its values every 5 nm, linear in between, as Mitsuba's film has them."""
    fine, response = observer()[0], film_response()
    every = np.isin(fine, WAVELENGTHS)
    coarse = np.stack([np.interp(fine, fine[every], r[every]) for r in response.T], axis=-1)
    emissions = [np.interp(fine, WAVELENGTHS, e) for e in (light("daylight"), sunlight())]
    return max(float(np.abs((e @ coarse) / (e @ response) - 1).max()) for e in emissions)
