"""A run: a folder of JSON lines and EXR images, written measurement by measurement, resumed by key.

run.json            what made the run
measurements.jsonl  one record a line; of lines with the same key the last one counts
images/*.exr        estimates and truths that the records name
"""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import platform
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import TimeoutError as TimedOut
from pathlib import Path

from pebble import ProcessExpired, ProcessFuture, ProcessPool

from compare import worker
from compare.task import PATH_TRACER, Task, in_order, wants_costs
from reference.store import CannotWrite, sweep
from reference.truth import has_closed_form
from scenes.contract import QUANTITIES, BadInput, find_scene

LINES = "measurements.jsonl"
TRUTH_SECONDS = 3600.0
WORKERS = 2
Report = Callable[[str, int, int], None]


def open_run(folder: Path, about: dict) -> None:
    """Make the folder and note what makes the run. Raises BadInput where nothing can be written."""
    try:
        (folder / "images").mkdir(parents=True, exist_ok=True)
        sweep(folder)
        sweep(folder / "images")
        partial = folder / f".run.json.{os.getpid()}"
        partial.write_text(json.dumps(about | machine(), indent=1) + "\n")
        partial.replace(folder / "run.json")
    except OSError as error:
        raise CannotWrite(
            f"cannot write the run to {folder}: {error.strerror}; choose another folder with --out"
        ) from error


def machine() -> dict:
    """What the costs were measured on."""
    model = platform.processor()
    with contextlib.suppress(OSError, StopIteration):
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    return {
        "machine": {"processor": model, "cores": os.cpu_count(), "system": platform.system()},
        "python": platform.python_version(),
        "written": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }


def records(folder: Path) -> list[dict]:
    """All records of a run, the last of each key; a line cut short by a kill is passed over.

    Raises BadInput where the folder holds no run.
    """
    path = folder / LINES
    if not path.is_file():
        raise BadInput(f"{folder} holds no run (no {LINES}): name a folder that `lightproof compare` wrote")
    found: dict[str, dict] = {}
    for line in path.read_text(errors="replace").splitlines():
        with contextlib.suppress(ValueError):
            record = json.loads(line)
            found[record["key"]] = record
    return list(found.values())


def append(folder: Path, new: Iterable[dict]) -> None:
    """Add records, each flushed to the disk as one line. Raises CannotWrite on a full disk."""
    path = folder / LINES
    try:
        torn = path.is_file() and path.stat().st_size and path.read_bytes()[-1:] != b"\n"
        with path.open("a") as lines:
            lines.write("\n" * bool(torn))
            for record in new:
                lines.write(json.dumps(record, allow_nan=False, default=str) + "\n")
            lines.flush()
            os.fsync(lines.fileno())
    except OSError as error:
        raise CannotWrite(
            f"cannot write {path}: {error.strerror}; free space and run again to resume"
        ) from error


def pending(tasks: list[Task], known: list[dict], variant: str) -> tuple[list[Task], list[dict]]:
    """Tasks still to be measured, and old records whose roles have grown. A setting that becomes the
    default is measured again, since only those have FLIP; so is one whose costs are wanted now."""
    done = {r["key"]: r for r in known if r["status"] == "ok"}
    missing, grown = [], []
    for task in tasks:
        key = task.key(variant)
        old = [done.get(f"{key}-{q}") for q in task.quantities]
        shown = "default" in task.roles and not all(r and "default" in r["roles"] for r in old)
        costless = wants_costs(task) and any(r and r["costs"] is None for r in old)
        if shown or costless or not all(old):
            missing.append(task)
            continue
        for record in old:
            roles = list(dict.fromkeys([*record["roles"], *task.roles]))
            if roles != record["roles"]:
                grown.append(record | {"roles": roles})
    return missing, grown


def execute(
    tasks: list[Task],
    folder: Path,
    device: str,
    plugins: tuple[str, ...] = (),
    report: Report = lambda what, done, total: None,
    warn: Callable[[str], None] = lambda message: None,
) -> None:
    """Measure all tasks that the run does not hold yet, in worker processes.

    A worker that crashes, hangs or eats the memory costs its task alone. Timed work never shares the
    machine: see compare.turns.
    """
    import mitsuba

    known = records(folder) if (folder / LINES).is_file() else []
    missing, grown = pending(tasks, known, mitsuba.variant())
    append(folder, grown)
    if not missing:
        return
    truths = {
        json.dumps([t.scene, t.make_scene().fields(), q, t.size], sort_keys=True): (
            t.scene,
            t.fields,
            q,
            t.size,
            t.demand,
        )
        for t in missing
        for q in t.quantities
        if not has_closed_form(find_scene(t.scene), QUANTITIES[q])
    }
    total = len(truths) + len(missing)
    with (
        tempfile.TemporaryDirectory() as shared,
        ProcessPool(
            max_workers=WORKERS,
            context=multiprocessing.get_context("spawn"),
            initializer=worker.start,
            initargs=(device, plugins, shared),
        ) as pool,
    ):
        try:
            for i, question in enumerate(truths.values()):
                report(f"truth: {question[0]} {question[2]} {question[3]}", i, total)
                future = pool.schedule(worker.prepare_truth, args=question, timeout=TRUTH_SECONDS)
                with contextlib.suppress(ProcessExpired, TimedOut):
                    answer = future.result()
                    for message in answer["warnings"]:
                        warn(message)
                    if answer["status"] == "cannot write":
                        raise CannotWrite(answer["error"])
                    if question[4].resolution > 0 and answer.get("demand", "reached") != "reached":
                        warn(
                            f"the truth of {question[0]} {question[2]} {question[3]} reached a resolution of "
                            f"{answer['resolution']:.3g}, not {question[4].resolution:g}: {answer['demand']}"
                        )
            asked: deque[tuple[Task, ProcessFuture]] = deque()
            waiting = deque(in_order(missing))
            for i in range(len(missing)):
                while waiting and len(asked) < WORKERS:
                    task = waiting.popleft()
                    asked.append((task, ask(pool, task, folder)))
                task, future = asked.popleft()
                report(f"{task.technique} on {task.scene}", len(truths) + i, total)
                found = outcome(task, future)
                if found[0]["status"] == "cannot write":
                    raise CannotWrite(found[0]["error"])
                append(folder, found)
            report("done", total, total)
        except BaseException:
            pool.stop()
            raise


def ask(pool: ProcessPool, task: Task, folder: Path) -> ProcessFuture:
    """Have a worker perform a task."""
    return pool.schedule(worker.perform, args=(task, str(folder)), timeout=task.seconds)


def outcome(task: Task, future: ProcessFuture) -> list[dict]:
    """The task's records, or those of the way in which its process ended."""
    try:
        return future.result()
    except TimedOut:
        return worker.failed(task, "timed out", f"took more than {task.seconds:g} s")
    except ProcessExpired as ended:
        return worker.failed(task, "crashed", f"its process ended (exit code {ended.exitcode})")
    except Exception as error:
        return worker.failed(task, "failed", worker.one_line(error))


def path_tracer_curve(known: list[dict], record: dict) -> list[dict]:
    """The path tracer's records on a record's scene, with its fields and size, by samples per pixel."""
    same = ("scene", "fields", "quantity", "size")
    curve = [
        r
        for r in known
        if r["technique"] == PATH_TRACER
        and r["status"] == "ok"
        and all(r[name] == record[name] for name in same)
    ]
    return sorted(curve, key=lambda r: r["knobs"]["spp"])
