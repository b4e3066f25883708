"""Metal and stone in one texture: against what is known of filtered parameters."""

import dataclasses

import mitsuba as mi
import numpy as np
import pytest

from approximations.area_lights import material_workflows as module
from approximations.area_lights.material_workflows import material_workflows
from reference.closed_form import ball, material_border
from reference.verify.routes_materials import inlay_against_blend
from reference.verify.run import judge
from scenes.material_border import MaterialBorder

SIZE = 32


def image(scene, grow=0, **knobs):
    view = scene.view(SIZE)
    return np.array(material_workflows(view, module.bake(view, grow=grow), **knobs), np.float64).T


def truth(scene):
    return material_border.material_border(scene, SIZE).reshape(-1, 3)


@pytest.mark.parametrize("scene", [MaterialBorder(), MaterialBorder(mip=2), MaterialBorder(turn=0.0)])
def test_halo_is_the_product_of_shares_and_differences(scene):
    """t (1 - t) (g - s) (E_diffuse - E_specular), to float32."""
    halo = material_border.halo(scene, SIZE).reshape(-1, 3)
    np.testing.assert_allclose(image(scene) - truth(scene), halo, atol=2e-4 * truth(scene).max())


def test_halo_is_greatest_where_half_is_metal():
    scene = MaterialBorder(sharpness=0.1)
    t = material_border.parts(scene, SIZE)[1]
    halo = np.abs(material_border.halo(scene, SIZE).reshape(-1, 3))[:, :1]
    assert abs(t[halo.argmax()] - 0.5) < 0.1
    assert halo[(t == 0) | (t == 1)].max() == 0


def test_halo_is_bright_under_diffuse_light_and_dull_under_a_mirrored_lobe():
    """Red of gold exceeds that of stone, blue does not."""
    added = {
        turn: image(MaterialBorder(turn=turn)) - truth(MaterialBorder(turn=turn)) for turn in (0.0, 47.0)
    }
    assert added[0.0][:, 0].sum() > 0 > added[0.0][:, 2].sum()
    assert added[47.0][:, 0].sum() < 0 < added[47.0][:, 2].sum()


def test_there_is_no_halo_where_all_light_is_alike():
    scene = MaterialBorder(contrast=0.0)
    np.testing.assert_allclose(image(scene), truth(scene), rtol=2e-3)


def test_specular_colours_may_be_filtered():
    for scene in (MaterialBorder(), MaterialBorder(mip=3)):
        np.testing.assert_allclose(image(scene, workflow="specular"), truth(scene), rtol=2e-3)
        assert np.allclose(image(scene, workflow="specular"), image(scene, workflow="exact"), rtol=1e-5)


def test_a_smaller_mask_leaves_metal_colour_to_the_diffuse_layer():
    """Red where gold is read as albedo, by up to the whole of what gold exceeds stone."""
    scene = MaterialBorder(contrast=0.0)
    added = image(scene, grow=-1) - truth(scene)
    assert np.abs(added).max() < 0.05
    dull = image(MaterialBorder(), grow=-1) - truth(MaterialBorder())
    assert dull[:, 0].min() < 2 * (image(MaterialBorder()) - truth(MaterialBorder()))[:, 0].min()


def test_irradiance_is_that_of_the_lobe():
    scene = MaterialBorder()
    known = ball.irradiance(scene.environment(), np.array([[0.0, 0.0, 1.0]]))[0]
    np.testing.assert_allclose(np.array(module.irradiance(scene.view(16))).ravel(), known, rtol=1e-3)


def test_textures_are_read_between_their_texels():
    texels = np.arange(16.0).reshape(4, 4, 1)
    u, v = np.array([0.0, 0.3, 0.5, 0.9, 1.0]), np.array([0.1, 0.9, 0.5, 0.2, 1.0])
    at = mi.Point2f(u.astype(np.float32), v.astype(np.float32))
    for level in (0, 1):
        k = 2**level
        mean = texels.reshape(4 // k, k, 4 // k, k).mean(axis=(1, 3))
        known = material_border.bilinear(mean, u, v)
        np.testing.assert_allclose(np.array(module.texture(texels, level).eval(at)[0]), known, atol=1e-5)


def test_twice_the_light_is_twice_the_halo():
    view = dataclasses.replace(MaterialBorder().view(16))
    maps = [module.bake(v) for v in (view, view.brighter(2.0))]
    a, b = (np.array(material_workflows(v, m)) for v, m in zip((view, view.brighter(2.0)), maps, strict=True))
    np.testing.assert_allclose(b, 2 * a, rtol=1e-5)


def test_closed_form_agrees_with_a_blend_in_mitsuba():
    assert [judge(c, 1e-3)["verdict"] for c in inlay_against_blend(1)] == ["agrees"] * 2
