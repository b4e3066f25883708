"""Lightproof: how wrong is a real-time technique, what does it cost, where does it break?

The command line and the public face. Exit codes: 0 good, 1 judged and failed, 2 wrong use or bad
input, 3 could not be judged, 4 interrupted or out of resources (run again to resume).
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from scenes.contract import QUANTITIES, BadInput, parse_text, unknown

app = typer.Typer(add_completion=False, no_args_is_help=True, help=__doc__, pretty_exceptions_enable=False)
reference_app = typer.Typer(no_args_is_help=True, help="The store of truths.")
scenes_app = typer.Typer(no_args_is_help=True, help="Scenes as files.")
app.add_typer(reference_app, name="reference")
app.add_typer(scenes_app, name="scenes")
out = Console(width=None if sys.stdout.isatty() else 200)
err = Console(stderr=True)

Json = Annotated[bool, typer.Option("--json", help="print JSON instead of a table")]
Device = Annotated[str, typer.Option(help="auto, cpu or gpu")]
Plugins = Annotated[list[Path] | None, typer.Option("--plugin", help="a Python file with more techniques")]
Sets = Annotated[list[str] | None, typer.Option("--set", help="field=value of the scene")]
RunFolder = Annotated[Path, typer.Argument(help="folder of a run")]


@app.command("list")
def list_command(
    what: Annotated[str, typer.Argument(help="techniques, scenes or sources")] = "techniques",
    as_json: Json = False,
    plugin: Plugins = None,
) -> None:
    """What there is: techniques, scenes, or the sections of sources that are covered."""
    prepare("cpu", plugin)
    tables = {"techniques": list_techniques, "scenes": list_scenes, "sources": list_sources}
    if what not in tables:
        raise unknown("list", what, tables)
    show(tables[what](), as_json)


def list_techniques() -> list[dict]:
    """One row per technique."""
    from approximations.contract import all_techniques

    return [
        {
            "name": t.name,
            "theme": t.theme,
            "estimates": t.estimates.name,
            "scenes": [s.__name__ for s in t.on],
            "knobs": {k: default for k, (_, default) in t.knobs().items()},
            "source": t.source,
        }
        for t in all_techniques().values()
    ]


def list_scenes() -> list[dict]:
    """One row per scene."""
    from scenes.contract import all_scenes

    return [
        {
            "name": name,
            "theme": s.theme,
            "shows": s.shows,
            "quantities": [q.name for q in s.quantities],
            "fields": {
                k: {"default": getattr(s(), k)}
                | ({"low": a.low, "high": a.high, "unit": a.unit} if (a := s.axes().get(k)) else {})
                for k in s.field_types()
            },
        }
        for name, s in all_scenes().items()
    ]


def list_sources() -> list[dict]:
    """One row per catalog id that a technique covers."""
    from approximations.contract import all_techniques
    from compare.gate import load_thresholds

    thresholds = load_thresholds()
    found: dict[str, dict] = {}
    for t in all_techniques().values():
        for section in t.covers:
            row = found.setdefault(section, {"id": section, "techniques": [], "scenes": [], "thresholds": 0})
            row["techniques"].append(t.name)
            row["scenes"] = sorted({*row["scenes"], *(s.__name__ for s in t.on)})
            row["thresholds"] += sum(th.technique == t.name for th in thresholds)
    return [found[k] for k in sorted(found)]


@app.command()
def compare(
    names: Annotated[list[str] | None, typer.Argument(help="techniques; all where none is named")] = None,
    theme: Annotated[str | None, typer.Option(help="all techniques of a theme")] = None,
    scene: Annotated[str | None, typer.Option(help="only this scene")] = None,
    profile: Annotated[str, typer.Option(help="quick or full")] = "quick",
    knob: Annotated[list[str] | None, typer.Option(help="knob=value of the techniques")] = None,
    settings: Sets = None,
    device: Device = "auto",
    plugin: Plugins = None,
    folder: Annotated[Path | None, typer.Option("--out", help="folder of the run")] = None,
    size: Annotated[int | None, typer.Option(min=8, max=4096, help="pixels along a side")] = None,
    seed: Annotated[int, typer.Option(min=1, max=10**6)] = 1,
    only: Annotated[bool, typer.Option("--only", help="this setting alone, without sweeps")] = False,
    page: Annotated[bool, typer.Option("--report/--no-report", help="write the page as well")] = True,
    as_json: Json = False,
) -> None:
    """Measure techniques against the truth; run again to resume. Prints a table and writes the page."""
    from compare import run
    from compare.summary import overview
    from compare.task import PROFILES

    if profile not in PROFILES:
        raise unknown("profile", profile, PROFILES)
    variant = prepare(device, plugin)
    fields, knobs = pairs(settings, "--set"), pairs(knob, "--knob")
    if names == ["path_tracer"]:
        tasks = path_tracer_tasks(scene, fields, knobs, profile, size, seed)
    else:
        tasks = technique_tasks(select(names, theme), profile, scene, fields, knobs, size, seed, only)
    narrowed = fields or knobs or size or only or seed != 1
    folder = folder or Path("runs") / (f"{profile}-asked" if narrowed else profile)
    run.open_run(folder, {"profile": profile, "variant": variant, "command": command_line()})
    with progress() as bar:
        line = bar.add_task("starting", total=None)
        run.execute(
            tasks,
            folder,
            device,
            tuple(str(p.resolve()) for p in plugin or ()),
            lambda what, done, total: bar.update(line, description=what, completed=done, total=total),
            lambda message: err.print(f"lightproof: {message}", markup=False, highlight=False),
        )
    keys = {f"{t.key(variant)}-{q}" for t in tasks for q in t.quantities}
    measured = [r for r in run.records(folder) if r["key"] in keys]
    if as_json:
        show(measured, True)
    else:
        show(overview(measured), False)
    if page:
        from reports.build import build

        err.print(f"report: {build(folder)}", highlight=False, soft_wrap=True)
    broken = [r for r in measured if r["status"] != "ok"]
    for r in broken:
        err.print(
            f"lightproof: {r['technique']} on {r['scene']} {r['quantity']} {r['status']}: {r['error']}",
            markup=False,
            highlight=False,
            soft_wrap=True,
        )
    if broken:
        raise typer.Exit(2 if any(r["status"] == "failed" for r in broken) else 4)


@app.command()
def report(
    folder: RunFolder = Path("runs/quick"),
    target: Annotated[Path | None, typer.Option("--out", help="folder of the page")] = None,
    open_it: Annotated[bool, typer.Option("--open", help="open the page in a browser")] = False,
) -> None:
    """Write the HTML page of a run; it opens from disk without a server."""
    from reports.build import build

    path = build(folder, target)
    out.print(str(path), soft_wrap=True)
    if open_it:
        typer.launch(str(path))


@app.command()
def gate(
    folder: RunFolder = Path("runs/quick"),
    thresholds: Annotated[Path | None, typer.Option(help="another thresholds file")] = None,
    plugin: Plugins = None,
    as_json: Json = False,
) -> None:
    """Judge a run by the accuracy thresholds."""
    from compare.gate import THRESHOLDS, exit_code, judge, load_thresholds
    from compare.run import records

    prepare("cpu", plugin)
    verdicts = judge(load_thresholds(thresholds or THRESHOLDS), records(folder))
    rows = [
        {
            "verdict": v.result,
            "threshold": v.threshold.label(),
            "measured": v.text,
            "margin": v.margin,
            "pays": v.threshold.pays,
        }
        for v in verdicts
    ]
    counts = {r: sum(v.result == r for v in verdicts) for r in ("pass", "fail", "not judged", "not measured")}
    if as_json:
        show({"counts": counts, "verdicts": rows}, True)
    else:
        show([r for r in rows if r["verdict"] != "pass"] or rows, False)
        out.print(", ".join(f"{n} {r}" for r, n in counts.items()))
    raise typer.Exit(exit_code(verdicts))


@app.command()
def diff(
    estimate: Path,
    truth: Path,
    exposure: Annotated[tuple[float, float], typer.Option(help="FLIP's start and stop, stops")] = (-3.0, 3.0),
    as_json: Json = False,
) -> None:
    """Hold one EXR image against another, with the metrics of `compare`."""
    from compare.images import difference
    from compare.metrics import MEANS

    found = {name: e.plain() for name, e in difference(estimate, truth, exposure).items()}
    if as_json:
        show(found, True)
        return
    show([{"metric": n, **e, "meaning": MEANS[n]} for n, e in found.items()], False)


@app.command()
def doctor(as_json: Json = False) -> None:
    """What this machine can run, and the one command that mends each thing that is missing."""
    from reference.doctor import examine

    checks = examine()
    rows = [
        {
            "what": c.name,
            "state": "good" if c.good else "missing" if c.needed else "absent, optional",
            "found": c.found,
            "mend": c.mend,
        }
        for c in checks
    ]
    show(rows, as_json)
    if not all(c.good for c in checks if c.needed):
        raise typer.Exit(2)


@reference_app.command("list")
def reference_list(as_json: Json = False) -> None:
    """Every stored truth with its resolution."""
    from compare.images import provenance
    from reference.store import SHIPPED, user_store

    rows = []
    for folder in (user_store(), SHIPPED):
        for path in sorted(folder.glob("*.exr")):
            row = {"file": path.name, "where": "shipped" if folder == SHIPPED else "store"}
            try:
                about = provenance(path)
            except BadInput as damage:
                rows.append(row | {"state": str(damage)})
                continue
            rows.append(
                row
                | {
                    "state": "good",
                    "samples": about["spp"],
                    "relative standard error": about["relative_standard_error"],
                    "KiB": round(path.stat().st_size / 1024, 1),
                }
            )
    show(rows, as_json)


@reference_app.command("show")
def reference_show(file: Path, as_json: Json = False) -> None:
    """How a stored truth was made; its pixels are checked against their digest."""
    from compare.images import provenance
    from reference.store import load

    load(file)
    about = provenance(file)
    show(about if as_json else [{"what": k, "value": str(v)} for k, v in about.items()], as_json)


@reference_app.command("render")
def reference_render(
    names: Annotated[list[str] | None, typer.Argument(help="scenes, or a Mitsuba XML file")] = None,
    profile: Annotated[str, typer.Option(help="quick or full")] = "quick",
    device: Device = "auto",
    plugin: Plugins = None,
    target: Annotated[Path | None, typer.Option("--out", help="EXR file for a Mitsuba scene file")] = None,
    spp: Annotated[int, typer.Option(min=1, help="samples per batch, for a scene file")] = 64,
) -> None:
    """Render the truths that a profile needs and the store lacks; or one Mitsuba scene file."""
    import os

    from compare.task import PROFILES
    from compare.worker import prepare_truth

    prepare(device, plugin)
    files = [n for n in names or [] if n.endswith(".xml")]
    if files:
        from reference.render import render_file
        from reference.store import save

        if len(files) > 1 or target is None:
            raise BadInput(
                "give one scene file and the EXR to write: reference render FILE.xml --out OUT.exr"
            )
        save(target, render_file(Path(files[0]), spp), "scene-file")
        out.print(str(target))
        return
    from reference.truth import has_closed_form
    from scenes.contract import find_scene

    wanted = {find_scene(n).__name__ for n in names or []}
    if profile not in PROFILES:
        raise unknown("profile", profile, PROFILES)
    if target is not None:
        os.environ["LIGHTPROOF_STORE"] = str(target)
    questions = {
        json.dumps([t.scene, t.make_scene().fields(), q, t.size]): (t.scene, t.fields, q, t.size)
        for t in technique_tasks(select(None, None), profile, None, {}, {}, None, 1, False)
        for q in t.quantities
        if (not wanted or t.scene in wanted) and not has_closed_form(find_scene(t.scene), QUANTITIES[q])
    }
    with progress() as bar:
        line = bar.add_task("starting", total=len(questions))
        for question in questions.values():
            bar.update(line, description=f"{question[0]} {question[2]} {question[3]}")
            answer = prepare_truth(*question)
            for message in answer["warnings"]:
                err.print(f"lightproof: {message}", markup=False)
            if answer["status"] != "ok":
                raise BadInput(answer["error"])
            bar.advance(line)


@scenes_app.command("export")
def scenes_export(
    name: str, folder: Path, settings: Sets = None, size: Annotated[int, typer.Option(min=8, max=4096)] = 128
) -> None:
    """Write a scene as Mitsuba XML (and grids) that Mitsuba itself renders to the same image."""
    prepare("cpu", None)
    from reference.transport import integrator
    from scenes.contract import make_scene
    from scenes.export import export

    description = make_scene(name, pairs(settings, "--set")).mitsuba(size)
    whole = {**description, "integrator": integrator(description, QUANTITIES["radiance"])}
    out.print(str(export(whole, folder, name)), soft_wrap=True)


def prepare(device: str, plugins: list[Path] | None) -> str:
    """Set the variant, then load every scene, technique and plugin; the variant's name."""
    from reference.toolchain import use_device

    variant = use_device(device)
    from approximations.contract import all_techniques, load_plugin
    from scenes.contract import all_scenes

    all_scenes()
    all_techniques()
    for path in plugins or ():
        load_plugin(path)
    return variant


def select(names: list[str] | None, theme: str | None) -> list:
    """The techniques named, of a theme, or all. Raises BadInput for unknown ones."""
    from approximations.contract import all_techniques, find_technique

    chosen = [find_technique(n) for n in names] if names else list(all_techniques().values())
    if theme is None:
        return chosen
    themes = {t.theme for t in all_techniques().values()}
    if theme not in themes:
        raise unknown("theme", theme, themes)
    return [t for t in chosen if t.theme == theme]


def technique_tasks(
    techniques: list,
    profile: str,
    scene: str | None,
    fields: dict,
    knobs: dict,
    size: int | None,
    seed: int,
    only: bool,
) -> list:
    """The plan of a selection, and what the thresholds of these techniques ask for unless the selection
    is narrowed."""
    from compare import gate
    from compare.task import PROFILES, merge, plan

    tasks = plan(
        techniques,
        PROFILES[profile],
        scene=scene,
        fields=fields,
        knobs=knobs,
        size=size,
        seed=seed,
        only=only,
    )
    if profile == "quick" and not (scene or fields or knobs or size or only):
        tasks = merge([*tasks, *gate.tasks(gate.load_thresholds(), techniques, seed)])
    return tasks


def path_tracer_tasks(
    scene: str | None, fields: dict, knobs: dict, profile: str, size: int | None, seed: int
) -> list:
    """The path tracer alone on one scene, at --knob spp=N."""
    from compare.task import PATH_TRACER, PROFILES, Task
    from scenes.contract import find_scene

    if scene is None or set(knobs) != {"spp"} or not isinstance(knobs["spp"], int) or knobs["spp"] < 1:
        raise BadInput("path_tracer needs --scene NAME and --knob spp=N with a whole N of 1 or more")
    cls = find_scene(scene)
    names = [q.name for q in cls.quantities if not q.probes and q.kind == "radiance"]
    side = size or PROFILES[profile].size
    return [
        Task(PATH_TRACER, cls.__name__, side, fields, knobs, (q,), ("path tracer",), seed, 600) for q in names
    ]


def pairs(texts: list[str] | None, option: str) -> dict[str, Any]:
    """name=value texts as a dictionary. Raises BadInput for any other form."""
    found = {}
    for text in texts or []:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise BadInput(f"{option} {text!r}: write name=value")
        found[name] = parse_text(value)
    return found


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


def command_line() -> str:
    """The command as typed, without this machine's paths."""
    return " ".join(["lightproof", *sys.argv[1:]])


def main() -> None:
    """Run the command line; every error is one line and an exit code."""
    from typer._click.exceptions import ClickException

    try:
        code = app(standalone_mode=False)
        if code == 130:  # what typer makes of an interrupt
            raise KeyboardInterrupt
    except BadInput as error:
        err.print(f"lightproof: {error}", markup=False, highlight=False, soft_wrap=True)
        code = 4 if getattr(error, "full", False) else 2
    except ClickException as error:
        err.print(f"lightproof: {error.format_message()}", markup=False, highlight=False, soft_wrap=True)
        code = 2
    except (KeyboardInterrupt, typer.Abort):
        err.print("lightproof: interrupted; run the same command again to resume", highlight=False)
        code = 4
    sys.exit(code if isinstance(code, int) else 0)


if __name__ == "__main__":
    main()
