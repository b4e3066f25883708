r"""What our transport is worth: efficiency against Mitsuba's own settings, measured in one run.

    efficiency = 1 / (variance x time)

Variance is the mean over pixels of that of one batch, time the median wall time of a batch (tracing, kernels
and film together, after a batch for warming up). Stock is `mi.render` with `path`, or `volpath` where light
passes through things, default parameters, independent sampler, STOCK_SPP samples a pixel. The gain is split
by taking our settings over one at a time, in the order of LADDER. All settings take turns, so that a slow
minute hits them alike.

The interval comes from the jackknife over rounds: wide where a variance rests on rare paths.
"""

from __future__ import annotations

import gc
import math
import resource
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy import stats

from reference.moments import Moments
from reference.render import batch_seed, sample
from reference.transport import PASSED_THROUGH, Transport, media, plugin_types, transport
from reference.truth import find_sampler
from scenes.contract import RADIANCE, BadInput, Scene, all_scenes, find_scene

STOCK_SPP = 64
LADDER = ("entry into media", "integrator and depth", "roulette", "sampler", "batch size")
TARGET, FLOOR = 2.0, 0.95
"""What the geometric mean over scenes, and every scene, must reach."""


def stock(scene: Scene, size: int) -> Transport:
    """Mitsuba's integrator with default parameters and its default sampler."""
    description = scene.mitsuba(size)
    through = media(description) or plugin_types(description) & PASSED_THROUGH
    return Transport({"type": "volpath" if through else "path"}, "independent", STOCK_SPP)


def rungs(scene: Scene, size: int) -> list[tuple[str, Transport]]:
    """Stock, then with one more of our settings at each rung; the last is ours. Rungs that change nothing are
    left out."""
    ours, how = transport(scene.mitsuba(size), RADIANCE, size), stock(scene, size)
    found = [("stock", how)]
    roulette = {k: v for k, v in ours.integrator.items() if k == "rr_depth"}
    plain = {k: v for k, v in ours.integrator.items() if k != "rr_depth"}
    for name in LADDER:
        if name == "entry into media":
            how = replace(how, starts_inside=ours.starts_inside)
        elif name == "integrator and depth":
            how = replace(how, integrator=plain)
        elif name == "roulette":
            how = replace(how, integrator=plain | roulette)
        elif name == "sampler":
            how = replace(how, sampler=ours.sampler)
        else:
            how = replace(how, spp=ours.spp)
        if not _same(how, found[-1][1]):
            found.append((name, how))
    return found


def _same(a: Transport, b: Transport) -> bool:
    unlimited = {"max_depth": -1}
    return replace(a, integrator=unlimited | a.integrator) == replace(b, integrator=unlimited | b.integrator)


def measure(
    scene: Scene, size: int, rounds: int, progress: Callable[[], None] = lambda: None
) -> dict[str, object]:
    """One row: the gain of our transport over stock with its 95 % interval, and each rung's share of it."""
    steps = rungs(scene, size)
    draws = [sample(scene, RADIANCE, size, how) for _, how in steps]
    for draw, (_, how) in zip(draws, steps, strict=True):
        draw(how.spp, 0)
    images: list[list[np.ndarray]] = [[] for _ in steps]
    seconds = np.zeros((len(steps), rounds))
    for k in range(rounds):
        for i, draw in enumerate(draws):
            started = time.perf_counter()
            image = draw(steps[i][1].spp, batch_seed(1, k))
            seconds[i, k] = time.perf_counter() - started
            images[i].append(image)
        progress()
    logs = np.array(
        [
            [_log_efficiency(images[i], seconds[i], k) for k in (None, *range(rounds))]
            for i in range(len(steps))
        ]
    )
    whole, left_out = logs[:, 0] - logs[0, 0], logs[:, 1:] - logs[0, 1:]
    error = np.sqrt(
        (rounds - 1) / rounds * ((left_out - left_out.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
    )
    half = stats.t.ppf(0.975, rounds - 1) * error[-1]
    ours = steps[-1][1]
    return {
        "scene": type(scene).__name__,
        "fields": scene.fields(),
        "size": size,
        "stock": steps[0][1].plain(),
        "ours": ours.plain(),
        "gain": {
            "value": math.exp(whole[-1]),
            "low": math.exp(whole[-1] - half),
            "high": math.exp(whole[-1] + half),
        },
        "log_error": float(error[-1]),
        "shares": {name: math.exp(whole[i] - whole[i - 1]) for i, (name, _) in enumerate(steps) if i},
        "noise": [float(_noise(images[i])) for i in range(len(steps))],
        "seconds": [float(np.median(s)) for s in seconds],
        "rungs": [name for name, _ in steps],
    }


def _log_efficiency(images: list[np.ndarray], seconds: np.ndarray, without: int | None) -> float:
    kept = [i for i in range(len(images)) if i != without]
    variance = np.var([images[i] for i in kept], axis=0, ddof=1).mean()
    return -math.log(max(variance, 1e-300) * float(np.median(seconds[kept])))


def _noise(images: list[np.ndarray]) -> float:
    """Standard deviation of one batch over the mean."""
    return math.sqrt(np.var(images, axis=0, ddof=1).mean()) / abs(np.mean(images))


def summary(rows: list[dict]) -> dict:
    """Geometric mean of the gains with its interval, the least of them, and the verdict: "pass", "fail", or
    "not judged" where an interval straddles what must be reached."""
    logs = np.array([math.log(r["gain"]["value"]) for r in rows])
    half = 1.96 * math.sqrt(sum(r["log_error"] ** 2 for r in rows)) / len(rows)
    mean = {
        "value": math.exp(logs.mean()),
        "low": math.exp(logs.mean() - half),
        "high": math.exp(logs.mean() + half),
    }
    good = mean["low"] >= TARGET and all(r["gain"]["low"] >= FLOOR for r in rows)
    bad = mean["high"] < TARGET or any(r["gain"]["high"] < FLOOR for r in rows)
    least = min(rows, key=lambda r: r["gain"]["value"])
    return {
        "geometric_mean": mean,
        "least": {"scene": least["scene"], **least["gain"]},
        "target": TARGET,
        "floor": FLOOR,
        "verdict": "fail" if bad else "pass" if good else "not judged",
    }


def memory(size: int = 2048, batches: int = 3) -> dict[str, float]:
    """Peak memory of this process (GiB) after one and after so many batches of a large image."""
    from scenes.sunlit import Valley

    scene, moments, peaks = Valley(), Moments(), []
    draw, how = sample(scene, RADIANCE, size), transport(scene.mitsuba(size), RADIANCE, size)
    for k in range(batches):
        moments.add(draw(how.spp, batch_seed(1, k)))
        gc.collect()
        peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20)
    return {"size": size, "samples": how.spp * batches, "first_GiB": peaks[0], "peak_GiB": peaks[-1]}


def scenes_to_measure(names: list[str]) -> list[Scene]:
    """Every scene with rendered radiance, at its defaults, or those named. Raises BadInput for others."""
    if names:
        found = [find_scene(n) for n in names]
        for cls in found:
            if RADIANCE not in cls.quantities or find_sampler(cls, RADIANCE):
                raise BadInput(f"{cls.__name__} has no rendered radiance: name a scene that has")
    else:
        found = [
            c for c in all_scenes().values() if RADIANCE in c.quantities and not find_sampler(c, RADIANCE)
        ]
    return [cls() for cls in found]


def brief(row: dict) -> dict:
    """A row of the printed table."""
    ours = row["ours"]
    return {
        "scene": row["scene"],
        "gain": row["gain"]["value"],
        "95 %": f"{row['gain']['low']:.3g} to {row['gain']['high']:.3g}",
        "ours": f"{ours['integrator']['type']}, {ours['sampler']}, {ours['spp']} spp",
        **row["shares"],
    }


def sentence(whole: dict) -> str:
    """The verdict on one line."""
    mean, least = whole["geometric_mean"], whole["least"]
    ranges = [f"{e['low']:.3g} to {e['high']:.3g}" for e in (mean, least)]
    return (
        f"{whole['verdict']}: geometric mean {mean['value']:.3g} ({ranges[0]}; {whole['target']:g} asked), "
        f"least {least['scene']} {least['value']:.3g} ({ranges[1]}; {whole['floor']:g} asked)"
    )


def memory_sentence(found: dict) -> str:
    """What a large image took, on one line."""
    side = found["size"]
    return (
        f"{side}x{side}: {found['peak_GiB']:.2f} GiB at {found['samples']} samples a pixel, "
        f"{found['first_GiB']:.2f} after the first batch"
    )
