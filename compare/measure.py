"""One task, measured: runs inside a worker process and returns plain records, one per truth."""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from approximations.contract import Technique
from compare import cost, metrics, statistics, stochastic, turns
from compare.gate import Threshold, load_thresholds
from compare.statistics import Estimate
from compare.task import PATH_TRACER, RGB_RENDERING, Task, find_measured, fine_size, wants_costs
from reference import store
from reference.store import ENOUGH, Demand
from reference.toolchain import other_variant
from reference.transport import transport
from reference.truth import Truth, box_filter
from scenes.contract import QUANTITIES, BadInput, Quantity, Scene, View

NARROW = 0.1
NEGLIGIBLE = 1e-3
SETTLED = {"default", "threshold"}
"""Roles whose figures are shown or judged."""
BAKES = 4
"""How many results of offline stages are kept."""


def measure(task: Task, folder: Path) -> list[dict]:
    """Errors, costs and findings of a task, one record per quantity; images go to folder/images.

    Raises BadInput where the technique's output or the scene cannot be measured.
    """
    if task.technique == PATH_TRACER:
        return [measure_path_tracer(task, folder)]
    technique = find_measured(task.technique)
    scene = task.make_scene()
    quantity = technique.estimates
    shown = "default" in task.roles
    if task.technique == RGB_RENDERING:
        from compare.colour import SHOWN_NOISE, rgb_rendering, sampled

        with turns.computing():
            draw, costs = rgb_rendering(scene, quantity, task.size, **task.knobs), None
        if wants_costs(task):
            seeds = stochastic.frame_seeds(task.seed)
            costs = plain_cost(lambda: draw(next(seeds)), task, cost.NOT_COUNTED)
        with turns.computing():
            noise = SHOWN_NOISE if SETTLED & set(task.roles) else math.inf
            estimate = sampled(draw, task.seed, noise)
        image = estimate.mean
    else:
        costs = technique_cost(technique, scene, quantity, task) if wants_costs(task) else None
        with turns.computing():
            estimate, image = None, evaluate(technique, scene, quantity, task.knobs, task.size)
    with turns.computing():
        if technique.bake_function and shown and task.all_counted:
            bake = technique.split(task.knobs)[1]
            costs["bake_rays"] = bake_rays(technique, scene, task.size, bake)
        return judged(task, technique, folder, image, estimate, costs)


def judged(
    task: Task,
    technique: Technique,
    folder: Path,
    image: np.ndarray,
    estimate: Truth | None,
    costs: dict | None,
) -> list[dict]:
    """The records of an image, one per quantity; its costs are not known where only a field is stressed."""
    import mitsuba

    scene, shown = task.make_scene(), "default" in task.roles
    key = task.key(mitsuba.variant())
    picture = save_image(folder, f"{key}.exr", image)
    stages = technique.stages()
    ladder = {"exact": [s for s in stages if task.knobs[s] == "exact"], "of": stages}
    inside = technique.domain_function(scene) if technique.domain_function else None
    records = []
    for name in task.quantities:
        record = header(task, key, QUANTITIES[name])
        truth, about = settled_truth(task, image, QUANTITIES[name], folder, estimate)
        record |= {
            "kind": "technique",
            "theme": technique.theme,
            "baseline": technique.baseline,
            "covers": list(technique.covers),
            "source": technique.source,
            "replaces": technique.replaces,
            "neglects": [a.name for a in technique.neglects],
            "stochastic": estimate is not None,
            "ladder": ladder,
            "domain": None if inside is None else {"inside": inside.inside, "reason": inside.reason},
            "truth": about,
            "costs": costs,
            "findings": findings(image, truth, QUANTITIES[name]),
            "errors": judge(image, truth, QUANTITIES[name], scene.exposure if shown else None, estimate),
            "images": {"estimate": picture, "truth": about["image"]},
        }
        if estimate is not None:
            record["noise"] = stochastic.noise(estimate, truth)
        records.append(record)
    return records


def header(task: Task, key: str, quantity: Quantity) -> dict:
    """What every record starts with."""
    import drjit
    import mitsuba

    return {
        "key": f"{key}-{quantity.name}",
        "status": "ok",
        "technique": task.technique,
        "scene": task.scene,
        "fields": task.make_scene().fields(),
        "changed": task.fields,
        "knobs": task.knobs,
        "quantity": quantity.name,
        "unit": quantity.unit,
        "size": task.size,
        "seed": task.seed,
        "roles": list(task.roles),
        "variant": mitsuba.variant(),
        "versions": {"mitsuba": mitsuba.__version__, "drjit": drjit.__version__},
        "command": task.command(),
        "time": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }


def errors_of(
    image: np.ndarray,
    truth: Truth,
    quantity: Quantity,
    exposure: tuple[float, float] | None,
    estimate: Truth | None = None,
) -> dict[str, Estimate]:
    """All metrics, FLIP where an exposure is given (it costs a hundred times the others). estimate: the image
    with its own noise, which is then taken out of the figures."""
    if estimate is None:
        return metrics.errors(image, truth, quantity, exposure)
    return stochastic.errors(estimate, truth, quantity, exposure)


def judge(
    image: np.ndarray,
    truth: Truth,
    quantity: Quantity,
    exposure: tuple[float, float] | None,
    estimate: Truth | None = None,
) -> dict | None:
    """The metrics as plain data; None where the image holds values that are not finite."""
    if not np.isfinite(image).all():
        return None
    found = errors_of(image, truth, quantity, exposure, estimate)
    return {name: e.plain() for name, e in found.items()}


def findings(image: np.ndarray, truth: Truth, quantity: Quantity) -> list[dict]:
    """Flaws of the image, shares above 1, and light whose variance rests on rare bright paths."""
    found = metrics.flaws(image, signed=quantity.kind == "length")
    if quantity.kind == "ratio" and np.nanmax(image) > 1 + 1e-6:
        found.append({"kind": "above 1", "text": f"a share of light reaches {np.nanmax(image):.6g}"})
    rare = truth.provenance.get("rare_paths", {"count": 0})
    if rare["count"] and quantity.kind == "radiance":
        worst = rare["worst"][0]
        found.append(
            {
                "kind": "rare bright paths",
                "text": f"the truth's noise rests on one batch at {rare['count']} pixels, most at "
                f"{tuple(worst['pixel'])}: {worst['times_the_mean']:g} times the mean",
                "pixel": worst["pixel"],
                "count": rare["count"],
            }
        )
    return found


@lru_cache(maxsize=2)
def make_view(scene: Scene, size: int, probes: bool) -> View:
    """The view at size x size samples; its arrays are evaluated, so that a frame does not pay for them."""
    import drjit as dr

    view = scene.probes(size) if probes else scene.view(size)
    dr.eval(view.camera.origin, view.camera.direction, view.fragments, view.surface)
    return view


_BAKED: dict[tuple, Any] = {}


def baked(technique: Technique, scene: Scene, size: int, probes: bool, settings: dict) -> tuple:
    """The result of the offline stage as extra arguments, the last few kept."""
    if technique.bake_function is None:
        return ()
    key = bake_key(technique, scene, size, settings)
    if key not in _BAKED:
        keep_bake(key, technique.run_bake(make_view(scene, size, probes), settings))
    return (_BAKED[key],)


def bake_key(technique: Technique, scene: Scene, size: int, settings: dict) -> tuple:
    """What a bake depends on."""
    seen = (scene, size) if technique.bakes_a_view else ()
    return (technique.bake_function, *seen, *sorted(settings.items()))


def keep_bake(key: tuple, result: Any) -> None:
    """The last bakes are kept."""
    while len(_BAKED) >= BAKES:
        _BAKED.pop(next(iter(_BAKED)))
    _BAKED[key] = result


def evaluate(
    technique: Technique, scene: Scene, quantity: Quantity, settings: dict[str, Any], size: int
) -> np.ndarray:
    """The technique's image (size, size, C) float64: SUBSAMPLES^2 even points a pixel, averaged."""
    frame, bake = technique.split(settings)
    fine = fine_size(size, quantity)
    view = make_view(scene, fine, quantity.probes)
    out = technique(view, *baked(technique, scene, fine, quantity.probes, bake), **frame)
    return box_filter(as_image(out, fine, technique.name), fine // size)


def as_image(out: Any, size: int, name: str) -> np.ndarray:
    """A Dr.Jit colour or number per pixel as (size, size, C) float64."""
    array = np.atleast_2d(np.array(out, dtype=np.float64))
    if array.ndim != 2 or array.shape[0] not in (1, 3):
        raise BadInput(f"{name} returned an array of shape {array.shape}: a Float or a Color3f is expected")
    if array.shape[1] == 1:
        array = np.repeat(array, size * size, axis=1)
    if array.shape[1] != size * size:
        raise BadInput(f"{name} returned {array.shape[1]} values: one per pixel, {size * size}, is expected")
    return array.T.reshape(size, size, -1)


def plain_cost(frame: Callable[[], Any], task: Task, counted: dict) -> dict:
    """Cost of a frame without a bake, whose work is known from elsewhere: a path that has ended would be
    counted until the longest ends."""
    return cost.frame_cost(frame, task.size**2, counted, cost.PATIENCE * task.seconds) | {"bake_ms": None}


def technique_cost(technique: Technique, scene: Scene, quantity: Quantity, task: Task) -> dict:
    """Frame cost at one sample a pixel, its work only where the task wants it counted; the bake apart, with
    its own time and bytes."""
    frame, bake = technique.split(task.knobs)
    extra, bake_ms = (), None
    with turns.computing():
        view = make_view(scene, task.size, quantity.probes)
    if technique.bake_function is not None:
        result, bake_ms = timed_bake(technique.name, scene, task.size, tuple(sorted(bake.items())))
        extra = (result,)
    costs = cost.frame_cost(
        lambda: technique(view, *extra, **frame),
        task.size**2,
        cost.NOT_COUNTED,
        cost.PATIENCE * task.seconds,
    )
    if not (task.all_counted or "default" in task.roles):
        return {"bake_ms": bake_ms} | costs
    with turns.computing():
        counted = cost.work(lambda: technique(view, *extra, **frame))
    return {"bake_ms": bake_ms} | costs | cost.per_pixel(counted, task.size**2)


@lru_cache(maxsize=BAKES)
def timed_bake(name: str, scene: Scene, size: int, settings: tuple) -> tuple[Any, float]:
    """The result of the offline stage for a frame of that size, and its kernels' time in ms."""
    import drjit as dr

    technique = find_measured(name)
    view = make_view(scene, size, technique.estimates.probes)
    with turns.timed(), cost.recording():
        result = technique.run_bake(view, dict(settings))
        dr.eval(result)
        dr.sync_thread()
        spent = cost.milliseconds(cost.kernels())
    keep_bake(bake_key(technique, scene, size, dict(settings)), result)
    return result, spent


def bake_rays(technique: Technique, scene: Scene, size: int, bake: dict) -> int:
    """Rays that the offline stage traces; counted turn by turn, so for a few settings only."""
    view = make_view(scene, size, technique.estimates.probes)
    return cost.work(lambda: technique.run_bake(view, bake))["rays"]


@lru_cache(maxsize=8)
def obtain(scene: Scene, quantity: Quantity, size: int, demand: Demand = ENOUGH) -> tuple[Truth, str]:
    """The truth and its key, the last few kept."""
    return store.obtain(scene, quantity, size, demand=demand)


def settled_truth(
    task: Task, image: np.ndarray, quantity: Quantity, folder: Path, estimate: Truth | None = None
) -> tuple[Truth, dict]:
    """The truth, with as many batches as the question takes, and what the record says of it.

    What is shown or judged goes on until `settled`, or until the batches of the profile or half of the
    task's time are spent; whatever is asked for by name (task.demand) comes on top.
    """
    scene, demand, started = task.make_scene(), task.demand, time.perf_counter()
    truth, key = obtain(scene, quantity, task.size, demand)
    if SETTLED & set(task.roles) and np.isfinite(image).all():
        bounds = [t for t in thresholds() if t.asks(task, quantity.name)]
        while (
            not truth.exact
            and not settled(errors_of(image, truth, quantity, None, estimate), bounds)
            and store.milestone(truth.batches) <= task.batches
            and time.perf_counter() - started < task.seconds / 2
        ):
            demand = Demand(0, batches=store.milestone(truth.batches))
            truth, key = obtain(scene, quantity, task.size, demand)
    return truth, describe_truth(scene, quantity, task, folder, truth, key, task.demand)


def settled(found: dict[str, Estimate], bounds: list[Threshold]) -> bool:
    """Whether more samples would change nothing that is said: the interval of the rmse is narrower than a
    tenth of it to each side (or the whole of it below 0.1 %), and no threshold lies within an interval."""
    rmse = found["rmse"]
    if max(rmse.high - rmse.value, rmse.value - rmse.low) > NARROW * rmse.value and rmse.high > NEGLIGIBLE:
        return False
    edges = [(found[t.metric], edge) for t in bounds if t.metric in found for edge in (t.at_most, t.at_least)]
    return not any(e.low < edge < e.high for e, edge in edges)


@lru_cache(maxsize=1)
def thresholds() -> list[Threshold]:
    """The bounds of the project."""
    return load_thresholds()


def describe_truth(
    scene: Scene, quantity: Quantity, task: Task, folder: Path, truth: Truth, key: str, demand: Demand
) -> dict:
    """What a record says of a truth; its image is copied into the run."""
    label = store.fingerprint([scene.fields(), quantity.name, task.size, type(scene).__name__])
    content = json.dumps([label, key, truth.batches])
    name = hashlib.sha256(content.encode()).hexdigest()[:20]
    return {
        "key": key,
        "provenance": truth.provenance,
        "batches": truth.batches,
        "resolution": truth.resolution(),
        "demand": demand.verdict(truth),
        "mean": float(truth.mean.mean()),
        "image": save_image(folder, f"truth-{name}.exr", truth.mean),
    }


def save_image(folder: Path, name: str, image: np.ndarray) -> str:
    """Write an image into the run's images folder unless it stands there, grey ones as one channel; its
    relative path."""
    import OpenEXR

    path = folder / "images" / name
    if not path.is_file():
        if np.array_equal(image, np.broadcast_to(image[..., :1], image.shape)):
            image = image[..., :1]
        letters = "RGB" if image.shape[2] == 3 else "Y"
        channels = {c: np.ascontiguousarray(image[..., i], np.float32) for i, c in enumerate(letters)}
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        store.write_exr(path, header, channels)
    return f"images/{name}"


@lru_cache(maxsize=16)
def path_tracer_work(scene: Scene, quantity: Quantity, size: int) -> dict:
    """Work of one sample per pixel, an upper bound: paths that have ended are still counted until the
    longest ends. In media, where that is hundreds of times the mean, nothing is counted."""
    import mitsuba as mi

    from reference.render import load_scene, variant_of
    from reference.transport import MEDIA, plugin_types

    if plugin_types(scene.mitsuba(size)) & MEDIA:
        return cost.NOT_COUNTED
    with other_variant(variant_of(scene)):
        loaded = load_scene(scene, quantity, size)
        return cost.work(lambda: mi.render(loaded, spp=1, seed=0))


def measure_path_tracer(task: Task, folder: Path) -> dict:
    """The reference integrator at a few samples per pixel, as if it were a technique. Its sampler is
    `independent`, which is unbiased at so few.

    The first of the frames that are timed, as many as every frame is timed at least, are the independent
    images that are judged. Work, where it is wanted, is counted at one sample per pixel and grows with the
    samples.
    """
    import mitsuba as mi

    from reference.render import load_scene, to_array, variant_of

    scene, spp = task.make_scene(), int(task.knobs["spp"])
    quantity = QUANTITIES[task.quantities[0]]
    key = task.key(mi.variant())
    with turns.computing():
        truth, tkey = obtain(scene, quantity, task.size, task.demand)
    about = describe_truth(scene, quantity, task, folder, truth, tkey, task.demand)
    variant = variant_of(scene)
    how = replace(transport(scene.mitsuba(task.size), quantity, task.size), sampler="independent")
    with turns.computing(), other_variant(variant):
        loaded = load_scene(scene, quantity, task.size, how)
    seeds = stochastic.frame_seeds(task.seed)
    images = []

    def frame() -> Any:
        images.append(loaded.integrator().render(loaded, loaded.sensors()[0], seed=next(seeds), spp=spp))
        return images[-1]

    counted = cost.NOT_COUNTED
    if task.all_counted:
        with turns.computing():
            once = path_tracer_work(scene, quantity, task.size)
        counted = {k: None if v is None else v * spp for k, v in once.items()}
    costs = plain_cost(frame, task, counted)
    with turns.computing():
        images = [to_array(image) for image in images[: 1 + cost.LEAST_REPEATS]]
        per_image = [metrics.errors(image, truth, quantity, None) for image in images]
    errors = {}
    for name in per_image[0]:
        each = [e[name] for e in per_image]
        joint = statistics.combine(statistics.spread([e.value for e in each]), each[0])
        errors[name] = Estimate(joint.value, joint.low, joint.high, each[0].floor).plain()
    stack = np.stack(images)
    noise = float(stack.var(axis=0, ddof=1).mean())
    scale = float(truth.mean.mean())
    return header(task, key, quantity) | {
        "kind": "path tracer",
        "theme": type(scene).theme,
        "baseline": True,
        "covers": [],
        "neglects": [],
        "stochastic": True,
        "noise": math.sqrt(noise) / scale,
        "ladder": {"exact": [], "of": []},
        "domain": None,
        "truth": about,
        "costs": costs,
        "findings": [f for f in metrics.flaws(images[0]) if not (scene.spectral and f["kind"] == "negative")],
        "errors": errors,
        "images": {
            "estimate": save_image(folder, f"{key}-{quantity.name}.exr", images[0]),
            "truth": about["image"],
        },
    }
