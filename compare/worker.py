"""What runs inside the worker process: set-up, truths, measurements. Nothing here may end a run but
its own task: whatever goes wrong becomes a record."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import re
import threading
import traceback
from contextlib import suppress
from pathlib import Path
from typing import Any

from compare import turns
from compare.task import PATH_TRACER, Task
from reference.store import ENOUGH, Demand
from scenes.contract import QUANTITIES, BadInput, all_scenes, make_scene

MEMORY_SHARE = 0.6


def start(device: str, plugins: tuple[str, ...], shared: str = "") -> None:
    """Prepare the process: memory limit, variant, every scene and technique, plugins; share turns with the
    other workers through a folder, and closed forms with all runs of this user."""
    from approximations.contract import all_techniques, load_plugin
    from reference.store import sweep, user_store
    from reference.toolchain import cache_folder, use_device
    from reference.truth import keep_closed_forms

    threading.Thread(target=end_with_parent, daemon=True).start()
    if use_device(device).startswith("llvm"):
        limit_memory()
    sweep(user_store())
    all_scenes()
    all_techniques()
    if shared:
        turns.join(Path(shared) / "turn")
        with suppress(OSError):
            keep_closed_forms(cache_folder() / "closed_forms")
    for path in plugins:
        load_plugin(Path(path))


def end_with_parent() -> None:
    """End this process once the one that started it is gone, whatever it is doing."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)


def limit_memory() -> None:
    """Cap the address space at a share of what is free, so that excess fails here and not elsewhere."""
    import resource

    limit = int(MEMORY_SHARE * free_memory())
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def free_memory() -> int:
    """Bytes that the system could hand out."""
    try:
        text = Path("/proc/meminfo").read_text()
        return next(int(line.split()[1]) * 1024 for line in text.splitlines() if "MemAvailable" in line)
    except (OSError, StopIteration):
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def prepare_truth(
    scene: str,
    fields: dict[str, Any],
    quantity: str,
    size: int,
    demand: Demand = ENOUGH,
    seed: int = 1,
    again: bool = False,
) -> dict:
    """Make sure that a truth of that demand is in the store; warnings about files that had to be replaced.

    What came of it: batches, resolution, and whether the demand was reached or which budget was spent.
    """
    from reference import store

    warnings: list[str] = []
    try:
        truth, _ = store.obtain(
            make_scene(scene, fields),
            QUANTITIES[quantity],
            size,
            demand=demand,
            seed=seed,
            again=again,
            warn=warnings.append,
        )
    except Exception as error:
        return {"status": status_of(error), "error": one_line(error), "warnings": warnings}
    return {
        "status": "ok",
        "warnings": warnings,
        "batches": truth.batches,
        "resolution": truth.resolution(demand.tile),
        "demand": demand.verdict(truth),
    }


def perform(task: Task, folder: str) -> list[dict]:
    """The task's records; one record of failure for each quantity where it raises."""
    from compare.measure import measure

    try:
        return measure(task, Path(folder))
    except Exception as error:
        return failed(task, status_of(error), one_line(error))


def failed(task: Task, status: str, error: str) -> list[dict]:
    """Records of a task that gave no figures."""
    import mitsuba

    return [
        {
            "key": f"{task.key(mitsuba.variant())}-{quantity}",
            "status": status,
            "error": error,
            "kind": "path tracer" if task.technique == PATH_TRACER else "technique",
            "technique": task.technique,
            "scene": task.scene,
            "fields": task.make_scene().fields(),
            "changed": task.fields,
            "knobs": task.knobs,
            "quantity": quantity,
            "size": task.size,
            "seed": task.seed,
            "roles": list(task.roles),
            "command": task.command(),
            "findings": [{"kind": status, "text": error}],
            "errors": None,
            "costs": None,
        }
        for quantity in task.quantities
    ]


def status_of(error: Exception) -> str:
    """ "out of memory", "cannot write" (which ends the run) or "failed"."""
    from reference.store import CannotWrite

    if isinstance(error, MemoryError) or re.search("out of memory|bad_alloc", str(error), re.IGNORECASE):
        return "out of memory"
    return "cannot write" if isinstance(error, CannotWrite) else "failed"


def one_line(error: Exception) -> str:
    """What went wrong and where, on one line."""
    text = " ".join(str(error).split()) or type(error).__name__
    if isinstance(error, BadInput):
        return text
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if "site-packages" not in f.filename] or frames
    where = f" at {Path(own[-1].filename).name}:{own[-1].lineno}" if own else ""
    return f"{type(error).__name__}: {text[:400]}{where}"
