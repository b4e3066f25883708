"""The store of truths: EXR files that say all about themselves, named by what their pixels depend on.

A truth grows: it is asked for with a Demand, batches are added until that is met, and what there is
stays. It is written at fixed numbers of batches (4, 8, 16, 24, 32, 48, 64, ...), so that a killed render
loses a third at most and its pixels are the same in however many sittings they were made.

Two folders are searched: the user's store, then the truths that come with the repository. A file
holds the mean (float32, rounded to a quarter of its standard error or finer), the standard error and
half the difference of two independent halves (float16 of 5 significant bits, scaled): all far below
the noise, and half the size. Its header holds the provenance and a digest of both. A file whose
digest, key or shape does not fit is named and never used.
"""

from __future__ import annotations

import ast
import contextlib
import errno
import hashlib
import inspect
import json
import math
import os
import shutil
import textwrap
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from reference.moments import join
from reference.toolchain import cache_folder
from reference.truth import Truth, evaluate_closed_form, find_sampler, has_closed_form
from scenes.contract import BadInput, Quantity, Scene

SHIPPED = Path(__file__).resolve().parents[1] / "truths"
CHANNELS = "RGB"
FORMAT = 2
LEAST_BATCHES = 16
"""Fewer give no variance to rely on."""


class DamagedTruth(BadInput):
    """A stored truth that cannot be used, named with the command that renders it again."""


class CannotWrite(BadInput):
    """A file could not be written: a full disk, or a folder without the right to write."""

    @property
    def full(self) -> bool:
        """Whether there was no room: the same command goes on once there is."""
        return any(os.strerror(e) in str(self) for e in (errno.ENOSPC, errno.EDQUOT))


def user_store() -> Path:
    """LIGHTPROOF_STORE, else `truths` in the user's cache."""
    return Path(os.environ.get("LIGHTPROOF_STORE") or cache_folder() / "truths")


def fingerprint(value: Any) -> Any:
    """Plain data that changes when the pixels would: floats to 6 digits, arrays as digests. Files go by
    their names, which hold digests of what is in them."""
    if isinstance(value, dict):
        named = value | {"filename": Path(value["filename"]).name} if "filename" in value else value
        return {str(k): fingerprint(named[k]) for k in sorted(named, key=str)}
    if isinstance(value, (list, tuple)):
        return [fingerprint(v) for v in value]
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, float):
        return f"{value:.6g}"
    array = np.asarray(getattr(value, "matrix", value), np.float64)
    mantissa, exponent = np.frexp(array)
    rounded = np.stack([np.round(mantissa * 4096), exponent]).astype(np.int32)
    return [list(array.shape), hashlib.sha256(rounded.tobytes()).hexdigest()]


def truth_key(scene: Scene, quantity: Quantity, size: int, seed: int = 1) -> str:
    """Digest of everything that the stored pixels depend on but for their number of batches, and for the
    version of Mitsuba, which the file names."""
    from reference.render import method

    declared = find_sampler(type(scene), quantity)
    content = {
        "scene": fingerprint(scene.mitsuba(size)),
        "fields": fingerprint(scene.fields()),
        "quantity": quantity.name,
        "size": size,
        "method": method(scene, quantity, size),
        "code": code_of(declared) if declared else "",
        "seed": seed,
        "format": FORMAT,
    }
    if quantity.probes:
        content["constants"] = fingerprint(constants(type(scene)))
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def code_of(function: Callable) -> str:
    """The text of a function and of all that it names in its own module, in that order."""
    module = inspect.getmodule(function)
    texts: dict[str, str] = {}

    def read(item: Any) -> None:
        texts[item.__name__] = inspect.getsource(item)
        for name in _names(item):
            found = vars(module).get(name)
            if name in texts or found is None:
                continue
            if inspect.getmodule(found) is module and (inspect.isfunction(found) or inspect.isclass(found)):
                read(found)
            elif name.isupper():
                texts[name] = repr(found)

    read(function)
    return "\n".join(texts.values())


def _names(item: Any) -> list[str]:
    tree = ast.parse(textwrap.dedent(inspect.getsource(item)))
    return list(dict.fromkeys(n.id for n in ast.walk(tree) if isinstance(n, ast.Name)))


def constants(scene: type[Scene]) -> dict[str, Any]:
    """The plain constants of a scene's classes, which may say where its probes are: no dictionary of Mitsuba
    does."""
    plain = (int, float, str, tuple, list)
    found = {k: v for c in reversed(scene.__mro__) for k, v in vars(c).items()}
    return {k: v for k, v in sorted(found.items()) if k.isupper() and isinstance(v, plain)}


def file_name(scene: Scene, quantity: Quantity, size: int, key: str) -> str:
    """Readable part, then the key that decides."""
    return f"{type(scene).__name__}-{quantity.name}-{size}-{key[:16]}.exr"


def find(name: str) -> Path | None:
    """The stored file of that name, the user's store before the shipped truths."""
    return next((p for p in (user_store() / name, SHIPPED / name) if p.is_file()), None)


@dataclass(frozen=True)
class Demand:
    """What a comparison asks of a truth.

    resolution: the least relative rmse that it must tell from none, over the image or, with `tile`, in the
    worst tile of so many pixels a side. batches, seconds: budgets that end the growth before that; at least
    LEAST_BATCHES are made unless time is up. With resolution 0, batches is a fixed budget.
    """

    resolution: float = math.inf
    tile: int | None = None
    batches: int = 1024
    seconds: float = math.inf

    def __post_init__(self) -> None:
        tile = 1 if self.tile is None else self.tile
        if not self.resolution >= 0 or self.batches < 4 or not self.seconds > 0 or tile < 1:
            raise BadInput(
                f"cannot ask for {self}: resolution is 0 or more, tile 1 or more, batches 4 or more, "
                "seconds above 0"
            )

    def unmet(self, truth: Truth, seconds: float) -> bool:
        """Whether more batches are wanted and within budget."""
        least = min(LEAST_BATCHES, self.batches)
        wanted = truth.batches < least or truth.resolution(self.tile) > self.resolution
        return wanted and milestone(truth.batches) <= self.batches and seconds < self.seconds

    def verdict(self, truth: Truth) -> str:
        """ "reached", or which budget ended the growth before."""
        if truth.exact or truth.resolution(self.tile) <= self.resolution:
            return "reached"
        return "batches spent" if milestone(truth.batches) > self.batches else "time spent"


ENOUGH = Demand()
"""LEAST_BATCHES, whatever they resolve."""


def milestone(batches: int) -> int:
    """The next number of batches at which a truth is written: 4, 8, 16, 24, 32, 48, 64, ..."""
    if batches < 4:
        return 4
    power = 1 << (batches.bit_length() - 1)
    return power * 2 if batches < 16 or batches > power else power * 3 // 2


def obtain(
    scene: Scene,
    quantity: Quantity,
    size: int,
    *,
    demand: Demand = ENOUGH,
    seed: int = 1,
    again: bool = False,
    warn: Callable[[str], None] = lambda message: None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[Truth, str]:
    """The truth and its key: closed form, else what the store has, grown until the demand is met.

    A damaged file is named through `warn`, and a sound one is rendered into the user's store. One of another
    version of Mitsuba is named and used as it is, unless more is asked of it or `again` is given: then it is
    rendered anew, since batches of two versions do not mix.
    """
    if quantity not in scene.quantities:
        known = ", ".join(q.name for q in scene.quantities)
        raise BadInput(f"{type(scene).__name__} has no {quantity.name}: it has {known}")
    if has_closed_form(type(scene), quantity):
        return evaluate_closed_form(scene, quantity, size), "closed-form"
    key = truth_key(scene, quantity, size, seed)
    name = file_name(scene, quantity, size, key)
    truth = None if again else largest(name, key, warn)
    if truth is not None and other_version(truth.provenance):
        warn(
            f"{name} was rendered with Mitsuba {truth.provenance['mitsuba']}: "
            f"`lightproof reference render {type(scene).__name__} --again` renders it with this one"
        )
        if demand.unmet(truth, 0.0):
            truth, again = None, True
    started = time.perf_counter()
    draw = None
    while truth is None or demand.unmet(truth, time.perf_counter() - started):
        from reference.render import render_batches, sample

        draw = draw or sample(scene, quantity, size)
        first = truth.batches if truth else 0
        total = max(_expected(truth, demand), milestone(first))
        count = milestone(first) - first
        new = render_batches(
            scene, quantity, size, first, count, seed, lambda done, t=total: progress(done, t), draw
        )
        truth = grown(truth, new)
        save(user_store() / name, truth, key, over_larger=again and first == 0)
        truth = load(user_store() / name, key)
    return truth, key


def grown(old: Truth | None, new: Truth) -> Truth:
    """Both as one truth, with the samples and seconds of both."""
    if old is None:
        return new
    joined = join(old, new)
    joined.provenance["seconds"] = round(old.provenance["seconds"] + new.provenance["seconds"], 2)
    return joined


def _expected(truth: Truth | None, demand: Demand) -> int:
    """Batches that the demand will take: the resolution falls with their square root."""
    if truth is None or truth.batches < LEAST_BATCHES or math.isinf(demand.resolution):
        return min(LEAST_BATCHES, demand.batches)
    if demand.resolution == 0:
        return demand.batches
    return min(
        math.ceil(truth.batches * (truth.resolution(demand.tile) / demand.resolution) ** 2), demand.batches
    )


def largest(name: str, key: str, warn: Callable[[str], None] = lambda message: None) -> Truth | None:
    """The stored truth of that name with the most batches, None where no folder has a sound one."""
    found = []
    for folder in (user_store(), SHIPPED):
        if (folder / name).is_file():
            try:
                found.append(load(folder / name, key))
            except DamagedTruth as damage:
                warn(str(damage))
    return max(found, key=lambda t: t.batches, default=None)


def other_version(about: dict) -> bool:
    """Whether a truth was rendered by another version of Mitsuba than this one."""
    import mitsuba as mi

    return about.get("mitsuba", mi.__version__) != mi.__version__


def save(path: Path, truth: Truth, key: str, over_larger: bool = True) -> None:
    """Write a truth in one step: a reader sees the whole file or none. Raises CannotWrite if it cannot.

    Not over_larger: a sound file of more batches, from a process that was faster, is left there.
    """
    import OpenEXR

    if not over_larger and path.is_file():
        with contextlib.suppress(DamagedTruth):
            there = json.loads(read_exr(path)[0].get("lightproof", "{}"))
            if there.get("key") == key and there.get("batches", 0) >= truth.batches:
                return

    error = np.sqrt(truth.variance)
    scale = float(error.max()) or 1.0
    step = np.exp2(np.floor(np.log2(np.maximum(error, 1e-30))) - 2)
    mean = np.where(error > 0, np.round(truth.mean / step) * step, truth.mean).astype(np.float32)
    half = truth.half_difference if truth.half_difference is not None else np.zeros_like(mean)
    channels = {}
    for c, letter in enumerate(CHANNELS[: mean.shape[2]] if mean.shape[2] > 1 else "Y"):
        channels[letter] = np.ascontiguousarray(mean[..., c])
        channels[f"error.{letter}"] = coarse(error[..., c] / scale)
        channels[f"half.{letter}"] = coarse(half[..., c] / scale)
    about = {
        **truth.provenance,
        "key": key,
        "scale": scale,
        "batches": truth.batches,
        "pixel_noise": truth.pixel_noise,
        "resolution": truth.resolution(),
        "resolution_of_worst_tile": truth.resolution(16),
        "correlation": np.round(truth.correlation, 6).tolist(),
    }
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "lightproof": json.dumps(about | {"digest": digest(about, channels)}, sort_keys=True),
    }
    write_exr(path, header, channels)


def coarse(values: np.ndarray) -> np.ndarray:
    """Rounded to 5 significant bits (within 3 %), as float16."""
    mantissa, exponent = np.frexp(values)
    return np.ldexp(np.round(mantissa * 32) / 32, exponent).astype(np.float16)


def load(path: Path, key: str | None = None) -> Truth:
    """Read a truth. Raises DamagedTruth where the file is not the one that was written for `key`."""
    header, channels = read_exr(path)
    again = "lightproof reference render"
    try:
        about = json.loads(header["lightproof"])
    except (KeyError, ValueError):
        raise DamagedTruth(
            f"{path} has no record of how it was made; delete it and run {again} to replace it"
        ) from None
    if about.pop("digest", None) != digest(about, channels):
        raise DamagedTruth(
            f"{path} is damaged (it does not match its digest); delete it and run {again} to replace it"
        )
    if key is not None and about.get("key") != key:
        raise DamagedTruth(
            f"{path} is the truth of another question (its key differs); delete it and run {again}"
        )
    letters = [c for c in (*CHANNELS, "Y") if c in channels]

    def stack(prefix: str) -> np.ndarray:
        return np.stack([channels[prefix + c].astype(np.float64) for c in letters], axis=-1)

    return Truth(
        mean=stack(""),
        variance=(stack("error.") * about["scale"]) ** 2,
        correlation=np.asarray(about["correlation"]),
        half_difference=stack("half.") * about["scale"],
        batches=about["batches"],
        provenance={k: v for k, v in about.items() if k not in ("scale", "correlation")},
    )


def digest(about: dict, channels: dict[str, np.ndarray]) -> str:
    """SHA-256 of the provenance and of all channels in the order of their names."""
    found = hashlib.sha256(json.dumps(about, sort_keys=True).encode())
    for name in sorted(channels):
        found.update(name.encode() + np.ascontiguousarray(channels[name]).tobytes())
    return found.hexdigest()


def write_exr(path: Path, header: dict, channels: dict[str, np.ndarray]) -> None:
    """Write an EXR beside its place, check it, and move it there. Raises CannotWrite if it cannot."""
    import OpenEXR

    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with silenced_stderr(), OpenEXR.File(header, channels) as exr:
            exr.write(str(partial))
        read_exr(partial)
        partial.replace(path)
    except (OSError, RuntimeError, DamagedTruth) as error:
        full = path.parent.is_dir() and shutil.disk_usage(path.parent).free < 1 << 16
        reason = getattr(error, "strerror", None) or (
            os.strerror(errno.ENOSPC) if full else "the folder is not writable"
        )
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
        raise CannotWrite(
            f"cannot write {path}: {reason}; free space there or choose another folder"
        ) from error


def sweep(folder: Path) -> None:
    """Remove the part-written files of processes that were killed while they wrote to a folder."""
    for partial in folder.glob(".*.*"):
        try:
            os.kill(int(partial.suffix[1:]), 0)
        except ProcessLookupError:
            partial.unlink(missing_ok=True)
        except (ValueError, PermissionError):
            continue


def read_exr(path: Path) -> tuple[dict, dict[str, np.ndarray]]:
    """Header and channels of an EXR file. Raises DamagedTruth where it is not a whole EXR file."""
    import OpenEXR

    try:
        with silenced_stderr(), OpenEXR.File(str(path), separate_channels=True) as exr:
            channels = {name: np.array(c.pixels) for name, c in exr.channels().items()}
            return dict(exr.header()), channels
    except Exception as error:
        reason = "no such file" if not Path(path).exists() else "not an EXR file, or cut short"
        raise DamagedTruth(f"cannot read {path}: {reason}; give a whole OpenEXR file") from error


@contextmanager
def silenced_stderr() -> Iterator[None]:
    """OpenEXR's C library prints its own line before it raises; one clear line is enough."""
    kept = os.dup(2)
    try:
        with Path(os.devnull).open("w") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
