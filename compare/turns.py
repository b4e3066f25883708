"""Turns at the machine among the workers of a run: many may compute at once, who is timed is alone.

A lock on a file, shared by those who compute and held alone by the one who is timed; the system lets it go
when a process dies. Without a file, in a process of its own, there is nobody to wait for.
"""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

_lock: IO | None = None


def join(path: Path) -> None:
    """Take turns with all who join the same file."""
    global _lock
    _lock = path.open("a")


@contextmanager
def computing() -> Iterator[None]:
    """While others may compute too."""
    with _turn(fcntl.LOCK_SH):
        yield


@contextmanager
def timed() -> Iterator[None]:
    """While nobody else computes."""
    with _turn(fcntl.LOCK_EX):
        yield


@contextmanager
def _turn(kind: int) -> Iterator[None]:
    if _lock is None:
        yield
        return
    fcntl.flock(_lock, kind)
    try:
        yield
    finally:
        fcntl.flock(_lock, fcntl.LOCK_UN)
