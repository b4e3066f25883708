"""A run of verification: what is chosen, in which family, row by row into verification.json.

Every stored truth and every check gets an equal part of SIGNIFICANCE (Sidak over them), split again over its
own comparisons, so that a run in which everything is right says so with probability 1 - SIGNIFICANCE.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from reference import store
from reference.store import CannotWrite, DamagedTruth
from reference.verify import stored
from reference.verify.agreement import agreement
from reference.verify.checks import CHECKS, SIGNIFICANCE, Check, Comparison
from scenes.contract import BadInput, all_scenes, discover, unknown

FILE = "verification.json"
KINDS = ("stored", "route", "physics", "published")
Report = Callable[[str, int, int], None]


def all_checks() -> dict[str, Check]:
    """Every declared check by name."""
    import reference.verify

    discover(reference.verify)
    return CHECKS


def choose(names: list[str]) -> tuple[list[Path], list[Check]]:
    """Stored truths and checks of that scene, kind, check or file; all where nothing is named."""
    files = [p for folder in (store.user_store(), store.SHIPPED) for p in sorted(folder.glob("*.exr"))]
    seen: dict[str, Path] = {}
    for path in files:
        seen.setdefault(path.name, path)
    files, checks = list(seen.values()), list(all_checks().values())
    if not names:
        return files, checks
    chosen_files, chosen_checks = [], []
    for name in names:
        path = Path(name)
        of_scene = [p for p in files if p.name.startswith(f"{name}-")]
        if path.suffix == ".exr":
            if not path.is_file():
                raise BadInput(f"{name}: no such file; `lightproof reference list` names the stored truths")
            chosen_files.append(path)
        elif name in all_scenes():
            chosen_files += of_scene
            chosen_checks += [c for c in checks if name in c.scenes]
        elif name in KINDS:
            chosen_files += files if name == "stored" else []
            chosen_checks += [c for c in checks if c.kind == name]
        elif name in all_checks():
            chosen_checks.append(all_checks()[name])
        else:
            raise unknown("scene, kind or check", name, [*all_scenes(), *KINDS, *all_checks()])
    return list(dict.fromkeys(chosen_files)), list({c.name: c for c in chosen_checks}.values())


def verify(
    names: list[str],
    folder: Path,
    seed: int = 1,
    again: bool = False,
    report: Report = lambda what, done, total: None,
) -> list[dict]:
    """The rows of a verification, also written to folder/verification.json; rows that are there already for
    the same code, truth and seed are kept unless `again`."""
    files, checks = choose(names)
    if not files and not checks:
        raise BadInput("nothing to verify: no truth is stored and no check is about what was named")
    members = [(_file_key(p), p.name, lambda p=p: rows_of_file(p, seed, each)) for p in files]
    members += [(c.name, c.name, lambda c=c: rows_of_check(c, seed, each)) for c in checks]
    each = -np.expm1(np.log1p(-SIGNIFICANCE) / len(members))
    kept = {} if again else {r["key"]: r for r in read(folder)}
    by_key: dict[str, list[dict]] = {}
    for row in kept.values():
        by_key.setdefault(row["key"].rpartition("#")[0], []).append(row)
    rows: list[dict] = []
    for i, (label, shown, work) in enumerate(members):
        key = _digest([label, seed, code_digest(), float(each)])
        report(shown, i, len(members))
        if key in by_key:
            rows += by_key[key]
            continue
        started = time.perf_counter()
        found = work()
        seconds = round((time.perf_counter() - started) / len(found), 2)
        rows += [{"key": f"{key}#{k}", **row, "seconds": seconds} for k, row in enumerate(found)]
        write(folder, rows + [r for r in kept.values() if r["key"] not in {x["key"] for x in rows}])
    write(folder, rows)
    report("done", len(members), len(members))
    return rows


def rows_of_file(path: Path, seed: int, each: float) -> list[dict]:
    """One row for a stored truth: the more telling of its two comparisons."""
    row = {
        "kind": "stored",
        "truth": path.name,
        "claim": "an independent render has the stored mean and variance",
        "routes": ["stored", "rendered again"],
        "citation": "",
        "note": "",
    }
    try:
        truth = store.load(path)
        if not stored.is_current(path, truth.provenance):
            return [row | {"verdict": "not used", "note": f"made by other code; {_prune(path)}"}]
        if store.other_version(truth.provenance):
            row["note"] = f"rendered with Mitsuba {truth.provenance['mitsuba']}"
        found = [judge(c, each / 2) for c in stored.rendered_again(truth, seed)]
    except DamagedTruth as damage:
        return [row | {"verdict": "damaged", "note": str(damage)}]
    except BadInput as trouble:
        return [row | {"verdict": "not judged", "note": str(trouble)}]
    mean, variance = found
    worst = mean if mean["p"] <= variance["p"] else variance | {"where": "the variance"}
    whole = {k: mean[k] for k in ("catches", "catches_locally")} | {"tests": mean["tests"] + 1}
    return [row | worst | whole | {"truth": path.name}]


def rows_of_check(check: Check, seed: int, each: float) -> list[dict]:
    """One row for each comparison of a check."""
    about = {
        "kind": check.kind,
        "check": check.name,
        "claim": check.claim,
        "routes": list(check.routes),
        "scenes": list(check.scenes),
        "citation": check.citation,
        "note": "",
    }
    try:
        comparisons = check.comparisons(seed)
    except BadInput as trouble:
        return [about | {"truth": check.name, "verdict": "not judged", "note": str(trouble)}]
    return [about | judge(c, each / len(comparisons)) for c in comparisons]


def judge(comparison: Comparison, significance: float) -> dict:
    """The figures of a row."""
    found = agreement(
        comparison.first, comparison.second, significance=significance, within=comparison.within
    )
    exact = comparison.first.batches == comparison.second.batches == 0
    return {
        "truth": comparison.label,
        "verdict": "agrees" if found.agrees else "differs",
        "p": found.p,
        "standard_errors": None if exact or not np.isfinite(found.standard_errors) else found.standard_errors,
        "relative": found.relative if np.isfinite(found.relative) else None,
        "where": found.where,
        "tests": found.tests,
        "significance": float(significance),
        "catches": found.catches,
        "catches_locally": found.catches_locally,
    }


def brief(row: dict) -> dict:
    """A row of the printed table."""
    return {
        "verdict": row["verdict"],
        "kind": row["kind"],
        "truth": row["truth"],
        "routes": " / ".join(row["routes"]),
        "largest, SE": row.get("standard_errors"),
        "relative": row.get("relative"),
        "where": row.get("where"),
        "p": row.get("p"),
        "catches": row.get("catches"),
        "note": row["note"],
    }


def totals(rows: list[dict]) -> list[dict]:
    """A row for each kind: how many agree, the largest disagreement, the error that half of them catch."""
    found = []
    for kind in (k for k in KINDS if any(r["kind"] == k for r in rows)):
        own = [r for r in rows if r["kind"] == kind]
        judged = [r for r in own if "p" in r]
        noisy = [r for r in judged if r["standard_errors"] is not None]
        worst = max(noisy, key=lambda r: r["standard_errors"], default=None)
        found.append(
            {
                "kind": kind,
                "truths": len(own),
                "agree": sum(r["verdict"] == "agrees" for r in own),
                "least p": min((r["p"] for r in judged), default=None),
                "largest, SE": worst and worst["standard_errors"],
                "of": worst and worst["truth"],
                "half catch": float(np.median([r["catches"] for r in judged])) if judged else None,
                "seconds": sum(r["seconds"] for r in own),
            }
        )
    return found


def exit_code(rows: list[dict]) -> int:
    """1 if a truth differs or is damaged, 3 if one could not be judged, else 0."""
    verdicts = {r["verdict"] for r in rows}
    if verdicts & {"differs", "damaged"}:
        return 1
    return 3 if "not judged" in verdicts else 0


def read(folder: Path) -> list[dict]:
    """The rows that a folder holds, none where there is no sound file."""
    try:
        return json.loads((folder / FILE).read_text())["rows"]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def write(folder: Path, rows: list[dict]) -> None:
    """Replace the file in one step. Raises CannotWrite."""
    partial = folder / f".{FILE}.{os.getpid()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        partial.write_text(json.dumps({"significance": SIGNIFICANCE, "rows": rows}, indent=1) + "\n")
        partial.replace(folder / FILE)
    except OSError as error:
        raise CannotWrite(
            f"cannot write {folder / FILE}: {error.strerror}; choose another folder with --out"
        ) from error


def _prune(path: Path) -> str:
    return "`lightproof reference prune` removes it" if path.parent != store.SHIPPED else "delete it"


def _file_key(path: Path) -> str:
    return f"{path.name} {hashlib.sha256(path.read_bytes()).hexdigest()}"


def _digest(content: list) -> str:
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:20]


@cache
def code_digest() -> str:
    """Digest of all that a truth can depend on: scenes and reference."""
    root = store.SHIPPED.parent
    files = sorted([*(root / "scenes").rglob("*.py"), *(root / "reference").rglob("*.py")])
    return hashlib.sha256(b"".join(f.read_bytes() for f in files)).hexdigest()
