"""The data behind the page: what report.json holds, and all that the templates and charts may show.

run          what made the run, how many measurements, the gate's result
overview     one row per technique, scene and quantity
techniques   their facts and their cases; a case is a technique held against one truth
findings     of each kind the smallest input that shows it
failures     measurements that gave no figures
truths       how each truth was made
verification how the truths were proved, by kind
speed        what binds the frames, where the bench was run
records      every measurement, by key
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from approximations.contract import Technique
from compare import envelope, speed
from compare.gate import ASSUMPTIONS, Verdict, describe, judge, load_thresholds
from compare.run import path_tracer_curve, records
from compare.summary import cost_at_error, error_at_cost, interval_text, is_length
from compare.task import PATH_TRACER, all_measured
from reference.verify import run as verification
from scenes.contract import QUANTITIES, SCENES, BadInput, Scene

RESULTS = ("fail", "not judged", "not measured", "pass")
"""Verdicts, worst first."""


def gather(folder: Path) -> dict:
    """Everything that the page of a run says, as plain data. Raises BadInput where there is no run."""
    known = newest(records(folder))
    declared, scenes, trouble = declarations()
    verdicts, trouble = ([], trouble) if trouble else verdicts_of(known)
    cases = [case(head, known, verdicts) for head in heads(known)]
    techniques = [facts(name, cases, declared) for name in dict.fromkeys(c["technique"] for c in cases)]
    techniques = [complete(t, {r["key"]: r for r in known}) for t in techniques]
    techniques.sort(key=lambda t: (t["theme"], t["baseline"], t["name"]))
    cases = [c for t in techniques for c in t["cases"]]
    name_anchors(techniques)
    known_axes = {name: axes(scenes[name]) for name in {c["scene"] for c in cases} & set(scenes)}
    for c in cases:
        c["envelopes"] = envelopes(c, {r["key"]: r for r in known}, known_axes.get(c["scene"], {}))
    findings = smallest(known)
    failures = [r["key"] for r in known if r["status"] != "ok"]
    return {
        "run": about(folder, known, verdicts, trouble) | {"findings": len(findings)},
        "overview": [overview_row(c, known) for c in cases],
        "techniques": techniques,
        "scenes": {name: scenes[name].shows for name in {c["scene"] for c in cases} & set(scenes)},
        "axes": known_axes,
        "findings": findings,
        "failures": failures,
        "verdicts": [plain_verdict(v) for v in verdicts],
        "truths": truths(known),
        "verification": verification_tables(verification.read(folder)),
        "speed": speed.read(folder),
        "records": {r["key"]: r for r in known},
    }


def newest(known: list[dict]) -> list[dict]:
    """Of measurements of the same question, made by older and newer code, the last one."""
    names = ("technique", "scene", "fields", "knobs", "quantity", "size", "seed")
    found: dict[str, dict] = {}
    for r in known:
        label = json.dumps([r.get(n) for n in names], sort_keys=True)
        found.pop(label, None)
        found[label] = r
    return list(found.values())


def declarations() -> tuple[dict[str, Technique], dict[str, type[Scene]], str]:
    """Techniques and scenes as declared, and why they cannot be had where this machine has no device."""
    import mitsuba

    from reference.toolchain import use_device
    from scenes.contract import all_scenes

    try:
        if mitsuba.variant() is None:
            use_device("cpu")
        all_scenes()
        return all_measured(), SCENES, ""
    except BadInput as error:
        return {}, {}, str(error)


def verdicts_of(known: list[dict]) -> tuple[list[Verdict], str]:
    """The gate's verdicts on a run, or why there are none."""
    try:
        return judge(load_thresholds(), known), ""
    except (BadInput, KeyError) as error:
        return [], str(error)


def plain_verdict(v: Verdict) -> dict:
    """A verdict as data."""
    t = v.threshold
    return {
        "result": v.result,
        "technique": t.technique,
        "scene": t.scene,
        "quantity": t.quantity,
        "metric": t.metric,
        "changed": t.fields | t.knobs,
        "bound": describe(t),
        "value": v.value,
        "low": v.low,
        "high": v.high,
        "margin": v.margin,
        "pays": t.pays,
        "text": v.text,
    }


def about(folder: Path, known: list[dict], verdicts: list[Verdict], trouble: str) -> dict:
    """What made the run, with counts."""
    try:
        made = json.loads((folder / "run.json").read_text())
    except (OSError, ValueError):
        made = {}
    counts = {result: sum(v.result == result for v in verdicts) for result in RESULTS}
    versions = [r["versions"] for r in known if "versions" in r]
    return {
        "name": folder.resolve().name,
        **{k: made.get(k) for k in ("profile", "variant", "command", "machine", "python", "written")},
        "variants": sorted({r["variant"] for r in known if "variant" in r}),
        "versions": {n: sorted({v[n] for v in versions if n in v}) for n in ("mitsuba", "drjit")},
        "measurements": len(known),
        "failed": sum(r["status"] != "ok" for r in known),
        "gate": {
            "result": next((r for r in RESULTS if counts[r]), "none"),
            "counts": counts,
            "trouble": trouble,
        },
    }


def heads(known: list[dict]) -> list[dict]:
    """The record that leads each case: the setting asked for, or the first measured where it is missing."""
    own = [r for r in known if r["technique"] != PATH_TRACER]
    found = [r for r in own if "default" in r["roles"]]
    led = {(r["technique"], r["scene"], r["quantity"]) for r in found}
    for r in own:
        question = (r["technique"], r["scene"], r["quantity"])
        if question not in led:
            led.add(question)
            found.append(r)
    return sorted(found, key=lambda r: (r["technique"], r["scene"], r["quantity"], r["size"]))


def case(head: dict, known: list[dict], verdicts: list[Verdict]) -> dict:
    """One technique against one truth: its settings, ladder, stress sweeps and rivals, all as keys."""
    question = (head["technique"], head["scene"], head["quantity"])
    own = [r for r in known if (r["technique"], r["scene"], r["quantity"]) == question]
    here = [r for r in own if r["fields"] == head["fields"] and r["size"] == head["size"]]
    same = [r for r in known if r["fields"] == head["fields"]]
    curve = path_tracer_curve(same, head)
    rivals = [
        r
        for r in same
        if "default" in r["roles"]
        and r["technique"] not in (head["technique"], PATH_TRACER)
        and (r["scene"], r["quantity"], r["size"]) == (head["scene"], head["quantity"], head["size"])
    ]
    quantity = QUANTITIES.get(head["quantity"])
    ratio = quantity.kind == "ratio" if quantity else "gain" not in (head["errors"] or {"gain": 0})
    judged = [
        plain_verdict(v)
        for v in verdicts
        if (v.threshold.technique, v.threshold.scene, v.threshold.quantity) == question
    ]
    return {
        "technique": head["technique"],
        "scene": head["scene"],
        "quantity": head["quantity"],
        "means": quantity.means if quantity else "",
        "unit": head.get("unit") or (quantity.unit if quantity else ""),
        "relative": not ratio,
        "probes": bool(quantity and quantity.probes),
        "size": head["size"],
        "changed": head.get("changed", {}),
        "fields": head["fields"],
        "domain": head.get("domain"),
        "head": head["key"],
        "settings": [setting(r, head) for r in here],
        "ladder": ladder(head, here),
        "stress": stress(head, own),
        "path_tracer": [r["key"] for r in curve if r["errors"]],
        "rivals": [r["key"] for r in rivals if r["status"] == "ok" and r["errors"]],
        "verdicts": judged,
        "verdict": next((x for x in RESULTS if any(v["result"] == x for v in judged)), ""),
    }


def setting(r: dict, head: dict) -> dict:
    """A setting of knobs by what it changes of the one asked for."""
    changed = {k: v for k, v in r["knobs"].items() if v != head["knobs"].get(k)}
    return {"key": r["key"], "changed": changed, "label": label(changed) or "as asked", "roles": r["roles"]}


def label(changed: dict[str, Any]) -> str:
    """name=value pairs on one line."""
    return ", ".join(f"{k}={show(v)}" for k, v in changed.items())


def show(value: Any) -> str:
    """A value of a knob or a field."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def ladder(head: dict, here: list[dict]) -> list[dict]:
    """Rungs with the first 0, 1, 2, ... stages exact, as far as they were measured."""
    rungs, knobs = [], dict(head["knobs"])
    stages = (head.get("ladder") or {}).get("of", [])
    for stage in [None, *stages]:
        if stage is not None:
            knobs[stage] = "exact"
        found = next((r for r in here if r["knobs"] == knobs and r["status"] == "ok" and r["errors"]), None)
        if found:
            rungs.append({"stage": stage, "key": found["key"]})
    return rungs if len(rungs) > 1 else []


def stress(head: dict, own: list[dict]) -> dict[str, list[dict]]:
    """Field -> its points in rising order, those without figures included."""
    found: dict[str, list[dict]] = {}
    for r in own:
        for role in r["roles"]:
            kind, _, field = role.partition(":")
            if kind != "stress" or r["knobs"] != head["knobs"]:
                continue
            others = {**r["fields"], field: head["fields"].get(field)}
            if others == head["fields"] and isinstance(r["fields"][field], (int, float)):
                found.setdefault(field, []).append({"key": r["key"], "x": r["fields"][field]})
    return {field: sorted(points, key=lambda p: p["x"]) for field, points in found.items()}


def envelopes(c: dict, known: dict[str, dict], units: dict[str, dict]) -> dict[str, dict]:
    """Field -> the interval around the case's own value in which the error stays under twice its own, with a
    sentence that says so."""
    head, found = known[c["head"]], {}
    for field, points in c["stress"].items():
        start = envelope.point(head, field)
        if start.rmse is None:
            continue
        swept = [envelope.point(known[p["key"]], field) for p in points]
        axis = units.get(field, {})
        held = envelope.envelope(swept, start, envelope.tolerance_of(start.rmse), axis.get("log", False))
        found[field] = held | {"said": envelope.sentence(field, held, axis.get("unit", "1"))}
    return found


def axes(scene: type[Scene]) -> dict[str, dict]:
    """Unit and scale of a scene's fields."""
    return {name: {"unit": a.unit, "log": a.log} for name, a in scene.axes().items()}


def facts(name: str, cases: list[dict], declared: dict[str, Technique]) -> dict:
    """What a technique says of itself, with its cases."""
    t = declared.get(name)
    return {
        "name": name,
        "theme": t.theme if t else "other",
        "baseline": bool(t and t.baseline),
        "replaces": t.replaces if t else "",
        "source": t.source if t else "",
        "covers": list(t.covers) if t else [],
        "neglects": [{"name": a.name, "means": a.means} for a in t.neglects] if t else [],
        "cases": [c for c in cases if c["technique"] == name],
    }


def complete(technique: dict, known: dict[str, dict]) -> dict:
    """Facts that no module declares any more, from the records (a plugin's, say)."""
    r = next((known[c["head"]] for c in technique["cases"] if "theme" in known[c["head"]]), None)
    if r is None or technique["source"]:
        return technique
    named = [{"name": n, "means": ASSUMPTIONS[n].means if n in ASSUMPTIONS else ""} for n in r["neglects"]]
    given = {k: r[k] for k in ("theme", "baseline", "covers", "replaces", "source") if k in r}
    return technique | given | {"neglects": named}


def name_anchors(techniques: list[dict]) -> None:
    """Give every technique and case an anchor of plain letters, each once."""
    used: set[str] = set()

    def anchor(*words: str) -> str:
        base = "-".join(re.sub(r"[^a-z0-9]+", "-", w.lower()).strip("-") for w in words)
        name, n = base, 2
        while name in used:
            name, n = f"{base}-{n}", n + 1
        used.add(name)
        return name

    for t in techniques:
        t["anchor"] = anchor("technique", t["name"])
        for c in t["cases"]:
            c["anchor"] = anchor(c["technique"], c["scene"], c["quantity"])


def figure(e: dict | None, scale: float = 1.0, unit: str = "") -> dict | None:
    """A value and its half interval as texts; unresolved where it is under twice its floor."""
    if e is None:
        return None
    value, _, half = interval_text(e, scale, unit).partition(" ± ")
    unresolved = value.endswith(" (unresolved)")
    return {
        "text": value.removesuffix(" (unresolved)"),
        "half": half,
        "exact": e["low"] == e["high"] and e["floor"] is None,
        "unresolved": unresolved,
        "sort": e["value"],
    }


def figures(r: dict) -> dict:
    """A record's figures as texts; empty where it has none."""
    e, c = r["errors"], r["costs"]
    if r["status"] != "ok" or e is None or c is None:
        return {}
    relative = "gain" in e
    main = {"scale": 100, "unit": " %"} if relative else {}
    return {
        "rmse": figure(e["rmse"], **main),
        "bias": figure(e["bias"]) if is_length(r) else figure(e["bias"], 100, " %"),
        "shape": figure(e.get("rmse_gain"), 100, " %"),
        "p99": figure(e.get("p99"), **main),
        "flip": figure(e.get("flip")),
        "ms": figure(c["frame_ms"]),
        "calibrated": c["frame_over_calibration"]["value"],
        "bake": c["bake_ms"],
        "operations": c["operations_per_pixel"],
        "rays": c["rays"],
        "bytes": c["bytes"],
    }


def overview_row(c: dict, known: list[dict]) -> dict:
    """A row of the first table: figures, path tracing beside them, verdict and findings."""
    by_key = {r["key"]: r for r in known}
    r = by_key[c["head"]]
    row = {k: c[k] for k in ("technique", "scene", "quantity", "size", "changed", "anchor", "verdict")}
    row |= {"key": r["key"], "status": r["status"], "error": r.get("error", ""), "relative": c["relative"]}
    row |= {"findings": [f["kind"] for f in r["findings"]], "judged": len(c["verdicts"])}
    found = figures(r)
    if not found:
        return row | {"figures": None}
    curve = [by_key[k] for k in c["path_tracer"]]
    rmse, ms = r["errors"]["rmse"]["value"], r["costs"]["frame_ms"]["value"]
    instead = error_at_cost(curve, ms) if curve else None
    needed = cost_at_error(curve, rmse) if curve else None
    scale, unit = (100, " %") if c["relative"] else (1, "")
    return row | {
        "figures": found,
        "path_tracer_error": instead,
        "path_tracer_error_text": f"{scale * instead:.3g}{unit}" if instead else "",
        "path_tracer_factor": needed / ms if needed and ms else None,
        "beaten": bool(instead and instead < rmse),
    }


def smallest(known: list[dict]) -> list[dict]:
    """Findings of measurements that ran: of each kind, the input with the fewest changes that shows it."""
    plain = {
        (r["technique"], r["scene"], r["quantity"]): r["knobs"] for r in known if "default" in r["roles"]
    }
    groups: dict[tuple, list[tuple]] = {}
    for r in (r for r in known if r["status"] == "ok"):
        base = plain.get((r["technique"], r["scene"], r["quantity"]), r["knobs"])
        changed = dict(r.get("changed") or {})
        changed |= {k: v for k, v in r["knobs"].items() if v != base.get(k)}
        for f in r["findings"]:
            question = (r["technique"], r["scene"], r["quantity"], f["kind"])
            groups.setdefault(question, []).append(((len(changed), r["size"]), f, changed, r))
    found = []
    for (technique, scene, quantity, kind), shown in sorted(groups.items(), key=lambda g: g[0]):
        _, f, changed, r = min(shown, key=lambda s: s[0])
        found.append(
            {
                "technique": technique,
                "scene": scene,
                "quantity": quantity,
                "kind": kind,
                "text": f["text"],
                "input": label(changed) or "as asked",
                "size": r["size"],
                "times": len(shown),
                "key": r["key"],
                "command": r["command"],
            }
        )
    return found


def truths(known: list[dict]) -> dict[str, dict]:
    """Image name -> how that truth was made, and how well it is known."""
    found = {}
    for r in known:
        truth = r.get("truth")
        if truth:
            found[truth["image"]] = {
                **{k: v for k, v in truth["provenance"].items() if k != "key"},
                "scene": r["scene"],
                "quantity": r["quantity"],
                "size": r["size"],
                **{k: truth.get(k) for k in ("key", "mean", "batches", "resolution", "demand")},
            }
    return found


PROOFS = {
    "stored": "Rendered again",
    "route": "A second route",
    "physics": "Laws of physics",
    "published": "Published numbers",
}


def verification_tables(rows: list[dict]) -> list[dict]:
    """A table for each kind of proof, what differs first, then the largest disagreement."""

    def order(row: dict) -> tuple:
        return row["verdict"] == "agrees", row.get("p", 0.0)

    return [
        {
            "kind": kind,
            "title": title,
            "rows": sorted((r for r in rows if r["kind"] == kind), key=order),
            "agree": sum(r["kind"] == kind and r["verdict"] == "agrees" for r in rows),
        }
        for kind, title in PROOFS.items()
        if any(r["kind"] == kind for r in rows)
    ]
