"""The store says what lies in it and who uses it, and lets go only what nobody can use."""

import shutil

import pytest

from compare import inventory
from reference import store
from reference.store import Demand, obtain
from scenes.contract import RADIANCE
from scenes.sunlit import Valley


@pytest.fixture(autouse=True)
def folders(tmp_path, monkeypatch):
    monkeypatch.setenv("LIGHTPROOF_STORE", str(tmp_path / "store"))
    monkeypatch.setattr(store, "SHIPPED", tmp_path / "shipped")
    (tmp_path / "shipped").mkdir()
    return tmp_path / "store", tmp_path / "shipped"


def render(scene, size):
    _, key = obtain(scene, RADIANCE, size, demand=Demand(0, batches=4))
    return store.user_store() / store.file_name(scene, RADIANCE, size, key)


def states(rows):
    return {r["file"]: r["state"] for r in rows}


def test_a_truth_of_a_profile_names_its_users_and_another_has_none():
    used, unused = render(Valley(), 128), render(Valley(), 16)
    rows = {r["file"]: r for r in inventory.inventory()}
    assert {"ambient_aperture", "constant_ambient", "path_tracer"} <= set(rows[used.name]["used by"])
    assert rows[unused.name]["used by"] == []
    assert rows[used.name]["state"] == "good"
    assert 0 < rows[used.name]["resolution"] < rows[used.name]["pixel noise"] < 1


def test_prune_lets_go_what_cannot_be_used_and_keeps_the_rest(folders):
    own, shipped = folders
    used, unused = render(Valley(), 128), render(Valley(), 16)
    foreign = own / "Valley-radiance-16-0000000000000000.exr"
    shutil.copy(unused, foreign)
    damaged = own / "Valley-radiance-17-0000000000000000.exr"
    damaged.write_text("no image")
    doubled = render(Valley(slope=30), 16)
    shutil.copy(doubled, shipped / doubled.name)
    planned = {r["file"]: r["why"] for r in inventory.prune(unused=False, dry_run=True)}
    assert set(planned) == {foreign.name, damaged.name, doubled.name}
    assert "other code" in planned[foreign.name] and "damaged" in planned[damaged.name]
    assert foreign.is_file()
    assert {r["file"] for r in inventory.prune(unused=False, dry_run=False)} == set(planned)
    assert sorted(p.name for p in own.iterdir()) == sorted([used.name, unused.name])
    assert (shipped / doubled.name).is_file()
    assert [r["file"] for r in inventory.prune(unused=True, dry_run=False)] == [unused.name]
    assert [p.name for p in own.iterdir()] == [used.name]
