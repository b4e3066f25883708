"""Curves of light by depth, fitted to the source function: writes `approximations/kit/light_curves.npz`.

    PYTHONPATH=. python tools/fit_light_curves.py

For each cloud and lobe: a, b and k of a e^(-k d) (1 - e^(-b d)), and the values at its knots of the function
that is straight between them in log d, all by least squares of S at the probes; see
`approximations.clouds.light_curve`. Prints what each leaves, next to octaves, to a constant, and to the best
product of a curve of depth and one of angle. Truths that the store lacks are rendered: many minutes.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from approximations.clouds import light_curve as model
from approximations.clouds.scattering_octaves import octave_source
from approximations.kit.cloud_march import light_depth
from reference.store import obtain
from reference.toolchain import use_device
from scenes.cloud import CloudSlab
from scenes.contract import SOURCE_FUNCTION, Scene
from scenes.cumulus import Cumulus

SIZE = 64
CLOUDS: dict[str, Scene] = {"slab": CloudSlab(), "cumulus": Cumulus()}
STARTS = ((2.0, 2.0, 1.0), (5.0, 50.0, 0.05), (2.0, 5.0, 0.1))
MOST = 1000.0  # of b, beyond which all points are as good as deep
BINS = 24, 64  # of depth and of angle, for what no lobe of a fixed shape can do


def curve(x: np.ndarray, d: np.ndarray) -> np.ndarray:
    """a e^(-k d) (1 - e^(-b d))."""
    return x[0] * np.exp(-x[2] * d) * (1 - np.exp(-x[1] * d))


def fit_constants(s: np.ndarray, d: np.ndarray, lobe: np.ndarray) -> np.ndarray:
    """a, b and k."""
    found = [
        least_squares(lambda y: curve(np.exp(y), d) * lobe - s, np.log(x), bounds=(-12, np.log(MOST)))
        for x in STARTS
    ]
    return np.exp(min(found, key=lambda r: r.cost).x)


def hats(d: np.ndarray) -> np.ndarray:
    """(n, KNOTS): weights of the oracle's knots at each depth."""
    share = np.log(np.clip(d, model.FIRST, model.LAST) / model.FIRST) / np.log(model.LAST / model.FIRST)
    return np.maximum(1 - np.abs(share[:, None] * (model.KNOTS - 1) - np.arange(model.KNOTS)), 0)


def fit_knots(s: np.ndarray, d: np.ndarray, lobe: np.ndarray) -> np.ndarray:
    """Values at the knots; those that no point is near follow their neighbours."""
    basis = hats(d)
    smooth = 1e-3 * np.linalg.norm(lobe) * np.diff(np.eye(model.KNOTS), axis=0)
    rows, wanted = np.vstack([basis * lobe[:, None], smooth]), np.append(s, np.zeros(len(smooth)))
    return np.linalg.lstsq(rows, wanted, rcond=None)[0]


def quantile_bins(x: np.ndarray, n: int) -> np.ndarray:
    """Which of n groups of equal number each value is in."""
    return np.clip(np.searchsorted(np.quantile(x, np.linspace(0, 1, n + 1)), x, side="right") - 1, 0, n - 1)


def best_product(s: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """f[i] h[j] of least squares."""
    f, h = np.ones(BINS[0]), np.ones(BINS[1])
    for _ in range(100):
        f = np.bincount(i, s * h[j], BINS[0]) / np.bincount(i, h[j] ** 2, BINS[0])
        h = np.bincount(j, s * f[i], BINS[1]) / np.bincount(j, f[i] ** 2, BINS[1])
    return f[i] * h[j]


def main() -> None:
    """Fit, write and print."""
    use_device("cpu")
    kept = {}
    for name, scene in CLOUDS.items():
        truth, _ = obtain(scene, SOURCE_FUNCTION, SIZE)
        s, noise = truth.mean.ravel(), truth.variance.mean()
        view = scene.probes(SIZE)
        d = np.array(light_depth(view, view.camera.origin, model.LIGHT_STEPS), dtype=np.float64)
        cosine = np.array(scene.to_sun()) @ np.array(view.camera.direction, dtype=np.float64)

        def left(found: np.ndarray, s=s, noise=noise) -> float:
            return float(np.sqrt(max(np.mean((found - s) ** 2) - noise, 0)) / s.mean())

        for phase, g in (("hg", model.BROAD), ("exact", scene.g)):
            lobe = (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)
            x, knots = fit_constants(s, d, lobe), fit_knots(s, d, lobe)
            kept[f"{name} {phase}"] = np.append(x, knots).astype(np.float32)
            printed = curve(np.array(model.PRINTED), d) * lobe
            gained = printed * (printed @ s) / (printed @ printed)
            print(
                f"{name} {phase}: a {x[0]:.3f} b {x[1]:.3f} k {x[2]:.4f};",
                f"printed {left(printed):.3f}, best gain {left(gained):.3f},",
                f"fitted {left(curve(x, d) * lobe):.3f}, oracle {left(hats(d) @ knots * lobe):.3f}",
            )
        print(f"{name}: constant {left(np.full_like(s, s.mean())):.3f}", end="")
        i, j = quantile_bins(d, BINS[0]), quantile_bins(cosine, BINS[1])
        print(f", product of free curves of depth and of angle {left(best_product(s, i, j)):.3f}", end="")
        print(f", octaves {left(np.array(octave_source(view))[0]):.3f}", end="")
        print(f", with b = 0.7 {left(np.array(octave_source(view, contribution=0.7))[0]):.3f}")
    np.savez(model.TABLE, **kept)


if __name__ == "__main__":
    main()
