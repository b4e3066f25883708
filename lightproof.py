"""Lightproof: how wrong is a real-time technique, what does it cost, where does it break?

The command line and the public face. Exit codes: 0 good, 1 judged and failed, 2 wrong use or bad
input, 3 could not be judged, 4 interrupted or out of resources (run again to resume).
"""

from __future__ import annotations

import math
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from reports.terminal import out, progress, say, show
from scenes.contract import QUANTITIES, BadInput, unknown

if TYPE_CHECKING:
    from reference.store import Demand

app = typer.Typer(add_completion=False, no_args_is_help=True, help=__doc__, pretty_exceptions_enable=False)
reference_app = typer.Typer(no_args_is_help=True, help="The store of truths.")
scenes_app = typer.Typer(no_args_is_help=True, help="Scenes as files.")
bench_app = typer.Typer(no_args_is_help=True, help="What our settings are worth, as ratios in one run.")
app.add_typer(reference_app, name="reference")
app.add_typer(scenes_app, name="scenes")
app.add_typer(bench_app, name="bench")

Json = Annotated[bool, typer.Option("--json", help="print JSON instead of a table")]
Device = Annotated[str, typer.Option(help="auto, cpu or gpu")]
Plugins = Annotated[list[Path] | None, typer.Option("--plugin", help="a Python file with more techniques")]
Sets = Annotated[list[str] | None, typer.Option("--set", help="field=value of the scene")]
RunFolder = Annotated[Path, typer.Argument(help="folder of a run")]
Resolution = Annotated[
    float | None, typer.Option(help="least relative rmse that the truth must tell from none, such as 0.001")
]
Tile = Annotated[int | None, typer.Option(min=1, help="resolution in the worst tile of so many pixels")]
Batches = Annotated[int | None, typer.Option(help="batches that a truth may grow to")]
Seconds = Annotated[float | None, typer.Option(help="seconds that a truth may grow")]


@app.command("list")
def list_command(
    what: Annotated[str, typer.Argument(help="techniques, scenes or sources")] = "techniques",
    as_json: Json = False,
    plugin: Plugins = None,
) -> None:
    """What there is: techniques, scenes, or the sections of sources that are covered."""
    prepare("cpu", plugin)
    from compare.listing import list_scenes, list_sources, list_techniques

    tables = {"techniques": list_techniques, "scenes": list_scenes, "sources": list_sources}
    if what not in tables:
        raise unknown("list", what, tables)
    show(tables[what](), as_json)


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
    resolution: Resolution = None,
    tile: Tile = None,
    truth_batches: Batches = None,
    truth_seconds: Seconds = None,
    page: Annotated[bool, typer.Option("--report/--no-report", help="write the page as well")] = True,
    as_json: Json = False,
) -> None:
    """Measure techniques against the truth; run again to resume. Prints a table and writes the page.

    Without names or a theme the quick profile leaves out settings that no threshold watches, but for one of a
    knob, and all but three points of a stressed axis.
    """
    from compare import run
    from compare.selection import pairs, path_tracer_tasks, select, technique_tasks, thinned
    from compare.summary import overview
    from compare.task import PROFILES
    from reference.store import ENOUGH

    if profile not in PROFILES:
        raise unknown("profile", profile, PROFILES)
    variant = prepare(device, plugin)
    fields, knobs = pairs(settings, "--set"), pairs(knob, "--knob")
    demand = demanded(resolution, tile, truth_batches, truth_seconds)
    if names == ["path_tracer"]:
        tasks = path_tracer_tasks(scene, fields, knobs, profile, size, seed, demand)
    else:
        tasks = technique_tasks(
            select(names, theme),
            profile,
            scene=scene,
            fields=fields,
            knobs=knobs,
            size=size,
            seed=seed,
            only=only,
            demand=demand,
        )
    narrowed = fields or knobs or size or only or seed != 1 or demand != ENOUGH
    if profile == "quick" and not (names or theme or scene or narrowed):
        tasks = thinned(tasks)
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
            say,
        )
    keys = {f"{t.key(variant)}-{q}" for t in tasks for q in t.quantities}
    measured = [r for r in run.records(folder) if r["key"] in keys]
    if as_json:
        show(measured, True)
    else:
        show(overview(measured), False)
    if page:
        from reports.build import build

        say(f"report: {build(folder)}")
    broken = [r for r in measured if r["status"] != "ok"]
    for r in broken:
        say(f"{r['technique']} on {r['scene']} {r['quantity']} {r['status']}: {r['error']}")
    if broken:
        raise typer.Exit(2 if any(r["status"] == "failed" for r in broken) else 4)


@app.command()
def needs(
    scene: str,
    tolerance: Annotated[str, typer.Option(help="metric=largest loss, such as rmse=0.05")],
    settings: Sets = None,
    size: Annotated[int, typer.Option(min=8, max=1024, help="pixels along a side")] = 64,
    seed: Annotated[int, typer.Option(min=1, max=10**6)] = 1,
    batches: Annotated[int, typer.Option(min=4, help="batches that an image may grow to")] = 256,
    seconds: Annotated[float, typer.Option(help="time for all of it")] = 60.0,
    folder: Annotated[Path | None, typer.Option("--out", help="folder of the chart")] = None,
    device: Device = "auto",
    as_json: Json = False,
) -> None:
    """The least light transport that a scene needs: what it loses with each thing that is dropped."""
    prepare(device, None)
    from compare import needs as question
    from compare.selection import pairs
    from reports.needs_chart import save
    from scenes.contract import make_scene

    [(metric, limit)] = pairs([tolerance], "--tolerance").items()
    with progress() as bar:
        line = bar.add_task("starting", total=None)
        answer = question.needs(
            make_scene(scene, pairs(settings, "--set")),
            metric,
            limit,
            size=size,
            seed=seed,
            batches=batches,
            seconds=seconds,
            report=lambda what, done, total: bar.update(line, description=what, completed=done, total=total),
        )
    _, picture = save(answer, folder or Path("runs/needs") / scene)
    if as_json:
        show(answer | {"chart": str(picture)}, True)
    else:
        show(question.table(answer), False)
        absent = ", ".join(answer["nothing_to_drop"]) or "none"
        said = (question.sentence(answer), f"nothing to drop: {absent}")
        out.print(*said, f"chart: {picture}", sep="\n", highlight=False, markup=False, soft_wrap=True)
    raise typer.Exit(question.exit_code(answer))


@app.command()
def stability(
    name: str,
    axis: Annotated[str | None, typer.Option(help="a field of its scenes; else those that it names")] = None,
    scene: Annotated[str | None, typer.Option(help="only this scene")] = None,
    tolerance: Annotated[
        float | None, typer.Option(help="rmse allowed; else twice that of the scene")
    ] = None,
    points: Annotated[int, typer.Option(min=3, max=65, help="along an axis")] = 9,
    size: Annotated[int, typer.Option(min=8, max=1024, help="pixels along a side")] = 64,
    device: Device = "auto",
    plugin: Plugins = None,
    folder: Annotated[Path | None, typer.Option("--out", help="folder of the run")] = None,
    as_json: Json = False,
) -> None:
    """Sweep a technique to both ends of each axis: where it stays within tolerance, and what breaks first."""
    from compare import run
    from compare.stability import rows, sweeps
    from compare.task import find_measured

    variant = prepare(device, plugin)
    found = sweeps(find_measured(name), scene, axis, points, size)
    folder = folder or Path("runs/stability")
    run.open_run(folder, {"profile": "stability", "variant": variant, "command": command_line()})
    plugins = tuple(str(p.resolve()) for p in plugin or ())
    with progress() as bar:
        line = bar.add_task("starting", total=None)
        run.execute(
            [t for tasks in found.values() for t in tasks],
            folder,
            device,
            plugins,
            lambda what, done, total: bar.update(line, description=what, completed=done, total=total),
            say,
        )
    known = {r["key"]: r for r in run.records(folder)}
    table = []
    for (_, field), tasks in found.items():
        keys = [f"{t.key(variant)}-{q}" for t in tasks for q in t.quantities]
        table += rows([known[k] for k in keys if k in known], field, tolerance)
    shown = ("technique", "scene", "quantity", "error", "tolerance", "envelope")
    show(table if as_json else [{k: r[k] for k in shown} for r in table], as_json)


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
    thresholds: Annotated[Path | None, typer.Option(help="another thresholds file or folder")] = None,
    propose: Annotated[str | None, typer.Option(help="print threshold lines for this technique")] = None,
    plugin: Plugins = None,
    as_json: Json = False,
) -> None:
    """Judge a run by the accuracy thresholds, or propose those of a technique."""
    from approximations.contract import find_technique
    from compare.gate import THRESHOLDS, exit_code, judge, load_thresholds
    from compare.propose import lines
    from compare.run import records

    prepare("cpu", plugin)
    if propose is not None:
        find_technique(propose)
        out.print(*lines(records(folder), propose), sep="\n", highlight=False, markup=False, soft_wrap=True)
        return
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
    """Every stored truth: its state, noise, size, and who is held against it."""
    prepare("cpu", None)
    from compare.inventory import inventory

    show(inventory(), as_json)


@reference_app.command("show")
def reference_show(file: Path, as_json: Json = False) -> None:
    """How a stored truth was made, its noise and size, and who uses it; its pixels are checked."""
    from compare.images import provenance

    about = provenance(file)
    prepare("cpu", None)
    from compare.inventory import entry
    from reference.store import load

    load(file)
    about = entry(file) | about
    show(about if as_json else [{"what": k, "value": v} for k, v in about.items()], as_json)


@reference_app.command("render")
def reference_render(
    names: Annotated[list[str] | None, typer.Argument(help="scenes, or a Mitsuba XML file")] = None,
    profile: Annotated[str, typer.Option(help="quick or full")] = "quick",
    settings: Sets = None,
    size: Annotated[int | None, typer.Option(min=8, max=4096, help="pixels along a side")] = None,
    quantity: Annotated[str | None, typer.Option(help="only this quantity")] = None,
    resolution: Resolution = None,
    tile: Tile = None,
    batches: Batches = None,
    seconds: Seconds = None,
    again: Annotated[bool, typer.Option("--again", help="anew, whatever is stored")] = False,
    seed: Annotated[int, typer.Option(min=1, max=10**6)] = 1,
    device: Device = "auto",
    plugin: Plugins = None,
    target: Annotated[Path | None, typer.Option("--out", help="another store, or the EXR of a file")] = None,
    spp: Annotated[int, typer.Option(min=1, help="samples per batch, for a scene file")] = 64,
    as_json: Json = False,
) -> None:
    """Render the truths that a profile needs, or those of scenes at one setting, until each has the
    resolution asked for; what is stored is continued. Or render one Mitsuba scene file."""
    prepare(device, plugin)
    from compare.selection import named_questions, pairs, profile_questions
    from reference import store

    if any(n.endswith(".xml") for n in names or []):
        from reference.render import render_file

        if len(names) > 1 or target is None:
            raise BadInput(
                "give one scene file and the EXR to write: reference render FILE.xml --out OUT.exr"
            )
        store.save(target, render_file(Path(names[0]), spp), "scene-file")
        out.print(str(target))
        return
    if target is not None:
        os.environ["LIGHTPROOF_STORE"] = str(target)
    if quantity is not None and quantity not in QUANTITIES:
        raise unknown("quantity", quantity, QUANTITIES)
    fields = pairs(settings, "--set")
    if fields or size or quantity:
        questions = named_questions(names or [], fields, size or 128, quantity)
    else:
        questions = profile_questions(names or [], profile)
    demand, rows = demanded(resolution, tile, batches, seconds), []
    with progress() as bar:
        line = bar.add_task("starting", total=None)
        for i, (scene, q, side) in enumerate(questions):
            label = f"{i + 1}/{len(questions)} {type(scene).__name__} {q.name} {side}"
            bar.update(line, description=label, completed=0, total=None)
            truth, _ = store.obtain(
                scene,
                q,
                side,
                demand=demand,
                seed=seed,
                again=again,
                warn=say,
                progress=lambda done, total: bar.update(line, completed=done, total=total),
            )
            rows.append(
                {"scene": type(scene).__name__, "quantity": q.name, "size": side, "batches": truth.batches}
                | {"pixel noise": truth.pixel_noise, "resolution": truth.resolution(demand.tile)}
                | {"demand": demand.verdict(truth)}
            )
    show(rows, as_json)
    short = [r for r in rows if resolution is not None and r["demand"] != "reached"]
    for r in short:
        say(
            f"{r['scene']} {r['quantity']} {r['size']}: resolution {demand.resolution:g} was asked, "
            f"{r['resolution']:.3g} is reached with {r['batches']} batches ({r['demand']}): "
            "allow more --batches or --seconds, or ask for less"
        )
    if short:
        raise typer.Exit(4)


@reference_app.command("verify")
def reference_verify(
    names: Annotated[list[str] | None, typer.Argument(help="scenes, files, kinds, checks; else all")] = None,
    seed: Annotated[int, typer.Option(min=1, max=10**6)] = 1,
    again: Annotated[bool, typer.Option("--again", help="also what is proved already")] = False,
    folder: Annotated[Path, typer.Option("--out", help="folder of the run to show it")] = Path("runs/quick"),
    device: Device = "auto",
    as_json: Json = False,
) -> None:
    """Prove the stored truths: rendered again, by a second route, by laws of physics, by published data."""
    prepare(device, None)
    from compare.run import LINES
    from reference.verify import run as verification

    with progress() as bar:
        line = bar.add_task("starting", total=None)
        rows = verification.verify(
            names or [],
            folder,
            seed,
            again,
            lambda what, done, total: bar.update(line, description=what, completed=done, total=total),
        )
    if as_json:
        show(rows, True)
    else:
        shown = [r for r in rows if names or r["verdict"] != "agrees"]
        show([verification.brief(r) for r in shown], False) if shown else None
        show(verification.totals(rows), False)
    if (folder / LINES).is_file():
        from reports.build import build

        say(f"report: {build(folder)}")
    raise typer.Exit(verification.exit_code(rows))


@reference_app.command("prune")
def reference_prune(
    unused: Annotated[bool, typer.Option("--unused", help="also what no profile asks for")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="only say what would go")] = False,
    as_json: Json = False,
) -> None:
    """Remove from the user's store what cannot be used: damaged files, those of other code, doubles."""
    prepare("cpu", None)
    from compare.inventory import prune

    show(prune(unused, dry_run), as_json)


@bench_app.command("reference")
def bench_reference(
    names: Annotated[list[str] | None, typer.Argument(help="scenes; all where none is named")] = None,
    size: Annotated[int, typer.Option(min=8, max=1024, help="pixels along a side")] = 64,
    rounds: Annotated[int, typer.Option(min=4, max=1000, help="batches of each setting")] = 12,
    device: Device = "auto",
    as_json: Json = False,
) -> None:
    """Efficiency = 1 / (variance x time) of the reference against stock `mi.render`, and peak memory."""
    prepare(device, None)
    from reference import bench

    scenes = bench.scenes_to_measure(names or [])
    with progress() as bar:
        line = bar.add_task("memory", total=len(scenes) * rounds)
        memory = bench.memory()
        rows = []
        for scene in scenes:
            bar.update(line, description=type(scene).__name__)
            rows.append(bench.measure(scene, size, rounds, lambda: bar.advance(line)))
    whole = bench.summary(rows)
    if as_json:
        show({"rows": rows, "summary": whole, "memory": memory}, True)
    else:
        show([bench.brief(r) for r in rows], False)
        out.print(bench.sentence(whole), bench.memory_sentence(memory), sep="\n", highlight=False)
    raise typer.Exit({"pass": 0, "fail": 1, "not judged": 3}[whole["verdict"]])


@bench_app.command("frames")
def bench_frames(
    names: Annotated[list[str] | None, typer.Argument(help="techniques; all where none is named")] = None,
    theme: Annotated[str | None, typer.Option(help="all techniques of a theme")] = None,
    scene: Annotated[str | None, typer.Option(help="only this scene; else each technique's first")] = None,
    size: Annotated[int, typer.Option(min=64, max=2048, help="pixels along a side")] = 512,
    growth: Annotated[bool, typer.Option(help="cost against pixels, 128 to 2048 a side")] = False,
    along: Annotated[str | None, typer.Option(help="cost against this field of the scene")] = None,
    folder: Annotated[Path, typer.Option("--out", help="run that keeps the table")] = Path("runs/quick"),
    device: Device = "auto",
    as_json: Json = False,
) -> None:
    """What binds every frame, how near it comes to what the machine can do, and how its cost grows."""
    prepare(device, None)
    from compare import speed
    from compare.selection import select
    from compare.task import RGB_RENDERING

    chosen = [t for t in select(names, theme) if t.name != RGB_RENDERING]
    pairs = [(t, s) for t in chosen for s in (t.on if scene else t.on[:1]) if scene in (None, s.__name__)]
    if not pairs:
        raise BadInput(f"none of these techniques is for the scene {scene}: drop --scene or name another")
    rows = []
    with progress() as bar:
        line = bar.add_task("starting", total=len(pairs))
        for technique, cls in pairs:
            bar.update(line, description=technique.name)
            row = speed.frame_row(technique, cls(), size)
            if growth:
                row["growth"] = speed.growth(technique, cls())
            if along:
                row["along"] = speed.along(technique, cls(), along, size)
            rows.append(row)
            bar.advance(line)
    speed.save(folder, rows)
    show(rows if as_json else [speed.brief(r) for r in rows], as_json)
    if any(r["verdict"] == "slow" for r in rows):
        raise typer.Exit(1)


@scenes_app.command("export")
def scenes_export(
    name: str, folder: Path, settings: Sets = None, size: Annotated[int, typer.Option(min=8, max=4096)] = 128
) -> None:
    """Write a scene as Mitsuba XML (and grids) that Mitsuba itself renders to the same image."""
    prepare("cpu", None)
    from compare.selection import pairs
    from reference.transport import integrator
    from scenes.contract import make_scene
    from scenes.export import export

    scene = make_scene(name, pairs(settings, "--set"))
    description = scene.mitsuba(size)
    whole = {**description, "integrator": integrator(description, QUANTITIES["radiance"])}
    out.print(str(export(whole, folder, name)), soft_wrap=True)
    if scene.spectral:
        say("its colours are spectra: render it with a spectral variant")


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


def demanded(
    resolution: float | None, tile: int | None, batches: int | None, seconds: float | None
) -> Demand:
    """What the options ask of a truth; a budget without a resolution is spent whole."""
    from reference.store import ENOUGH, Demand

    if tile is not None and resolution is None:
        raise BadInput("--tile says where --resolution must be reached: give both")
    if resolution is batches is seconds is None:
        return ENOUGH
    asked = 0.0 if resolution is None else resolution
    return Demand(asked, tile, batches or (10**6 if resolution is None else 1024), seconds or math.inf)


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
        say(str(error))
        code = 4 if getattr(error, "full", False) else 2
    except ClickException as error:
        say(error.format_message())
        code = 2
    except (KeyboardInterrupt, typer.Abort):
        say("interrupted; run the same command again to resume")
        code = 4
    sys.exit(code if isinstance(code, int) else 0)


if __name__ == "__main__":
    main()
