"""Tables, progress and messages of the command line."""

from __future__ import annotations

import json
import sys
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

out = Console(width=None if sys.stdout.isatty() else 200)
err = Console(stderr=True)


def say(message: str) -> None:
    """One line on the error stream."""
    err.print(f"lightproof: {message}", markup=False, highlight=False, soft_wrap=True)


def show(rows: Any, as_json: bool) -> None:
    """Print rows as JSON or as a table."""
    if as_json:
        print(json.dumps(rows, indent=1, default=str))
        return
    table = Table(box=None, header_style="bold", pad_edge=False)
    widest = max(rows, key=len, default={})
    names = list(dict.fromkeys([*widest, *(name for row in rows for name in row)]))
    for name in names:
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*(cell(row.get(name)) for name in names))
    out.print(table, markup=False) if rows else out.print("nothing to show")


def cell(value: Any) -> str:
    """A value for a table."""
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, dict):
        return ", ".join(f"{k}={cell(v)}" for k, v in value.items())
    if isinstance(value, list):
        return ", ".join(map(cell, value))
    return "" if value is None else str(value)


def progress() -> Progress:
    """A progress bar on the error stream, where that is a terminal."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=err,
        transient=True,
        disable=not err.is_terminal,
    )
