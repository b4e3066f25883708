"""Scenes as files that Mitsuba itself reads: XML, with density grids, images and meshes beside it."""

from __future__ import annotations

import shutil
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from scenes.contract import BadInput


def export(description: dict, folder: Path, name: str) -> Path:
    """Write a scene dictionary as folder/name.xml, with grids (.vol), images (.exr) and meshes (.ply) beside
    it; the XML's path.

    Raises BadInput where the folder cannot be written.
    """
    path = folder / f"{name}.xml"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        parsed = mi.parser.parse_dict(
            mi.parser.ParserConfig(mi.variant()), _with_files(description, folder.resolve(), name)
        )
        root = ElementTree.fromstring(mi.parser.write_string(parsed))
        _exact_scales(root, description)
        ElementTree.ElementTree(root).write(path, encoding="utf-8")
    except (OSError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise BadInput(f"cannot write to {folder}: {reason}; choose another folder") from error
    return path


def _exact_scales(element: ElementTree.Element, description: dict) -> None:
    """Transforms that scale, as their matrices: what Mitsuba 3.9.1 writes of a scale of 2000 : 2000 : 1 is
    4267 : 4267 : 1.03."""
    for child in element:
        value = description.get(child.get("name"))
        if child.tag == "transform" and child.find("scale") is not None:
            numbers = np.array(mi.ScalarTransform4f(value).matrix, np.float64).ravel()
            child[:] = [ElementTree.Element("matrix", value=" ".join(f"{x:.9g}" for x in numbers))]
        elif isinstance(value, dict):
            _exact_scales(child, value)


def _with_files(value: Any, folder: Path, name: str) -> Any:
    if not isinstance(value, dict):
        return value
    if value.get("type") == "gridvolume" and ("grid" in value or "data" in value):
        grid = value.get("grid") or mi.VolumeGrid(value["data"])
        path = folder / f"{name}.vol"
        grid.write(str(path))
        rest = {k: v for k, v in value.items() if k not in ("grid", "data")}
        return rest | {"filename": str(path)}
    if "bitmap" in value:
        path = folder / f"{name}.exr"
        value["bitmap"].write(str(path))
        return {k: v for k, v in value.items() if k != "bitmap"} | {"filename": str(path)}
    if value.get("type") == "ply":
        path = folder / f"{name}.ply"
        shutil.copyfile(value["filename"], path)
        value = value | {"filename": str(path)}
    return {k: _with_files(v, folder, f"{name}-{k}") for k, v in value.items()}
