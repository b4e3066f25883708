"""The one instrument of cost, for techniques and for the path tracer: Dr.Jit's kernel history.

Time is the summed execution time of a frame's kernels, so that neither tracing nor waiting counts. It is
taken in turn with a fixed calibration kernel. Work comes from a separate pass with loops evaluated turn by
turn, since the static operation count sees a loop's body once whatever its trip count.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

import drjit as dr
import mitsuba as mi

from compare import turns
from compare.statistics import median

REPEATS, LEAST_REPEATS = 10, 3
PATIENCE = 1 / 1200
"""Share of a task's time after which a frame is timed no more often than LEAST_REPEATS."""
CALIBRATION_SIZE = 1 << 18
RAY = re.compile(r"call void %\w+\(ptr %\w+, ptr %\w+, ptr %\w+, ptr|_optix_trace|optix\.ptx\.trace")
VECTOR_ACCESS = re.compile(
    r"(?:=\s*load|^\s*store) <\d+ x (\w+)>|masked\.(?:gather|scatter)\.v\d+([fi]\d+)|"
    r"\b(?:ld|st)\.global(?:\.nc)?(?:\.v\d)?\.[bfsu](\d+)",
    re.MULTILINE,
)
BYTES = {"float": 4, "double": 8, "half": 2, "i1": 1, "i8": 1, "i16": 2, "i32": 4, "i64": 8, "ptr": 8}

NOT_COUNTED = dict.fromkeys(("operations", "rays", "bytes", "kernels"))
"""Work where nothing counts it."""


def kernels() -> list[dict]:
    """What ran since the last call."""
    return [k for k in dr.kernel_history() if k["execution_time"] is not None]


@contextmanager
def recording() -> Iterator[None]:
    """Kernel history on, and empty at the start."""
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.sync_thread()
        dr.kernel_history()
        yield


def run(frame: Callable[[], Any]) -> list[dict]:
    """Evaluate one frame and return its kernels."""
    dr.eval(frame())
    dr.sync_thread()
    return kernels()


def milliseconds(launched: list[dict]) -> float:
    """Summed execution time."""
    return sum(k["execution_time"] for k in launched)


def calibration() -> Any:
    """A fixed amount of arithmetic: 64 dependent multiply-adds on each of 2^18 numbers."""
    x = dr.arange(mi.Float, CALIBRATION_SIZE)
    x = dr.opaque(mi.Float, 1.0001) * x
    for _ in range(64):
        x = dr.fma(x, 0.9999, 1e-4)
    return x


def frame_cost(
    frame: Callable[[], Any], pixels: int, counted: dict | None = None, patience: float = 0.1
) -> dict:
    """What a frame costs. frame: lazily builds the image; its inputs are evaluated already. counted: its
    work, where that is known from elsewhere. patience: seconds after which it is timed no more often than
    LEAST_REPEATS. Only while it is timed, after one more run to warm up, does it have the machine to itself.

    Returns frame_ms, calibration_ms and frame_over_calibration with intervals, compile_ms (of the first
    call, near 0 where compiled_before), operations, rays and bytes, and peak_bytes.
    """
    with recording():
        with turns.computing():
            run(calibration)
            first = run(frame)
        dr.detail.malloc_clear_statistics()
        frames, controls = [], []
        with turns.timed():
            run(calibration)
            run(frame)
            until = time.perf_counter() + patience
            while len(frames) < LEAST_REPEATS or (len(frames) < REPEATS and time.perf_counter() < until):
                controls.append(milliseconds(run(calibration)))
                frames.append(milliseconds(run(frame)))
        peak = dr.detail.malloc_watermark(dr.backend_v(mi.Float))
    return {
        "frame_ms": median(frames).plain(),
        "calibration_ms": median(controls).plain(),
        "frame_over_calibration": median([f / c for f, c in zip(frames, controls, strict=True)]).plain(),
        "repeats": len(frames),
        "compile_ms": sum(k.get("codegen_time", 0) + k.get("backend_time", 0) for k in first),
        "compiled_before": all(k.get("cache_hit", 1) for k in first),
        "peak_bytes": int(peak),
        **per_pixel(counted or work(frame), pixels),
    }


def per_pixel(counted: dict, pixels: int) -> dict:
    """Counted work with its operations per pixel, None where nothing was counted."""
    operations = counted["operations"]
    return counted | {"operations_per_pixel": operations and operations / pixels}


def work(frame: Callable[[], Any]) -> dict:
    """Operations, rays and bytes of a frame, each turn of each loop counted. The same on every run."""
    with dr.scoped_set_flag(dr.JitFlag.SymbolicLoops, False), recording():
        launched = run(frame)
    operations = rays = moved = 0
    for k in launched:
        if k["type"] is not dr.KernelType.JIT:
            continue
        text = k["ir"] if isinstance(k["ir"], str) else k["ir"].getvalue()
        traced, touched = accesses(text)
        operations += k["operation_count"] * k["size"]
        rays += traced * k["size"]
        moved += touched * k["size"]
    return {"operations": operations, "rays": rays, "bytes": moved, "kernels": len(launched)}


@lru_cache(maxsize=1024)
def accesses(text: str) -> tuple[int, int]:
    """Rays that one item of a kernel traces, and bytes that it loads and stores. A loop taken turn by turn
    launches the same kernel over and over."""
    return len(RAY.findall(text)), traffic(text)


def traffic(text: str) -> int:
    """Bytes that one item of a kernel loads and stores."""
    total = 0
    for vector, gathered, ptx in VECTOR_ACCESS.findall(text):
        if ptx:
            total += int(ptx) // 8
        elif gathered:
            total += int(gathered[1:]) // 8
        else:
            total += BYTES.get(vector, 4)
    return total
