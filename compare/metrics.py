"""Which errors are reported for which kind of quantity.

radiance  bias, rmse (over the mean of the truth), relmse, gain, rmse_gain, p50, p99, max, flip
ratio     bias, mae, rmse (absolute), p99, max
length    bias, mae, rmse, p99, max (m)

bias, rmse, relmse, gain and rmse_gain are unbiased and carry intervals; the others carry the floor
that two halves of the truth read against each other.
"""

from __future__ import annotations

import numpy as np

from compare.statistics import Estimate, best_gain, bias, mse, offset, root
from reference.truth import Truth
from scenes.contract import BadInput, Quantity

PIXELS_PER_DEGREE = 67.0
MEANS = {
    "bias": "mean of the estimate over the mean of the truth, less 1; for lengths their difference",
    "rmse": "root of the mean squared error; over the mean of the truth for radiance",
    "relmse": "mean of squared error over (truth^2 + 1 % of the mean squared)",
    "gain": "the one factor that brings the estimate nearest",
    "rmse_gain": "rmse left after that factor: error of shape, not of level",
    "mae": "mean absolute difference",
    "p50": "median of the absolute error, relative for radiance",
    "p99": "99th percentile of the absolute error, relative for radiance",
    "max": "largest absolute error, relative for radiance",
    "flip": "mean HDR-FLIP at the scene's pinned exposures",
}


def same_shape(a: np.ndarray, truth: Truth) -> tuple[np.ndarray, Truth]:
    """Both with as many channels as they need: a grey one is spread over the other's channels."""
    ca, cr = a.shape[2], truth.mean.shape[2]
    if ca == cr:
        return a, truth
    if cr == 1 and np.array_equal(a, np.broadcast_to(a[..., :1], a.shape)):
        return a[..., :1], truth
    if cr == 1:
        return a, truth.spread(ca)
    return np.repeat(a, cr, 2), truth


def errors(
    a: np.ndarray, truth: Truth, quantity: Quantity, exposure: tuple[float, float] | None
) -> dict[str, Estimate]:
    """All metrics of an image (H, W, C) against a truth of the same size. FLIP only with an exposure."""
    if a.shape[:2] != truth.mean.shape[:2]:
        raise BadInput(
            f"the images differ in size: {a.shape[1]}x{a.shape[0]} against "
            f"{truth.mean.shape[1]}x{truth.mean.shape[0]}; render both at the same size"
        )
    a, truth = same_shape(a, truth)
    if quantity.kind != "radiance":
        level = bias if quantity.kind == "ratio" else offset
        found = {"bias": level(a, truth), "rmse": root(mse(a, truth))}
        return found | absolute_errors(a, truth, ("mae", "p99", "max"), relative=False)
    mean = float(truth.mean.mean())
    if mean <= 0:
        raise BadInput("the truth is black everywhere, so that no relative error exists: light the scene")
    gain, left = best_gain(a, truth)
    found = {
        "bias": bias(a, truth),
        "rmse": root(mse(a, truth), mean),
        "relmse": mse(a, truth, 1 / (truth.mean**2 + 1e-2 * mean**2)),
        "gain": gain,
        "rmse_gain": root(left, mean),
        **absolute_errors(a, truth, ("p50", "p99", "max"), relative=True),
    }
    if exposure is not None:
        found["flip"] = flip(a, truth, exposure)
    return found


def absolute_errors(
    a: np.ndarray, truth: Truth, names: tuple[str, ...], *, relative: bool
) -> dict[str, Estimate]:
    """Mean, percentiles and maximum of |A - R|, over |R| with a floor of 1 % of its mean if relative."""
    unit = np.maximum(np.abs(truth.mean), 0.01 * np.abs(truth.mean).mean()) if relative else 1.0
    error = np.abs(a - truth.mean) / unit
    noise = None if truth.half_difference is None else np.abs(truth.half_difference) / unit
    pool = {
        "mae": np.mean,
        "p50": lambda x: np.percentile(x, 50),
        "p99": lambda x: np.percentile(x, 99),
        "max": np.max,
    }
    found = {}
    for name in names:
        value = float(pool[name](error))
        found[name] = Estimate(value, value, value, None if noise is None else float(pool[name](noise)))
    return found


def flip(a: np.ndarray, truth: Truth, exposure: tuple[float, float]) -> Estimate:
    """Mean HDR-FLIP at pinned exposures (stops), and its floor between halves of the truth."""
    value = flip_map(truth.mean, a, exposure).mean()
    floor = None if truth.exact else float(flip_map(*truth.halves(), exposure).mean())
    return Estimate(float(value), float(value), float(value), floor)


def flip_map(reference: np.ndarray, test: np.ndarray, exposure: tuple[float, float]) -> np.ndarray:
    """HDR-FLIP error per pixel, (H, W) in [0, 1]. Negative and missing values count as black."""
    import flip_evaluator

    pair = [
        np.ascontiguousarray(
            np.broadcast_to(np.clip(np.nan_to_num(x), 0, 1e6), (*x.shape[:2], 3)), np.float32
        )
        for x in (reference, test)
    ]
    start, stop = exposure
    settings = {
        "ppd": PIXELS_PER_DEGREE,
        "startExposure": float(start),
        "stopExposure": float(stop),
        "numExposures": max(2, int(np.ceil(stop - start))),
    }
    error, _, _ = flip_evaluator.evaluate(pair[0], pair[1], "HDR", applyMagma=False, parameters=settings)
    return np.asarray(error, np.float64).reshape(error.shape[0], error.shape[1], -1)[..., 0]


def flaws(a: np.ndarray, *, signed: bool = False) -> list[dict]:
    """What no image may hold: values that are not finite, and, unless they are signed, negative ones; with
    the first pixel."""
    found = []
    for kind, bad in (
        ("NaN", np.isnan(a)),
        ("infinity", np.isinf(a)),
        ("negative", (not signed) & (np.nan_to_num(a, posinf=0, neginf=0) < 0)),
    ):
        where = np.argwhere(bad.any(axis=2))
        if len(where):
            y, x = (int(i) for i in where[0])
            found.append(
                {
                    "kind": kind,
                    "text": f"{len(where)} of {bad.shape[0] * bad.shape[1]} pixels, first at ({x}, {y})",
                    "count": len(where),
                    "pixel": [x, y],
                }
            )
    return found
