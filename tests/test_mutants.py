"""Every sign of every technique is watched by a threshold, and every threshold can fail.

To flip every sign takes minutes, so that what was proved is kept in tests/proven, one digest a module of all
that the proof rests on: a module whose digest still stands has only its first sign flipped, one that changed
is proved again, and `make mutants` keeps the new digests.
"""

import ast
import multiprocessing
import os
from concurrent.futures import TimeoutError as TimedOut
from pathlib import Path

import numpy as np
import pytest
from pebble import ProcessExpired, ProcessPool

from approximations.contract import all_techniques, find_technique
from compare import mutants, worker
from compare.gate import load_thresholds
from compare.measure import evaluate

ALIKE = {
    "height_fog.py: i + offset": "turns the even offsets of a stratified sum into the same ones backwards",
    "split_sum.py: nv * nh + np.sqrt((1 - nv**2) * (1 - nh**2)) * np.cos(phi)": "half a turn about n",
    "sampling.py: mi.Float(i) * GOLDEN_ANGLE + turn": "a random turn to the left is one to the right",
    "cloud_shadow_pass.py: far - near": "longer steps beyond the layer meet nothing there",
    "cloud_shadow_pass.py: mi.Float(i) + 0.5": "the same samples from one step earlier on, in clear air",
    "spherical_shell.py: -1e-6": "no ray is that near the level",
    "spherical_shell.py: b + dr.copysign(dr.safe_sqrt(square), b)": "the same roots, off by a metre or two",
    "spherical_shell.py: o + (start + (i + 0.5) * h) * d": "sheets stand alike before and behind the eye",
    "diffusion_cloud.py: x + grid.cell * c": "the places about a middle lie on both sides alike",
    "cloud_model.py: 2 ** STORAGE[storage] - 1": "257 steps are as coarse as 255; a test counts them",
    "cloud_model.py: -1": "the last of two axes",
    "cloud_model.py: mi.Float(i % size) + 0.5": "wisps move by one of 128 texels, less than bounds tell",
    "cloud_model.py: mi.Float(i // size) + 0.5": "wisps move by one of 128 texels, less than bounds tell",
}
"""Mutants that no image can tell from the original, and why."""

PROVEN = Path(__file__).parent / "proven"

all_techniques()
MODULES = mutants.modules()
KIT = {
    f: [n for n in MODULES.values() if f in mutants.kit_files(find_technique(n[0]))]
    for f in sorted({f for names in MODULES.values() for f in mutants.kit_files(find_technique(names[0]))})
}


@pytest.fixture(scope="module")
def pool():
    with ProcessPool(
        max_workers=2,
        context=multiprocessing.get_context("spawn"),
        initializer=worker.start,
        initargs=("cpu", ()),
    ) as pool:
        yield pool


def unseen(pool, found: list[mutants.Mutant], names: list[str], thresholds: list, unproven: set) -> list:
    """Mutants that pass the gate; thresholds that fail for one leave `unproven`. A crash is seen."""
    passed = []
    for batch in (found[i : i + 4] for i in range(0, len(found), 4)):
        order = sorted(range(len(thresholds)), key=lambda i: i not in unproven)
        asked = [thresholds[i] for i in order]
        futures = [
            pool.schedule(mutants.verdicts, args=(m, names[0], asked, not unproven), timeout=120)
            for m in batch
        ]
        for mutant, future in zip(batch, futures, strict=True):
            try:
                verdicts = future.result()
            except (ProcessExpired, TimedOut):
                continue
            failed = {i for i, v in zip(order, verdicts, strict=False) if v.result == "fail"}
            unproven -= failed
            if not failed:
                passed.append(mutant)
    return passed


def excused(mutant: mutants.Mutant) -> bool:
    return f"{Path(mutant.file).name}: {mutant.text}" in ALIKE


def assert_all_seen(passed: list[mutants.Mutant]) -> None:
    left = [m.label for m in passed if not excused(m)]
    assert not left, "no threshold sees: " + "; ".join(left)


def thresholds_of(names: list[str]) -> list:
    found = [t for t in load_thresholds() if t.technique in names]
    assert found, f"{names} have no thresholds"
    return found


def is_proved(name: str, digest: str) -> bool:
    proof = PROVEN / name
    return "LIGHTPROOF_PROVE" not in os.environ and proof.is_file() and proof.read_text().strip() == digest


def keep(name: str, digest: str) -> None:
    if "LIGHTPROOF_PROVE" in os.environ:
        PROVEN.mkdir(exist_ok=True)
        (PROVEN / name).write_text(digest + "\n")


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("file", MODULES, ids=lambda f: f.stem)
def test_a_flipped_sign_fails_the_gate_and_every_threshold_can_fail(pool, file):
    names = MODULES[file]
    thresholds, found = thresholds_of(names), mutants.mutants(file)
    kits = mutants.kit_files(find_technique(names[0]))
    digest = mutants.digest([file, *kits], names, thresholds)
    if is_proved(file.stem, digest):
        watched = [m for m in found if not excused(m)]
        assert_all_seen(unseen(pool, watched[:1], names, thresholds, set()))
        return
    unproven = set(range(len(thresholds)))
    passed = unseen(pool, found, names, thresholds, unproven)
    if unproven:
        unseen(pool, [m for kit in kits for m in mutants.mutants(kit)], names, thresholds, unproven)
    assert_all_seen(passed)
    assert not unproven, "never fails: " + "; ".join(thresholds[i].label() for i in unproven)
    keep(file.stem, digest)


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("file", KIT, ids=lambda f: f.stem)
def test_a_flipped_sign_in_the_kit_fails_the_gate_of_a_technique_that_uses_it(pool, file):
    passed = mutants.mutants(file)
    users = [n for names in KIT[file] for n in names]
    digest = mutants.digest([file, *(find_technique(n).file for n in users)], users, thresholds_of(users))
    if is_proved(f"kit-{file.stem}", digest):
        return
    for names in KIT[file]:
        passed = unseen(pool, passed, names, thresholds_of(names), set())
    assert_all_seen(passed)
    keep(f"kit-{file.stem}", digest)


def test_a_mutant_differs_from_its_original_in_one_sign(tmp_path):
    file = tmp_path / "m.py"
    file.write_text("def f(a, b=-1):\n    return -a + b if a < b else a - b\n")
    found = mutants.mutants(file)
    assert sorted(m.text for m in found) == ["-a", "-a + b", "a - b", "a < b"]
    twins = {ast.unparse(mutants.mutated_source(m)) for m in found}
    assert len(twins) == 4
    assert "def f(a, b=-1):\n    return -a - b if a < b else a - b" in twins


def test_a_flipped_sign_reaches_a_technique_through_another_part_of_the_kit():
    technique = find_technique("ambient_aperture")
    sampling = next(p for p in mutants.kit_files(technique) if p.stem == "sampling")
    assert "approximations.kit.sampling" not in mutants.kit_used(technique.function.__module__)
    mutant = next(m for m in mutants.mutants(sampling) if m.text == "1 - z * z")
    scene, settings = technique.on[0](), technique.settings({})
    twin = mutants.load_twin(technique, mutant)["ambient_aperture"]
    plain, flipped = (evaluate(t, scene, t.estimates, settings, 8) for t in (technique, twin))
    assert np.abs(plain - flipped).max() > 0.05
