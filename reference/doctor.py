"""What this machine can run, and the one command that mends each thing that is missing or broken.

Nothing here imports Mitsuba or Dr.Jit into this process: a broken LLVM must give an answer, not an abort.
"""

from __future__ import annotations

import ctypes
import importlib.metadata
import os
import platform
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

from reference import toolchain
from reference.store import user_store

STORE_BYTES = 2 << 30


@dataclass(frozen=True)
class Check:
    """One thing that a machine has or lacks. needed: whether `compare` cannot run without it."""

    name: str
    good: bool
    found: str
    mend: str = ""
    needed: bool = True


def examine() -> list[Check]:
    """All checks, in the order in which they matter."""
    return [python(), *packages(), llvm(), cuda(), optix(), chromium(), disk()]


def python() -> Check:
    """CPython 3.10 or newer."""
    good = sys.version_info >= (3, 10)
    return Check("Python", good, platform.python_version(), "" if good else _apt("python3.11"))


def packages() -> list[Check]:
    """Mitsuba and Dr.Jit, as installed."""
    found = []
    for name in ("mitsuba", "drjit"):
        try:
            found.append(Check(name.capitalize(), True, importlib.metadata.version(name)))
        except importlib.metadata.PackageNotFoundError:
            found.append(Check(name.capitalize(), False, "not installed", "make setup"))
    return found


def llvm() -> Check:
    """The library that Dr.Jit's code generator will use, tried in a child process."""
    tried = toolchain.candidates()
    good = toolchain.find_llvm()
    if good is not None:
        return Check("LLVM", True, f"LLVM {toolchain.llvm_version(good)} ({good}), tried and works")
    found = ", ".join(
        f"LLVM {toolchain.llvm_version(p) or '?'} ({p}) {'aborts' if p.is_file() else 'is not there'}"
        for p in tried
    )
    return Check("LLVM", False, found or "no libLLVM found", toolchain.install_llvm_command())


def cuda() -> Check:
    """An NVIDIA driver with a device; the CPU serves without."""
    good = toolchain.gpu_driver()
    return Check(
        "CUDA",
        good,
        "driver and device" if good else "no NVIDIA driver or device",
        "" if good else _apt("nvidia-driver") + "  (only on a machine with an NVIDIA GPU)",
        needed=False,
    )


def optix() -> Check:
    """The ray-tracing library of the NVIDIA driver, which CUDA variants of Mitsuba need."""
    try:
        ctypes.CDLL("libnvoptix.so.1")
        return Check("OptiX", True, "libnvoptix.so.1", needed=False)
    except OSError:
        mend = _apt("nvidia-driver") + "  (OptiX comes with the full driver)"
        return Check("OptiX", False, "no libnvoptix.so.1", mend, needed=False)


def chromium() -> Check:
    """A browser for the tests of the report page."""
    path = find_chromium()
    mend = "" if path else _apt("chromium")
    return Check("Chromium", path is not None, path or "not found", mend, needed=False)


def find_chromium() -> str | None:
    """The system's Chromium or Chrome."""
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    return next((p for p in map(shutil.which, names) if p), None)


def disk() -> Check:
    """Room for the store of truths."""
    folder = user_store()
    there = next(p for p in (folder, *folder.parents) if p.exists())
    free = shutil.disk_usage(there).free
    good = free >= STORE_BYTES and os.access(there, os.W_OK)
    mend = "" if good else "export LIGHTPROOF_STORE=/a/folder/with/2/GiB"
    return Check("Store", good, f"{folder}: {free / 2**30:.1f} GiB free", mend)


def _apt(package: str) -> str:
    if sys.platform == "darwin":
        return f"brew install {package}"
    sudo = "" if os.geteuid() == 0 else "sudo "
    if not Path("/usr/bin/apt-get").exists():
        return f"install {package} with this system's package manager"
    return f"{sudo}apt-get update && {sudo}apt-get install -y {package}"
