"""The house keeps its arrows: who may import whom, how long a technique may be, what it says it covers."""

import ast
import re
from pathlib import Path

import pytest

from approximations.contract import all_techniques

ROOT = Path(__file__).resolve().parents[1]
MAY_IMPORT = {
    "scenes": {"scenes"},
    "reference": {"scenes", "reference"},
    "approximations": {"scenes", "approximations"},
    "compare": {"scenes", "reference", "approximations", "compare"},
    "reports": {"scenes", "reference", "approximations", "compare", "reports"},
    "lightproof": {"scenes", "reference", "approximations", "compare", "reports"},
}
MODULES = sorted(
    p for name in MAY_IMPORT for p in [*(ROOT / name).rglob("*.py"), ROOT / f"{name}.py"] if p.is_file()
)
LINES_OF_A_TECHNIQUE = 300


def imported(source: str) -> set[str]:
    """Packages of the house that a source imports anywhere, inside functions too."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide the arrow"
            found.add(node.module.split(".")[0])
    return found & set(MAY_IMPORT)


def package(path: Path) -> str:
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_run_one_way(path):
    assert imported(path.read_text()) <= MAY_IMPORT[package(path)]


def test_an_import_against_the_arrow_is_seen_wherever_it_stands():
    hidden = "def f():\n    if True:\n        from reference.store import load\n    import compare.run as r\n"
    assert imported(hidden) == {"reference", "compare"}
    assert not imported(hidden) <= MAY_IMPORT["approximations"]


def test_every_package_is_looked_at():
    assert {package(p) for p in MODULES} == set(MAY_IMPORT)


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_only_the_toolchain_chooses_the_variant(path):
    calls = {
        node.attr
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute) and node.attr == "set_variant"
    }
    assert not calls or path == ROOT / "reference/toolchain.py"


@pytest.mark.parametrize("technique", all_techniques().values(), ids=lambda t: t.name)
def test_a_technique_is_short_and_names_its_sections(technique):
    assert len(technique.file.read_text().splitlines()) <= LINES_OF_A_TECHNIQUE
    assert all(re.fullmatch(r"[a-z][a-z0-9-]*/\d\d", section) for section in technique.covers)
