r"""The least light transport that a scene needs: what an image loses with each part that is dropped.

Every level of every family of `reference.reduced` is held against the full image, from the least transport up
to the first that can be dropped (`compare.loss`). Batches grow from milestone to milestone until each loss is
settled or the budget is spent. The full transport against itself is measured too. What it loses is noise: a
tolerance that it cannot be shown to keep is out of reach.

Of each family the least level that can be dropped is taken. Losses add up, so all that are taken are measured
together, with new seeds; if that is too much, they are taken up one by one, the largest saving first, as long
as the whole stays within the tolerance. saving = 1 - cost / cost of the full transport, at equal noise.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from compare.loss import DROPPED, FIRST, METRICS, NEEDED, OPEN, Question, ratio
from reference.reduced import Family, Reduction, families
from reference.store import milestone
from reference.truth import find_sampler
from scenes.contract import RADIANCE, BadInput, Scene, unknown

SHARE = 0.7
"""Of the seconds, for one reduction at a time; the rest is for all together."""

Report = Callable[[str, int, int], None]


def needs(
    scene: Scene,
    metric: str,
    tolerance: float,
    *,
    size: int = 64,
    seed: int = 1,
    batches: int = 256,
    seconds: float = 60.0,
    report: Report = lambda what, done, total: None,
) -> dict:
    """What a scene's radiance loses with each thing that may be dropped, and the least transport that stays
    within the tolerance, as plain data.

    metric: one of METRICS. tolerance: the largest loss. batches, seconds: what each image, and the whole, may
    take; images are `size` pixels a side. Raises BadInput for an unknown metric, a tolerance that is not a
    number of 0 or more, or a scene without rendered radiance.

    verdict: "found"; "impossible tolerance", where the full transport against itself reads more within the
    budget; "not settled", where a loss is on neither side. `least` is the best that is sure, or None.
    """
    question = checked(scene, metric, tolerance, size, seed, batches)
    if not seconds > 0:
        raise BadInput(f"seconds must be above 0, not {seconds:g}")
    started = time.monotonic()
    end, halfway = started + seconds, started + SHARE * seconds
    kinds = families(scene.mitsuba(size), scene.spectral)

    def tell(what: str) -> None:
        report(what, min(round(time.monotonic() - started), round(seconds)), round(seconds))

    control, rows = one_by_one(question, [f for f in kinds.values() if f], halfway, tell)
    for row in [control, *rows]:
        row["cost_ratio"] = ratio(row["cost"], control["cost"])
    least, found = None, "impossible tolerance" if control["loss"] else "not settled"
    if control["verdict"] == DROPPED:
        least, settled = together(question, kinds, rows, control, end, tell)
        least = least | {"breaks_first": breaks_first(least, rows)}
        found = "found" if settled and not unsettled(rows) else "not settled"
    return {
        "scene": type(scene).__name__,
        "fields": scene.fields(),
        "metric": metric,
        "tolerance": tolerance,
        "size": size,
        "seed": seed,
        "verdict": found,
        "full": control,
        "reductions": rows,
        "nothing_to_drop": [name for name, f in kinds.items() if not f],
        "least": least,
        "seconds": round(time.monotonic() - started, 1),
    }


def checked(scene: Scene, metric: str, tolerance: float, size: int, seed: int, batches: int) -> Question:
    """The question, if it is one. Raises BadInput."""
    if RADIANCE not in scene.quantities or find_sampler(type(scene), RADIANCE):
        raise BadInput(f"{type(scene).__name__} has no rendered radiance: name a scene that has")
    if metric not in METRICS:
        raise unknown("metric", metric, METRICS)
    if isinstance(tolerance, (str, bool)) or not 0 <= tolerance < math.inf:
        raise BadInput(f"--tolerance {metric}={tolerance}: expected a number of 0 or more, such as 0.05")
    if batches < FIRST:
        raise BadInput(f"batches must be {FIRST} or more, not {batches}")
    return Question(scene, size, metric, float(tolerance), seed, batches)


def one_by_one(
    question: Question, kinds: list[Family], deadline: float, tell: Callable[[str], None]
) -> tuple[dict, list[dict]]:
    """The full transport against itself, and every level from the least up to the first that can be dropped.
    What is not settled is looked at again with more batches; finer levels only once noise is not what hides
    it."""
    rows: dict[str, dict] = {}
    count, control = FIRST, {"verdict": OPEN}
    while True:
        tell(f"full transport, {count} batches")
        question.grow_full(count, deadline)
        if control["verdict"] != DROPPED:
            control = question.measure((), count, deadline)
        for family in kinds:
            for reduction in family:
                row = rows.get(reduction.label)
                if row is None or row["verdict"] == OPEN:
                    tell(f"{reduction.label}, {count} batches")
                    row = rows[reduction.label] = question.measure((reduction,), count, deadline)
                too_early = row["verdict"] == OPEN and control["verdict"] == OPEN
                if row["verdict"] == DROPPED or row["loss"] is None or too_early:
                    break
        settled = control["verdict"] == DROPPED and not unsettled(list(rows.values()))
        if settled or time.monotonic() >= deadline or milestone(count) > question.batches:
            order = [r.label for family in kinds for r in family]
            return control, sorted(rows.values(), key=lambda row: order.index(row["drops"][0]))
        count = milestone(count)


def together(
    question: Question,
    kinds: dict[str, Family],
    rows: list[dict],
    control: dict,
    deadline: float,
    tell: Callable[[str], None],
) -> tuple[dict, bool]:
    """The row of all that can be dropped at once, and whether that was settled."""
    dropped = {r["family"]: r for r in reversed(rows) if r["verdict"] == DROPPED}
    by_saving = sorted(dropped.values(), key=lambda r: (r["cost_ratio"], r["family"]))
    levels = {r.label: r for family in kinds.values() for r in family}
    chosen = [levels[r["drops"][0]] for r in by_saving]
    order = list(levels)

    def row_of(reductions: list[Reduction]) -> dict:
        reductions = sorted(reductions, key=lambda r: order.index(r.label))
        tell(" + ".join(r.family for r in reductions))
        count, row = FIRST, {"verdict": OPEN}
        while row["verdict"] == OPEN and count <= question.batches and time.monotonic() < deadline:
            question.grow_full(count, deadline)
            row = question.measure(reductions, count, deadline, "together")
            count = milestone(count)
        return row | {"cost_ratio": ratio(row.get("cost"), control["cost"])}

    if not chosen:
        return control, True
    every = row_of(chosen)
    if every["verdict"] == DROPPED:
        return every, True
    taken, best, settled = [], control, every["verdict"] == NEEDED
    for reduction in chosen:
        finer = [r for r in kinds[reduction.family] if order.index(r.label) >= order.index(reduction.label)]
        for level in finer[:3]:
            row = row_of([*taken, level])
            settled = settled and row["verdict"] != OPEN
            if row["verdict"] == DROPPED:
                taken, best = [*taken, level], row
                break
    return best, settled


def unsettled(rows: list[dict]) -> list[dict]:
    """What is open still, but for levels beyond one that can be dropped: they hold more of the transport."""
    found, done = [], set()
    for row in rows:
        if row["verdict"] == DROPPED:
            done.add(row["family"])
        elif row["verdict"] == OPEN and row["family"] not in done:
            found.append(row)
    return found


def breaks_first(least: dict, rows: list[dict]) -> dict | None:
    """Of what is dropped, the part that loses most on its own: its assumption has the least margin."""
    parts = [r for r in rows if r["loss"] and r["drops"][0] in least["drops"]]
    worst = max(parts, key=lambda r: r["loss"]["value"], default=None)
    return worst and {"drops": worst["drops"][0], "assumes": worst["assumes"][0], "loss": worst["loss"]}


def table(answer: dict) -> list[dict]:
    """A row for each thing that was dropped, and one for the least transport."""
    full, least = answer["full"], answer["least"]
    rows = [(", ".join(r["drops"]), r["verdict"], r) for r in answer["reductions"]]
    rows = [("nothing", "", full), *rows, *([("all that can go", "least transport", least)] if least else [])]
    return [
        {
            "dropped": name,
            "verdict": said,
            answer["metric"]: row["loss"] and row["loss"]["value"],
            "95 %": row["loss"] and f"{row['loss']['low']:.3g} to {row['loss']['high']:.3g}",
            "cost": row["cost_ratio"],
            "batches": row["batches"],
        }
        for name, said, row in rows
    ]


def sentence(answer: dict) -> str:
    """The answer in words."""
    asked, least, full = f"{answer['metric']} {answer['tolerance']:g}", answer["least"], answer["full"]
    if answer["verdict"] == "impossible tolerance":
        return (
            f"impossible tolerance: {asked} was asked, {full['loss']['high']:.3g} is what {full['batches']} "
            "batches of the full transport reach; allow more --seconds or --batches, or ask for less"
        )
    if least is None:
        return "not settled: time was up before the full transport was rendered; allow more --seconds"
    open_rows = [r["drops"][0] for r in unsettled(answer["reductions"])]
    e, how = least["loss"], least["transport"]
    said = [
        f"{answer['verdict']}: {answer['scene']} keeps within {asked} with {describe(how)}",
        f"dropped: {', '.join(least['drops']) or 'nothing'}",
        f"it loses {e['value']:.3g} ({e['low']:.3g} to {e['high']:.3g})",
    ]
    if least["cost_ratio"] is not None and least["drops"]:
        said.append(f"at {100 * least['cost_ratio']:.3g} % of the cost of the full transport")
    if least["breaks_first"]:
        said.append(f"breaks first: {least['breaks_first']['assumes']} ({least['breaks_first']['drops']})")
    if open_rows:
        said.append(f"not settled: {', '.join(open_rows)}; allow more --seconds or --batches")
    return "; ".join(said)


def describe(how: dict) -> str:
    """A transport in a few words."""
    depth = how["integrator"]["max_depth"]
    return f"{how['integrator']['type']} of {'any depth' if depth < 0 else f'depth {depth}'}"


def exit_code(answer: dict) -> int:
    """0 found, 1 impossible tolerance, 3 not settled."""
    return {"found": 0, "impossible tolerance": 1, "not settled": 3}[answer["verdict"]]
