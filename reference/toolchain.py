"""A working LLVM for Dr.Jit, found before Dr.Jit is imported, and the variant to run.

With LLVM 14 to 16 the code generator aborts the whole process, so each candidate library is tried in
a child process first and the answer remembered until the file changes.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from scenes.contract import BadInput

LIBRARY_FOLDERS = (
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/usr/lib64",
    "/usr/lib",
    "/usr/local/lib",
    "/opt/homebrew/opt/llvm/lib",
    "/usr/local/opt/llvm/lib",
)
PACKAGED = "/usr/lib"  # where distributions keep llvm-*/lib
TRIAL = (
    "import resource; resource.setrlimit(resource.RLIMIT_CORE, (0, 0));"
    "import drjit as dr, mitsuba as mi; mi.set_variant('llvm_ad_rgb');"
    "s = mi.load_dict(mi.cornell_box()); dr.eval(mi.render(s, spp=1)); dr.sync_thread()"
)


def cache_folder() -> Path:
    """Where this user's caches lie: LIGHTPROOF_CACHE, else XDG_CACHE_HOME/lightproof."""
    chosen = os.environ.get("LIGHTPROOF_CACHE")
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(chosen) if chosen else Path(base) / "lightproof"


def llvm_version(library: Path) -> int:
    """Major version in a library's real name, 0 where it has none."""
    names = [library.name, library.resolve().name, *library.resolve().parts]
    found = [re.search(r"(?:LLVM[-.](?:so\.)?|llvm-?|llvm/)(\d+)", n) for n in names]
    return next((int(m.group(1)) for m in found if m), 0)


def candidates() -> list[Path]:
    """LLVM libraries on this machine, best first: the one named by the user, then the newest."""
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    if named:
        return [Path(named)]
    folders = [Path(f) for f in LIBRARY_FOLDERS]
    folders += sorted(Path(PACKAGED).glob("llvm-*/lib"))
    found = {
        p.resolve(): p
        for folder in folders
        for pattern in ("libLLVM*.so*", "libLLVM*.dylib")
        for p in folder.glob(pattern)
    }
    return sorted(found.values(), key=lambda p: (14 <= llvm_version(p) <= 16, -llvm_version(p)))


def works(library: Path) -> bool:
    """Whether Dr.Jit compiles and runs with this library, tried once in a child process.

    The answer is remembered for this file and this Dr.Jit; a trial that ran out of time is not.
    """
    memory = cache_folder() / "llvm.json"
    try:
        known = json.loads(memory.read_text())
    except (OSError, ValueError):
        known = {}
    try:
        stat = library.stat()
        version = importlib.metadata.version("drjit")
    except (OSError, importlib.metadata.PackageNotFoundError):
        return False
    label = f"{library.resolve()} {stat.st_size} {int(stat.st_mtime)} drjit {version}"
    if label not in known:
        environment = {**os.environ, "DRJIT_LIBLLVM_PATH": str(library)}
        try:
            trial = subprocess.run(
                [sys.executable, "-c", TRIAL], env=environment, capture_output=True, timeout=300, check=False
            )
        except subprocess.TimeoutExpired:
            return False
        known[label] = trial.returncode == 0
        try:
            memory.parent.mkdir(parents=True, exist_ok=True)
            memory.write_text(json.dumps(known))
        except OSError:
            pass
    return known[label]


def find_llvm() -> Path | None:
    """The first library that works, None where none does."""
    return next((p for p in candidates() if works(p)), None)


def no_llvm() -> str:
    """What to say where no library works."""
    found = ", ".join(f"LLVM {llvm_version(p) or '?'} ({p})" for p in candidates()) or "none"
    named = " or unset DRJIT_LIBLLVM_PATH" if os.environ.get("DRJIT_LIBLLVM_PATH") else ""
    return (
        f"no LLVM library that Dr.Jit can use (found: {found}; 14 to 16 abort, 17 or newer is expected): "
        f"run {install_llvm_command()}{named}"
    )


def install_llvm_command() -> str:
    """The one command that mends a missing or broken LLVM on this machine."""
    if sys.platform == "darwin":
        return "brew install llvm"
    if not shutil.which("apt-get"):
        return "this system's package manager to install LLVM 17 or newer"
    sudo = "" if os.geteuid() == 0 else "sudo "
    return f"{sudo}apt-get update && {sudo}apt-get install -y {newest_llvm_package()}"


def newest_llvm_package() -> str:
    """libllvm19 where the package lists have it, else the newest from 17 that they have."""
    try:
        listed = subprocess.run(
            ["apt-cache", "--names-only", "search", r"^libllvm[0-9]+$"],
            capture_output=True,
            text=True,
            check=False,
        ).stdout
    except OSError:
        listed = ""
    versions = {int(v) for v in re.findall(r"^libllvm(\d+)", listed, re.MULTILINE)}
    good = sorted(v for v in versions if v >= 17)
    return "libllvm19" if 19 in good or not good else f"libllvm{good[-1]}"


def use_device(device: str) -> str:
    """Set the Mitsuba variant for "auto", "cpu" or "gpu" and return its name.

    Raises BadInput where the device cannot run, naming the command that mends it.
    """
    if device not in ("auto", "cpu", "gpu"):
        raise BadInput(f"device must be auto, cpu or gpu, not {device!r}")
    if device != "cpu" and gpu_driver():
        variant = "cuda_ad_rgb"
    elif device == "gpu":
        raise BadInput("no NVIDIA driver was found on this machine: install one, or use --device cpu")
    else:
        library = find_llvm()
        if library is None:
            raise BadInput(no_llvm())
        os.environ["DRJIT_LIBLLVM_PATH"] = str(library)
        variant = "llvm_ad_rgb"
    import mitsuba as mi

    mi.set_variant(variant)
    return variant


def gpu_driver() -> bool:
    """Whether the NVIDIA driver's CUDA library can be loaded and sees a device."""
    import ctypes

    try:
        cuda = ctypes.CDLL("libcuda.so.1")
    except OSError:
        return False
    count = ctypes.c_int(0)
    return cuda.cuInit(0) == 0 and cuda.cuDeviceGetCount(ctypes.byref(count)) == 0 and count.value > 0


@contextmanager
def other_variant(name: str) -> Iterator[None]:
    """Another variant of Mitsuba within a block; objects of the old one stay usable after it."""
    import mitsuba as mi

    kept = mi.variant()
    if kept == name:
        yield
        return
    mi.set_variant(name)
    try:
        yield
    finally:
        mi.set_variant(kept)


def spectral_twin(variant: str) -> str:
    """The spectral variant of the same device. Raises BadInput for a variant that is not RGB."""
    if not variant.endswith("_rgb"):
        raise BadInput(f"{variant} has no spectral twin here: expected a variant that ends in _rgb")
    return variant.removesuffix("_rgb") + "_spectral"
