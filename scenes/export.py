"""Scenes as files that Mitsuba itself reads: XML, with density grids beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi

from scenes.contract import BadInput


def export(description: dict, folder: Path, name: str) -> Path:
    """Write a scene dictionary as folder/name.xml with its grids as .vol files; the XML's path.

    Raises BadInput where the folder cannot be written.
    """
    path = folder / f"{name}.xml"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        parsed = mi.parser.parse_dict(
            mi.parser.ParserConfig(mi.variant()), _with_files(description, folder.resolve(), name)
        )
        mi.parser.write_file(parsed, str(path))
    except (OSError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise BadInput(f"cannot write to {folder}: {reason}; choose another folder") from error
    return path


def _with_files(value: Any, folder: Path, name: str) -> Any:
    if not isinstance(value, dict):
        return value
    if value.get("type") == "gridvolume" and ("grid" in value or "data" in value):
        grid = value.get("grid") or mi.VolumeGrid(value["data"])
        path = folder / f"{name}.vol"
        grid.write(str(path))
        rest = {k: v for k, v in value.items() if k not in ("grid", "data")}
        return rest | {"filename": str(path)}
    return {k: _with_files(v, folder, f"{name}-{k}") for k, v in value.items()}
