"""What every scene must do, generated from its declaration: nothing here names a scene."""

import math

import mitsuba as mi
import numpy as np
import pytest

from reference.render import batch_seed, load_scene, to_array, variant_of
from reference.toolchain import other_variant
from reference.transport import integrator
from scenes.contract import RADIANCE, BadInput, all_scenes, make_scene
from scenes.export import export

SCENES = list(all_scenes().values())


@pytest.mark.parametrize("scene", SCENES, ids=lambda s: s.__name__)
def test_mitsuba_renders_the_exported_file_to_the_same_image(scene, tmp_path):
    made = scene(**({"optical_depth": 1.0} if "optical_depth" in scene.axes() else {}))
    with other_variant(variant_of(made)):
        description = made.mitsuba(24)
        whole = {**description, "integrator": integrator(description, RADIANCE)}
        exported = mi.load_file(str(export(whole, tmp_path, "scene")))
        ours = load_scene(made, RADIANCE, 24)
        a, b = (
            np.stack([to_array(mi.render(s, spp=64, seed=batch_seed(first, k))) for k in range(4)])
            for s, first in ((exported, 1), (ours, 2))
        )
    noise = math.sqrt((a.var(axis=0, ddof=1).mean() + b.var(axis=0, ddof=1).mean()) / (4 * a[0].size))
    assert a.mean() == pytest.approx(b.mean(), abs=5 * noise + 2e-4 * b.mean())
    blocks = (a.mean(axis=0) - b.mean(axis=0)).reshape(6, 4, 6, 4, 3).mean(axis=(1, 3, 4))
    spread = np.sqrt(((a.var(0, ddof=1) + b.var(0, ddof=1)) / 4).reshape(6, 4, 6, 4, 3).sum((1, 3, 4))) / 48
    assert np.mean(np.abs(blocks) > 4 * math.sqrt(3) * spread + 5e-3 * b.mean()) < 0.06


@pytest.mark.parametrize("scene", SCENES, ids=lambda s: s.__name__)
def test_every_axis_holds_its_default_and_refuses_what_lies_beyond(scene):
    assert scene.axes()
    for name, axis in scene.axes().items():
        assert axis.low <= getattr(scene(), name) <= axis.high
        for value in (axis.low - 1, axis.high + 1, math.nan, "many"):
            with pytest.raises(BadInput, match=name):
                make_scene(scene.__name__, {name: value})


@pytest.mark.parametrize("scene", SCENES, ids=lambda s: s.__name__)
def test_a_view_has_one_camera_ray_per_pixel_of_unit_length(scene):
    camera = scene().view(16).camera
    w = np.array(camera.direction)
    assert w.shape == (3, 256)
    assert np.allclose(np.linalg.norm(w, axis=0), 1, atol=1e-5)


@pytest.mark.parametrize("scene", SCENES, ids=lambda s: s.__name__)
def test_twice_the_light_is_twice_every_source_of_the_view(scene):
    view = scene().view(8)
    bright = view.brighter(2)
    for part in ("sun", "sky", "fog", "fragments"):
        assert (getattr(view, part) is None) == (getattr(bright, part) is None)
    if view.sun:
        assert bright.sun.irradiance == 2 * view.sun.irradiance
    if view.fragments:
        assert np.allclose(bright.fragments.background, 2 * np.array(view.fragments.background))
