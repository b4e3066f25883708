"""What a truth is, and which way leads to it for a scene and a quantity.

A closed form in float64 is taken where one is declared; otherwise independent Monte Carlo batches.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from scenes.contract import SUBSAMPLES, BadInput, Quantity, Scene, discover


@dataclass(frozen=True)
class Truth:
    """The exact value of a quantity on a scene, with what is known of its error.

    mean: (H, W, C) float64, C = 1 where all channels agree. variance: of that mean, same shape, zeros
    for a closed form. correlation: (C, C) between the channels of a pixel, pooled over the image.
    half_difference: (A - B) / 2 of the means of two independent halves, None for a closed form.
    batches: how many independent batches the variance comes from, 0 for a closed form.
    """

    mean: np.ndarray
    variance: np.ndarray
    correlation: np.ndarray
    half_difference: np.ndarray | None
    batches: int
    provenance: dict[str, Any] = field(default_factory=dict)

    @property
    def pixel_noise(self) -> float:
        """Root mean square of the pixels' standard errors over the mean of the image."""
        return float(np.sqrt(self.variance.mean()) / max(abs(self.mean.mean()), 1e-300))

    def resolution(self, tile: int | None = None) -> float:
        """The least rmse, over the mean of the image, that this truth tells from none at 95 %.

        A perfect estimate reads a mean squared error of 0 +- 1.96 sqrt(2 sum (tr C)^2) / n, of which this is
        the root. With `tile`, within the worst of the tiles of that many pixels a side. 0 where exact.
        """
        height, width, channels = self.mean.shape
        squared = self.variance.sum(axis=2) ** 2
        side = min(tile, height, width) if tile else None
        if side:
            rows, columns = (np.arange(0, n - side + 1, side) for n in (height, width))
            whole = squared[: len(rows) * side, : len(columns) * side]
            sums = np.add.reduceat(np.add.reduceat(whole, rows, axis=0), columns, axis=1)
            spread = np.sqrt(2 * sums.max()) / (side * side * channels)
        else:
            spread = np.sqrt(2 * squared.sum()) / self.mean.size
        return float(np.sqrt(1.96 * spread) / max(abs(self.mean.mean()), 1e-300))

    @property
    def exact(self) -> bool:
        """True for closed forms."""
        return self.batches == 0

    def spread(self, channels: int) -> Truth:
        """The same truth with its one channel in so many; itself where it has them already."""
        if self.mean.shape[2] == channels:
            return self
        half = self.half_difference
        return replace(
            self,
            mean=np.repeat(self.mean, channels, 2),
            variance=np.repeat(self.variance, channels, 2),
            correlation=np.ones((channels, channels)),
            half_difference=None if half is None else np.repeat(half, channels, 2),
        )

    def halves(self) -> tuple[np.ndarray, np.ndarray]:
        """Two independent estimates of the truth; twice the truth itself where it is exact."""
        if self.half_difference is None:
            return self.mean, self.mean
        return self.mean + self.half_difference, self.mean - self.half_difference


ClosedForm = Callable[[Scene, int], np.ndarray]
Sampler = Callable[[Scene, int, int, int], np.ndarray]
CLOSED_FORMS: dict[tuple[type[Scene], str], ClosedForm] = {}
SAMPLERS: dict[tuple[type[Scene], str], Sampler] = {}


def closed_form(scene: type[Scene], quantity: Quantity) -> Callable[[ClosedForm], ClosedForm]:
    """Declare f(scene, size) -> (size, size, C) float64, exact at the centres of size x size samples."""

    def declare(function: ClosedForm) -> ClosedForm:
        CLOSED_FORMS[scene, quantity.name] = function
        return function

    return declare


def sampler(scene: type[Scene], quantity: Quantity) -> Callable[[Sampler], Sampler]:
    """Declare f(scene, size, spp, seed) -> (size, size, C): one unbiased batch, where `mi.render` of
    the scene's own sensor does not answer the question."""

    def declare(function: Sampler) -> Sampler:
        SAMPLERS[scene, quantity.name] = function
        return function

    return declare


def has_closed_form(scene: type[Scene], quantity: Quantity) -> bool:
    """Whether the truth is a closed form."""
    return _find(CLOSED_FORMS, scene, quantity) is not None


def find_sampler(scene: type[Scene], quantity: Quantity) -> Sampler | None:
    """The declared sampler, None where Mitsuba's own render serves."""
    return _find(SAMPLERS, scene, quantity)


def evaluate_closed_form(scene: Scene, quantity: Quantity, size: int) -> Truth:
    """The closed form averaged over SUBSAMPLES^2 points of every pixel; probes have one point each."""
    function = _find(CLOSED_FORMS, type(scene), quantity)
    if function is None:
        raise BadInput(f"{type(scene).__name__} has no closed form of {quantity.name}")
    fine = 1 if quantity.probes else SUBSAMPLES
    mean = _once(function, scene, quantity, size, lambda: box_filter(function(scene, size * fine), fine))
    channels = mean.shape[2]
    return Truth(
        mean,
        np.zeros_like(mean),
        np.eye(channels),
        None,
        0,
        {
            "method": "closed form in float64",
            "function": f"{function.__module__}.{function.__name__}",
            "scene": type(scene).__name__,
            "fields": scene.fields(),
            "quantity": quantity.name,
            "size": size,
        },
    )


UNUSED_DAYS = 30
_kept: Path | None = None


def keep_closed_forms(folder: Path) -> None:
    """Have this process share the closed forms that it works out with others and with later runs, as files in
    a folder. Those that it has not looked up for UNUSED_DAYS are removed."""
    global _kept
    folder.mkdir(parents=True, exist_ok=True)
    for path in folder.iterdir():
        with suppress(OSError):
            if path.stat().st_mtime < time.time() - UNUSED_DAYS * 86400:
                path.unlink()
    _kept = folder


@cache
def _code() -> str:
    """Digest of all that a closed form may go through."""
    root = Path(__file__).resolve().parents[1]
    files = sorted((root / "scenes").glob("*.py")) + sorted((root / "reference").rglob("*.py"))
    return hashlib.sha256(b"".join(f.read_bytes() for f in files)).hexdigest()


def _once(
    function: ClosedForm, scene: Scene, quantity: Quantity, size: int, work_out: Callable[[], np.ndarray]
) -> np.ndarray:
    if _kept is None:
        return work_out()
    import mitsuba

    own = [Path(inspect.getsourcefile(made)).read_text() for made in (function, type(scene))]
    what = [type(scene).__name__, scene.fields(), quantity.name, size, mitsuba.variant(), _code(), own]
    path = _kept / f"{hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()}.npy"
    with suppress(OSError, ValueError, EOFError):  # not there, not ours to touch, or not whole
        os.utime(path)
        return np.load(path)
    found = work_out()
    partial = _kept / f".{path.stem}.{os.getpid()}"
    with suppress(OSError):
        with partial.open("wb") as file:
            np.save(file, found)
        partial.replace(path)
    return found


def box_filter(image: np.ndarray, n: int) -> np.ndarray:
    """Mean over n x n blocks of a (H, W, C) image."""
    h, w, c = image.shape
    return image.reshape(h // n, n, w // n, n, c).mean(axis=(1, 3), dtype=np.float64)


def _find(table: dict, scene: type[Scene], quantity: Quantity):
    import reference

    discover(reference)
    return next((table[c, quantity.name] for c in scene.__mro__ if (c, quantity.name) in table), None)
