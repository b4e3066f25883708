"""Truths of visibility and of light by other surfaces, against closed forms and sums."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from reference.closed_form import caps
from reference.render import load_scene, render_once, sample
from reference.truth import box_filter
from reference.visibility import light_point, sky_visibility
from scenes.contract import DIRECT_RADIANCE, INDIRECT_RADIANCE, ONE_BOUNCE, RADIANCE, AreaLight
from scenes.mitsuba_parts import area_light, glossy
from scenes.sunlit import SphereOverPlane


def mean_of(scene, quantity, size=16, spp=1024):
    return render_once(load_scene(scene, quantity, size), spp, 7)[..., 0]


def test_sky_beside_a_sphere_is_as_open_as_the_closed_form():
    scene, size, fine = SphereOverPlane(), 16, 16
    p = np.array(scene.view(size * fine).surface.position).T
    ground = np.abs(p[:, 2]) < 1e-3
    exact = np.where(ground, caps.openness_beside_sphere(np.hypot(p[:, 0], p[:, 1]), 1.0), 0)
    exact, whole = (
        box_filter(np.reshape(x, (size * fine, size * fine, 1)).astype(float), fine)[..., 0]
        for x in (exact, ground)
    )
    found = sky_visibility(scene, size, 1024, 3)[..., 0]
    assert np.abs(found - exact)[whole == 1].max() < 0.06
    assert np.mean((found - exact)[whole == 1]) == pytest.approx(0, abs=2e-3)


def test_direct_and_indirect_light_are_all_of_it():
    scene = SphereOverPlane(albedo=0.8)
    whole = mean_of(scene, RADIANCE)
    parts = mean_of(scene, DIRECT_RADIANCE) + mean_of(scene, INDIRECT_RADIANCE)
    lit = np.isfinite(np.array(scene.view(16).surface.distance)).reshape(16, 16)
    assert parts[lit].mean() == pytest.approx(whole[lit].mean(), rel=3e-3)


def test_one_bounce_goes_with_the_square_of_the_albedo():
    dark, bright = (mean_of(SphereOverPlane(albedo=a), ONE_BOUNCE) for a in (0.2, 0.8))
    assert bright.mean() == pytest.approx(16 * dark.mean(), rel=5e-3)
    assert mean_of(SphereOverPlane(albedo=0.8), INDIRECT_RADIANCE).mean() > 1.05 * bright.mean()


SHAPES = [
    AreaLight("sphere", [0.3, 0, 2], [0.4, 0, 0], [0, 0.4, 0], 3.0),
    AreaLight("disk", [0.3, 0, 2], [0, 0.5, 0], [0.5, 0, 0], 3.0),
    AreaLight("rectangle", [0.3, 0, 2], [0, 0.7, 0], [0.3, 0, 0], 3.0),
    AreaLight("tube", [0.3, 0, 2], [0.6, 0.2, 0], [0, 0, 0.1], 3.0),
]


@pytest.mark.parametrize("light", SHAPES, ids=lambda light: light.shape)
def test_points_of_a_light_lie_on_the_shape_that_glows(light):
    shape = mi.load_dict(area_light(light))
    random = mi.load_dict({"type": "independent"})
    random.seed(1, 512)
    p = light_point(light, random.next_2d())
    ours, theirs = np.array(p), np.array(shape.sample_position(0.0, random.next_2d()).p)
    np.testing.assert_allclose(ours.mean(axis=1), theirs.mean(axis=1), atol=0.12)
    np.testing.assert_allclose(np.cov(ours), np.cov(theirs), atol=0.05)
    down = mi.Ray3f([0.3, 0.0, -1.0], [0, 0, 1])
    hit = shape.ray_intersect(down) if light.shape != "tube" else None
    if hit is not None:
        assert np.allclose(np.array(hit.emitter(mi.load_dict({"type": "scene", "s": shape})).eval(hit)), 3)


def test_glossy_is_the_sum_of_its_parts():
    si = mi.SurfaceInteraction3f()
    wi, wo = mi.Vector3f(0.5, 0, 3**0.5 / 2), mi.Vector3f(-0.6, 0.2, 0.6**0.5)
    si.wi, si.sh_frame = wi, mi.Frame3f([0, 0, 1])
    both = mi.load_dict(glossy(0.3, [0.1, 0.2, 0.4], 0.3)).eval(mi.BSDFContext(), si, wo)
    lobe = mi.load_dict(glossy(0.0, 1.0, 0.3)).eval(mi.BSDFContext(), si, wo)
    expected = 0.3 / np.pi * 0.6**0.5 + np.array([0.1, 0.2, 0.4]) * np.array(lobe)[:, 0]
    np.testing.assert_allclose(np.array(both)[:, 0], expected, rtol=1e-5)


def test_samplers_of_visibility_serve_every_scene():
    from reference.truth import find_sampler
    from scenes.contract import SKY_VISIBILITY

    assert find_sampler(SphereOverPlane, SKY_VISIBILITY) is sky_visibility
    assert sample(SphereOverPlane(), SKY_VISIBILITY, 8)(16, 1).shape == (8, 8, 1)


def test_a_mirror_beside_a_diffuse_part_sends_back_what_both_do():
    """Mitsuba's blend of a true mirror with a diffuse part would give 0.318."""
    plane = {"type": "rectangle", "bsdf": glossy(0.2, 0.1, 0.0)}
    sky = {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}}
    integrator = {"type": "path", "max_depth": 2}
    world = mi.load_dict({"type": "scene", "plane": plane, "sky": sky, "integrator": integrator})
    n = 1 << 18
    random = mi.load_dict({"type": "independent"})
    random.seed(3, n)
    eye, way = mi.Point3f(0.5, 0.5, 0.65), mi.Vector3f(-0.5205, -0.5205, -0.6767)
    ray = mi.RayDifferential3f(eye + dr.zeros(mi.Point3f, n), dr.normalize(way))
    found = np.array(world.integrator().sample(world, random, ray)[0])
    assert found.mean() == pytest.approx(0.3, rel=0.01)
