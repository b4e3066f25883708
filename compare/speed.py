r"""How near the frames come to what the machine can do, what binds them, and how their cost grows.

Ceilings are measured by kernels that do one thing only: multiply-add, divide, square root, stream from
memory, gather at random from a table of 1 MiB, trace the camera's rays into the scene. A frame's counts of
each, over its ceiling, is the time that this alone would take; the largest binds, and its share of the
frame's time says how near the frame comes to that ceiling.

Counts come from the kernels' code with every turn of every loop taken (compare.cost.work); the bytes that
are streamed from the frame as it runs, where the state of a loop stays in registers.

Growth is the slope of log time, and of log operations, over log pixels.
"""

from __future__ import annotations

import gc
import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy import stats

from approximations.contract import Technique
from compare import cost
from compare.measure import make_view
from compare.statistics import median
from compare.worker import free_memory
from scenes.contract import BadInput, Scene, unknown

ENOUGH = 0.3
"""Share of a ceiling that a frame should reach."""
SIZES = (128, 256, 512, 1024, 2048)
REPEATS = 7
PATTERNS = {
    "divide": re.compile(r"= fdiv |\bdiv\.\w+\.f"),
    "root": re.compile(r"call <\d+ x \w+> @llvm\.sqrt|\bsqrt\.\w+\.f"),
    "gather": re.compile(r"call .*?@llvm\.masked\.(?:gather|scatter)\."),
    "ray": cost.RAY,
}
NAMES = {
    "arithmetic": "multiply-adds",
    "divide": "divisions",
    "root": "square roots",
    "stream": "bandwidth",
    "gather": "random access",
    "ray": "ray tracing",
}


def timed(frame: Callable[[], Any], repeats: int = REPEATS) -> float:
    """Median milliseconds of a frame's kernels, after one call that compiles."""
    with cost.recording():
        cost.run(frame)
        return float(np.median([cost.milliseconds(cost.run(frame)) for _ in range(repeats)]))


Probe = tuple[float, Callable[[], Any]]


@lru_cache(maxsize=1)
def probes() -> dict[str, Probe]:
    """Kernels that do one thing, and how many of it: multiply-adds, divisions, roots, bytes, gathers."""
    n, chains, turns = 1 << 18, 8, 32
    a, b = dr.opaque(mi.Float, 0.999), dr.opaque(mi.Float, 1e-4)

    def repeat(step: Callable[[mi.Float], mi.Float]) -> Probe:
        def frame() -> mi.Float:
            x = dr.arange(mi.Float, n) * dr.opaque(mi.Float, 1e-6) + 1
            found = [x + 0.1 * i for i in range(chains)]
            for _ in range(turns):
                found = [step(c) for c in found]
            return sum(found[1:], found[0])

        return n * chains * turns, frame

    source, table = dr.full(mi.Float, 1, 1 << 24), dr.arange(mi.Float, 1 << 18)
    where = mi.PCG32(size=1 << 20).next_uint32() & ((1 << 18) - 1)
    dr.make_opaque(source, table, where)
    return {
        "arithmetic": repeat(lambda x: dr.fma(x, a, b)),
        "divide": repeat(lambda x: a / x),
        "root": repeat(lambda x: dr.sqrt(x)),
        "stream": (8 * dr.width(source), lambda: source + 1),
        "gather": (dr.width(where), lambda: dr.gather(mi.Float, table, where)),
    }


def ceilings() -> dict[str, float]:
    """Things of each kind per millisecond, now."""
    return {kind: amount / timed(frame) for kind, (amount, frame) in probes().items()}


def ray_ceiling(scene: Scene, size: int) -> float:
    """Camera rays per millisecond that find the distance of their first surface."""
    view = make_view(scene, size, False)
    if view.trace is None:
        return math.inf
    return size**2 / timed(lambda: view.trace(view.camera.origin, view.camera.direction))


def counts(frame: Callable[[], Any]) -> dict[str, float]:
    """What a frame does: things of each kind, and `operations` in all."""
    found = dict.fromkeys((*NAMES, "operations"), 0.0)
    with dr.scoped_set_flag(dr.JitFlag.SymbolicLoops, False), cost.recording():
        for size, text, operations in _code(cost.run(frame)):
            found["operations"] += operations * size
            for kind, pattern in PATTERNS.items():
                found[kind] += len(pattern.findall(text)) * size
    with cost.recording():
        for size, text, _ in _code(cost.run(frame)):
            bare = re.sub(r".*masked\.(?:gather|scatter).*", "", text)
            found["stream"] += cost.traffic(bare) * size
    found["arithmetic"] = found["operations"] - sum(found[k] for k in PATTERNS)
    return found


def _code(launched: list[dict]) -> list[tuple[int, str, int]]:
    return [
        (k["size"], k["ir"] if isinstance(k["ir"], str) else k["ir"].getvalue(), k["operation_count"])
        for k in launched
        if k["type"] is dr.KernelType.JIT
    ]


def prepared(technique: Technique, scene: Scene, size: int, knobs: dict[str, Any]) -> Callable[[], Any]:
    """The frame at size x size, its inputs evaluated. The bake takes the least of its sweep."""
    frame, bake = technique.split(technique.settings(knobs))
    view = make_view(scene, size, technique.estimates.probes)
    extra: tuple = ()
    if technique.bake_function is not None:
        for name, values in technique.variations().items():
            if name in bake and name not in knobs and type(bake[name]) in (int, float):
                bake[name] = min([bake[name], *values])
        extra = (technique.run_bake(view, bake),)
        dr.eval(extra)
    return lambda: technique(view, *extra, **frame)


def frame_row(technique: Technique, scene: Scene, size: int, knobs: dict[str, Any] | None = None) -> dict:
    """Time, what binds it, and the share of that ceiling."""
    frame = prepared(technique, scene, size, knobs or {})
    with cost.recording():
        cost.run(frame)
        ms = median([cost.milliseconds(cost.run(frame)) for _ in range(REPEATS)])
    done = counts(frame)
    able = ceilings() | {"ray": ray_ceiling(scene, size) if done["ray"] else math.inf}
    alone = {kind: done[kind] / able[kind] for kind in NAMES}
    binds = max(alone, key=alone.get)
    return {
        "technique": technique.name,
        "scene": type(scene).__name__,
        "size": size,
        "knobs": knobs or {},
        "frame_ms": ms.plain(),
        "operations_per_pixel": done["operations"] / size**2,
        "shares": {NAMES[k]: t / ms.value for k, t in alone.items() if t > 0},
        "binds": NAMES[binds],
        "share": alone[binds] / ms.value,
        "verdict": verdict(binds, alone[binds] / ms.value),
    }


def verdict(binds: str, share: float) -> str:
    """Good where multiply-adds or bandwidth bind and are used well; else what binds instead, or slow."""
    if binds not in ("arithmetic", "stream"):
        return f"bound by {NAMES[binds]}"
    return "good" if share >= ENOUGH else "slow"


def growth(
    technique: Technique, scene: Scene, sizes: tuple[int, ...] = SIZES, knobs: dict[str, Any] | None = None
) -> dict:
    """Exponents of time and of operations against pixels, with the standard error of the fit.

    They are those of what comes on top from one size to the next, so that what a frame does whatever its
    size, such as its shadow map, does not hide how the rest grows; None where noise leaves fewer than two
    steps. Small images lie in the caches, so that even a copy grows faster than its pixels: `beside_copy` is
    the exponent of the frame's time over that of a copy of as many bytes, plus 1. It ends at the size from
    which the next would take more than half of the free memory.
    """
    peak = 0
    times, copies, work = [], [], []
    for size in sizes:
        if peak * (size / sizes[max(len(times) - 1, 0)]) ** 2 > free_memory() / 2:
            break
        dr.detail.malloc_clear_statistics()
        frame = prepared(technique, scene, size, knobs or {})
        if not work:
            floats = max(1, round(counts(frame)["stream"] / size**2 / 8))
        times.append(timed(frame))
        source = dr.full(mi.Float, 1, floats * size**2)
        dr.make_opaque(source)
        copies.append(timed(lambda source=source: source + 1))
        if len(work) < 3:
            work.append(cost.work(frame)["operations"])
        peak = dr.detail.malloc_watermark(dr.backend_v(mi.Float))
        del frame, source
        make_view.cache_clear()
        gc.collect()
        dr.flush_malloc_cache()
    sizes = sizes[: len(times)]
    logs = np.log([s**2 for s in sizes])[1:]
    more, copied, added = np.diff(times), np.diff(copies), np.diff(work)
    sure = (more > 0) & (copied > 0)
    fit = slope(logs[sure], more[sure])
    beside = slope(logs[sure], more[sure] / copied[sure])
    return {
        "sizes": list(sizes),
        "ms": times,
        "exponent": fit and fit.slope,
        "error": fit and fit.stderr,
        "beside_copy": beside and 1 + beside.slope,
        "exponent_of_operations": math.log(added[1] / added[0]) / (logs[1] - logs[0]),
    }


def slope(logs: np.ndarray, values: np.ndarray) -> Any:
    """The fit of log values over logs, None through fewer than two points."""
    return stats.linregress(logs, np.log(values)) if len(values) > 1 else None


FILE = "speed.json"


def read(folder: Path) -> list[dict]:
    """The rows of a run; none where the bench was not run."""
    path = folder / FILE
    return json.loads(path.read_text()) if path.is_file() else []


def save(folder: Path, rows: list[dict]) -> Path:
    """Write the rows beside those of other techniques that the run holds."""
    folder.mkdir(parents=True, exist_ok=True)
    new = {(r["technique"], r["scene"]) for r in rows}
    whole = [r for r in read(folder) if (r["technique"], r["scene"]) not in new] + rows
    partial = folder / f".{FILE}"
    partial.write_text(json.dumps(whole, indent=1, default=float) + "\n")
    return partial.replace(folder / FILE)


def brief(row: dict) -> dict:
    """A row of the table on the command line."""
    grown, lights = row.get("growth") or {}, row.get("along") or {}
    return {
        "technique": row["technique"],
        "scene": row["scene"],
        "frame ms": f"{row['frame_ms']['value']:.3g}",
        "op/px": f"{row['operations_per_pixel']:.0f}",
        "binds": row["binds"],
        "of its ceiling": f"{100 * row['share']:.0f} %",
        "verdict": row["verdict"],
        "time ~ pixels^": f"{grown['exponent']:.3f}" if grown.get("exponent") else "",
        "beside a copy": f"{grown['beside_copy']:.3f}" if grown.get("exponent") else "",
        "work ~ pixels^": f"{grown['exponent_of_operations']:.3f}" if grown else "",
    } | ({f"work ~ {lights['field']}^": f"{lights['exponent_of_operations']:.2f}"} if lights else {})


def along(technique: Technique, scene: Scene, field: str, size: int, points: int = 5) -> dict:
    """Exponents of time and operations against a field of the scene, such as the number of lights.

    Raises BadInput for a field without an axis, or whose axis reaches 0.
    """
    axis = scene.axes().get(field)
    if axis is None:
        raise unknown(f"axis of {type(scene).__name__}", field, scene.axes())
    if axis.low <= 0:
        raise BadInput(f"{field} reaches {axis.low:g}, so that cost has no exponent along it: name another")
    kind = type(getattr(scene, field))
    values = sorted({kind(v) for v in axis.points(points)})
    frames = [prepared(technique, replace(scene, **{field: v}), size, {}) for v in values]
    logs = np.log(values)
    work = [cost.work(frame)["operations"] for frame in frames]
    times = [timed(frame) for frame in frames]
    return {
        "field": field,
        "values": values,
        "ms": times,
        "exponent": stats.linregress(logs, np.log(times)).slope,
        "exponent_of_operations": stats.linregress(logs, np.log(work)).slope,
    }
