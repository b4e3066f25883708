"""Truths on disk: whole or not at all, never another question's, never damaged ones."""

import multiprocessing
import os

import numpy as np
import pytest

from reference import render, store
from reference.transport import Effort, integrator
from scenes.contract import DIRECT_RADIANCE, RADIANCE, SINGLE_SCATTERING, BadInput
from scenes.sunlit import SphereOverPlane

SCENE = SphereOverPlane(light_radius=0.3)


@pytest.fixture(autouse=True)
def own_store(tmp_path, monkeypatch):
    monkeypatch.setenv("LIGHTPROOF_STORE", str(tmp_path / "store"))
    return tmp_path / "store"


@pytest.fixture
def truth(rng):
    batches = rng.lognormal(0, 0.3, size=(16, 12, 12, 3)) * np.array([1.0, 2.0, 0.5])
    return render.from_batches(batches)


def test_what_is_read_is_what_was_written_far_below_the_noise(truth, tmp_path):
    path = tmp_path / "t.exr"
    store.save(path, truth, "k")
    again = store.load(path, "k")
    error = np.sqrt(truth.variance)
    assert np.abs(again.mean - truth.mean).max() <= (error / 8).max() * 1.001
    assert np.allclose(np.sqrt(again.variance), error, rtol=0.035)
    assert np.allclose(again.correlation, truth.correlation, atol=1e-6)
    assert again.batches == 16
    assert again.provenance["heaviest_tail"] == truth.provenance["heaviest_tail"]


def test_a_flipped_byte_anywhere_is_named_or_leaves_the_truth_as_it_was(truth, tmp_path):
    path = tmp_path / "t.exr"
    store.save(path, truth, "k")
    whole, sound = path.read_bytes(), store.load(path, "k")
    named = 0
    for at in range(9, len(whole), len(whole) // 150):
        data = bytearray(whole)
        data[at] ^= 0x5A
        path.write_bytes(data)
        try:
            again = store.load(path, "k")
        except store.DamagedTruth as damage:
            named += "t.exr" in str(damage)
            continue
        assert np.array_equal(again.mean, sound.mean) and again.provenance == sound.provenance
    assert named > 120


def test_a_cut_file_and_another_file_are_found_and_named(truth, tmp_path):
    path = tmp_path / "t.exr"
    store.save(path, truth, "k")
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(store.DamagedTruth, match="cut short"):
        store.load(path)
    path.write_text("not an image")
    with pytest.raises(store.DamagedTruth, match="not an EXR"):
        store.load(path)


def test_the_truth_of_another_question_is_refused(truth, tmp_path):
    store.save(tmp_path / "t.exr", truth, "k")
    with pytest.raises(store.DamagedTruth, match="another question"):
        store.load(tmp_path / "t.exr", "other")


def test_a_damaged_truth_is_named_and_replaced_never_used(own_store, monkeypatch):
    monkeypatch.setattr(store, "effort", lambda description, size: Effort(4, 4))
    first, key = store.obtain(SCENE, DIRECT_RADIANCE, 16)
    path = own_store / store.file_name(SCENE, DIRECT_RADIANCE, 16, key)
    data = bytearray(path.read_bytes())
    data[-30] ^= 1
    path.write_bytes(data)
    heard = []
    again, _ = store.obtain(SCENE, DIRECT_RADIANCE, 16, warn=heard.append)
    assert len(heard) == 1 and path.name in heard[0]
    assert np.array_equal(first.mean, again.mean)
    assert store.load(path, key)


def test_the_key_depends_on_scene_quantity_size_effort_and_seed():
    def key(scene=SCENE, quantity=RADIANCE, size=16, how=None):
        return store.truth_key(scene, quantity, size, how or Effort())

    others = [
        key(scene=SphereOverPlane(light_radius=0.31)),
        key(quantity=DIRECT_RADIANCE),
        key(size=32),
        key(how=Effort(spp=65)),
        key(how=Effort(batches=17)),
        key(how=Effort(seed=2)),
    ]
    assert key() == key()
    assert len({key(), *others}) == 7


def test_a_quantity_that_the_scene_lacks_is_refused_by_name():
    with pytest.raises(BadInput, match="has no single_scattering: it has radiance, direct_radiance"):
        store.obtain(SCENE, SINGLE_SCATTERING, 16)


def test_nothing_half_written_is_left_when_the_disk_is_full(truth, tmp_path, monkeypatch):
    def full(path):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(store, "read_exr", full)
    with pytest.raises(store.CannotWrite, match="No space left"):
        store.save(tmp_path / "t.exr", truth, "k")
    assert not list(tmp_path.iterdir())


def test_what_a_killed_writer_left_is_swept_and_a_living_one_left_alone(tmp_path):
    child = multiprocessing.get_context("fork").Process(target=int)
    child.start()
    child.join()
    dead, living, whole = (
        tmp_path / name for name in (f".t.exr.{child.pid}", f".t.exr.{os.getpid()}", "t.exr")
    )
    for path in (dead, living, whole):
        path.write_text("x")
    store.sweep(tmp_path)
    assert sorted(tmp_path.iterdir()) == sorted([living, whole])


def write(path):
    rng = np.random.default_rng(os.getpid())
    truth = render.from_batches(rng.normal(1, 0.1, size=(16, 64, 64, 3)))
    for _ in range(10):
        store.save(path, truth, "k")


def test_two_processes_may_write_the_same_truth_at_once(tmp_path):
    path = tmp_path / "t.exr"
    context = multiprocessing.get_context("fork")
    writers = [context.Process(target=write, args=(path,)) for _ in range(2)]
    for w in writers:
        w.start()
    for w in writers:
        w.join()
    assert store.load(path, "k").batches == 16
    assert [p.name for p in tmp_path.iterdir()] == ["t.exr"]


def test_the_integrator_is_the_least_that_is_exact():
    surfaces = {"type": "scene", "a": {"type": "sphere", "bsdf": {"type": "diffuse"}}}
    masked = {"type": "scene", "a": {"type": "rectangle", "bsdf": {"type": "mask"}}}
    fog = {"type": "scene", "a": {"type": "cube", "interior": {"type": "homogeneous"}}}
    assert integrator(surfaces, RADIANCE)["type"] == "path"
    assert integrator(surfaces, DIRECT_RADIANCE)["type"] == "direct"
    assert integrator(masked, RADIANCE)["type"] == "volpath"
    assert integrator(fog, SINGLE_SCATTERING) == {"type": "volpath", "max_depth": 2, "rr_depth": 100000}
    assert integrator(fog, RADIANCE)["rr_depth"] == 100000
