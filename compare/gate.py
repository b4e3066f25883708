"""Accuracy thresholds: pass, fail, or could not be judged.

thresholds/*.toml, a file per theme, hold one table a threshold:

    [[threshold]]
    technique = "ambient_aperture"     scene = "Valley"     quantity = "direct_radiance"
    knobs = { overlap = "exact" }      fields = {}          # what differs from the defaults
    metric = "rmse"   at_most = 0.2   at_least = 0.1        # one bound or both
    pays = "shape of visibility"                            # the assumption that pays for the error

A bound is passed when the whole 95 % interval is on its good side, failed when all of it is on the
other side, and not judged where the interval straddles it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from approximations import contract
from approximations.contract import Technique
from compare.metrics import MEANS
from compare.task import PROFILES, ROOT, Task, find_measured, quantities_on
from scenes.contract import QUANTITIES, BadInput, find_scene, make_scene, unknown

THRESHOLDS = ROOT / "thresholds"
ASSUMPTIONS = {a.name: a for a in vars(contract).values() if isinstance(a, contract.Assumption)}


@dataclass(frozen=True)
class Threshold:
    """A bound on one metric of one measurement, and the assumption that pays for the error."""

    technique: str
    scene: str
    quantity: str
    metric: str
    pays: str
    at_most: float = math.inf
    at_least: float = -math.inf
    size: int = 0
    knobs: dict[str, Any] = field(default_factory=dict)
    fields: dict[str, Any] = field(default_factory=dict)

    @property
    def side(self) -> int:
        """Pixels along a side: those of the quick profile unless another size is named."""
        full = PROFILES["quick"].size
        return self.size or (full // 2 if find_measured(self.technique).estimates.probes else full)

    def label(self) -> str:
        """One line that names it."""
        changed = ", ".join(f"{k}={v}" for k, v in (self.fields | self.knobs).items())
        return f"{self.technique} on {self.scene} {self.quantity} {self.metric}" + (
            f" ({changed})" if changed else ""
        )

    def asks(self, task: Task, quantity: str) -> bool:
        """Whether a task is the measurement that this threshold is about."""
        return (
            task.technique == self.technique
            and (task.scene, quantity, task.size)
            == (
                self.scene,
                self.quantity,
                self.side,
            )
            and self.fits_settings(task.knobs, task.make_scene().fields())
        )

    def fits_settings(self, knobs: dict, fields: dict) -> bool:
        """Whether knobs and fields are those of this threshold."""
        return (
            knobs == find_measured(self.technique).settings(self.knobs)
            and fields == make_scene(self.scene, self.fields).fields()
        )

    def fits(self, record: dict) -> bool:
        """Whether a record is the measurement that this threshold is about."""
        return (
            (record["technique"], record["scene"], record["quantity"], record["size"])
            == (self.technique, self.scene, self.quantity, self.side)
        ) and self.fits_settings(record["knobs"], record["fields"])


@dataclass(frozen=True)
class Verdict:
    """result: "pass", "fail", "not judged" or "not measured"; margin: distance of the value to the
    nearest bound in units of that bound, negative beyond it."""

    threshold: Threshold
    result: str
    value: float | None
    low: float | None
    high: float | None
    margin: float | None
    text: str


def load_thresholds(path: Path = THRESHOLDS) -> list[Threshold]:
    """All thresholds of a file, or of the files of a folder, checked. Raises BadInput for anything else."""
    files = sorted(path.glob("*.toml")) if path.is_dir() else [path]
    if not files:
        raise BadInput(f"{path} holds no thresholds: no *.toml file is there")
    return [t for file in files for t in _load_file(file)]


def _load_file(path: Path) -> list[Threshold]:
    try:
        import tomllib
    except ImportError:
        import tomli as tomllib
    try:
        tables = tomllib.loads(path.read_text())["threshold"]
    except (OSError, KeyError, tomllib.TOMLDecodeError) as error:
        raise BadInput(f"{path} holds no thresholds: {error}; expected [[threshold]] tables") from error
    found = []
    for table in tables:
        try:
            threshold = Threshold(**table)
        except TypeError as error:
            raise BadInput(f"{path}: {error}; see compare/gate.py for the form") from error
        if threshold.metric not in MEANS:
            raise unknown("metric", threshold.metric, MEANS)
        if threshold.pays not in ASSUMPTIONS:
            raise unknown("assumption", threshold.pays, ASSUMPTIONS)
        if threshold.quantity not in QUANTITIES:
            raise unknown("quantity", threshold.quantity, QUANTITIES)
        if math.isinf(threshold.at_most) and math.isinf(threshold.at_least):
            raise BadInput(f"{path}: {threshold.label()} has neither at_most nor at_least: give a bound")
        technique = find_measured(threshold.technique)
        technique.settings(threshold.knobs)
        if threshold.quantity not in quantities_on(technique, find_scene(threshold.scene)):
            raise BadInput(f"{path}: {threshold.label()}: the technique is not held against that truth")
        found.append(threshold)
    return found


def tasks(thresholds: list[Threshold], techniques: list[Technique], seed: int = 1) -> list[Task]:
    """The measurements that thresholds of these techniques ask for."""
    names = {t.name for t in techniques}
    return [
        Task(
            t.technique,
            t.scene,
            t.side,
            t.fields,
            find_measured(t.technique).settings(t.knobs),
            (t.quantity,),
            ("threshold",),
            seed,
            PROFILES["quick"].seconds,
        )
        for t in thresholds
        if t.technique in names
    ]


def judge(thresholds: list[Threshold], records: list[dict]) -> list[Verdict]:
    """A verdict for every threshold whose technique the run has on that scene, by its newest record."""
    newest: dict[tuple, list[dict]] = {}
    for r in reversed(records):
        newest.setdefault((r["technique"], r["scene"]), []).append(r)
    return [
        judge_one(t, next((r for r in there if t.fits(r)), None))
        for t in thresholds
        if (there := newest.get((t.technique, t.scene)))
    ]


def judge_one(threshold: Threshold, record: dict | None) -> Verdict:
    """Hold one record's interval against a threshold."""
    if record is None:
        return Verdict(threshold, "not measured", None, None, None, None, "not in this run")
    if record["status"] != "ok" or record["errors"] is None:
        why = record.get("error") or "; ".join(f"{f['kind']}: {f['text']}" for f in record["findings"])
        return Verdict(threshold, "fail", None, None, None, None, f"no figures: {why}")
    if threshold.metric not in record["errors"]:
        why = f"{threshold.metric} is not taken of this setting"
        return Verdict(threshold, "not measured", None, None, None, None, why)
    e = record["errors"][threshold.metric]
    value, low, high = e["value"], e["low"], e["high"]
    bounds = [b for b in (threshold.at_most, threshold.at_least) if math.isfinite(b)]
    nearest = min(bounds, key=lambda b: abs(b - value))
    sign = 1 if nearest == threshold.at_most else -1
    margin = sign * (nearest - value) / (abs(nearest) or 1.0)
    if high <= threshold.at_most and low >= threshold.at_least:
        result = "pass"
    elif low > threshold.at_most or high < threshold.at_least:
        result = "fail"
    else:
        result = "not judged"
    text = f"{value:.4g} [{low:.4g}, {high:.4g}] against {describe(threshold)}"
    return Verdict(threshold, result, value, low, high, margin, text)


def describe(threshold: Threshold) -> str:
    """The bounds in words."""
    words = []
    if math.isfinite(threshold.at_least):
        words.append(f"at least {threshold.at_least:g}")
    if math.isfinite(threshold.at_most):
        words.append(f"at most {threshold.at_most:g}")
    return " and ".join(words)


def exit_code(verdicts: list[Verdict]) -> int:
    """1 if any failed, else 3 if any could not be judged or none was there, else 0."""
    results = {v.result for v in verdicts}
    if "fail" in results:
        return 1
    return 0 if results == {"pass"} else 3
