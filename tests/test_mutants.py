"""Every sign of every technique is watched by a threshold, and every threshold can fail."""

import ast
import multiprocessing
from concurrent.futures import TimeoutError as TimedOut
from pathlib import Path

import pytest
from pebble import ProcessExpired, ProcessPool

from approximations.contract import all_techniques, find_technique
from compare import mutants, worker
from compare.gate import load_thresholds

ALIKE: dict[str, str] = {}
"""Mutants that no image can tell from the original, and why."""

FILES = sorted({t.file for t in all_techniques().values()})


@pytest.fixture(scope="module")
def pool():
    with ProcessPool(
        max_workers=2,
        context=multiprocessing.get_context("spawn"),
        initializer=worker.start,
        initargs=("cpu", ()),
    ) as pool:
        yield pool


def all_mutants(file: Path) -> list[mutants.Mutant]:
    technique = find_technique(mutants.modules()[file][0])
    return [m for f in (file, *mutants.kit_files(technique)) for m in mutants.mutants(f)]


@pytest.mark.timeout(600)
@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_a_flipped_sign_fails_the_gate_and_every_threshold_can_fail(pool, file):
    names = mutants.modules()[file]
    thresholds = [t for t in load_thresholds() if t.technique in names]
    assert thresholds, f"{file.stem} has no thresholds"
    unproven, unseen = set(range(len(thresholds))), []
    found = all_mutants(file)
    assert found
    for batch in (found[i : i + 4] for i in range(0, len(found), 4)):
        order = sorted(range(len(thresholds)), key=lambda i: i not in unproven)
        until_fail = not unproven
        futures = [
            pool.schedule(
                mutants.verdicts,
                args=(m, names[0], [thresholds[i] for i in order], until_fail),
                timeout=120,
            )
            for m in batch
        ]
        for mutant, future in zip(batch, futures, strict=True):
            try:
                verdicts = future.result()
            except (ProcessExpired, TimedOut):
                continue
            failed = {i for i, v in zip(order, verdicts, strict=False) if v.result == "fail"}
            unproven -= failed
            if not failed and mutant.label not in ALIKE:
                unseen.append(mutant.label)
    assert not unseen, "no threshold sees: " + "; ".join(unseen)
    assert not unproven, "never fails: " + "; ".join(thresholds[i].label() for i in unproven)


def test_a_mutant_differs_from_its_original_in_one_sign(tmp_path):
    file = tmp_path / "m.py"
    file.write_text("def f(a, b=-1):\n    return -a + b if a < b else a - b\n")
    found = mutants.mutants(file)
    assert sorted(m.text for m in found) == ["-a", "-a + b", "a - b", "a < b"]
    twins = {ast.unparse(mutants.mutated_source(m)) for m in found}
    assert len(twins) == 4
    assert "def f(a, b=-1):\n    return -a - b if a < b else a - b" in twins
