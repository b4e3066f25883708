"""The command line as its users meet it, in child processes: results as JSON, one clear line for every
mistake, and nothing lost when a run dies."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from approximations.contract import TECHNIQUES, all_techniques, load_plugin
from compare import run
from compare.gate import Threshold, judge
from compare.task import Task, plan
from compare.worker import failed, status_of
from lightproof import main
from reference.store import CannotWrite, write_exr

ROOT = Path(__file__).resolve().parents[1]
SCHEMA = json.loads((ROOT / "compare/measurement.schema.json").read_text())
LONG = ("per_pixel_lists", "--size", "16", "--no-report")
CHEAP = ("constant_ambient", "--scene", "Valley", "--size", "16", "--no-report")

HEAD = """
import os
import drjit as dr
import mitsuba as mi
import numpy as np
from approximations.contract import OCCLUSION, technique
from scenes.contract import DIRECT_RADIANCE, View
from scenes.sunlit import Valley

def declare(function):
    return technique(source="a test", estimates=DIRECT_RADIANCE, on=(Valley,), replaces="all",
                     neglects=(OCCLUSION,))(function)
"""
TECHNIQUES_THAT_FAIL = """
@declare
def sound(view):
    return mi.Color3f(0.3)

@declare
def raises(view):
    return view.fog.b

@declare
def aborts(view):
    os.abort()

@declare
def eats_memory(view):
    return [np.zeros(2**27) for _ in iter(int, 1)]

@declare
def hangs(view):
    while True:
        pass

@declare
def gives_nan(view):
    return mi.Color3f(dr.nan)

@declare
def gives_too_few(view):
    return dr.zeros(mi.Color3f, 7)

@declare
def gives_text(view):
    return "light"
"""
SCENE_THAT_MITSUBA_REJECTS = """
from dataclasses import dataclass
from scenes.contract import RADIANCE, Camera, Scene, scene
from scenes.mitsuba_parts import perspective

@scene(theme="tests", shows="nothing", quantities=(RADIANCE,), exposure=(-2.0, 2.0))
@dataclass(frozen=True)
class Rejected(Scene):
    def mitsuba(self, size=128):
        sensor = perspective([0, 0, 1], [0, 0, 0], 40, size)
        return {"type": "scene", "ball": {"type": "spheroid"}, "sensor": sensor}

    def view(self, size=128):
        return View(size, size, Camera(mi.Point3f(0), mi.Vector3f(0), mi.Vector3f(0), 0.1, 10.0))

@technique(source="a test", estimates=RADIANCE, on=(Rejected,), replaces="all", neglects=(OCCLUSION,))
def on_rejected(view):
    return mi.Color3f(0.3)

@declare
def sound_neighbour(view):
    return mi.Color3f(0.3)
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with the files that the commands below name."""
    folder = tmp_path_factory.mktemp("place")
    plugins = {
        "bad.py": HEAD + TECHNIQUES_THAT_FAIL,
        "rejected.py": HEAD + SCENE_THAT_MITSUBA_REJECTS,
        "raising.py": "import os\n\nraise RuntimeError('not today')\n",
        "syntax.py": "def f(:\n",
        "empty.py": "x = 1\n",
        "hemisphere_light.py": readme_plugin(),
    }
    for name, text in plugins.items():
        (folder / name).write_text(text)
    grey = np.ones((8, 8))
    images(folder, "good", grey)
    images(folder, "nan", np.where(np.eye(8) > 0, np.nan, 1.0))
    images(folder, "negative", np.where(np.eye(8) > 0, -1.0, 1.0))
    images(folder, "infinite", np.where(np.eye(8) > 0, np.inf, 1.0))
    images(folder, "larger", np.ones((16, 16)))
    images(folder, "black", 0 * grey)
    images(folder, "grey", grey, "Y")
    images(folder, "depth", grey, "Z")
    whole = (folder / "good.exr").read_bytes()
    (folder / "short.exr").write_bytes(whole[: len(whole) // 2])
    (folder / "text.exr").write_text("an image, they said")
    (folder / "rejected.xml").write_text('<scene version="3.0.0"><shape type="spheroid"/></scene>')
    (folder / "torn.xml").write_text('<scene version="3.0.0"><shape')
    threshold = (
        '[[threshold]]\ntechnique="{}"\nscene="Valley"\nquantity="radiance"\nmetric="{}"\npays="{}"\n{}'
    )
    for name, values in {
        "metric": ("constant_ambient", "rsme", "occlusion", ""),
        "pays": ("constant_ambient", "rmse", "oclusion", ""),
        "technique": ("constant_ambiant", "rmse", "occlusion", "at_most=1"),
        "bound": ("constant_ambient", "rmse", "occlusion", ""),
    }.items():
        (folder / f"{name}.toml").write_text(threshold.format(*values))
    (folder / "torn.toml").write_text("[[threshold")
    return folder


def images(folder: Path, name: str, grey: np.ndarray, channels: str = "RGB") -> None:
    write_exr(folder / f"{name}.exr", {}, {c: grey.astype(np.float32) for c in channels})


def readme_plugin() -> str:
    """The example of README.md: the Python block below the heading that says how to add a technique."""
    text = (ROOT / "README.md").read_text()
    return re.search(r"## Add a technique.*?```python\n(.*?)```", text, re.DOTALL)[1]


def start(place: Path, words, **more) -> subprocess.Popen:
    """A command that can be interrupted even where these tests run in a shell's background, which cannot."""
    own = {
        "LIGHTPROOF_STORE": str(place / "store"),
        "XDG_CACHE_HOME": str(place / "cache"),
        "COLUMNS": "80",
    }
    return subprocess.Popen(
        [sys.executable, "-m", "lightproof", *map(str, words)],
        env={k: v for k, v in os.environ.items() if k != "LIGHTPROOF_CACHE"} | own | more,
        cwd=place,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        text=True,
    )


def lightproof(place: Path, *words, **more) -> subprocess.CompletedProcess:
    child = start(place, words, **more)
    out, err = child.communicate(timeout=200)
    return subprocess.CompletedProcess(words, child.returncode, out, err)


def one_line(answer: subprocess.CompletedProcess) -> str:
    """What the command said on the error stream, which must be one line of its own."""
    assert re.fullmatch(r"lightproof: [^\n]+\n", answer.stderr), answer.stderr
    assert "Traceback" not in answer.stderr
    return answer.stderr


MISTAKES = {
    "unknown technique": (
        "compare constant_ambiant",
        "unknown technique 'constant_ambiant'.*constant_ambient",
    ),
    "unknown scene": ("compare constant_ambient --scene Vally", "unknown scene 'Vally'.*Valley"),
    "scene of others": ("compare constant_ambient --scene GlassSheets", "not for GlassSheets.*Valley"),
    "unknown theme": ("compare --theme ambience", "unknown theme 'ambience'.*ambient"),
    "unknown profile": ("compare --profile quik", "unknown profile 'quik'.*quick"),
    "unknown device": ("compare --device tpu", "auto, cpu or gpu"),
    "unknown field": (
        "compare constant_ambient --scene Valley --set slop=3",
        "field of Valley 'slop'.*slope",
    ),
    "unknown knob": ("compare ambient_aperture --knob ray=3", "knob of ambient_aperture 'ray'.*rays"),
    "no knobs": ("compare constant_ambient --knob rays=3", "has no knobs"),
    "unknown list": ("list technique", "unknown list 'technique'.*techniques"),
    "unknown command": ("compair", "compair"),
    "unknown option": ("compare --sise 16", "--sise"),
    "unknown scene to export": ("scenes export Vally out", "Valley"),
    "unknown scene to render": ("reference render Vally", "Valley"),
    "knob below": ("compare ambient_aperture --knob rays=1", r"rays must lie in \[4, 65536\], not 1"),
    "knob above": ("compare ambient_aperture --knob rays=1e9", r"rays must lie in \[4, 65536\]"),
    "knob of text": ("compare ambient_aperture --knob rays=many", "rays must be a whole number, not 'many'"),
    "knob of a fraction": (
        "compare ambient_aperture --knob rays=8.5",
        "rays must be a whole number, not 8.5",
    ),
    "knob of nan": ("compare ambient_aperture --knob rays=nan", "rays must be a whole number, not nan"),
    "knob of no option": ("compare ambient_aperture --knob overlap=lense", "one of smoothstep, lens,"),
    "knob without value": ("compare ambient_aperture --knob overlap", "name=value"),
    "field above": ("compare constant_ambient --scene Valley --set slope=85", r"slope must lie in \[5, 80\]"),
    "field of nan": (
        "compare constant_ambient --scene Valley --set slope=nan",
        "slope must be a finite number",
    ),
    "field of text": ("compare constant_ambient --scene Valley --set slope=steep", "slope must be a finite"),
    "size too small": ("compare --size 2", "--size.*8"),
    "size of text": ("compare --size big", "--size.*integer"),
    "path tracer alone": ("compare path_tracer", "--scene NAME and --knob spp=N"),
    "folder below a file": ("compare constant_ambient --out good.exr/run --no-report", "cannot write.*--out"),
    "export below a file": ("scenes export Valley good.exr/run", "cannot write"),
    "missing plugin": ("list --plugin missing.py", "missing.py: no such file"),
    "plugin that raises": ("list --plugin raising.py", "raising.py, line 3: RuntimeError: not today"),
    "plugin of no Python": ("list --plugin syntax.py", "syntax.py, line 1: SyntaxError"),
    "plugin of nothing": ("list --plugin empty.py", "declares no new technique"),
    "no run": ("gate nowhere", "nowhere holds no run"),
    "no run to show": ("report nowhere", "nowhere holds no run"),
    "unknown metric": ("gate {run} --thresholds metric.toml", "unknown metric 'rsme'.*rmse"),
    "unknown assumption": ("gate {run} --thresholds pays.toml", "unknown assumption 'oclusion'.*occlusion"),
    "threshold of no technique": ("gate {run} --thresholds technique.toml", "constant_ambient"),
    "threshold without bound": ("gate {run} --thresholds bound.toml", "give a bound"),
    "torn thresholds": ("gate {run} --thresholds torn.toml", "torn.toml holds no thresholds"),
    "missing thresholds": ("gate {run} --thresholds nowhere.toml", "nowhere.toml"),
    "missing image": ("diff nowhere.exr good.exr", "nowhere.exr: no such file"),
    "NaN": ("diff nan.exr good.exr", r"nan.exr holds NaN values \(8 of 64 pixels, first at \(0, 0\)\)"),
    "NaN in the truth": ("diff good.exr nan.exr", "nan.exr holds NaN"),
    "infinity": ("diff infinite.exr good.exr", "infinite.exr holds infinity"),
    "negative light": ("diff negative.exr good.exr", "negative.exr holds negative"),
    "other size": ("diff good.exr larger.exr", "8x8 against 16x16"),
    "other channels": ("diff good.exr grey.exr", "3 channels.*1"),
    "no colour": ("diff depth.exr good.exr", "has channels Z"),
    "black truth": ("diff good.exr black.exr", "black everywhere"),
    "cut short": ("diff short.exr good.exr", "short.exr: not an EXR file, or cut short"),
    "no EXR": ("diff good.exr text.exr", "text.exr: not an EXR file"),
    "no truth": ("reference show good.exr", "no record of how it was made"),
    "rejected file": ("reference render rejected.xml --out x.exr", "Mitsuba rejects rejected.xml.*spheroid"),
    "torn file": ("reference render torn.xml --out x.exr", "Mitsuba rejects torn.xml"),
    "missing file": ("reference render nowhere.xml --out x.exr", "nowhere.xml: no such file"),
    "file without target": ("reference render rejected.xml", "--out"),
    "quantity that a scene lacks": (
        "reference render Valley --quantity transmittance",
        "has no transmittance",
    ),
    "unknown quantity": (
        "reference render Valley --quantity radiant",
        "unknown quantity 'radiant'.*radiance",
    ),
    "size of no scene": ("reference render --size 16", "need a scene"),
    "demand of 2 batches": ("reference render Valley --size 16 --batches 2", "batches 4 or more"),
    "demand below zero": ("compare constant_ambient --resolution -1", "resolution is 0 or more"),
    "tile without resolution": ("reference render Valley --size 16 --tile 8", "give both"),
    "nothing to verify": ("reference verify Vally", "'Vally'.*Valley"),
    "bench of no scene": ("bench reference Vally", "Valley"),
    "needs of no scene": ("needs Vally --tolerance rmse=0.1", "Valley"),
    "needs of no metric": ("needs Valley --tolerance rsme=0.1", "unknown metric 'rsme'.*rmse"),
    "tolerance without value": ("needs Valley --tolerance rmse", "write name=value"),
    "tolerance of text": ("needs Valley --tolerance rmse=small", "expected a number"),
}
IN_CHILDREN = (
    "unknown technique",
    "unknown command",
    "knob below",
    "folder below a file",
    "plugin that raises",
    "plugin of no Python",
    "plugin of nothing",
    "NaN",
    "cut short",
    "rejected file",
)
"""Mistakes made in processes of their own, one of each kind; the others meet the same `main` in this one."""

ALONE = "--size 16 --only --no-report"
RUNS = {
    "fails": f"compare sound raises gives_too_few gives_text gives_nan --plugin bad.py {ALONE}",
    "ends": f"compare aborts eats_memory sound --plugin bad.py {ALONE}",
    "rejected": f"compare on_rejected sound_neighbour --plugin rejected.py {ALONE}",
    "readme": f"compare hemisphere_light --plugin hemisphere_light.py --scene Valley {ALONE}",
}
TABLES = {
    "techniques": "list techniques",
    "scenes": "list scenes",
    "sources": "list sources",
    "doctor": "doctor",
    "truths": "reference list",
    "prune": "reference prune --dry-run",
    "render": "reference render Valley --quantity direct_radiance --size 16 --batches 4",
    "verify": "reference verify inverse_square_and_cosine --out proofs",
    "needs": "needs Valley --tolerance rmse=0.3 --size 16 --out chart",
    "diff": "diff grey.exr grey.exr",
    "gate": "gate {run}",
    "compare": "compare constant_ambient --scene Valley --size 16 --only --no-report --out {run}",
}


@pytest.fixture(scope="module")
def whole_run(place):
    """A run that nobody disturbed: one technique and the path tracer's curves."""
    answer = lightproof(place, "compare", *CHEAP, "--out", "whole")
    assert answer.returncode == 0, answer.stderr
    return answer, place / "whole"


@pytest.fixture(scope="module")
def answers(place, whole_run):
    """What takes a process of its own, two at a time."""
    commands = {name: MISTAKES[name][0] for name in IN_CHILDREN}
    commands |= {name: f"{words} --out {name}" for name, words in RUNS.items()}
    commands["compare"] = TABLES["compare"] + " --json"
    with ThreadPoolExecutor(2) as two:
        asked = {
            name: two.submit(lightproof, place, *words.format(run=whole_run[1]).split())
            for name, words in commands.items()
        }
    return {name: answer.result() for name, answer in asked.items()}


@pytest.fixture
def ask(place, whole_run, answers, monkeypatch, capfd):
    """The answer to a command: its child's, or that of `main` called here."""

    def answer(name: str, words: str) -> subprocess.CompletedProcess:
        if name in answers:
            return answers[name]
        argv = words.format(run=whole_run[1]).split()
        monkeypatch.setattr(sys, "argv", ["lightproof", *argv])
        monkeypatch.chdir(place)
        monkeypatch.setenv("LIGHTPROOF_STORE", str(place / "store"))
        with pytest.raises(SystemExit) as end:
            main()
        return subprocess.CompletedProcess(words, end.value.code, *capfd.readouterr())

    return answer


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_told_in_one_line_and_exit_code_2(ask, name):
    words, expected = MISTAKES[name]
    answer = ask(name, words)
    assert re.search(expected, one_line(answer))
    assert (answer.returncode, answer.stdout) == (2, "")


@pytest.mark.parametrize("name", TABLES)
def test_every_table_is_also_json(ask, name):
    answer = ask(name, f"{TABLES[name]} --json")
    assert isinstance(json.loads(answer.stdout), (list, dict)) and answer.stderr == ""
    assert answer.returncode == (3 if name == "gate" else 0)


def test_sources_say_what_is_covered_by_what(ask):
    rows = json.loads(ask("sources", "list sources --json").stdout)
    assert all(list(row) == ["id", "techniques", "scenes", "thresholds"] for row in rows)
    first = next(row for row in rows if row["id"] == "ambient-aperture/01")
    assert "ambient_aperture" in first["techniques"] and "Valley" in first["scenes"]
    assert isinstance(first["thresholds"], int)


def test_records_fit_their_schema_and_it_names_all_that_they_hold(whole_run, answers, place):
    check = jsonschema.Draft202012Validator(SCHEMA, format_checker=jsonschema.FormatChecker())
    folders = [whole_run[1], *(place / name for name in RUNS)]
    found = [r for folder in folders for r in run.records(folder)]
    assert {r["status"] for r in found} >= {"ok", "failed", "crashed", "out of memory"}
    for r in found:
        check.validate(r)
        assert set(r) <= set(SCHEMA["properties"])
        assert set(r["costs"] or ()) <= set(SCHEMA["properties"]["costs"]["properties"])
        for image in r.get("images", {}).values():
            assert any((folder / image).is_file() for folder in folders)


def by_technique(folder: Path) -> dict[str, dict]:
    return {r["technique"]: r for r in run.records(folder)}


def test_a_technique_that_raises_costs_its_own_measurement_and_exit_code_2(answers, place):
    answer, found = answers["fails"], by_technique(place / "fails")
    assert answer.returncode == 2 and "Traceback" not in answer.stderr
    assert {n: r["status"] for n, r in found.items()} == {
        "sound": "ok",
        "raises": "failed",
        "gives_too_few": "failed",
        "gives_text": "failed",
        "gives_nan": "ok",
    }
    assert re.search(r"AttributeError: .*'b' at bad.py:\d+$", found["raises"]["error"])
    assert "one per pixel" in found["gives_too_few"]["error"]
    assert found["gives_nan"]["errors"] is None and found["gives_nan"]["findings"][0]["kind"] == "NaN"
    lines = answer.stderr.splitlines()
    assert len(lines) == 3 and all(
        re.match("lightproof: .* on Valley direct_radiance failed: ", x) for x in lines
    )
    assert "sound" in answer.stdout and "raises" in answer.stdout


def test_a_crash_and_a_lack_of_memory_cost_their_own_measurements_and_exit_code_4(answers, place):
    answer, found = answers["ends"], by_technique(place / "ends")
    assert answer.returncode == 4 and "Traceback" not in answer.stderr
    assert found["sound"]["status"] == "ok"
    assert found["aborts"]["status"] == "crashed"
    assert found["eats_memory"]["status"] == "out of memory"
    assert len([x for x in answer.stderr.splitlines() if x.startswith("lightproof: ")]) == 2


def test_a_scene_that_mitsuba_rejects_costs_its_own_measurement(answers, place):
    answer, found = answers["rejected"], by_technique(place / "rejected")
    assert answer.returncode == 2
    assert re.search("Mitsuba rejects the scene Rejected: .*spheroid", one_line(answer))
    assert found["on_rejected"]["status"] == "failed" and found["sound_neighbour"]["status"] == "ok"


def test_the_technique_of_the_readme_runs(answers, place):
    answer = answers["readme"]
    assert (answer.returncode, answer.stderr) == (0, "")
    assert "hemisphere_light" in answer.stdout
    errors = by_technique(place / "readme")["hemisphere_light"]["errors"]
    assert 0.05 < errors["rmse"]["value"] < 1


def test_the_threshold_of_the_readme_judges_the_technique_of_the_readme(answers, place):
    bound = re.search(r"```toml\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)[1]
    (place / "readme.toml").write_text(f"{bound}size = 16\n")
    words = "gate readme --thresholds readme.toml --plugin hemisphere_light.py --json"
    answer = lightproof(place, *words.split())
    assert answer.returncode == 0, answer.stderr + answer.stdout
    assert json.loads(answer.stdout)["counts"]["pass"] == 1


def test_a_technique_that_hangs_is_ended_and_the_next_one_measured(place, monkeypatch):
    monkeypatch.setenv("LIGHTPROOF_STORE", str(place / "store"))
    for name in set(all_techniques()) | set(load_plugin(place / "bad.py")):
        monkeypatch.setitem(TECHNIQUES, name, TECHNIQUES[name])
    tasks = [
        Task(name, "Valley", 16, quantities=("direct_radiance",), seconds=seconds)
        for name, seconds in (("hangs", 2.0), ("sound", 60.0))
    ]
    run.open_run(place / "hang", {})
    run.execute(tasks, place / "hang", "cpu", (str(place / "bad.py"),))
    found = by_technique(place / "hang")
    assert found["hangs"]["status"] == "timed out" and "2 s" in found["hangs"]["error"]
    assert found["sound"]["status"] == "ok"


def test_a_killed_run_goes_on_where_it_was(place, whole_run):
    folder = place / "killed"
    lines = folder / run.LINES
    before = b""
    for wanted in (0, 1, 3, 5):
        child = start(place, ["compare", *CHEAP, "--out", folder])
        until = time.monotonic() + 60
        while not (folder / "run.json").is_file() or len(text(lines).splitlines()) < wanted:
            assert child.poll() is None and time.monotonic() < until
            time.sleep(0.005)
        workers = children(child.pid)
        child.send_signal(signal.SIGKILL)
        child.wait()
        while any(map(alive, workers)):
            assert time.monotonic() < until, "the worker outlives its run"
            time.sleep(0.005)
        child.stdout.close(), child.stderr.close()
        assert text(lines).startswith(before)
        before = text(lines)
    with lines.open("ab") as torn:
        torn.write(b'{"key": "cut sh')
    answer = lightproof(place, "compare", *CHEAP, "--out", folder)
    assert answer.returncode == 0
    assert text(lines).startswith(before)
    keys = [json.loads(line)["key"] for line in text(lines).splitlines() if line.endswith(b"}")]
    assert len(keys) == len(set(keys))
    undisturbed = {r["key"]: r["errors"] for r in run.records(whole_run[1])}
    assert {r["key"]: r["errors"] for r in run.records(folder)} == undisturbed
    assert not [p for p in folder.rglob("*") if p.name.startswith(".")]


def children(pid: int) -> list[int]:
    """Processes that one has started; none where the system does not say."""
    lists = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for found in lists for child in found.read_text().split()]


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def text(path: Path) -> bytes:
    return path.read_bytes() if path.is_file() else b""


def test_an_interrupted_run_says_how_to_go_on(place):
    child = start(place, ["compare", *LONG, "--out", "interrupted"])
    until = time.monotonic() + 60
    while not text(place / "interrupted" / run.LINES):
        assert child.poll() is None and time.monotonic() < until
        time.sleep(0.005)
    child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=60)
    assert child.returncode == 4, said
    assert said.splitlines()[-1] == "lightproof: interrupted; run the same command again to resume"
    assert "Traceback" not in said and run.records(place / "interrupted")


def test_a_finished_run_is_not_measured_again(place, whole_run):
    before = text(whole_run[1] / run.LINES)
    answer = lightproof(place, "compare", *CHEAP, "--out", whole_run[1])
    assert answer.stdout == whole_run[0].stdout
    assert text(whole_run[1] / run.LINES) == before


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 40 KiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=40k", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("needs the right to mount a file system")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_stops_a_run_that_keeps_what_it_has(place, small_disk):
    answer = lightproof(place, "compare", *CHEAP, "--out", small_disk / "run")
    assert "free space" in one_line(answer) and answer.returncode == 4
    kept = run.records(small_disk / "run")
    assert kept and all(r["status"] == "ok" for r in kept)


def test_a_full_disk_is_told_apart_from_a_folder_that_cannot_be_written(tmp_path, monkeypatch):
    def full(_):
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(CannotWrite) as told:
        run.append(tmp_path, [{"key": "a"}])
    assert told.value.full and "run again to resume" in str(told.value)
    (tmp_path / "file").touch()
    with pytest.raises(CannotWrite) as told:
        run.open_run(tmp_path / "file/run", {})
    assert not told.value.full and "--out" in str(told.value)


def test_the_gate_judges_the_newest_figures(whole_run):
    old = next(r for r in run.records(whole_run[1]) if r["kind"] == "technique")
    new = old | {"key": "newer", "errors": {"rmse": {"value": 9.0, "low": 9.0, "high": 9.0}}}
    bound = Threshold(old["technique"], old["scene"], old["quantity"], "rmse", "", at_most=1.0, size=16)
    assert [v.result for v in judge([bound], [old])] == ["pass"]
    assert [v.result for v in judge([bound], [old, new])] == ["fail"]


def test_diff_gives_the_metrics_worked_out_by_hand(place):
    """Truth 1 and 3, estimate 2 and 3 on the halves: mean 2, mean of A 5/2, one error of 1 in two."""
    halves = np.arange(16)[None, :] < 8
    images(place, "hand", np.where(halves, 2.0, 3.0) * np.ones((16, 1)))
    images(place, "hand-truth", np.where(halves, 1.0, 3.0) * np.ones((16, 1)))
    answer = lightproof(place, "diff", "hand.exr", "hand-truth.exr", "--json")
    found = {name: e["value"] for name, e in json.loads(answer.stdout).items()}
    assert found["bias"] == pytest.approx(0.25)
    assert found["rmse"] == pytest.approx(np.sqrt(1 / 2) / 2)
    assert found["relmse"] == pytest.approx(1 / 2 / (1 + 0.01 * 2**2))
    assert found["gain"] == pytest.approx((2 * 1 + 3 * 3) / (2**2 + 3**2))
    assert found["rmse_gain"] == pytest.approx(np.sqrt((9**2 + 6**2) / 13**2 / 2) / 2)
    assert (found["max"], found["p99"]) == (1, 1)
    assert 0 < found["flip"] < 1
    same = json.loads(lightproof(place, "diff", "hand.exr", "hand.exr", "--json").stdout)
    assert {n: e["value"] for n, e in same.items() if n != "gain"} == dict.fromkeys(set(same) - {"gain"}, 0)


def test_a_plan_names_commands_that_repeat_each_measurement(place):
    from approximations.contract import find_technique
    from compare.task import PROFILES

    tasks = plan([find_technique("ambient_aperture")], PROFILES["quick"], scene="Valley", size=16)
    task = next(t for t in tasks if t.knobs["rays"] == 64)
    assert "--knob rays=64" in task.command() and "--scene Valley" in task.command()


def test_allocators_that_fail_in_their_own_words_count_as_out_of_memory():
    assert status_of(RuntimeError("could not construct output: std::bad_alloc")) == "out of memory"
    assert status_of(RuntimeError("cuda_check(): API error 0002: out of memory")) == "out of memory"
    assert status_of(RuntimeError("something else")) == "failed"


def test_a_failed_record_fits_the_schema():
    task = Task("constant_ambient", "Valley", 16, quantities=("radiance",))
    (record,) = failed(task, "timed out", "took more than 2 s")
    jsonschema.validate(record, SCHEMA)
