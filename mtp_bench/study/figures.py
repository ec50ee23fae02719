"""Figures of a study, as data: each is made of the rows of a table, and drawn by the drawers of `panels`."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..running.compare import threshold_agents
from ..tables import Table
from ..viz.terminal.output import counted
from .causes import CAUSES
from .drawing import SERIES, Drawing, draw, hex_color
from .error_rows import subset_name
from .findings import Findings
from .panels import HATCHES, MARKERS, Map, Panel, Series, draw_panels
from .specs import column, texts_of

CAUSE_COLORS = ("grey", "yellow", "orange", "green", "sky", "vermillion", "purple")
EVENT_COLORS = {"ids": "vermillion", "lost": "orange", "reacquired": "sky", "frag": "blue"}
FROM_ZERO = {"y": (0.0, None)}
Tables = dict[str, Table]  # by name


@dataclass(frozen=True)
class Sketch:
    """Content of a figure, without its title and sentence."""

    panels: Sequence[Panel | Map]
    n: str = ""  # empty: targets, objects, scenes and seeds
    size: tuple[float, float] | None = None  # inches
    rows: int = 1  # of panels
    legend: int = 3  # columns
    knees: str = ""  # a part of the sentence


def make_figures(findings: Findings, tables: Tables) -> dict[str, Drawing]:
    """Every figure whose table has the values that it shows, by name."""
    figures = {}
    for name, (table, sketch_of) in FIGURES.items():
        sketch = sketch_of(findings, tables) if table in tables else Sketch(())
        if sketch.panels:
            texts = texts_of("figures", name, findings, knees=sketch.knees)
            figures[name] = draw(
                name, *texts, sketch.n or n_of(findings),
                lambda *axes, sketch=sketch: draw_panels(axes, sketch.panels, sketch.legend),
                len(sketch.panels), sketch.size, sketch.rows,
            )  # fmt: skip
    return figures


def n_of(findings: Findings, seeds: int | None = None) -> str:
    """Numbers of targets, objects, scenes and seeds; ``seeds``: if they are not those of ranked runs."""
    row = findings.row(findings.subject.single, "all")
    runs = row.seeds if seeds is None else seeds
    parts = ((row.targets, "target"), (row.objects, "object"), (row.scenes, "scene"), (runs, "seed"))
    return ", ".join(counted(*part) for part in parts)


def colors_of(findings: Findings) -> dict[str, str]:
    """Colour of every agent by its label, the same in all figures."""
    first, plan = findings.subject, findings.plan
    colors = {first.truth.label: "green", first.single.label: "blue"}
    for control in plan.shown_controls:
        colors[control.label] = "orange" if control is plan.same_samples else "purple"
    colors.setdefault(first.most.label, "vermillion")
    left = [name for name in SERIES if name not in colors.values()]
    others = [s.label for subject in plan.subjects[1:] for s in (subject.most, subject.single, subject.truth)]
    for label in dict.fromkeys([*others, *(subject.end.label for subject in plan.subjects)]):
        if label not in colors:
            colors[label] = left.pop(0) if left else "grey"
    return colors


def where(rows: Iterable[Any], **values: Any) -> list[Any]:
    """Rows whose attributes have these values."""
    return [row for row in rows if all(getattr(row, name) == value for name, value in values.items())]


def pick(rows: Iterable[Any], name: str) -> list[Any]:
    """A column of rows."""
    return [getattr(row, name) for row in rows]


def called(row: Any) -> str:
    """Label of the agent of a row."""
    return f"{row.agent}, H = {row.H}" if row.H > 1 else str(row.agent)


def _series(rows: Sequence[Any], label: str, color: str, x: str | Sequence[float], y: str, **more: Any) -> Series:
    """A series of two columns of rows, or of given places; with the intervals of ``y``, if the rows have them."""
    at = pick(rows, x) if isinstance(x, str) else x
    intervals = [getattr(row, f"{y}_interval", None) for row in rows]
    return Series(label, at, pick(rows, y), color, intervals=intervals if any(intervals) else (), **more)


def _of_agents(findings: Findings, rows: Sequence[Any], x: str, y: str, **more: Any) -> list[Series]:
    """A series of each agent with each number of hypotheses."""
    colors, agents = colors_of(findings), dict.fromkeys((row.agent, row.H) for row in rows)
    every = [where(rows, agent=agent, H=count) for agent, count in agents]
    return [_series(own, called(own[0]), colors.get(own[0].agent, "grey"), x, y, **more) for own in every]


def _of_paper(rows: Sequence[Any], x: Sequence[float], y: str, label: str, color: str = "ink", **style: Any) -> Series:
    """Figures of the paper, where it has some."""
    known = [(at, row) for at, row in zip(x, rows, strict=True) if getattr(row, y) is not None]
    own = [row for _, row in known]
    return _series(own, label if known else "", color, [at for at, _ in known], y, kind="paper", style=style)


def _level(label: str, values: Sequence[float | None], color: str, **style: Any) -> Series:
    return Series(label, (), values, color, "level", style=style)


def _few_and_most(rows: Sequence[Any]) -> list[Any]:
    """Rows with one hypothesis or the largest number of them."""
    return [row for row in rows if row.H in (1, max(pick(rows, "H")))]


def _named(names: Iterable[str]) -> list[tuple[float, str]]:
    """Ticks 0, 1, 2, ... with these names."""
    return [(float(i), name) for i, name in enumerate(names)]


def _counts(values: Iterable[int]) -> list[tuple[float, str]]:
    """Ticks at these numbers."""
    return [(float(value), str(value)) for value in sorted(set(values))]


def _pasts(findings: Findings, tables: Tables) -> Sketch:
    rows = [row for row in where(tables["pasts"].rows, agent=findings.subject.name) if row.minADE is not None]
    names, series = list(dict.fromkeys(pick(rows, "targets_of"))), []
    for i, (past, color) in enumerate((("GT tracks", "green"), ("tracklets", "blue"))):
        mine = where(rows, past=past)
        x = [names.index(row.targets_of) for row in mine]
        series.append(_series(mine, past, color, x, "minADE", kind="bar"))
        series.append(_of_paper(mine, [at + 0.38 * (i - 0.5) for at in x], "paper_minADE", "the paper's" if i else ""))
    counts = {row.targets_of: row.targets for row in rows}
    ticks = _named(f"{textwrap.fill(name, 10)}\nn = {counts[name]}" for name in names)
    return Sketch([Panel(series, "targets with an event of this kind", "minADE, m", ticks, limits=FROM_ZERO)])


def _frequency(findings: Findings, tables: Tables) -> Sketch:
    rows, panels = tables["frequency"].rows, []
    style = {"color": [hex_color(EVENT_COLORS[row.kind]) for row in rows], "hatch": HATCHES[: len(rows)]}
    for field, unit in (("per_trajectory", "trajectory"), ("per_frame", "frame")):
        texts = [f"{value:.2g}" for value in pick(rows, field)]
        bars = _series(rows, "", "blue", range(len(rows)), field, kind="bar", texts=texts, style=style)
        one = [_level("", [1.0], "soft", linestyle=":")] if unit == "trajectory" else []
        panels.append(Panel([bars, *one], "kind of event", f"events per {unit}", _named(pick(rows, "kind"))))
    n = f"{rows[0].trajectories} trajectories, {rows[0].frames} frames, {rows[0].boxes} boxes"
    return Sketch(panels, n)


def _events(findings: Findings, tables: Tables) -> str:
    counts = {row.kind: row.events for row in tables["frequency"].rows}
    scenes = len(findings.bench.scenes)
    return f"{counts['ids']} ids, {counts['frag']} frag of {findings.subject.single.label}, {scenes} scenes"


def _distance(findings: Findings, tables: Tables) -> Sketch:
    kinds = {kind: where(tables["distance"].rows, kind=kind) for kind in ("ids", "frag")}
    series = [
        _series(rows, kind, EVENT_COLORS[kind], range(len(rows)), "events", kind="bar", texts=pick(rows, "events"))
        for kind, rows in kinds.items()
    ]
    ticks = _named(f"{r.low:g}–{r.high:g}" if r.high is not None else f"over {r.low:g}" for r in kinds["ids"])
    panel = Panel(series, "distance of the object to the ego, m", "events", ticks)
    return Sketch([panel], _events(findings, tables))


def _gain(findings: Findings, tables: Tables) -> Sketch:
    subject, control, panels = findings.subject, findings.plan.same_samples, []
    for table, subset in (("targeted", "paper_ids"), ("targeted", "ids"), ("global", "all")):
        rows = where(tables[table].rows, targets_of=subset_name(subset))
        if all(row.minADE is None for row in rows):
            continue
        single = where(rows, agent=subject.single.label, H=subject.single.hypotheses or 1)[:1]
        series = []
        for sampling, color, label in (("k of all", "vermillion", "k samples"), ("none", "sky", "H·k samples")):
            mine = single + [r for r in where(rows, agent=subject.name, sampling=sampling) if r.H > 1]
            series.append(_series(mine, f"{subject.name}, {label}", color, "H", "minADE"))
            style = {"linestyle": ":", "marker": MARKERS[color]}
            series.append(_of_paper(mine, pick(mine, "H"), "paper_minADE", f"the paper's, {label}", color, **style))
        for setting, color, line in ((control, "orange", "--"), (subject.truth, "green", "-")):
            if setting is not None:
                level = pick(where(rows, agent=setting.label)[:1], "minADE")
                series.append(_level(setting.label, level, color, linestyle=line))
        y = f"minADE on {subset_name(subset)}, m"
        panels.append(Panel(series, "hypotheses H", y, _counts(pick(rows, "H")), limits=FROM_ZERO))
    return Sketch(panels, size=(9.2, 3.7), legend=2)


def _ranked(findings: Findings, tables: Tables) -> Sketch:
    subject, control, panels = findings.subject, findings.plan.same_samples, []
    rows = [*tables["global"].rows, *tables["targeted"].rows]
    for subset in map(subset_name, ("all", "ids", "reacquired")):
        here = where(rows, targets_of=subset)
        mine = [r for r in where(here, agent=subject.name, sampling="k of all") if r.to_single is not None]
        counts, differences = [1, *pick(mine, "H")], [0.0, *pick(mine, "to_single")]
        intervals = [(0.0, 0.0), *pick(mine, "to_single_interval")]
        series = [Series(subject.name, counts, differences, "vermillion", intervals=intervals)]
        if control is not None:
            level = pick(where(here, agent=control.label)[:1], "to_single")
            series.append(_level(control.label, level, "orange", linestyle="--"))
        series.append(_level(subject.single.label, [0.0], "blue", linewidth=1.2))
        panels.append(Panel(series, "hypotheses H", f"bADE on {subset}, m,\ndifference", _counts(counts)))
    return Sketch(panels, size=(9.2, 3.3))


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
    y, ticks = "events in every hypothesis,\n% of those with one", _counts([1, *pick(rows, "H")])
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
            series.append(_series(mine, kind, EVENT_COLORS[kind], "first_frame", field, kind="bar", style=style))
        limits = {"y": (0.0, 1.05 * top)}
        panels.append(Panel(series, "frame of the scene", "events, all scenes", (), title, limits, stacked=True))
    return Sketch(panels, _events(findings, tables))


def _speed(findings: Findings, tables: Tables) -> Sketch:
    rows = sorted(tables["speed"].rows, key=lambda row: row.H)
    stages = {"tracking": "blue", "prediction": "vermillion", "whole": "grey"}
    series = [_series(rows, "whole agent" if s == "whole" else s, color, "H", s) for s, color in stages.items()]
    panel = Panel(series, "hypotheses H", "time of a frame, ms", _counts(pick(rows, "H")), limits=FROM_ZERO)
    return Sketch([panel], f"{rows[0].frames} frames")


def _k_curve(findings: Findings, tables: Tables) -> Sketch:
    rows = _few_and_most(tables["k_curve"].rows)
    series, ticks = _of_agents(findings, rows, "k", "minADE"), _counts(pick(rows, "k"))
    x, y = "samples k (logarithmic)", "expected minADE, m"
    return Sketch([Panel(series, x, y, ticks, limits=FROM_ZERO, log=True)])


def _causes(findings: Findings, tables: Tables) -> Sketch:
    rows = _few_and_most(where(tables["causes"].rows, targets_of="all"))[::-1]
    places = range(len(rows))
    series = [
        _series(rows, column(cause).title, color, places, cause, kind="bar", style={"width": 0.62})
        for cause, color in zip(CAUSES, CAUSE_COLORS, strict=True)
    ]
    mark = {"marker": "|", "markersize": 17, "markeredgewidth": 2}
    series.append(_series(rows, "bADE", "ink", places, "error", kind="dots", style=mark))
    ends = [max(row.error, sum(max(getattr(row, cause), 0.0) for cause in CAUSES)) for row in rows]
    texts = [f"{row.error:.2f}" for row in rows]
    series.append(Series("", places, ends, "ink", "dots", (), texts, {"marker": ""}))
    series.append(_level("", [0.0], "soft", linewidth=0.8))
    x = "bADE, m, averaged over budgets of false forecasts"
    panel = Panel(series, "", x, _named(map(called, rows)), across=True, stacked=True)
    return Sketch([panel], size=(8.1, 1.3 + 0.36 * len(rows)), legend=4)


def _gaps(findings: Findings, tables: Tables) -> Sketch:
    rows, panels = tables["gaps"].rows, list[Panel]()
    if all(row.closed is None for row in rows):
        return Sketch(())
    pairs = {"closed": ("of all agents", "blue", "o"), "closed_own_predictor": ("of its own", "vermillion", "s")}
    rows = [row for row in _few_and_most(rows) if any(getattr(row, field) is not None for field in pairs)]
    labels = list(dict.fromkeys(map(called, rows)))[::-1]
    known = [value for row in rows for field in pairs if (value := getattr(row, field)) is not None]
    limits = {"x": (1.15 * min([-0.1, *known]), max([1.05, *known])), "y": (-0.6, len(labels) - 0.4)}
    for subset in dict.fromkeys(pick(rows, "targets_of")):
        here, series = where(rows, targets_of=subset), list[Series]()
        for shift, (field, (label, color, marker)) in enumerate(pairs.items()):
            mine = [row for row in here if getattr(row, field) is not None]
            at = [labels.index(called(row)) + 0.16 - 0.32 * shift for row in mine]
            name = f"reference pair {label}"
            series.append(_series(mine, name, color, at, field, kind="dots", style={"marker": marker}))
        places = [float(labels.index(called(row))) for row in here]
        series.append(_of_paper(here, places, "paper_closed", "the paper's, by minADE"))
        series += [_level("", [0.0], "soft", linewidth=0.8), _level("", [1.0], "green", linewidth=0.8)]
        ticks = _named(labels if not panels else [""] * len(labels))
        x = f"gap closed on {subset}, %"
        panels.append(Panel(series, "", x, ticks, limits=limits, across=True, percent=True))
    return Sketch(panels, size=(8.1, 1.5 + 0.42 * len(labels)), legend=2)


def _bins(findings: Findings, rows: Sequence[Any], field: str, x: str) -> Panel:
    """One number of each agent in each bin, with its interval, and the number of targets in the bin."""
    names = list(dict.fromkeys(pick(rows, "bin")))
    rows = [row for row in rows if getattr(row, field) is not None]
    series = _of_agents(findings, rows, "bin", field, kind="dots")
    shifted = [
        replace(each, x=[names.index(name) + 0.12 * (i - 1.5) for name in each.x]) for i, each in enumerate(series)
    ]
    counts = {row.bin: row.targets for row in rows}
    ticks = _named(f"{name}\n{counts.get(name, 0)}" for name in names)
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


def _budgets(findings: Findings, tables: Tables) -> Sketch:
    series = _of_agents(findings, tables["budgets"].rows, "allowed", "error", style={"markersize": 3})
    known = findings.table(findings.subject.single).budgets.false_known
    x = "false forecasts allowed per target" if known else "forecasts allowed per live frame"
    return Sketch([Panel(series, x, "error, m", limits=FROM_ZERO)], legend=2)


def _calibration(findings: Findings, tables: Tables) -> Sketch:
    rows = tables["calibration"].rows
    brier = {called(row): row.brier for row in rows if row.brier is not None}
    series = [
        replace(each, label=f"{each.label} (Brier {brier[each.label]:.3f})" if each.label in brier else each.label)
        for each in _of_agents(findings, rows, "confidence", "of_a_true_object")
    ]
    diagonal = Series("a probability", [0, 1], [0, 1], "soft", style={"linestyle": ":", "marker": ""})
    x, y = "stated confidence (probability)", "share of a true object"
    panel = Panel([diagonal, *series], x, y, limits={"x": (0.0, 1.0), "y": (0.0, 1.0)})
    n = f"{sum(pick(rows, 'forecasts'))} forecasts of {len(series)} agents"
    return Sketch([panel], n, size=(5.6, 4.2), legend=1)


def _cuts(findings: Findings, tables: Tables) -> Sketch:
    rows, panels = tables["cuts"].rows, []
    for field, subset in (("error", "all"), ("error_ids", "ids")):
        series = []
        for agent, color in zip(threshold_agents(), ("blue", "vermillion", "orange"), strict=True):
            mine = where(rows, agent=agent)
            shares = [100 * row.true_detections_below for row in mine]
            series.append(_series(mine, agent, color, shares, field))
        if subset == "ids":  # the switches of the first agent, along the axis
            texts = [f"{row.switches_of_stp} ids" for row in where(rows, agent=threshold_agents()[0])]
            zeros = [0.0] * len(texts)
            series.append(Series("", series[0].x, zeros, "soft", "dots", (), texts, {"marker": ""}))
        y = f"bADE on {subset_name(subset)}, m"
        panels.append(Panel(series, "true detections left out, %", y, limits=FROM_ZERO))
    return Sketch(panels, n_of(findings, seeds=1))


def _people(findings: Findings, tables: Tables) -> Sketch:
    rows = tables["people"].rows
    places = range(len(rows))
    series = [_series(rows, "minADE", "blue", places, "minADE", kind="bar")]
    series.append(_of_paper(rows, places, "paper_minADE", "the paper's"))
    ticks = _named(f"H = {row.H}\nre-tracking: {row.retracking}" for row in rows)
    return Sketch([Panel(series, "SORT and Social-LSTM", "minADE, m", ticks)])


def _surface(findings: Findings, tables: Tables) -> Sketch:
    rows = where(tables["surface"].rows, agent=findings.subject.name)
    counts, ks = sorted({row.H for row in rows}), sorted({row.k for row in rows})
    cost = {row.H: row.cost for row in rows}
    names = [f"{h}" if cost[h] is None else f"{h}  ({cost[h]:.1f} ms)" for h in counts]
    maps: list[Map] = []
    for field, subset in (("minADE", "all"), ("minADE_ids", subset_name("ids"))):
        value = np.full((len(counts), len(ks)), np.nan)
        for row in rows:
            known = getattr(row, field)
            value[counts.index(row.H), ks.index(row.k)] = np.nan if known is None else known
        if np.isfinite(value).any():
            y = "" if maps else "hypotheses H (time of a frame)"
            maps.append(Map(value, [str(k) for k in ks], names, f"minADE on {subset}, m", "samples k", y))
    knees = [row for row in tables["knee"].rows if row.knee is not None] if "knee" in tables else []
    bend = " ".join(f"Knee over {row.of}: {row.knee:g}." for row in knees) or "No knee: the error does not bend."
    return Sketch(maps, size=(9.2, 3.2) if len(maps) > 1 else None, knees=bend)


FIGURES: dict[str, tuple[str, Callable[[Findings, Tables], Sketch]]] = {  # name -> its table, and its content
    "pasts": ("pasts", _pasts),
    "frequency": ("frequency", _frequency),
    "distance": ("distance", _distance),
    "gain": ("targeted", _gain),
    "ranked": ("global", _ranked),
    "shared": ("shared", _shared),
    "frames": ("frames", _frames),
    "speed": ("speed", _speed),
    "surface": ("surface", _surface),
    "k_curve": ("k_curve", _k_curve),
    "causes": ("causes", _causes),
    "gaps": ("gaps", _gaps),
    "since": ("since", _since),
    "age": ("age", _age),
    "bins": ("bins", _parts),
    "budgets": ("budgets", _budgets),
    "calibration": ("calibration", _calibration),
    "cuts": ("cuts", _cuts),
    "people": ("people", _people),
}
