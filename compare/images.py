"""Images from files, checked before anything is computed from them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from compare.metrics import errors, flaws
from compare.statistics import Estimate
from reference import store
from reference.truth import Truth
from scenes.contract import RADIANCE, BadInput


def read_image(path: Path) -> np.ndarray:
    """(H, W, C) float64 of the R, G, B or the Y channel. Raises BadInput for anything else."""
    _, channels = store.read_exr(path)
    names = ["R", "G", "B"] if {"R", "G", "B"} <= set(channels) else ["Y"]
    if names == ["Y"] and "Y" not in channels:
        raise BadInput(f"{path} has channels {', '.join(sorted(channels))}: R, G and B, or Y, are expected")
    image = np.stack([channels[c].astype(np.float64) for c in names], axis=-1)
    for flaw in flaws(image):
        raise BadInput(f"{path} holds {flaw['kind']} values ({flaw['text']}): mend the image first")
    return image


def read_truth(path: Path) -> Truth:
    """A truth with its noise where the file is one of ours, else the image as an exact one."""
    header, _ = store.read_exr(path)
    if "lightproof" in header:
        return store.load(path)
    image = read_image(path)
    eye = np.eye(image.shape[2])
    return Truth(image, np.zeros_like(image), eye, None, 0, {"method": "image file, taken as exact"})


def difference(estimate: Path, reference: Path, exposure: tuple[float, float]) -> dict[str, Estimate]:
    """All radiance metrics of one file against another. Raises BadInput for what cannot be compared."""
    a, truth = read_image(estimate), read_truth(reference)
    if a.shape[2] != truth.mean.shape[2]:
        raise BadInput(
            f"{estimate} has {a.shape[2]} channels and {reference} {truth.mean.shape[2]}: "
            "give two images of the same kind"
        )
    return errors(a, truth, RADIANCE, exposure)


def provenance(path: Path) -> dict:
    """What a stored truth says of itself. Raises BadInput where it says nothing."""
    header, _ = store.read_exr(path)
    if "lightproof" not in header:
        raise BadInput(f"{path} is not a truth of Lightproof: its header has no record of how it was made")
    return json.loads(header["lightproof"])
