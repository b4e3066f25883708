"""Mutated twins: the same technique with one sign flipped, to prove that the thresholds can fail.

A mutant is a copy of a technique's module, or of a kit module that it uses, in which one `+` became
`-`, one minus sign went, or one comparison was turned round; in a module without any sign, in which one
product became a quotient. Declarations (decorators, annotations,
the domain) are left alone, since they do not make the image.
"""

from __future__ import annotations

import ast
import hashlib
import sys
import tempfile
import types
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from approximations.contract import TECHNIQUES, Technique, find_technique
from compare.gate import Threshold, Verdict, judge_one
from compare.task import ROOT, scene_file

FLIPS = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Lt: ast.Gt,
    ast.Gt: ast.Lt,
    ast.LtE: ast.GtE,
    ast.GtE: ast.LtE,
}
KIT = "approximations.kit."
FACTORS = {ast.Mult: ast.Div, ast.Div: ast.Mult}


@dataclass(frozen=True)
class Mutant:
    """One flipped sign: the file, which of its signs, and what a reader would see."""

    file: str
    number: int
    line: int
    text: str

    @property
    def label(self) -> str:
        """Where and what."""
        return f"{Path(self.file).name}:{self.line}: {self.text}"


def signs(tree: ast.AST, flips: dict = FLIPS) -> Iterator[tuple[ast.AST, int]]:
    """Every sign that makes the image, in the order of the source: the node, and which comparison."""
    if isinstance(tree, ast.FunctionDef):
        if any(isinstance(d, ast.Attribute) and d.attr == "domain" for d in tree.decorator_list):
            return
        for node in tree.body:
            yield from signs(node, flips)
        return
    if isinstance(tree, (ast.BinOp, ast.AugAssign)) and type(tree.op) in flips:
        yield tree, 0
    if isinstance(tree, ast.UnaryOp) and isinstance(tree.op, ast.USub) and flips is FLIPS:
        yield tree, 0
    if isinstance(tree, ast.Compare):
        for i, op in enumerate(tree.ops):
            if type(op) in flips:
                yield tree, i
    for name, child in ast.iter_fields(tree):
        if name in ("decorator_list", "annotation", "returns"):
            continue
        for node in child if isinstance(child, list) else [child]:
            if isinstance(node, ast.AST):
                yield from signs(node, flips)


def flips_of(tree: ast.Module) -> dict:
    """Signs, or products where a module has no sign."""
    return FLIPS if next(signs(tree), None) else FACTORS


def mutants(file: Path) -> list[Mutant]:
    """All mutants of a source file."""
    source = file.read_text()
    found = []
    tree = ast.parse(source)
    for number, (node, _) in enumerate(signs(tree, flips_of(tree))):
        text = ast.get_source_segment(source, node) or ast.unparse(node)
        found.append(Mutant(str(file), number, node.lineno, " ".join(text.split())[:90]))
    return found


def mutated_source(mutant: Mutant) -> ast.Module:
    """The module with that sign flipped."""
    tree = ast.parse(Path(mutant.file).read_text())
    flips = flips_of(tree)
    for number, (node, i) in enumerate(list(signs(tree, flips))):
        if number != mutant.number:
            continue
        if isinstance(node, ast.UnaryOp):
            node.op = ast.UAdd()
        elif isinstance(node, ast.Compare):
            node.ops[i] = flips[type(node.ops[i])]()
        else:
            node.op = flips[type(node.op)]()
    return ast.fix_missing_locations(tree)


def kit_files(technique: Technique) -> list[Path]:
    """The kit modules whose functions a technique's module uses, itself or through another of the kit."""
    found: set[str] = set()
    waiting = [technique.function.__module__]
    while waiting:
        new = kit_used(waiting.pop()) - found
        found |= new
        waiting += new
    return sorted(Path(sys.modules[m].__file__) for m in found)


def kit_used(module: str) -> set[str]:
    """Names of the kit modules whose functions or classes a module imports."""
    used = {getattr(v, "__module__", "") for v in vars(sys.modules[module]).values() if callable(v)}
    return {m for m in used if m and m.startswith(KIT) and m != module}


def load_twin(technique: Technique, mutant: Mutant) -> dict[str, Technique]:
    """The techniques that the technique's module declares, with one sign flipped; the registry is left
    as it was."""
    kept, file = dict(TECHNIQUES), technique.file
    TECHNIQUES.clear()
    try:
        if Path(mutant.file) == file:
            _load(f"twin_of_{file.stem}", mutated_source(mutant))
        else:
            flipped = next(m for m, v in sys.modules.items() if getattr(v, "__file__", None) == mutant.file)
            twins = {flipped: _load(f"twin_of_kit_{Path(mutant.file).stem}", mutated_source(mutant))}
            _twin(technique.function.__module__, twins)
        return dict(TECHNIQUES)
    finally:
        TECHNIQUES.clear()
        TECHNIQUES.update(kept)


def _twin(module: str, twins: dict[str, types.ModuleType]) -> types.ModuleType:
    """A copy of a module in which whatever it imports from the kit comes from the twins there, if the flipped
    one is among what it uses; else the module itself."""
    if module in twins:
        return twins[module]
    parts = {name: _twin(name, twins) for name in kit_used(module)}
    original = sys.modules[module]
    if all(part is sys.modules[name] for name, part in parts.items()) and module.startswith(KIT):
        return original
    copy = _load(f"twin_of_{module.replace('.', '_')}", ast.parse(Path(original.__file__).read_text()))
    for key, value in list(vars(copy).items()):
        part = parts.get(getattr(value, "__module__", None) or "")
        name = getattr(value, "__name__", key)
        if part is not None and hasattr(part, name):
            setattr(copy, key, getattr(part, name))
    twins[module] = copy
    return copy


def _load(name: str, tree: ast.Module) -> types.ModuleType:
    """A module from a syntax tree, through a file, since Dr.Jit reads the source of `@dr.syntax`."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{name}.py"
        file.write_text(ast.unparse(tree))
        module = types.ModuleType(name)
        module.__file__ = str(file)
        sys.modules[name] = module
        exec(compile(file.read_text(), str(file), "exec"), vars(module))
    return module


def verdicts(mutant: Mutant, technique: str, thresholds: list[Threshold], until_fail: bool) -> list[Verdict]:
    """The gate's verdicts on a mutated twin, up to the first failure if `until_fail`."""
    from compare.measure import evaluate, findings, judge, obtain
    from scenes.contract import QUANTITIES, make_scene

    twins = load_twin(find_technique(technique), mutant)
    images: dict[str, object] = {}
    found = []
    for t in thresholds:
        twin = twins[t.technique]
        scene = make_scene(t.scene, t.fields)
        settings = twin.settings(t.knobs)
        label = str((t.technique, scene, settings, t.side))
        record = {"status": "ok", "findings": []}
        try:
            if label not in images:
                images[label] = evaluate(twin, scene, twin.estimates, settings, t.side)
            truth, _ = obtain(scene, QUANTITIES[t.quantity], t.side)
            record["errors"] = judge(images[label], truth, QUANTITIES[t.quantity], None)
            record["findings"] = findings(images[label], truth, QUANTITIES[t.quantity])
        except Exception as error:
            record |= {"status": "failed", "error": str(error)}
        found.append(judge_one(t, record))
        if until_fail and found[-1].result == "fail":
            break
    return found


def digest(files: list[Path], techniques: list[str], thresholds: list[Threshold]) -> str:
    """Digest of all that decides whether a mutant is seen: sources, thresholds, and the scenes that they
    name. What all measurements share (statistics, truths) is not in it: after a change there, prove anew."""
    chosen = [t for t in thresholds if t.technique in techniques]
    scenes = sorted({scene_file(t.scene) for t in chosen})
    content = [p.read_text() for p in [*files, *scenes]] + sorted(repr(t) for t in chosen)
    return hashlib.sha256("\n".join(content).encode()).hexdigest()


def modules() -> dict[Path, list[str]]:
    """Technique modules of the project and the techniques that each declares."""
    found: dict[Path, list[str]] = {}
    for t in TECHNIQUES.values():
        if t.file.is_relative_to(ROOT):
            found.setdefault(t.file, []).append(t.name)
    return found
