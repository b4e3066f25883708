"""Images of a run as text for the page: float16, split into byte planes, deflated, in base64.

Truth and signed error are stored, the error rounded after the subtraction: an estimate that agrees
with the truth to five digits still shows where it differs.
"""

from __future__ import annotations

import base64
import math
import zlib
from pathlib import Path

import numpy as np

from reference import store
from scenes.contract import BadInput

LARGEST = 256
"""Pixels along a side in the page; larger images are averaged down to it."""

HALF_MAX = 65504.0


class Shelf:
    """The images of a page, each once under a short name."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.packed: dict[str, dict] = {}

    def read(self, path: str) -> np.ndarray:
        """(H, W, C) float64 of an image that a record names. Raises BadInput where it is damaged."""
        _, channels = store.read_exr(self.folder / path)
        letters = [c for c in "RGB" if c in channels] or sorted(channels)
        return np.stack([channels[c].astype(np.float64) for c in letters], axis=-1)

    def add(self, name: str, image: np.ndarray) -> str:
        """Pack an image under a name; the name."""
        if name not in self.packed:
            self.packed[name] = pack(image)
        return name


def viewer(case: dict, record: dict, tracer: dict | None, shelf: Shelf) -> dict | None:
    """What the viewer of a case shows: truth, estimate and signed error, path tracing of about the same
    cost, and which pixels differ by more than the truth's noise. None where the images cannot be read."""
    if record["status"] != "ok" or not record.get("images"):
        return None
    try:
        truth = shelf.read(record["images"]["truth"])
        estimate = shelf.read(record["images"]["estimate"])
    except BadInput:
        return None
    if truth.shape[:2] != estimate.shape[:2]:
        return None
    channels = max(truth.shape[2], estimate.shape[2])
    error = np.broadcast_to(estimate - truth, (*truth.shape[:2], channels))
    seen = block_mean(truth)
    finite = error[np.isfinite(error)]
    spread = float(np.percentile(np.abs(finite), 99)) if finite.size else 0.0
    bright = float(np.percentile(seen, 99)) if case["relative"] else 1.0
    about = {
        "truth": shelf.add(record["images"]["truth"], seen),
        "error": shelf.add(f"{record['key']} error", block_mean(error)),
        "size": list(seen.shape[1::-1]),
        "full": list(truth.shape[1::-1]),
        "technique": record["technique"],
        "unit": "" if case["unit"] == "1" else case["unit"],
        "mean": float(truth.mean()),
        "relative": case["relative"],
        "probes": case["probes"],
        "exposure": round(4 * math.log2(0.8 / bright)) / 4 if case["relative"] and bright > 0 else 0.0,
        "range": nice(spread) or 0.01 * abs(float(truth.mean())) or 1.0,
        "unclear": unclear(record, error),
    }
    if tracer is not None:
        try:
            path = tracer["images"]["estimate"]
            about["tracer"] = shelf.add(path, block_mean(shelf.read(path)))
            about["spp"] = tracer["knobs"]["spp"]
        except BadInput:
            pass
    return about


def unclear(record: dict, error: np.ndarray) -> str:
    """One bit per pixel, base64: where the mean difference over channels is within two standard errors of
    the truth. Empty for closed forms, and where the store no longer holds the truth's noise."""
    key = record["truth"]["key"]
    name = f"{record['scene']}-{record['quantity']}-{record['size']}-{key[:16]}.exr"
    path = store.find(name) if key != "closed-form" else None
    if path is None:
        return ""
    try:
        truth = store.load(path, key)
    except BadInput:
        return ""
    if truth.mean.shape[:2] != error.shape[:2]:
        return ""
    deviation = np.sqrt(truth.variance)
    channels = deviation.shape[2]
    variance = np.einsum("hwc,cd,hwd->hw", deviation, truth.correlation, deviation) / channels**2
    n = math.ceil(max(error.shape[:2]) / LARGEST)
    noise = np.sqrt(block_mean(variance[..., None])[..., 0]) / n
    quiet = np.abs(block_mean(error).mean(axis=2)) <= 2 * noise
    return base64.b64encode(np.packbits(quiet)).decode()


def block_mean(image: np.ndarray) -> np.ndarray:
    """Average over blocks, so that no side exceeds LARGEST."""
    n = math.ceil(max(image.shape[:2]) / LARGEST)
    if n == 1:
        return image
    rows, columns = (np.arange(0, side, n) for side in image.shape[:2])
    sums = np.add.reduceat(np.add.reduceat(image, rows, axis=0), columns, axis=1)
    counts = np.outer(*(np.diff([*at, side]) for at, side in zip((rows, columns), image.shape, strict=False)))
    return sums / counts[..., None]


def pack(image: np.ndarray) -> dict:
    """Size and pixels: float16 of image / scale over the whole range, per channel a plane of high and one
    of low bytes, each as differences of neighbours, deflated. One channel where all agree."""
    if image.shape[2] > 1 and np.array_equal(image, np.broadcast_to(image[..., :1], image.shape), True):
        image = image[..., :1]
    largest = np.abs(image[np.isfinite(image)]).max(initial=0.0)
    scale = float(largest) / HALF_MAX or 1.0
    codes = np.ascontiguousarray((image / scale).astype("<f2")).view(np.uint16)
    planes = np.moveaxis(codes, 2, 0).reshape(codes.shape[2], -1)
    both = np.stack([planes >> 8, planes & 255], axis=1).astype(np.uint8).reshape(-1, planes.shape[1])
    steps = np.diff(both, axis=1, prepend=np.uint8(0))
    height, width, channels = image.shape
    return {
        "width": width,
        "height": height,
        "channels": channels,
        "scale": scale,
        "data": base64.b64encode(zlib.compress(steps.tobytes(), 9)).decode(),
    }


def nice(value: float) -> float:
    """The next of 1, 1.5, 2, 3, 5, 7, 10, ... at or above a value; 0 for 0."""
    if value <= 0:
        return 0.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(m * power for m in (1, 1.5, 2, 3, 5, 7, 10) if m * power >= value * (1 - 1e-9))
