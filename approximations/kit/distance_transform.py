"""Distance transforms: from a binary image of what is inside to every cell's distance from the other side.

All of them give, for every cell, the distance between its centre and that of the nearest cell of the opposite
state, in cells, positive outside and negative inside. From 1 outside to -1 inside there is no 0.
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy import ndimage

CHAMFER = (3.0, 4.0, 5.0)
"""Weights of a step along an axis, the diagonal of a face and of a cell; 3 stands for one cell."""


def signed_distance(inside: np.ndarray, metric: str) -> np.ndarray:
    """Signed distance in cells. metric: "euclidean", "chamfer", "chessboard" or "city block"."""
    return unsigned_distance(~inside, metric) - unsigned_distance(inside, metric)


def unsigned_distance(solid: np.ndarray, metric: str) -> np.ndarray:
    """Distance of the cells of `solid` from the nearest cell outside it, 0 there, in cells.

    Euclidean: what the search through all pairs of cells finds, in linear time (scipy's exact transform).
    Where no cell is outside, every distance is the number of cells along the sum of the edges.
    """
    if solid.all():
        return np.full(solid.shape, float(sum(solid.shape)))
    if metric == "euclidean":
        return ndimage.distance_transform_edt(solid)
    if metric == "chamfer":
        return chamfer(solid)
    name = {"chessboard": "chessboard", "city block": "taxicab"}[metric]
    return ndimage.distance_transform_cdt(solid, name).astype(float)


def chamfer(solid: np.ndarray) -> np.ndarray:
    """Chamfer 3-4-5: the cheapest way by single steps, over 3.

    A cheapest way needs one axis, one face diagonal and one cell diagonal at most, in any order: one sweep to
    and one fro for each of the 13 lines, which come with their mirror images, finds it.
    """
    found = np.where(solid, 3.0 * sum(solid.shape), 0.0)
    lines = list(itertools.product((-1, 0, 1), repeat=3))[14:]
    for step in lines:
        weight = CHAMFER[np.count_nonzero(step) - 1]
        axis = next(i for i in range(3) if step[i])
        layers = np.moveaxis(found, axis, 0)
        across = [step[i] for i in range(3) if i != axis]
        for i in range(1, len(layers)):
            _relax(layers[i], layers[i - 1], across, weight)
        for i in range(len(layers) - 1, 0, -1):
            _relax(layers[i - 1], layers[i], across, weight)
    return found / 3


def _relax(layer: np.ndarray, previous: np.ndarray, shift: list[int], weight: float) -> None:
    """layer = min(layer, previous moved by `shift` + weight), in place."""
    to, start = zip(
        *(
            (slice(max(s, 0), n + min(s, 0)), slice(max(-s, 0), n + min(-s, 0)))
            for s, n in zip(shift, layer.shape, strict=True)
        ),
        strict=True,
    )
    np.minimum(layer[to], previous[start] + weight, out=layer[to])
