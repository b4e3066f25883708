"""A verification catches what it says that it catches: faults seeded into truths and checks must be named."""

import json
from dataclasses import replace

import numpy as np
import pytest

from lightproof import main
from reference import store
from reference.moments import from_batches
from reference.render import batch_seed, sample
from reference.store import Demand, obtain
from reference.transport import transport
from reference.verify import run as verification
from reference.verify.agreement import Sampled
from reference.verify.checks import CHECKS, Check, Comparison
from scenes.cloud import CloudSphere
from scenes.contract import RADIANCE, BadInput
from scenes.sunlit import SphereOverPlane, Valley

SIZE = 32


@pytest.fixture(autouse=True)
def own_store(tmp_path, monkeypatch):
    monkeypatch.setenv("LIGHTPROOF_STORE", str(tmp_path / "store"))
    monkeypatch.setattr(store, "SHIPPED", tmp_path / "none shipped")
    return tmp_path / "store"


def stored(scene, change=lambda image: image, how=None, batches=16, quantity=RADIANCE, seed=1):
    """A truth in the store under its right name, its batches drawn by another transport or changed."""
    spp = (how or transport(scene.mitsuba(SIZE), quantity, SIZE)).spp
    draw = sample(scene, quantity, SIZE, how)
    truth = from_batches(np.stack([change(draw(spp, batch_seed(seed, k))) for k in range(batches)]))
    honest, key = obtain(scene, quantity, SIZE, demand=Demand(0, batches=4), seed=seed)
    path = store.user_store() / store.file_name(scene, quantity, SIZE, key)
    truth.provenance.update({k: v for k, v in honest.provenance.items() if k not in truth.provenance})
    store.save(path, truth, key)
    return path


def verdict(path, seed=1):
    (row,) = verification.rows_of_file(path, seed, verification.SIGNIFICANCE)
    return row


def test_an_honest_truth_is_proved_and_the_power_is_stated():
    row = verdict(stored(Valley()))
    assert row["verdict"] == "agrees"
    assert row["catches"] < 0.01
    assert row["tests"] > SIZE * SIZE


def tilted(image):
    """What a cosine to the power 1.02 would do to a surface lit at all angles: a slope of 2 % over it."""
    return image * (1 + 0.02 * np.linspace(0, 1, image.shape[0])[:, None, None])


FAULTS = {
    "1 % of the energy is lost": lambda image: 0.99 * image,
    "a wrong cosine": tilted,
    "the grid is shifted by one pixel": lambda image: np.roll(image, 1, axis=1),
    "the picture is mirrored": lambda image: image[:, ::-1],
    "one 8 x 8 block is 3 % too bright": lambda image: (
        image * (1 + 0.03 * np.pad(np.ones((8, 8, 1)), ((4, SIZE - 12), (9, SIZE - 17), (0, 0))))
    ),
    "red and blue are exchanged, 1 % apart": lambda image: image * np.array([0.995, 1.0, 1.005]),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_a_stored_truth_is_caught(fault):
    row = verdict(stored(SphereOverPlane(), FAULTS[fault]))
    assert row["verdict"] == "differs", row


def test_a_biased_roulette_is_caught():
    """Paths of a conservative cloud that are cut at 10 turns and not weighed up for it: 3 % of the light."""
    scene = CloudSphere(optical_depth=4.0, g=0.2)
    how = transport(scene.mitsuba(SIZE), RADIANCE, SIZE)
    cut = replace(how, integrator=how.integrator | {"max_depth": 10})
    assert verdict(stored(scene, how=cut))["verdict"] == "differs"


def test_half_a_pixel_is_caught(monkeypatch):
    """The film's grid shifted by half a pixel: the render's own fault, not a roll of the array."""
    honest = SphereOverPlane.mitsuba

    def shifted(self, size=128):
        description = honest(self, size)
        sensor = description["sensor"]
        return description | {"sensor": sensor | {"principal_point_offset_x": 0.5 / size}}

    scene = SphereOverPlane()
    draw = sample(scene, RADIANCE, SIZE)
    with monkeypatch.context() as patch:
        patch.setattr(SphereOverPlane, "mitsuba", shifted)
        moved = sample(scene, RADIANCE, SIZE)
    assert not np.allclose(moved(16, 1), draw(16, 1))
    spp = transport(scene.mitsuba(SIZE), RADIANCE, SIZE).spp
    path = stored(scene)
    truth = from_batches(np.stack([moved(spp, batch_seed(1, k)) for k in range(16)]))
    about = store.load(path).provenance
    truth.provenance.update({k: v for k, v in about.items() if k not in truth.provenance})
    store.save(path, truth, about["key"])
    assert verdict(path)["verdict"] == "differs"


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_variance_that_is_not_that_of_the_batches_is_caught(factor):
    path = stored(Valley())
    truth = store.load(path)
    truth.variance[:] *= factor
    store.save(path, truth, truth.provenance["key"])
    row = verdict(path)
    assert row["verdict"] == "differs" and row["where"] == "the variance"


def test_honest_truths_raise_no_alarm_in_repeated_runs():
    path = stored(SphereOverPlane())
    alarms = sum(verdict(path, seed)["verdict"] != "agrees" for seed in range(2, 14))
    assert alarms <= 1  # 0.12 expected


def test_damaged_and_foreign_files_are_named(own_store):
    path = stored(Valley(), batches=4)
    data = bytearray(path.read_bytes())
    data[-30] ^= 1
    path.write_bytes(data)
    assert verdict(path)["verdict"] == "damaged"
    other = own_store / "Valley-radiance-32-0000000000000000.exr"
    path.unlink()
    stored(Valley(), batches=4).rename(other)
    row = verdict(other)
    assert row["verdict"] == "not used" and "prune" in row["note"]


@pytest.fixture
def own_checks(monkeypatch):
    """Three checks in place of the real ones: one that holds, one that does not, one that cannot be made."""
    verification.all_checks()

    def refuses(seed):
        raise BadInput("no such light")

    one = Sampled.exact(1.0)
    functions = {
        "holds": lambda seed: Comparison("unity", one, one),
        "fails": lambda seed: [Comparison("unity", one, one), Comparison("more", Sampled.exact(1.01), one)],
        "refuses": refuses,
    }
    made = {n: Check(n, "physics", f"{n}", ("a", "b"), f) for n, f in functions.items()}
    for name in list(CHECKS):
        monkeypatch.delitem(CHECKS, name)
    CHECKS.update(made)
    yield CHECKS
    for name in made:
        CHECKS.pop(name, None)


@pytest.mark.parametrize(
    ("names", "code"), [(["holds"], 0), (["fails"], 1), (["refuses"], 3), (["physics"], 1)]
)
def test_verdicts_and_exit_codes(own_checks, tmp_path, names, code):
    rows = verification.verify(names, tmp_path)
    assert verification.exit_code(rows) == code
    saved = json.loads((tmp_path / "verification.json").read_text())
    assert saved["rows"] == json.loads(json.dumps(rows))


def test_what_is_proved_is_not_proved_again_unless_asked(own_checks, tmp_path, monkeypatch):
    calls = []
    function = own_checks["holds"].function
    counted = Check(
        "holds", "physics", "holds", ("a", "b"), lambda seed: calls.append(seed) or function(seed)
    )
    monkeypatch.setitem(own_checks, "holds", counted)
    verification.verify(["holds"], tmp_path)
    verification.verify(["holds"], tmp_path)
    assert calls == [1]
    verification.verify(["holds"], tmp_path, again=True)
    verification.verify(["holds"], tmp_path, seed=2)
    assert calls == [1, 1, 2]


def test_a_row_per_kind_says_how_many_agree(own_checks, tmp_path):
    (row,) = verification.totals(verification.verify(["physics"], tmp_path))
    assert (row["truths"], row["agree"]) == (4, 2)


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ("reference verify Vally", 2, "Valley"),
        ("reference verify nowhere.exr", 2, "no such file"),
        ("reference verify stored", 2, "nothing to verify"),
    ],
)
def test_mistakes_are_one_line(words, code, said, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["lightproof", *words.split()])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == code
    line = capsys.readouterr().err
    assert said in line and "Traceback" not in line
