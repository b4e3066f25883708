r"""What an image loses with parts of its light transport, measured until it is settled.

The loss is a metric of `compare.metrics` between the reduced image A and the full one R. Both are means of
independent batches with seeds of their own, so that the noise of both is taken away:
E (A - R)^2 - V_A - V_R (`compare.stochastic`). Its 95 % interval lies on one side of the tolerance, or not:

    can be dropped   the interval's upper end is within the tolerance
    is needed        its lower end is above it
    not settled      neither

A metric that cannot be freed of noise has its floor in the place of the interval's half width. |bias| and
|gain - 1| are lengths.

    cost = variance of a batch x time of its kernels
"""

from __future__ import annotations

import time
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from compare import cost
from compare.metrics import MEANS
from compare.statistics import Estimate
from compare.stochastic import errors
from reference.moments import Moments
from reference.reduced import Reduction, sample_reduced
from reference.render import Draw, batch_seed
from reference.store import Demand, obtain
from reference.transport import Transport
from reference.truth import Truth, has_closed_form
from scenes.contract import RADIANCE, Scene

METRICS = tuple(m for m in MEANS if m != "mae")
IDEAL = {"gain": 1.0}
FIRST = 4
"""Batches behind the first look at a loss; the squared error pools their variances over all pixels."""
DROPPED, NEEDED, OPEN = "can be dropped", "is needed", "not settled"


@dataclass
class Sampling:
    """An image that grows: its batches, and the kernel time of each (ms). truth: as of the last milestone."""

    draw: Draw
    how: Transport
    seed: int
    moments: Moments = field(default_factory=Moments)
    milliseconds: list[float] = field(default_factory=list)
    truth: Truth | None = None

    def grow(self, batches: int, deadline: float) -> None:
        """Add batches up to a number of them, unless time is up before."""
        with cost.recording():
            while self.moments.count < batches:
                if time.monotonic() >= deadline:
                    return
                self.moments.add(self.draw(self.how.spp, batch_seed(self.seed, self.moments.count)))
                self.milliseconds.append(cost.milliseconds(cost.kernels()))
        self.truth = self.moments.truth()

    def cost(self) -> dict[str, float]:
        """Kernel time of a sample a pixel (ms, median, without the first batch, which warms up) and its
        product with the variance of a sample."""
        a = self.truth.spread(3)
        each = float(np.median(self.milliseconds[1:])) / self.how.spp
        return {"ms": each, "ms_variance": each * float(a.variance.mean()) * a.batches * self.how.spp}


@dataclass
class Question:
    """A scene at a size, the metric and tolerance, and the full image that losses are measured against."""

    scene: Scene
    size: int
    metric: str
    tolerance: float
    seed: int
    batches: int
    full: Truth | None = None
    whole: Sampling | None = None
    found: dict[tuple[str, ...], Sampling] = field(default_factory=dict)

    def grow_full(self, batches: int, deadline: float) -> None:
        """The full image, from the store unless its truth is a closed form."""
        left = deadline - time.monotonic()
        if left <= 0 or (self.full is not None and self.full.batches >= batches):
            return
        if has_closed_form(type(self.scene), RADIANCE):
            self.whole = self.whole or self.sampling((), "full")
            self.whole.grow(batches, deadline)
            self.full = self.whole.truth
        else:
            demand = Demand(0.0, batches=batches, seconds=left)
            self.full, _ = obtain(self.scene, RADIANCE, self.size, demand=demand, seed=self.seed)

    def sampling(self, reductions: Iterable[Reduction], series: str) -> Sampling:
        """The image without what is dropped, with the seeds of a series."""
        chosen = tuple(reductions)
        draw, how = sample_reduced(self.scene, self.size, chosen)
        label = " + ".join((series, *(r.label for r in chosen)))
        return Sampling(draw, how, batch_seed(self.seed, zlib.crc32(label.encode())))

    def measure(
        self, reductions: Iterable[Reduction], batches: int, deadline: float, series: str = "alone"
    ) -> dict:
        """A row: verdict, loss and cost with so many batches, or with what time was left for."""
        chosen = tuple(reductions)
        key = (series, *(r.label for r in chosen))
        if time.monotonic() < deadline:
            if key not in self.found:
                self.found[key] = self.sampling(chosen, series)
            self.found[key].grow(batches, deadline)
        image = self.found.get(key)
        row = {
            "family": chosen[0].family if len(chosen) == 1 else None,
            "level": chosen[0].level if len(chosen) == 1 else None,
            "depth": chosen[0].depth if len(chosen) == 1 else None,
            "drops": [r.label for r in chosen],
            "assumes": [r.assumes for r in chosen],
        }
        if image is None or image.truth is None or self.full is None:
            return row | {"verdict": OPEN, "loss": None, "batches": 0, "transport": None, "cost": None}
        lost = loss(image.truth, self.full, self.metric, self.scene.exposure)
        return row | {
            "verdict": verdict(lost, self.tolerance),
            "loss": lost.plain(),
            "batches": image.truth.batches,
            "transport": image.how.plain(),
            "cost": image.cost(),
        }


def loss(estimate: Truth, full: Truth, metric: str, exposure: tuple[float, float]) -> Estimate:
    """How far an image is from the full one, with its 95 % interval; for FLIP and percentiles, its floor."""
    found = errors(estimate, full, RADIANCE, exposure if metric == "flip" else None)[metric]
    half = found.high - found.value if found.floor is None else found.floor
    if metric in ("bias", "gain"):
        value = abs(found.value - IDEAL.get(metric, 0.0))
        return Estimate(value, max(value - half, 0.0), value + half)
    if found.floor is not None:
        return replace(found, low=max(found.value - half, 0.0), high=found.value + half)
    return found


def verdict(lost: Estimate, tolerance: float) -> str:
    """On which side of the tolerance the interval lies."""
    return DROPPED if lost.high <= tolerance else NEEDED if lost.low > tolerance else OPEN


def ratio(price: dict | None, full: dict | None) -> float | None:
    """Cost over that of the full transport at equal noise; of a sample where the full image has no noise."""
    if not price or not full or full["ms"] == 0:
        return None
    name = "ms_variance" if full["ms_variance"] > 0 else "ms"
    return price[name] / full[name]
