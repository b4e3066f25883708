"""The rules that choose how light is followed: least transport, and still exact."""

import math

import mitsuba as mi
import numpy as np
import pytest
from scipy import stats

from reference import transport as rules
from reference.render import batch_seed, load_description, sample, to_array
from reference.transport import NO_ROULETTE, Transport, integrator, roulette_depth, transport
from scenes.cloud import CloudSlab, CloudSphere
from scenes.contract import DIRECT_RADIANCE, RADIANCE, SINGLE_SCATTERING
from scenes.fog import FogOverGround
from scenes.glass import GlassSheets
from scenes.sunlit import SphereOverPlane, Valley

WHITE = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}}
BLACK = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
LAMP = {"type": "area", "radiance": {"type": "rgb", "value": 1.0}}


def scene(**parts):
    return {"type": "scene"} | parts


def test_the_first_rule_that_fits_is_taken():
    surfaces = scene(
        a={"type": "sphere", "bsdf": WHITE}, lamp={"type": "rectangle", "emitter": LAMP, "bsdf": BLACK}
    )
    masked = scene(a={"type": "rectangle", "bsdf": {"type": "mask", "opacity": 0.5, "nested": WHITE}})
    glowing = scene(
        a={"type": "rectangle", "bsdf": {"type": "mask", "opacity": 0.5, "nested": BLACK}, "e": LAMP}
    )
    fog = scene(
        a={"type": "cube", "bsdf": {"type": "null"}, "interior": {"type": "homogeneous", "albedo": 1.0}}
    )
    assert integrator(surfaces, RADIANCE)["type"] == "path"
    assert integrator(surfaces, DIRECT_RADIANCE) == {"type": "direct"}
    assert integrator(masked, RADIANCE)["type"] == "volpath"
    assert integrator(glowing, RADIANCE) == {"type": "volpath", "max_depth": 1, "rr_depth": NO_ROULETTE}
    assert integrator(fog, SINGLE_SCATTERING) == {"type": "volpath", "max_depth": 2, "rr_depth": NO_ROULETTE}
    assert integrator(fog, RADIANCE)["rr_depth"] == NO_ROULETTE


def test_delta_lights_are_not_looked_for_by_bsdf_samples():
    sun = scene(a={"type": "sphere", "bsdf": WHITE}, sun={"type": "directional"})
    assert integrator(sun, DIRECT_RADIANCE) == {"type": "direct", "bsdf_samples": 0}


def test_coloured_extinction_takes_the_integrator_that_weighs_all_wavelengths():
    def ball(sigma_t):
        medium = {"type": "homogeneous", "albedo": 0.0, "sigma_t": sigma_t}
        return scene(a={"type": "sphere", "bsdf": {"type": "null"}, "interior": medium})

    assert integrator(ball({"type": "rgb", "value": [1.0, 2.0, 3.0]}), RADIANCE)["type"] == "volpathmis"
    assert integrator(ball({"type": "rgb", "value": [2.0, 2.0, 2.0]}), RADIANCE)["type"] == "volpath"
    assert integrator(ball({"type": "regular", "values": "1, 2"}), RADIANCE)["type"] == "volpathmis"
    assert integrator(ball(1.0), RADIANCE)["type"] == "volpath"


@pytest.mark.parametrize(
    ("albedo", "depth"),
    [(0.0, 5), (0.5, 5), (0.9, 28), (0.99, 298), (1.0, NO_ROULETTE), ([0.2, 0.9, 0.5], 28)],
)
def test_roulette_starts_where_a_path_is_spent(albedo, depth):
    assert roulette_depth(scene(m={"type": "homogeneous", "albedo": albedo})) == depth


def test_an_albedo_that_varies_is_never_cut():
    grid = {"type": "gridvolume", "filename": "x.vol"}
    assert roulette_depth(scene(m={"type": "heterogeneous", "albedo": grid})) == NO_ROULETTE


def test_rays_start_inside_the_one_medium_that_is_seen_from_outside():
    cloud = {"type": "homogeneous", "albedo": 1.0}
    ball = {"type": "sphere", "bsdf": {"type": "null"}, "interior": cloud}
    outside, inside = {"type": "perspective"}, {"type": "perspective", "medium": cloud}
    assert transport(scene(a=ball, sensor=outside), RADIANCE, 16).starts_inside
    assert not transport(scene(a=ball, sensor=inside), RADIANCE, 16).starts_inside
    assert not transport(scene(a=ball, b=ball, sensor=outside), RADIANCE, 16).starts_inside
    assert not transport(
        scene(a={"type": "sphere", "bsdf": WHITE}, sensor=outside), RADIANCE, 16
    ).starts_inside


@pytest.mark.parametrize("size", [16, 64, 128, 512, 2048])
@pytest.mark.parametrize("cls", [SphereOverPlane, Valley, FogOverGround, GlassSheets, CloudSlab, CloudSphere])
def test_batches_are_square_and_bounded(cls, size):
    how = transport(cls().mitsuba(size), RADIANCE, size)
    assert math.isqrt(how.spp) ** 2 == how.spp
    assert rules.LEAST_SPP[how.sampler] <= how.spp <= rules.MOST_SPP


@pytest.mark.parametrize(
    ("made", "quantity"),
    [
        (SphereOverPlane(), RADIANCE),
        (SphereOverPlane(), DIRECT_RADIANCE),
        (Valley(), DIRECT_RADIANCE),
        (FogOverGround(), RADIANCE),
        (GlassSheets(), RADIANCE),
        (CloudSphere(albedo=0.9), RADIANCE),
    ],
    ids=lambda x: getattr(x, "name", type(x).__name__),
)
def test_the_least_transport_loses_nothing(made, quantity):
    """Against the integrator with every default that costs more."""
    description = made.mitsuba(16)
    how = transport(description, quantity, 16)
    kind = "path" if how.integrator["type"] in ("path", "direct") else "volpath"
    depth = 2 if quantity is DIRECT_RADIANCE else -1
    plain = Transport({"type": kind, "max_depth": depth, "rr_depth": NO_ROULETTE}, "independent", 256)
    means, errors = [], []
    for chosen, first in ((how, 0), (plain, 100)):
        loaded = load_description(description, chosen)
        drawn = [
            to_array(mi.render(loaded, spp=chosen.spp, seed=batch_seed(first, k))).mean() for k in range(8)
        ]
        means.append(np.mean(drawn))
        errors.append(np.std(drawn, ddof=1) / math.sqrt(8))
    noise = math.hypot(*errors)
    assert noise < 0.02 * means[1]
    assert abs(means[0] - means[1]) < 4 * noise + 1e-4 * means[1]


def test_a_biased_sampler_would_be_seen():
    """`ldsampler` loses light in a valley: why no rule chooses it."""
    description = Valley().mitsuba(16)
    chosen = integrator(description, RADIANCE)
    means = []
    for name in ("ldsampler", "independent"):
        loaded = load_description(description, Transport(chosen, name, 64))
        means.append(
            np.mean([to_array(mi.render(loaded, spp=64, seed=batch_seed(1, k))).mean() for k in range(16)])
        )
    assert means[0] < 0.99 * means[1]


@pytest.mark.parametrize(
    "made", [SphereOverPlane(), CloudSphere(optical_depth=4.0)], ids=lambda x: type(x).__name__
)
def test_intervals_of_batches_hold_in_repeated_runs(made):
    """95 % intervals of whole images from 8 batches, against the mean of all 32 runs."""
    draw = sample(made, RADIANCE, 8)
    runs = np.array([[draw(16, batch_seed(r, k)).mean() for k in range(8)] for r in range(32)])
    half = stats.t.ppf(0.975, 7) * runs.std(axis=1, ddof=1) / math.sqrt(8)
    held = np.abs(runs.mean(axis=1) - runs.mean()) < half
    assert held.sum() >= stats.binom.ppf(1e-3, 32, 0.95)
    said = runs.std(axis=1, ddof=1).mean() / math.sqrt(8)
    assert runs.mean(axis=1).std(ddof=1) == pytest.approx(said, rel=0.4)


@pytest.mark.parametrize(("seeds", "bound"), [("in a row", None), ("scattered", 0.03)])
def test_neighbouring_pixels_of_different_batches_share_no_noise(seeds, bound):
    """Mitsuba's strata repeat a pixel further on at seed + spp."""
    draw, spp = sample(Valley(), RADIANCE, 16), 16
    chosen = range(2 * spp) if seeds == "in a row" else [batch_seed(1, k) for k in range(2 * spp)]
    drawn = np.stack([draw(spp, s)[..., 0] for s in chosen])
    noise = (drawn - drawn.mean(axis=0)) / drawn.std(axis=0)
    shared = float((noise[:spp, :, 1:] * noise[spp:, :, :-1]).mean())
    assert shared > 0.2 if bound is None else abs(shared) < bound
