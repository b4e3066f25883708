"""What lies in the store of truths, who uses it, and what may go."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from compare import gate
from compare.task import PROFILES, all_measured, plan
from reference import store
from reference.store import DamagedTruth
from reference.truth import has_closed_form
from reference.verify.stored import is_current
from scenes.contract import QUANTITIES


@cache
def users() -> dict[str, tuple[str, ...]]:
    """Name of the file of every truth that a profile or a threshold asks for -> the techniques held
    against it ("path_tracer" among them)."""
    techniques = list(all_measured().values())
    tasks = [t for profile in PROFILES.values() for t in plan(techniques, profile)]
    tasks += gate.tasks(gate.load_thresholds(), techniques)
    found: dict[str, dict[str, None]] = {}
    names: dict[tuple, str] = {}
    for task in tasks:
        scene = task.make_scene()
        for q in task.quantities:
            quantity = QUANTITIES[q]
            if has_closed_form(type(scene), quantity):
                continue
            question = (scene, q, task.size)
            if question not in names:
                key = store.truth_key(scene, quantity, task.size)
                names[question] = store.file_name(scene, quantity, task.size, key)
            found.setdefault(names[question], {})[task.technique] = None
    return {name: tuple(who) for name, who in found.items()}


def entry(path: Path) -> dict:
    """One row about a stored file: where it is, its state, noise, size, and who uses it."""
    row = {"file": path.name, "where": "shipped" if path.parent == store.SHIPPED else "store"}
    row["KiB"] = round(path.stat().st_size / 1024, 1)
    try:
        truth = store.load(path)
    except DamagedTruth as damage:
        return row | {"state": f"damaged: {damage}"}
    about = truth.provenance
    state = "good" if is_current(path, about) else "made by other code"
    if state == "good" and store.other_version(about):
        state = f"rendered with Mitsuba {about['mitsuba']}"
    return row | {
        "state": state,
        "samples": about.get("spp", 0) * truth.batches,
        "pixel noise": truth.pixel_noise,
        "resolution": truth.resolution(),
        "used by": list(users().get(path.name, ())),
    }


def inventory() -> list[dict]:
    """A row for every file of both folders."""
    return [entry(p) for folder in (store.user_store(), store.SHIPPED) for p in sorted(folder.glob("*.exr"))]


def prune(unused: bool, dry_run: bool) -> list[dict]:
    """Remove from the user's store what cannot be used: damaged files, those of other code, those that the
    repository holds with as many samples, and what killed writers left; with `unused`, also what no profile
    asks for. The rows of what went, each with its reason."""
    folder = store.user_store()
    if not dry_run:
        store.sweep(folder)
    gone = []
    for path in sorted(folder.glob("*.exr")):
        row = entry(path)
        why = row["state"] if row["state"].startswith(("damaged", "made by other code")) else ""
        shipped = store.SHIPPED / path.name
        if not why and shipped.is_file() and entry(shipped).get("samples", 0) >= row["samples"]:
            why = "the repository holds it"
        if not why and unused and not row["used by"]:
            why = "no profile asks for it"
        if why:
            gone.append({"file": path.name, "KiB": row["KiB"], "why": why})
            if not dry_run:
                path.unlink(missing_ok=True)
    return gone
