"""An overcast layer seen from below, dry and in rain: CloudSlab with its rain, and how dark the base gets."""

import numpy as np
import pytest

from approximations.clouds.cloud_light import cloud_light
from approximations.clouds.diffusion_cloud import bake, diffusion_light
from reference.slab_monte_carlo import slab_fluxes
from scenes.cloud import CloudSlab

PHOTONS = 4000


def overcast(**fields):
    return CloudSlab(**{"seen": "below", "sun_elevation": 90.0, **fields})


def let_through(scene, rng):
    """Share of the sun's light that leaves at the base, and its standard error at most."""
    depth, albedo = scene.rainy
    through = slab_fluxes(depth, scene.to_sun()[2], albedo, scene.g, PHOTONS, rng)[1]
    return through, np.sqrt(max(through, 1 / PHOTONS) / PHOTONS)


def base(technique, scene, *baked):
    """Mean radiance of the base."""
    return np.array(technique(scene.view(16), *baked), np.float64)[0].mean()


def test_rain_of_four_on_a_layer_of_eight_is_a_layer_of_thirty_two(rng):
    """(checked) T = 0.272."""
    through, error = let_through(overcast(optical_depth=8.0, precipitation=4.0), rng)
    assert through == pytest.approx(0.272, abs=4 * error + 0.001)


def test_absorbing_rain_is_black_where_denser_rain_lets_a_quarter_pass(rng):
    """Albedo 1 / p: what p = 4 leaves of a layer of 8 is nothing."""
    denser, absorbing = (
        let_through(overcast(optical_depth=8.0, precipitation=4.0, rain=r), rng)[0]
        for r in ("denser", "absorbing")
    )
    assert denser > 0.24 and absorbing < 1e-3


def test_the_rain_gain_darkens_a_base_far_more_than_denser_rain_does(rng):
    """Wet over dry: 0.42 in truth at p = 4, 0.48 of radiance by diffusion; the curve's e^-(d p) has 0.005."""
    dry, wet = (overcast(optical_depth=8.0, precipitation=p) for p in (1.0, 4.0))
    exact = let_through(wet, rng)[0] / let_through(dry, rng)[0]
    diffused = [base(diffusion_light, s, bake(s.view(2))) for s in (dry, wet)]
    curve = [base(cloud_light, s) for s in (dry, wet)]
    assert diffused[1] / diffused[0] == pytest.approx(exact, rel=0.2)
    assert curve[1] / curve[0] == pytest.approx(0.0049, rel=0.1)
