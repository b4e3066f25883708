"""The page of a run, from records and images written by hand: nothing is rendered."""

import json
import math
import re

import numpy as np
import pytest

from compare.gate import Threshold
from reference.doctor import find_chromium
from reference.store import CannotWrite, write_exr
from reference.verify import run as verification
from reports.build import build, default_target
from reports.data import gather, smallest
from reports.images import block_mean, nice, pack
from scenes.contract import BadInput, make_scene

HOSTILE = "<script>alert(1)</script>\"'&"
SIZE = 16


def estimate(value, half=0.0, floor=None):
    resolved = floor is None or value >= 2 * floor
    return {"value": value, "low": value - half, "high": value + half, "floor": floor, "resolved": resolved}


def record(technique, rmse, ms, *roles, knobs=None, fields=None, size=SIZE, **more):
    knobs, fields = knobs or {}, {"gap": 0.0, "albedo": 0.5} | (fields or {})
    key = f"{abs(hash((technique, str(knobs), str(fields), size))):020d}-radiance"
    return {
        "key": key,
        "status": "ok",
        "kind": "path tracer" if technique == "path_tracer" else "technique",
        "technique": technique,
        "theme": "toys",
        "baseline": False,
        "covers": ["toy/01"],
        "neglects": ["occlusion"],
        "scene": "Box",
        "fields": fields,
        "changed": {k: v for k, v in fields.items() if v != {"gap": 0.0, "albedo": 0.5}[k]},
        "knobs": knobs,
        "quantity": "radiance",
        "unit": "W m^-2 sr^-1",
        "size": size,
        "seed": 1,
        "roles": list(roles),
        "variant": "llvm_ad_rgb",
        "versions": {"mitsuba": "3.9.1", "drjit": "1.5.0"},
        "command": f"lightproof compare {technique} --scene Box --only --size {size} --seed 1",
        "time": "2026-01-01T00:00:00Z",
        "ladder": {"exact": [k for k, v in knobs.items() if v == "exact"], "of": ["overlap", "cosine"]},
        "domain": {"inside": fields["gap"] < 1, "reason": "" if fields["gap"] < 1 else "the gap is wide"},
        "truth": {
            "key": "closed-form",
            "provenance": {"method": "closed form in float64", "function": "toys.box", "fields": fields},
            "batches": 0,
            "resolution": 0.0,
            "demand": "reached",
            "mean": 0.5,
            "image": "images/truth.exr",
        },
        "costs": {
            "bake_ms": None,
            "frame_ms": estimate(ms, 0.1 * ms),
            "frame_over_calibration": estimate(2 * ms),
            "operations_per_pixel": 31.0,
            "rays": 0,
            "bytes": 4096,
        },
        "findings": [],
        "errors": {
            "bias": estimate(-0.1234, 0.0021),
            "rmse": estimate(rmse, 0.01 * rmse),
            "gain": estimate(1.1, 0.01),
            "rmse_gain": estimate(0.5 * rmse, 0.01 * rmse),
            "p99": estimate(0.9, floor=0.01),
            "flip": estimate(0.01, floor=0.02),
        },
        "images": {"estimate": "images/estimate.exr", "truth": "images/truth.exr"},
    } | more


def failed(technique, *roles, status="crashed", error="its process ended (exit code -6)", **more):
    whole = record(technique, 1, 1, *roles, **more)
    for name in (
        "theme",
        "baseline",
        "covers",
        "neglects",
        "ladder",
        "domain",
        "truth",
        "images",
        "versions",
    ):
        del whole[name]
    found = [{"kind": status, "text": error}]
    return whole | {"status": status, "error": error, "errors": None, "costs": None, "findings": found}


def whole_run():
    plain, name = {"overlap": "lens", "cosine": "raw", "rays": 64}, HOSTILE
    rungs = [{**plain, "overlap": "exact"}, {**plain, "overlap": "exact", "cosine": "exact"}]
    swept = [
        record(name, 0.2 + 0.1 * g, 0.5, "stress:gap", knobs=plain, fields={"gap": g}) for g in (0.5, 1.5)
    ]
    nan = {"kind": "NaN", "text": "3 of 256 pixels, first at (1, 2)", "count": 3, "pixel": [1, 2]}
    return [
        record(name, 0.2, 0.5, "default", knobs=plain),
        record(name, 0.21, 0.2, "knob:rays", knobs={**plain, "rays": 16}),
        record(name, 0.15, 0.6, "knob:overlap", "ladder:1", knobs=rungs[0]),
        record(name, 0.05, 0.7, "ladder:2", knobs=rungs[1]),
        *swept,
        failed(name, "stress:gap", knobs=plain, fields={"gap": 2.0}),
        record("plain_toy", 0.4, 0.1, "default", baseline=True),
        record("broken_toy", 0.4, 0.1, "default", errors=None, findings=[nan]),
        *(
            record("path_tracer", 0.8 / math.sqrt(n), 2.0 * n, "path tracer", knobs={"spp": n})
            for n in (1, 4)
        ),
    ]


def write_run(folder, records, images=True):
    folder.mkdir()
    (folder / "measurements.jsonl").write_text("".join(json.dumps(r) + "\n" for r in records))
    about = {"profile": "quick", "variant": "llvm_ad_rgb", "command": "lightproof compare", "python": "3.11"}
    machine = {"processor": "a processor", "cores": 2, "system": "Linux"}
    (folder / "run.json").write_text(json.dumps(about | {"machine": machine}))
    if images:
        ramp = np.linspace(0, 1, SIZE * SIZE, dtype=np.float32).reshape(SIZE, SIZE)
        for name, image in (("truth", ramp), ("estimate", ramp[::-1].copy())):
            write_exr(folder / f"images/{name}.exr", {}, {"Y": image})
    return folder


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    base = tmp_path_factory.mktemp("page")
    return build(write_run(base / "toy run", whole_run()), base / "out")


@pytest.fixture(scope="module")
def html(page):
    return page.read_text()


def test_page_says_what_was_measured_on_what(html):
    for said in (
        "toy run",
        "quick",
        "a processor, 2 cores",
        "Mitsuba 3.9.1",
        "llvm_ad_rgb",
        "occlusion",
        "toy/01",
    ):
        assert said in html
    assert re.search(r"<b>11</b> measurements", html)
    assert re.search(r"<b>1</b> without figures", html)


def test_figures_stand_with_interval_and_unresolved_ones_are_marked(html):
    assert "20.00 %" in html and "± 0.20" in html
    assert "-12.34 %" in html and "± 0.21" in html
    assert re.search(r'class="unresolved"[^>]*>&lt; 0.04<', html)


def test_brute_force_stands_beside_at_the_same_cost_and_at_the_same_error(page):
    data = json.loads((page.parent / "report.json").read_text())
    row = next(r for r in data["overview"] if r["technique"] == HOSTILE)
    assert row["path_tracer_error"] == pytest.approx(0.8)
    assert row["path_tracer_factor"] == pytest.approx(2 * (0.8 / 0.2) ** 2 / 0.5)


def test_findings_and_failures_are_listed_with_their_command(html):
    assert "3 of 256 pixels, first at (1, 2)" in html
    assert "its process ended (exit code -6)" in html
    assert html.count("lightproof compare broken_toy --scene Box") >= 2


def test_nothing_is_loaded_from_elsewhere(html):
    assert not re.search(r"https?://", html)
    assert not re.search(r"<(?:link|img|script|iframe)[^>]+(?:src|href)=\"(?!data:,)", html)
    assert len(html) < 1_000_000


def test_names_are_text_and_never_markup(html):
    assert "<script>alert" not in html
    assert "&lt;script&gt;alert(1)" in html


def test_charts_show_knobs_rungs_and_lost_points(html):
    drawn = "".join(re.findall(r"<svg.*?</svg>", html, re.DOTALL))
    for said in (
        "1 spp",
        "plain_toy",
        "+ cosine exact",
        "all stages exact",
        "gap 2: crashed",
        "outside: the gap",
    ):
        assert said in drawn
    ids = re.findall(r'id="([^"]+)"', html)
    assert len(ids) == len(set(ids))


def test_twin_in_json_holds_every_record_and_no_pictures(page):
    text = (page.parent / "report.json").read_text()
    data = json.loads(text)
    assert len(data["records"]) == 11 and "<svg" not in text
    ladder = next(t for t in data["techniques"] if t["name"] == HOSTILE)["cases"][0]["ladder"]
    assert [rung["stage"] for rung in ladder] == [None, "overlap", "cosine"]


@pytest.mark.parametrize(
    ("records", "said"),
    [
        ([], "holds no measurement of a technique"),
        ([record("path_tracer", 0.8, 2.0, "path tracer", knobs={"spp": 1})], "only 1 of the path tracer"),
        ([failed("toy", "default"), failed("path_tracer", "path tracer", knobs={"spp": 1})], "crashed"),
        ([record("toy", 0.2, 0.5, "knob:rays", knobs={"rays": 4})], "not measured yet"),
        ([record("toy", 0.2, 0.5, "default", errors=None)], "no figures"),
        (
            [
                record("toy", 0.2, 0.5, *r, fields={"gap": g})
                for r, g in ((["default"], 0.0), (["stress:gap"], 2.0))
            ],
            "under stress",
        ),
        ([record("toy", 0.0, 0.5, "default")], "its images are not in the run"),
    ],
)
def test_partial_runs_still_give_a_page(tmp_path, records, said):
    folder = write_run(tmp_path / "run", records, images=False)
    (folder / "run.json").unlink()
    assert said.lower() in build(folder, tmp_path / "out").read_text().lower()


def proof(kind, verdict, **changed):
    return {
        "key": f"{kind}{verdict}#0",
        "kind": kind,
        "truth": f"{kind} truth",
        "claim": "a law is kept",
        "routes": ["one", "another"],
        "citation": "A. Author 1901",
        "verdict": verdict,
        "note": "",
        "standard_errors": 3.25,
        "relative": 0.0123,
        "where": "pixel (4, 2)",
        "p": 0.5,
        "catches": 0.0042,
        "seconds": 1.0,
    } | changed


def test_proofs_of_the_truths_stand_in_a_table_each_what_differs_first(tmp_path):
    folder = write_run(tmp_path / "proved", whole_run())
    rows = [
        proof("physics", "agrees"),
        proof("physics", "differs", truth="lost energy", p=1e-9),
        proof("published", "agrees", standard_errors=None),
        {"key": "s#0", "kind": "stored", "truth": "x.exr", "claim": "c", "routes": ["a", "b"], "citation": ""}
        | {"verdict": "damaged", "note": "cut short", "seconds": 0.1},
    ]
    verification.write(folder, rows)
    html = build(folder, tmp_path / "out").read_text()
    assert "Laws of physics: 1 of 2 agree" in html and "Published numbers: 1 of 1 agree" in html
    assert html.index("lost energy") < html.index("physics truth")
    for said in ("one / another", "3.25", "1.2 %", "pixel (4, 2)", "0.42 %", "A. Author 1901", "cut short"):
        assert said in html


def test_a_run_without_proofs_says_how_to_get_them(html):
    assert "lightproof reference verify" in html


def test_verdicts_stand_in_the_head_the_table_and_the_case(tmp_path, monkeypatch):
    fields = make_scene("Valley", {}).fields()
    r = record("constant_ambient", 0.4, 0.1, "default") | {"scene": "Valley", "fields": fields, "changed": {}}
    bounds = [
        Threshold("constant_ambient", "Valley", "radiance", metric, "occlusion", size=SIZE, **bound)
        for metric, bound in (("rmse", {"at_most": 0.5}), ("bias", {"at_least": 0.1}))
    ]
    monkeypatch.setattr("reports.data.load_thresholds", lambda: bounds)
    folder = write_run(tmp_path / "run", [r], images=False)
    data = gather(folder)
    assert data["run"]["gate"]["result"] == "fail" and data["overview"][0]["verdict"] == "fail"
    html = build(folder, tmp_path / "out").read_text()
    assert "gate: fail" in html and "against at most 0.5" in html and "pays: occlusion" in html


def test_pages_lie_in_the_checkout_or_else_in_the_run(tmp_path, monkeypatch):
    assert default_target(tmp_path / "quick").parts[-3:] == ("reports", "out", "quick")
    monkeypatch.setattr("reports.build.HERE", tmp_path / "site-packages/reports")
    assert default_target(tmp_path / "quick") == tmp_path / "quick/report"


def test_what_cannot_be_written_is_said_in_one_line(tmp_path):
    folder = write_run(tmp_path / "run", [], images=False)
    (tmp_path / "taken").write_text("")
    with pytest.raises(CannotWrite, match="choose another folder"):
        build(folder, tmp_path / "taken" / "page")
    with pytest.raises(BadInput, match="holds no run"):
        build(tmp_path / "nowhere", tmp_path / "out")


def test_of_two_measurements_of_one_question_the_newer_counts(tmp_path):
    old, new = (
        record("toy", 0.5, 1.0, "default"),
        record("toy", 0.2, 1.0, "default") | {"key": "new-radiance"},
    )
    data = gather(write_run(tmp_path / "run", [old, new], images=False))
    assert [row["figures"]["rmse"]["text"] for row in data["overview"]] == ["20.00 %"]


def test_a_finding_is_shown_by_the_input_with_the_fewest_changes():
    flaw = [{"kind": "negative", "text": "1 of 256 pixels"}]
    shown = [
        record("toy", 0.2, 1.0, "default", knobs={"rays": 4}),
        record("toy", 0.2, 1.0, "a", knobs={"rays": 8}, fields={"gap": 2.0}, findings=flaw),
        record("toy", 0.2, 1.0, "b", knobs={"rays": 4}, fields={"gap": 2.0}, findings=flaw),
    ]
    found = smallest(shown)
    assert [(f["input"], f["times"]) for f in found] == [("gap=2", 2)]


def test_packed_images_come_back_within_half_precision(rng):
    import base64
    import zlib

    image = rng.normal(size=(5, 7, 3)) * 1e-6
    image[0, 0] = math.inf, -math.inf, math.nan
    p = pack(image)
    steps = np.frombuffer(zlib.decompress(base64.b64decode(p["data"])), np.uint8).reshape(3, 2, 35)
    high, low = np.moveaxis(np.cumsum(steps, axis=2, dtype=np.uint8).astype(np.uint16), 1, 0)
    back = np.moveaxis(((high << 8) | low).view(np.float16).astype(float).reshape(3, 5, 7), 0, 2) * p["scale"]
    assert back == pytest.approx(image, rel=1e-3, abs=1e-13, nan_ok=True)
    assert pack(np.repeat(image[..., :1], 3, axis=2))["channels"] == 1


def test_large_images_are_averaged_in_blocks(rng):
    image = rng.random((515, 300, 1))
    small = block_mean(image)
    assert small.shape == (172, 100, 1)
    assert small[3, 4, 0] == pytest.approx(image[9:12, 12:15].mean())
    assert small[-1, 0, 0] == pytest.approx(image[513:, :3].mean())


@pytest.mark.parametrize(("value", "rounded"), [(0.12, 0.15), (0.1, 0.1), (7.1, 10), (0, 0)])
def test_colour_scales_end_at_round_values(value, rounded):
    assert nice(value) == pytest.approx(rounded)


@pytest.fixture(scope="module")
def browser():
    path = find_chromium()
    if path is None:
        pytest.skip("no Chromium on this machine")
    from playwright.sync_api import sync_playwright

    quiet = ["background-networking", "component-update", "sync", "gpu", "quic"]
    with sync_playwright() as p:
        started = p.chromium.launch(
            executable_path=path, args=["--no-sandbox", "--no-first-run", *(f"--disable-{q}" for q in quiet)]
        )
        yield started
        started.close()


@pytest.fixture
def tab(browser, page):
    opened = browser.new_page(viewport={"width": 1400, "height": 1000})
    opened.said, opened.asked = [], []
    opened.on("console", lambda m: opened.said.append(m.text))
    opened.on("pageerror", lambda e: opened.said.append(str(e)))
    opened.on("dialog", lambda d: opened.said.append(d.message))
    opened.on("request", lambda r: opened.asked.append(r.url))
    opened.goto(page.as_uri())
    opened.wait_for_selector(".viewer[data-ready=yes]")
    yield opened
    opened.close()


def pixels(tab, k=0):
    """Colours of a grid of points on the canvas of view k of the first viewer."""
    return tab.evaluate(
        """k => { const c = document.querySelector('.viewer').querySelectorAll('canvas')[k];
        const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
        return [...Array(64).keys()].map(i => 4 * Math.floor(i * d.length / 256))
            .map(at => [...d.slice(at, at + 3)]) }""",
        k,
    )


def test_page_opens_from_disk_without_a_request_or_an_error(tab):
    assert tab.said == []
    assert [url.split(":")[0] for url in tab.asked] == ["file"]
    assert len(tab.asked) == 1


def test_canvas_shows_the_image_and_the_exposure_moves_it(tab):
    first = pixels(tab)
    assert len({tuple(p) for p in first}) > 8
    tab.locator(".viewer").first.focus()
    tab.keyboard.press("Shift+E")
    brighter = pixels(tab)
    assert sum(map(sum, brighter)) > sum(map(sum, first))
    tab.keyboard.press("e")
    assert pixels(tab) == first
    tab.locator(".viewer input[type=range]").first.fill("-5")
    assert sum(map(sum, pixels(tab))) < sum(map(sum, first))
    tab.keyboard.press("r")
    assert pixels(tab) == first


def test_keys_switch_the_image(tab):
    tab.locator(".viewer").first.focus()
    panes = tab.locator(".viewer").first.locator(".pane")
    assert panes.count() == 4
    for key, shown in (("1", [0]), ("2", [1]), ("3", [2]), ("4", [3]), ("0", [0, 1, 2, 3])):
        tab.keyboard.press(key)
        assert [k for k in range(4) if panes.nth(k).is_visible()] == shown


def test_signed_error_is_blue_where_too_dark_and_red_where_too_bright(tab):
    error = pixels(tab, 2)
    (top_red, _, top_blue), (low_red, _, low_blue) = error[4], error[-4]
    assert top_red > top_blue and low_blue > low_red


def test_pixel_under_the_cursor_is_read_out(tab):
    box = tab.locator(".viewer canvas").first
    box.scroll_into_view_if_needed()
    place = box.bounding_box()
    tab.mouse.move(place["x"] + place["width"] * 0.5 / SIZE, place["y"] + place["height"] * 1.5 / SIZE)
    said = tab.locator(".viewer .read").first.inner_text()
    truth, found = 16 / 255, (14 * 16) / 255
    assert said.startswith("(0, 1)")
    assert f"truth {truth:.5f}"[:12] in said
    assert f"difference +{found - truth:.4f}"[:18] in said


def test_a_click_sorts_the_table_both_ways(tab):
    head = tab.locator("#overview-table th", has_text="Error").first

    def errors():
        cells = tab.locator("#overview-table tbody td.strong").all()
        return [float(c.get_attribute("data-sort")) for c in cells]

    head.click()
    assert errors() == [0.2, 0.4]
    head.click()
    assert errors() == [0.4, 0.2]


def test_page_shows_in_the_dark(browser, page):
    dark = browser.new_page(color_scheme="dark")
    dark.goto(page.as_uri())
    colours = "getComputedStyle(document.querySelector('figure svg text')).fill"
    assert dark.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(20, 21, 23)"
    assert dark.evaluate(colours) != "rgb(0, 0, 0)"
    dark.close()
