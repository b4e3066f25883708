"""Truths on disk: whole or not at all, never another question's, never damaged ones."""

import importlib
import multiprocessing
import os

import numpy as np
import pytest

from reference import moments, render, store
from reference import truth as truths
from reference.store import Demand
from scenes.contract import DIRECT_RADIANCE, RADIANCE, SINGLE_SCATTERING, BadInput
from scenes.sunlit import SphereOverPlane, Valley

SCENE = SphereOverPlane(light_radius=0.3)
FEW = Demand(0, batches=4)


@pytest.fixture(autouse=True)
def own_store(tmp_path, monkeypatch):
    monkeypatch.setenv("LIGHTPROOF_STORE", str(tmp_path / "store"))
    return tmp_path / "store"


@pytest.fixture
def truth(rng):
    batches = rng.lognormal(0, 0.3, size=(16, 12, 12, 3)) * np.array([1.0, 2.0, 0.5])
    return moments.from_batches(batches)


def test_what_is_read_is_what_was_written_far_below_the_noise(truth, tmp_path):
    path = tmp_path / "t.exr"
    store.save(path, truth, "k")
    again = store.load(path, "k")
    error = np.sqrt(truth.variance)
    assert np.abs(again.mean - truth.mean).max() <= (error / 8).max() * 1.001
    assert np.allclose(np.sqrt(again.variance), error, rtol=0.035)
    assert np.allclose(again.correlation, truth.correlation, atol=1e-6)
    assert again.batches == 16
    assert again.provenance["rare_paths"] == truth.provenance["rare_paths"]
    assert again.resolution() == pytest.approx(truth.resolution(), rel=0.02)


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


def test_a_damaged_truth_is_named_and_replaced_never_used(own_store):
    first, key = store.obtain(SCENE, DIRECT_RADIANCE, 16, demand=FEW)
    path = own_store / store.file_name(SCENE, DIRECT_RADIANCE, 16, key)
    data = bytearray(path.read_bytes())
    data[-30] ^= 1
    path.write_bytes(data)
    heard = []
    again, _ = store.obtain(SCENE, DIRECT_RADIANCE, 16, demand=FEW, warn=heard.append)
    assert len(heard) == 1 and path.name in heard[0]
    assert np.array_equal(first.mean, again.mean)
    assert store.load(path, key)


def test_the_key_depends_on_scene_quantity_size_transport_and_seed(monkeypatch):
    def key(scene=SCENE, quantity=RADIANCE, size=16, seed=1):
        return store.truth_key(scene, quantity, size, seed)

    plain = key()
    others = [
        key(scene=SphereOverPlane(light_radius=0.31)),
        key(quantity=DIRECT_RADIANCE),
        key(size=32),
        key(seed=2),
    ]
    assert key() == plain
    monkeypatch.setattr("reference.transport.MOST_SPP", 64)
    assert len({plain, key(), *others}) == 6


def test_what_is_stored_is_continued_to_the_pixels_that_one_sitting_gives(own_store, monkeypatch):
    drawn = []
    real = render.render_batches

    def counted(scene, quantity, size, first, count, *rest):
        drawn.append((first, count))
        return real(scene, quantity, size, first, count, *rest)

    monkeypatch.setattr(render, "render_batches", counted)
    store.obtain(SCENE, DIRECT_RADIANCE, 16, demand=Demand(0, batches=8))
    grown, key = store.obtain(SCENE, DIRECT_RADIANCE, 16, demand=Demand(0, batches=24))
    assert drawn == [(0, 4), (4, 4), (8, 8), (16, 8)]
    assert grown.batches == 24
    (own_store / store.file_name(SCENE, DIRECT_RADIANCE, 16, key)).unlink()
    whole, _ = store.obtain(SCENE, DIRECT_RADIANCE, 16, demand=Demand(0, batches=24))
    assert np.array_equal(grown.mean, whole.mean) and np.array_equal(grown.variance, whole.variance)
    drawn.clear()
    again, _ = store.obtain(SCENE, DIRECT_RADIANCE, 16, demand=Demand(0, batches=16))
    assert not drawn and again.batches == 24


def test_a_render_that_was_interrupted_goes_on_where_it_was(own_store, monkeypatch):
    real = render.render_batches

    def torn(scene, quantity, size, first, *rest):
        if first == 8:
            raise KeyboardInterrupt
        return real(scene, quantity, size, first, *rest)

    monkeypatch.setattr(render, "render_batches", torn)
    with pytest.raises(KeyboardInterrupt):
        store.obtain(SCENE, DIRECT_RADIANCE, 16)
    (path,) = own_store.iterdir()
    assert store.load(path).batches == 8


def test_growth_ends_at_the_resolution_asked_for_or_names_the_budget_that_was_spent():
    first, _ = store.obtain(SCENE, RADIANCE, 16)
    wanted = Demand(first.resolution() / 1.3)
    enough, _ = store.obtain(SCENE, RADIANCE, 16, demand=wanted)
    assert enough.resolution() <= wanted.resolution and wanted.verdict(enough) == "reached"
    assert 16 < enough.batches <= 64
    local = Demand(enough.resolution(8) / 1.2, tile=8, batches=32)
    assert local.unmet(enough, 0.0) == (enough.batches < 32)
    impossible = Demand(1e-9, batches=enough.batches)
    assert impossible.verdict(enough) == "batches spent" and not impossible.unmet(enough, 0.0)
    late = Demand(1e-9, seconds=1.0)
    assert late.verdict(enough) == "time spent" and not late.unmet(enough, 2.0)


@pytest.mark.parametrize("bad", [{"resolution": -1.0}, {"batches": 3}, {"seconds": 0}, {"tile": 0}])
def test_a_demand_that_makes_no_sense_is_refused(bad):
    with pytest.raises(BadInput, match="cannot ask for"):
        Demand(**bad)


def test_a_truth_of_another_mitsuba_is_named_used_and_rendered_anew_when_asked(monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(render.mi, "__version__", "0.1.0")
        store.obtain(SCENE, DIRECT_RADIANCE, 16, demand=FEW)
    heard = []
    old, _ = store.obtain(SCENE, DIRECT_RADIANCE, 16, demand=FEW, warn=heard.append)
    assert old.provenance["mitsuba"] == "0.1.0"
    assert "Mitsuba 0.1.0" in heard[0] and "--again" in heard[0]
    new, _ = store.obtain(SCENE, DIRECT_RADIANCE, 16, demand=FEW, again=True)
    assert new.provenance["mitsuba"] == render.mi.__version__


def test_a_longer_truth_of_a_faster_process_is_left(truth, tmp_path, rng):
    path = tmp_path / "t.exr"
    store.save(path, truth, "k")
    shorter = moments.from_batches(rng.normal(1, 0.1, size=(8, 12, 12, 3)))
    store.save(path, shorter, "k", over_larger=False)
    assert store.load(path).batches == 16
    store.save(path, shorter, "k")
    assert store.load(path).batches == 8


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
    truth = moments.from_batches(rng.normal(1, 0.1, size=(16, 64, 64, 3)))
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


def test_constants_that_move_probes_are_in_the_key_of_their_truths(monkeypatch):
    from scenes.contract import IRRADIANCE, RADIANCE
    from scenes.rooms import ColouredRoom, IrradianceTrack

    track, room = IrradianceTrack(), ColouredRoom()
    before = [store.truth_key(track, IRRADIANCE, 8), store.truth_key(room, RADIANCE, 8)]
    monkeypatch.setattr(IrradianceTrack, "START", -3.5)
    after = [store.truth_key(track, IRRADIANCE, 8), store.truth_key(room, RADIANCE, 8)]
    assert before[0] != after[0]
    assert before[1] == after[1]


def test_a_closed_form_is_worked_out_once_by_all_who_share_a_folder(tmp_path, monkeypatch):
    scene, calls, filtered = Valley(), [], truths.box_filter
    plain = truths.evaluate_closed_form(scene, DIRECT_RADIANCE, 8)
    monkeypatch.setattr(truths, "box_filter", lambda image, n: calls.append(n) or filtered(image, n))
    monkeypatch.setattr(truths, "_kept", None)
    truths.keep_closed_forms(tmp_path)
    kept = [truths.evaluate_closed_form(scene, DIRECT_RADIANCE, 8) for _ in range(2)]
    assert len(calls) == 1
    assert all(np.array_equal(k.mean, plain.mean) for k in kept)
    other = truths.evaluate_closed_form(Valley(light_elevation=60.0), DIRECT_RADIANCE, 8)
    assert len(calls) == 2
    assert not np.array_equal(other.mean, plain.mean)


def test_a_closed_form_is_worked_out_anew_for_other_code_a_broken_file_or_after_a_month(
    tmp_path, monkeypatch
):
    calls, filtered = [], truths.box_filter
    monkeypatch.setattr(truths, "box_filter", lambda image, n: calls.append(n) or filtered(image, n))
    monkeypatch.setattr(truths, "_kept", None)
    truths.keep_closed_forms(tmp_path)
    truths.evaluate_closed_form(Valley(), DIRECT_RADIANCE, 8)
    monkeypatch.setattr(truths, "_code", lambda: "other")
    truths.evaluate_closed_form(Valley(), DIRECT_RADIANCE, 8)
    assert len(calls) == len(list(tmp_path.iterdir())) == 2
    for path in tmp_path.iterdir():
        path.write_bytes(path.read_bytes()[:100])
    truths.evaluate_closed_form(Valley(), DIRECT_RADIANCE, 8)
    truths.evaluate_closed_form(Valley(), DIRECT_RADIANCE, 8)
    assert len(calls) == 3
    for path in tmp_path.iterdir():
        os.utime(path, (0, 0))
    truths.keep_closed_forms(tmp_path)
    assert not list(tmp_path.iterdir())


SAMPLER = """
SHARE = {share}


def sampled(scene):
    return _drawn(scene) * SHARE


def _drawn(scene):
    return {drawn}


def _beside(scene):
    return {beside}
"""


def test_a_key_changes_with_what_the_sampler_names_and_not_with_what_stands_beside(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)

    def code(name, share=1.0, drawn=1, beside=1):
        (tmp_path / f"{name}.py").write_text(SAMPLER.format(share=share, drawn=drawn, beside=beside))
        return store.code_of(importlib.import_module(name).sampled)

    plain = code("plain_sampler")
    assert code("other_beside", beside=2) == plain
    assert code("other_helper", drawn=2) != plain
    assert code("other_constant", share=2.0) != plain
