"""One task, measured: runs inside a worker process and returns plain records, one per truth."""

from __future__ import annotations

import math
import time
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from approximations.contract import Technique, find_technique
from compare import cost, metrics, statistics
from compare.task import PATH_TRACER, Task, fine_size
from reference import store
from reference.truth import Truth, box_filter
from scenes.contract import QUANTITIES, BadInput, Quantity, Scene, View


def measure(task: Task, folder: Path) -> list[dict]:
    """Errors, costs and findings of a task, one record per quantity; images go to folder/images.

    Raises BadInput where the technique's output or the scene cannot be measured.
    """
    import mitsuba

    if task.technique == PATH_TRACER:
        return [measure_path_tracer(task, folder)]
    technique = find_technique(task.technique)
    scene = task.make_scene()
    quantity = technique.estimates
    image = evaluate(technique, scene, quantity, task.knobs, task.size)
    shown = "default" in task.roles
    costs = technique_cost(technique, scene, quantity, task.knobs, task.size)
    if technique.bake_function and shown:
        bake = technique.split(task.knobs)[1]
        costs["bake_rays"] = bake_rays(technique, scene, task.size, bake)
    key = task.key(mitsuba.variant())
    picture = save_image(folder, f"{key}.exr", image)
    stages = technique.stages()
    ladder = {"exact": [s for s in stages if task.knobs[s] == "exact"], "of": stages}
    inside = technique.domain_function(scene) if technique.domain_function else None
    records = []
    for name in task.quantities:
        record = header(task, key, QUANTITIES[name])
        truth, about = find_truth(scene, QUANTITIES[name], task.size, folder)
        record |= {
            "kind": "technique",
            "theme": technique.theme,
            "baseline": technique.baseline,
            "covers": list(technique.covers),
            "source": technique.source,
            "replaces": technique.replaces,
            "neglects": [a.name for a in technique.neglects],
            "stochastic": False,
            "ladder": ladder,
            "domain": None if inside is None else {"inside": inside.inside, "reason": inside.reason},
            "truth": about,
            "costs": costs,
            "findings": findings(image, truth, QUANTITIES[name]),
            "errors": judge(image, truth, QUANTITIES[name], scene.exposure if shown else None),
            "images": {"estimate": picture, "truth": about["image"]},
        }
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


def judge(
    image: np.ndarray, truth: Truth, quantity: Quantity, exposure: tuple[float, float] | None
) -> dict | None:
    """All metrics as plain data, FLIP where an exposure is given (it costs a hundred times the others);
    None where the image holds values that are not finite."""
    if not np.isfinite(image).all():
        return None
    found = metrics.errors(image, truth, quantity, exposure)
    return {name: e.plain() for name, e in found.items()}


def findings(image: np.ndarray, truth: Truth, quantity: Quantity) -> list[dict]:
    """Flaws of the image, shares above 1, and truths whose variance rests on one batch."""
    found = metrics.flaws(image)
    if quantity.kind == "ratio" and np.nanmax(image) > 1 + 1e-6:
        found.append({"kind": "above 1", "text": f"a share of light reaches {np.nanmax(image):.6g}"})
    heavy = truth.provenance.get("heaviest_tail")
    if heavy and heavy["share_of_one_batch"] > 0.9 and truth.batches >= 16:
        found.append(
            {
                "kind": "heavy tail",
                "text": f"the truth's variance at pixel {tuple(heavy['pixel'])} rests on one batch",
                "pixel": heavy["pixel"],
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
    key = (technique.bake_function, scene, size, tuple(sorted(settings.items())))
    if key not in _BAKED:
        while len(_BAKED) >= 2:
            _BAKED.pop(next(iter(_BAKED)))
        _BAKED[key] = technique.bake_function(make_view(scene, size, probes), **settings)
    return (_BAKED[key],)


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


def technique_cost(
    technique: Technique, scene: Scene, quantity: Quantity, settings: dict[str, Any], size: int
) -> dict:
    """Frame cost at one sample a pixel; the bake apart, with its own time and bytes."""
    import drjit as dr

    frame, bake = technique.split(settings)
    view = make_view(scene, size, quantity.probes)
    extra: tuple = ()
    costs: dict[str, Any] = {"bake_ms": None}
    if technique.bake_function is not None:
        with cost.recording():
            result = technique.bake_function(view, **bake)
            dr.eval(result)
            dr.sync_thread()
            costs["bake_ms"] = cost.milliseconds(cost.kernels())
        extra = (result,)
    return costs | cost.frame_cost(lambda: technique(view, *extra, **frame), size * size)


def bake_rays(technique: Technique, scene: Scene, size: int, bake: dict) -> int:
    """Rays that the offline stage traces; counted turn by turn, so for a few settings only."""
    view = make_view(scene, size, technique.estimates.probes)
    return cost.work(lambda: technique.bake_function(view, **bake))["rays"]


@lru_cache(maxsize=8)
def obtain(scene: Scene, quantity: Quantity, size: int) -> tuple[Truth, str]:
    """The truth and its key, the last few kept."""
    return store.obtain(scene, quantity, size)


def find_truth(scene: Scene, quantity: Quantity, size: int, folder: Path) -> tuple[Truth, dict]:
    """The truth, and what the record says of it; its image is copied into the run."""
    truth, key = obtain(scene, quantity, size)
    label = store.fingerprint([scene.fields(), quantity.name, size, type(scene).__name__])
    import hashlib
    import json

    name = hashlib.sha256(json.dumps([label, key]).encode()).hexdigest()[:20]
    about = {
        "key": key,
        "provenance": truth.provenance,
        "mean": float(truth.mean.mean()),
        "image": save_image(folder, f"truth-{name}.exr", truth.mean),
    }
    return truth, about


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


NOT_COUNTED = dict.fromkeys(("operations", "rays", "bytes", "kernels"))


@lru_cache(maxsize=16)
def path_tracer_work(scene: Scene, quantity: Quantity, size: int) -> dict:
    """Work of one sample per pixel, an upper bound: paths that have ended are still counted until the
    longest ends. In media, where that is hundreds of times the mean, nothing is counted."""
    import mitsuba as mi

    from reference.render import load_scene
    from reference.transport import MEDIA, plugin_types

    if plugin_types(scene.mitsuba(size)) & MEDIA:
        return NOT_COUNTED
    loaded = load_scene(scene, quantity, size)
    return cost.work(lambda: mi.render(loaded, spp=1, seed=0))


def measure_path_tracer(task: Task, folder: Path) -> dict:
    """The reference integrator at a few samples per pixel, as if it were a technique.

    The frames that are timed, and the first one, are the independent images that are judged. Work is
    counted at one sample per pixel and grows with the samples.
    """
    import mitsuba as mi

    from reference.render import load_scene, to_array

    scene, spp = task.make_scene(), int(task.knobs["spp"])
    quantity = QUANTITIES[task.quantities[0]]
    key = task.key(mi.variant())
    truth, about = find_truth(scene, quantity, task.size, folder)
    loaded = load_scene(scene, quantity, task.size)
    seeds = iter(range(task.seed * 10**6, 2 * task.seed * 10**6))
    images = []

    def frame() -> Any:
        images.append(mi.render(loaded, spp=spp, seed=next(seeds)))
        return images[-1]

    counted = path_tracer_work(scene, quantity, task.size)
    counted = {k: None if v is None else v * spp for k, v in counted.items()}
    costs = cost.frame_cost(frame, task.size**2, counted)
    images = [to_array(image) for image in images]
    per_image = [metrics.errors(image, truth, quantity, None) for image in images]
    errors = {}
    for name in per_image[0]:
        each = [e[name] for e in per_image]
        joint = statistics.combine(statistics.spread([e.value for e in each]), each[0])
        errors[name] = statistics.Estimate(joint.value, joint.low, joint.high, each[0].floor).plain()
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
        "costs": costs | {"bake_ms": None},
        "findings": metrics.flaws(images[0]),
        "errors": errors,
        "images": {
            "estimate": save_image(folder, f"{key}-{quantity.name}.exr", images[0]),
            "truth": about["image"],
        },
    }
