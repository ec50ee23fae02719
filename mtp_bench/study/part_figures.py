"""Figures of events, and of parts of the error: causes, time since an event, age, distance, class, confidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from .causes import CAUSES
from .drawing import hex_color
from .findings import Findings
from .panels import HATCHES, Panel, Series
from .sketches import (
    Sketch,
    Tables,
    agent_series,
    called,
    count_ticks,
    few_and_most,
    level_series,
    named_ticks,
    pick,
    series_of,
    where,
)
from .specs import column

CAUSE_COLORS = ("grey", "yellow", "orange", "green", "sky", "vermillion", "purple")

EVENT_COLORS = {"ids": "vermillion", "lost": "orange", "reacquired": "sky", "frag": "blue"}


def _frequency(findings: Findings, tables: Tables) -> Sketch:
    rows, panels = tables["frequency"].rows, []
    style = {"color": [hex_color(EVENT_COLORS[row.kind]) for row in rows], "hatch": HATCHES[: len(rows)]}
    for field, unit in (("per_trajectory", "trajectory"), ("per_frame", "frame")):
        texts = [f"{value:.2g}" for value in pick(rows, field)]
        bars = series_of(rows, "", "blue", range(len(rows)), field, kind="bar", texts=texts, style=style)
        one = [level_series("", [1.0], "soft", linestyle=":")] if unit == "trajectory" else []
        panels.append(Panel([bars, *one], "kind of event", f"events per {unit}", named_ticks(pick(rows, "kind"))))
    n = f"{rows[0].trajectories} trajectories, {rows[0].frames} frames, {rows[0].boxes} boxes"
    return Sketch(panels, n)


def _events(findings: Findings, tables: Tables) -> str:
    counts = {row.kind: row.events for row in tables["frequency"].rows}
    scenes = len(findings.bench.scenes)
    return f"{counts['ids']} ids, {counts['frag']} frag of {findings.subject.single.label}, {scenes} scenes"


def _distance(findings: Findings, tables: Tables) -> Sketch:
    kinds = {kind: where(tables["distance"].rows, kind=kind) for kind in ("ids", "frag")}
    series = [
        series_of(rows, kind, EVENT_COLORS[kind], range(len(rows)), "events", kind="bar", texts=pick(rows, "events"))
        for kind, rows in kinds.items()
    ]
    ticks = named_ticks(f"{r.low:g}–{r.high:g}" if r.high is not None else f"over {r.low:g}" for r in kinds["ids"])
    panel = Panel(series, "distance of the object to the ego, m", "events", ticks)
    return Sketch([panel], _events(findings, tables))


def _shared(findings: Findings, tables: Tables) -> Sketch:
    rows, series = where(tables["shared"].rows, agent=findings.subject.name), []
    for kind in ("ids", "lost", "reacquired"):
        mine = where(rows, kind=kind)
        if mine and mine[0].events_single:
            left = [100.0, *(100 * row.events_in_all / row.events_single for row in mine)]
            label = f"{kind} (n = {mine[0].events_single})"
            series.append(Series(label, [1, *pick(mine, "H")], left, EVENT_COLORS[kind]))
    paper = [row for row in where(rows, kind="ids") if row.paper_fewer is not None]
    left = [100 * (1 - row.paper_fewer) for row in paper]
    series.append(Series("the paper's ids" if paper else "", pick(paper, "H"), left, "ink", "paper"))
    y, ticks = "events in every hypothesis,\n% of those with one", count_ticks([1, *pick(rows, "H")])
    return Sketch([Panel(series, "hypotheses H", y, ticks, limits={"y": (0, 105)})], _events(findings, tables))


def _frames(findings: Findings, tables: Tables) -> Sketch:
    rows, panels = tables["frames"].rows, []
    kinds = [where(rows, kind=kind) for kind in ("ids", "frag")]
    most = findings.subject.most.hypotheses
    top = max(row.events_single + other.events_single for row, other in zip(*kinds, strict=True)) or 1
    for field, title in (("events_single", "one hypothesis"), ("events_in_all", f"in all {most} hypotheses")):
        series = []
        for mine in kinds:
            style = {"align": "edge", "width": [row.last_frame - row.first_frame + 1 for row in mine]}
            kind = mine[0].kind
            series.append(series_of(mine, kind, EVENT_COLORS[kind], "first_frame", field, kind="bar", style=style))
        limits = {"y": (0.0, 1.05 * top)}
        panels.append(Panel(series, "frame of the scene", "events, all scenes", (), title, limits, stacked=True))
    return Sketch(panels, _events(findings, tables))


def _causes(findings: Findings, tables: Tables) -> Sketch:
    rows = few_and_most(where(tables["causes"].rows, targets_of="all"))[::-1]
    places = range(len(rows))
    series = [
        series_of(rows, column(cause).title, color, places, cause, kind="bar", style={"width": 0.62})
        for cause, color in zip(CAUSES, CAUSE_COLORS, strict=True)
    ]
    mark = {"marker": "|", "markersize": 17, "markeredgewidth": 2}
    series.append(series_of(rows, "bADE", "ink", places, "error", kind="dots", style=mark))
    ends = [max(row.error, sum(max(getattr(row, cause), 0.0) for cause in CAUSES)) for row in rows]
    texts = [f"{row.error:.2f}" for row in rows]
    series.append(Series("", places, ends, "ink", "dots", (), texts, {"marker": ""}))
    series.append(level_series("", [0.0], "soft", linewidth=0.8))
    x = "bADE, m, averaged over budgets of false forecasts"
    panel = Panel(series, "", x, named_ticks(map(called, rows)), across=True, stacked=True)
    return Sketch([panel], size=(8.1, 1.3 + 0.36 * len(rows)), legend=4)


def _bins(findings: Findings, rows: Sequence[Any], field: str, x: str) -> Panel:
    """One number of each agent in each bin, with its interval, and the number of targets in the bin."""
    names = list(dict.fromkeys(pick(rows, "bin")))
    rows = [row for row in rows if getattr(row, field) is not None]
    series = agent_series(findings, rows, "bin", field, kind="dots")
    shifted = [
        replace(each, x=[names.index(name) + 0.12 * (i - 1.5) for name in each.x]) for i, each in enumerate(series)
    ]
    counts = {row.bin: row.targets for row in rows}
    ticks = named_ticks(f"{name}\n{counts.get(name, 0)}" for name in names)
    ends = [pair[1] for pair in pick(rows, f"{field}_interval") if pair is not None]
    most = max(pick(rows, field), default=1.0)  # intervals of a handful of targets must not squeeze the rest
    top = max(most, min(max(ends, default=most), 1.35 * most)) * 1.07 or 1.0
    y = f"{column(field).title}, m"
    return Panel(shifted, f"{x}; below: targets", y, ticks, limits={"y": (0, top)}, small=len(names) > 6)


def _since(findings: Findings, tables: Tables) -> Sketch:
    every = {kind: where(tables["since"].rows, by=kind) for kind in ("ids", "reacquired")}
    labels = {kind: f"frames since the last {kind}" for kind in every}
    panels = [_bins(findings, rows, "minADE", labels[kind]) for kind, rows in every.items() if rows]
    return Sketch(panels, size=(8.1, 5.8), rows=len(panels), legend=4)


def _age(findings: Findings, tables: Tables) -> Sketch:
    panel = _bins(findings, tables["age"].rows, "plain_error", "age of the track, frames")
    return Sketch([panel], size=(6.8, 3.6), legend=2)


def _parts(findings: Findings, tables: Tables) -> Sketch:
    labels = {"distance": "distance to the ego, m", "class": "class", "motion": "motion, and weighted for planning"}
    every = {by: where(tables["bins"].rows, by=by) for by in labels}
    every["motion"] += where(tables["bins"].rows, by="planning")
    panels = [_bins(findings, rows, "plain_error", labels[by]) for by, rows in every.items() if rows]
    return Sketch(panels, size=(8.1, 2.7 * len(panels) + 0.4), rows=len(panels), legend=4)


def _calibration(findings: Findings, tables: Tables) -> Sketch:
    rows = tables["calibration"].rows
    brier = {called(row): row.brier for row in rows if row.brier is not None}
    series = [
        replace(each, label=f"{each.label} (Brier {brier[each.label]:.3f})" if each.label in brier else each.label)
        for each in agent_series(findings, rows, "confidence", "of_a_true_object")
    ]
    diagonal = Series("a probability", [0, 1], [0, 1], "soft", style={"linestyle": ":", "marker": ""})
    x, y = "stated confidence (probability)", "share of a true object"
    panel = Panel([diagonal, *series], x, y, limits={"x": (0.0, 1.0), "y": (0.0, 1.0)})
    n = f"{sum(pick(rows, 'forecasts'))} forecasts of {len(series)} agents"
    return Sketch([panel], n, size=(5.6, 4.2), legend=1)


PART_FIGURES = {  # name -> its table, and its content
    "frequency": ("frequency", _frequency),
    "distance": ("distance", _distance),
    "shared": ("shared", _shared),
    "frames": ("frames", _frames),
    "causes": ("causes", _causes),
    "since": ("since", _since),
    "age": ("age", _age),
    "bins": ("bins", _parts),
    "calibration": ("calibration", _calibration),
}
