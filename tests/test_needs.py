"""What `needs` drops, on scenes whose losses are known: each loss is found, no wrong one is let through."""

import json
import math
from dataclasses import dataclass
from typing import ClassVar

import mitsuba as mi
import numpy as np
import pytest

from compare import needs as asked
from compare.loss import DROPPED, NEEDED, OPEN, loss, verdict
from compare.needs import exit_code, needs, sentence, table
from compare.statistics import Estimate
from reference.coarser import box_filtered, coarser_textures, coarser_volumes
from reference.moments import from_batches
from reference.reduced import SHRINK, families, isotropic, reduced, scaled, without_size
from reference.render import load_description, to_array
from reports import needs_chart
from scenes.cloud import CloudSphere
from scenes.contract import RADIANCE, TRANSMITTANCE, BadInput, Scene
from scenes.mitsuba_parts import diffuse, orthographic, perspective, round_sun, uniform_sky

SIZE = 8


@dataclass(frozen=True)
class Made(Scene):
    """A scene for these tests, kept out of the list of scenes."""

    theme: ClassVar[str] = "test"
    quantities: ClassVar[tuple] = (RADIANCE,)
    exposure: ClassVar[tuple[float, float]] = (-2.0, 2.0)


@dataclass(frozen=True)
class Furnace(Made):
    """The inside of a ball that glows with L and reflects rho: L (1 - rho^n) / (1 - rho) at depth n."""

    rho: float = 0.5

    def mitsuba(self, size: int = 128) -> dict:
        ball = {
            "type": "sphere",
            "flip_normals": True,
            "bsdf": diffuse(self.rho),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 1.0}},
        }
        return {"type": "scene", "ball": ball, "sensor": perspective([0, -0.5, 0], [0, 0.5, 0], 60, size)}


@dataclass(frozen=True)
class Ground(Made):
    """A wide floor under a round sun, with a ball that throws a shadow where `ball` is set.

    At 1 mrad the sun itself would be wrong: Mitsuba's cone to a sphere, 1 - cos in float32, is off by 7 %."""

    radius: float = 0.02
    ball: bool = True

    def mitsuba(self, size: int = 128) -> dict:
        floor = {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().scale(50),
            "bsdf": diffuse(0.3),
        }
        ball = {"ball": {"type": "sphere", "center": [0, 0, 1.5], "radius": 0.7, "bsdf": diffuse(0.3)}}
        sun = round_sun([0.0, 0.6, 0.8], self.radius, math.pi)
        return {
            "type": "scene",
            "floor": floor,
            **(ball if self.ball else {}),
            "sun": sun,
            "sky": uniform_sky(0.05),
            "sensor": perspective([0, -6, 4], [0, 0, 0], 45, size),
        }


@dataclass(frozen=True)
class Picture(Made):
    """A glowing wall of stripes and nothing that scatters: only the light itself is seen."""

    contrast: float = 0.5

    def mitsuba(self, size: int = 128) -> dict:
        colours = {"color0": 1 + self.contrast, "color1": 1 - self.contrast}
        wall = {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().look_at([0, 2, 0], [0, 0, 0], [0, 0, 1]).scale([1, 1, 1]),
            "bsdf": diffuse(0.0),
            "emitter": {
                "type": "area",
                "radiance": {
                    "type": "checkerboard",
                    **{k: {"type": "srgb", "color": 3 * [v], "unbounded": True} for k, v in colours.items()},
                    "to_uv": mi.ScalarTransform4f().scale([4, 4, 1]),
                },
            },
        }
        return {"type": "scene", "wall": wall, "sensor": orthographic([0, 0, 0], [0, 2, 0], 1.0, size)}


@pytest.fixture(autouse=True)
def own_store(tmp_path, monkeypatch):
    monkeypatch.setenv("LIGHTPROOF_STORE", str(tmp_path / "truths"))


def rendered(description: dict, spp: int = 256) -> np.ndarray:
    description, how = reduced(description, SIZE, ())
    return to_array(mi.render(load_description(description, how), spp=spp, seed=1))


def with_depth(answer: dict) -> list[dict]:
    return [r for r in answer["reductions"] if r["depth"] is not None]


def test_a_furnace_loses_rho_to_the_n():
    answer = needs(Furnace(), "rmse", 0.1, size=SIZE)
    assert answer["verdict"] == "found" and exit_code(answer) == 0
    for row in with_depth(answer):
        assert row["loss"]["value"] == pytest.approx(0.5 ** row["depth"], rel=0.01)
    assert [r["depth"] for r in with_depth(answer)] == [1, 2, 3, 4]
    assert [r["verdict"] for r in with_depth(answer)] == [NEEDED, NEEDED, NEEDED, DROPPED]
    assert answer["least"]["transport"]["integrator"]["max_depth"] == 4
    assert answer["least"]["breaks_first"]["assumes"] == "light that was turned 4 times or more is faint"
    assert "light size" in answer["nothing_to_drop"]


def test_bias_is_judged_by_its_size():
    answer = needs(Furnace(), "bias", 0.3, size=SIZE)
    assert [r["depth"] for r in with_depth(answer)] == [1, 2]
    assert with_depth(answer)[1]["loss"]["value"] == pytest.approx(0.25, rel=0.01)


def test_where_nothing_scatters_the_light_itself_is_enough():
    answer = needs(Picture(0.1), "rmse", 0.2, size=SIZE)
    assert with_depth(answer) == [] and "bounces" in answer["nothing_to_drop"]
    assert answer["least"]["transport"]["integrator"]["max_depth"] == 1
    [mean] = answer["reductions"]
    assert mean["verdict"] == DROPPED and mean["loss"]["value"] == pytest.approx(0.1, abs=2e-3)
    assert answer["least"]["drops"] == ["texture detail (mean)"]


def test_texture_detail_that_is_seen_is_needed():
    answer = needs(Picture(0.5), "rmse", 0.2, size=SIZE)
    assert answer["reductions"][0]["verdict"] == NEEDED and answer["least"]["drops"] == []
    assert answer["reductions"][0]["loss"]["value"] == pytest.approx(0.5, abs=5e-3)


def test_a_small_sun_is_a_point_and_a_large_one_is_not():
    small = needs(Ground(0.02), "rmse", 0.05, size=SIZE)
    large = needs(Ground(0.6), "rmse", 0.05, size=SIZE)
    assert [r["verdict"] for r in small["reductions"] if r["family"] == "light size"] == [DROPPED]
    assert [r["verdict"] for r in large["reductions"] if r["family"] == "light size"] == [NEEDED]
    assert "light size (points)" in small["least"]["drops"]


def test_of_each_family_only_the_least_level_is_taken():
    """The level after one that was not settled at first is measured too, and may be droppable as well."""
    kinds = families(Furnace().mitsuba(SIZE), False)
    question = asked.checked(Furnace(), "rmse", 0.2, SIZE, 1, 64)
    rows = [
        {"family": "bounces", "drops": [f"bounces (beyond depth {d})"], "verdict": DROPPED, "cost_ratio": c}
        for d, c in ((3, 0.9), (4, 0.8))
    ]
    control = {"verdict": DROPPED, "cost": None}
    least, settled = asked.together(question, kinds, rows, control, math.inf, lambda _: None)
    assert settled and least["drops"] == ["bounces (beyond depth 3)"]


def test_what_is_open_beyond_a_level_that_can_be_dropped_need_not_be_settled():
    said = [("a", NEEDED), ("a", OPEN), ("a", DROPPED), ("a", OPEN), ("b", OPEN)]
    rows = [{"family": f, "verdict": v, "drops": [str(i)]} for i, (f, v) in enumerate(said)]
    assert [r["drops"] for r in asked.unsettled(rows)] == [["1"], ["4"]]


def test_every_image_has_seeds_of_its_own():
    question = asked.checked(Furnace(), "rmse", 0.2, SIZE, 1, 64)
    depth = families(Furnace().mitsuba(SIZE), False)["bounces"]
    series = [question.sampling(r, s) for s in ("alone", "together") for r in ((), depth[:1], depth[1:2])]
    assert len({s.seed for s in series} | {question.seed}) == 7
    assert question.sampling((), "alone").seed == series[0].seed


def test_what_is_dropped_together_is_measured_together():
    answer = needs(Ground(0.02), "rmse", 0.1, size=SIZE)
    least = answer["least"]
    assert len(least["drops"]) == 2 and least["loss"]["high"] <= 0.1
    alone = {r["drops"][0]: r["loss"]["value"] for r in answer["reductions"]}
    assert least["loss"]["value"] >= 0.9 * max(alone[d] for d in least["drops"])


def test_losses_that_add_up_beyond_the_tolerance_are_taken_back(monkeypatch):
    """Two things that lose a quarter each, and more than the tolerance at once."""
    kinds = families(Furnace().mitsuba(SIZE), False)
    [depth] = [f for f in kinds.values() if f]
    darker = asked.Reduction("level", "half", "x", lambda d: {**d, "ball": _dimmed(d["ball"], 0.75)})
    monkeypatch.setattr(asked, "families", lambda *_: {"bounces": depth, "level": (darker,)})
    answer = needs(Furnace(), "rmse", 0.26, size=SIZE)
    alone = {r["drops"][0]: (r["verdict"], r["loss"]["value"]) for r in answer["reductions"]}
    assert alone["level (half)"][0] == DROPPED
    assert alone["level (half)"][1] == pytest.approx(0.25, rel=0.01)
    assert alone["bounces (beyond depth 2)"][0] == DROPPED
    both = 1 - 0.75 * 0.75
    assert both > 0.26
    assert answer["verdict"] == "found" and answer["least"]["loss"]["high"] <= 0.26
    assert answer["least"]["drops"] != ["bounces (beyond depth 2)", "level (half)"]


def _dimmed(ball: dict, k: float) -> dict:
    return {**ball, "emitter": {"type": "area", "radiance": {"type": "rgb", "value": k}}}


def test_an_impossible_tolerance_says_what_was_reached():
    answer = needs(Ground(0.3), "rmse", 1e-7, size=SIZE, batches=8)
    assert answer["verdict"] == "impossible tolerance" and exit_code(answer) == 1
    assert answer["least"] is None and answer["full"]["loss"]["high"] > 1e-7
    assert f"{answer['full']['loss']['high']:.3g} is what" in sentence(answer)


def test_a_budget_that_is_too_small_settles_nothing_and_says_so():
    answer = needs(Furnace(), "rmse", 0.1, size=SIZE, seconds=1e-6)
    assert answer["verdict"] == "not settled" and exit_code(answer) == 3
    assert "time was up" in sentence(answer)
    assert table(answer)[0]["95 %"] is None


def test_the_same_seed_gives_the_same_losses():
    first, again = (needs(Ground(0.3), "rmse", 0.05, size=SIZE, seed=3) for _ in range(2))
    keep = ("drops", "verdict", "loss", "batches")
    assert [[r[k] for k in keep] for r in first["reductions"]] == [
        [r[k] for k in keep] for r in again["reductions"]
    ]
    other = needs(Ground(0.3), "rmse", 0.05, size=SIZE, seed=4)
    assert [r["loss"] for r in first["reductions"]] != [r["loss"] for r in other["reductions"]]


@pytest.mark.parametrize(
    ("metric", "tolerance", "said"),
    [
        ("rsme", 0.1, "unknown metric 'rsme': did you mean rmse"),
        ("rmse", -1.0, "expected a number of 0 or more"),
    ]
    + [("rmse", math.nan, "expected a number"), ("rmse", "x", "expected a number")],
)
def test_bad_input_is_one_line(metric, tolerance, said):
    with pytest.raises(BadInput, match=said):
        needs(Furnace(), metric, tolerance, size=SIZE)


def test_a_scene_without_rendered_radiance_is_refused():
    @dataclass(frozen=True)
    class Clear(Furnace):
        quantities: ClassVar[tuple] = (TRANSMITTANCE,)

    with pytest.raises(BadInput, match="no rendered radiance"):
        needs(Clear(), "rmse", 0.1)


def test_the_verdict_is_the_side_of_the_whole_interval():
    assert verdict(Estimate(1, 0.9, 1.1), 1.1) == DROPPED
    assert verdict(Estimate(1, 0.9, 1.1), 0.8) == NEEDED
    assert verdict(Estimate(1, 0.9, 1.1), 1.0) == OPEN


@pytest.mark.parametrize("batches", [4, 8])
@pytest.mark.parametrize("error", [0.02, 0.1])
def test_intervals_of_a_loss_hold_the_true_one(rng, batches, error):
    base = np.linspace(1, 2, 16)[:, None, None] * np.ones((16, 16, 3))
    true = error * math.sqrt((base**2).mean()) / base.mean()

    def image(mean):
        shape = (batches, 16, 16)
        noise = 0.15 * rng.standard_normal((*shape, 1)) + 0.1 * rng.standard_normal((*shape, 3))
        return from_batches(mean + noise)

    found = [loss(image(base * (1 + error)), image(base), "rmse", (0, 1)) for _ in range(300)]
    assert 0.91 <= np.mean([e.low <= true <= e.high for e in found]) <= 0.985


def test_a_point_lights_what_faces_it_as_the_ball_did():
    ball = {"type": "sphere", "center": [1.0, 0.5, 4.0], "radius": 0.5, "bsdf": diffuse(0.0)}
    light = {**ball, "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [3.0, 2.0, 1.0]}}}
    moved = {
        **light,
        "to_world": mi.ScalarTransform4f().translate([0, 0, -4]).scale(2),
        "center": [0.5, 0.25, 4],
    }
    moved["radius"] = 0.25
    assert without_size(light)["position"] == pytest.approx(without_size(moved)["position"])
    assert without_size(light)["intensity"]["value"] == pytest.approx(
        without_size(moved)["intensity"]["value"]
    )
    assert without_size(light)["intensity"]["value"] == pytest.approx([math.pi / 4 * k for k in (3, 2, 1)])
    floor = {"type": "rectangle", "bsdf": diffuse(0.8)}
    scene = {"type": "scene", "floor": floor, "sensor": orthographic([0, -5, 3], [0, 0, 0], 0.3, SIZE)}
    a, b = (rendered(scene | {"light": shape}).mean(axis=(0, 1)) for shape in (light, without_size(light)))
    assert b == pytest.approx(a, rel=3e-3)


def test_a_flat_light_keeps_its_intensity_in_every_direction():
    to_world = mi.ScalarTransform4f().look_at([0, 0, 3], [0.5, 0, 0], [0, 1, 0]).scale(0.1)
    glow = {"type": "area", "radiance": {"type": "srgb", "color": [5.0, 5.0, 5.0], "unbounded": True}}
    light = {"type": "disk", "to_world": to_world, "bsdf": diffuse(0.0), "emitter": glow}
    small = without_size(light)
    assert small["emitter"]["radiance"]["color"] == pytest.approx([5 / SHRINK**2] * 3)
    floor = {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(4), "bsdf": diffuse(0.8)}
    scene = {"type": "scene", "floor": floor, "sensor": orthographic([0, -5, 1], [0, 0, 0], 1.5, SIZE)}
    a, b = (rendered(scene | {"light": shape}) for shape in (light, small))
    assert b == pytest.approx(a, rel=0.02)


def test_spectra_and_textures_are_scaled_and_others_left_alone():
    assert scaled(2.0, 3) == 6 and scaled({"type": "rgb", "value": [1, 2, 3]}, 2)["value"] == [2, 4, 6]
    assert scaled({"type": "regular", "values": "1, 2.5"}, 2)["values"] == "2, 5"
    assert scaled({"type": "checkerboard", "color0": 1, "color1": 2}, 2)["color1"] == 4
    assert scaled({"type": "blackbody", "temperature": 3000}, 2) is None


def test_similarity_keeps_absorption_and_reduced_scattering():
    medium = {"type": "homogeneous", "sigma_t": 2.0, "albedo": 0.9, "phase": {"type": "hg", "g": 0.8}}
    new = isotropic(medium)
    sigma_t = new["scale"] * new["sigma_t"]
    assert sigma_t * (1 - new["albedo"]) == pytest.approx(2 * 0.1)
    assert sigma_t * new["albedo"] == pytest.approx(2 * 0.9 * 0.2)


def test_scattering_orders_and_similarity_are_asked_of_a_cloud():
    kinds = {name for name, f in families(CloudSphere().mitsuba(SIZE), False).items() if f}
    assert kinds == {"scattering orders", "phase function"}
    assert not families(CloudSphere(g=0.0).mitsuba(SIZE) | {}, False)["light size"]


def test_a_refracting_ball_is_needed_before_a_wall_that_it_turns_over():
    wall = Picture(0.5).mitsuba(SIZE)
    glass = {"type": "sphere", "center": [0, 1, 0], "radius": 0.6, "bsdf": {"type": "dielectric"}}
    levels = families(wall | {"glass": glass}, False)["refraction"]
    assert [r.level for r in levels] == ["no interface", "thin panes"]
    clear = rendered(levels[0].change(wall | {"glass": glass}))
    assert clear == pytest.approx(rendered(wall), rel=1e-2, abs=1e-2)
    pane, bent = rendered(levels[1].change(wall | {"glass": glass})), rendered(wall | {"glass": glass})
    middle = np.s_[3:5, 3:5]
    assert pane[middle].mean() < 0.95 * clear[middle].mean()
    assert np.abs(bent - clear).max() > 0.2


def test_the_box_filter_keeps_the_mean_and_splits_what_lies_across_an_edge():
    assert box_filtered(np.arange(8.0), 2, (0,)).tolist() == [0.5, 2.5, 4.5, 6.5]
    assert box_filtered(np.array([0.0, 3.0, 6.0]), 2, (0,)) == pytest.approx([1.0, 5.0])
    a = np.random.default_rng(1).random((5, 7, 3))
    assert box_filtered(a, None, (0, 1)) == pytest.approx(a.mean(axis=(0, 1), keepdims=True))
    assert box_filtered(a, 3, (0, 1)).mean(axis=(0, 1)) == pytest.approx(a.mean(axis=(0, 1)))


def test_bitmaps_and_grids_become_their_mean():
    image = np.random.default_rng(2).random((4, 6, 3)).astype(np.float32)
    texture = {"type": "bitmap", "bitmap": mi.Bitmap(image), "filter_type": "nearest"}
    mean = coarser_textures({"bsdf": {"type": "diffuse", "reflectance": texture}}, None)["bsdf"][
        "reflectance"
    ]
    assert np.array(mean["bitmap"]).ravel() == pytest.approx(image.mean(axis=(0, 1)), rel=1e-5)
    assert mean["filter_type"] == "nearest"
    half = coarser_textures(texture, 2)
    assert np.array(half["bitmap"]).shape == (2, 3, 3)
    grid = np.random.default_rng(3).random((4, 4, 4, 1)).astype(np.float32)
    medium = {"type": "heterogeneous", "albedo": 0.5}
    medium["sigma_t"] = {"type": "gridvolume", "grid": mi.VolumeGrid(grid)}
    even = coarser_volumes({"m": medium}, None)["m"]
    assert even["type"] == "homogeneous" and even["sigma_t"] == pytest.approx(float(grid.mean()), rel=1e-5)
    assert np.array(coarser_volumes(medium, 2)["sigma_t"]["grid"]).shape[:3] == (2, 2, 2)


def test_a_checkerboard_of_two_kinds_of_colour_has_no_mean():
    with pytest.raises(BadInput, match="two kinds of colour"):
        coarser_textures({"type": "checkerboard", "color0": 1.0, "color1": {"type": "rgb", "value": 1}}, None)


def test_the_chart_is_drawn_with_the_tolerance_and_every_depth(tmp_path):
    answer = needs(Furnace(), "rmse", 0.1, size=SIZE)
    picture, pixels = needs_chart.save(json.loads(json.dumps(answer)), tmp_path / "out")
    text = picture.read_text()
    assert "tolerance 0.1" in text and "max_depth" in text and "var(--" not in text
    for row in with_depth(answer):
        assert f"{row['loss']['value']:.3g} (" in text
    assert pixels.read_bytes().startswith(b"\x89PNG")
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="cannot write"):
        needs_chart.save(answer, tmp_path / "file")


@pytest.mark.parametrize(("tolerance", "seconds"), [(0.0, 60.0), (0.1, 1e-6)])
def test_an_answer_without_a_verdict_is_drawn_as_well(tmp_path, tolerance, seconds):
    answer = needs(Furnace(), "rmse", tolerance, size=SIZE, batches=4, seconds=seconds)
    assert answer["verdict"] != "found" and answer["least"] is None
    assert needs_chart.save(answer, tmp_path)[1].read_bytes().startswith(b"\x89PNG")
