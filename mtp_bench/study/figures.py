"""Figures of a study, as data: each is made of the rows of a table, and drawn by the drawers of `panels`."""

from __future__ import annotations

import textwrap
from collections.abc import Callable

import numpy as np

from ..running.compare import threshold_agents
from .drawing import Drawing, draw
from .error_rows import subset_name
from .findings import Findings
from .panels import MARKERS, Map, Panel, Series, draw_panels
from .part_figures import PART_FIGURES
from .sketches import (
    FROM_ZERO,
    Sketch,
    Tables,
    agent_series,
    called,
    count_ticks,
    few_and_most,
    level_series,
    n_of,
    named_ticks,
    paper_series,
    pick,
    series_of,
    where,
)
from .specs import texts_of


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


def _pasts(findings: Findings, tables: Tables) -> Sketch:
    rows = [row for row in where(tables["pasts"].rows, agent=findings.subject.name) if row.minADE is not None]
    names, series = list(dict.fromkeys(pick(rows, "targets_of"))), []
    for i, (past, color) in enumerate((("GT tracks", "green"), ("tracklets", "blue"))):
        mine = where(rows, past=past)
        x = [names.index(row.targets_of) for row in mine]
        series.append(series_of(mine, past, color, x, "minADE", kind="bar"))
        series.append(
            paper_series(mine, [at + 0.38 * (i - 0.5) for at in x], "paper_minADE", "the paper's" if i else "")
        )
    counts = {row.targets_of: row.targets for row in rows}
    ticks = named_ticks(f"{textwrap.fill(name, 10)}\nn = {counts[name]}" for name in names)
    return Sketch([Panel(series, "targets with an event of this kind", "minADE, m", ticks, limits=FROM_ZERO)])


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
            series.append(series_of(mine, f"{subject.name}, {label}", color, "H", "minADE"))
            style = {"linestyle": ":", "marker": MARKERS[color]}
            series.append(paper_series(mine, pick(mine, "H"), "paper_minADE", f"the paper's, {label}", color, **style))
        for setting, color, line in ((control, "orange", "--"), (subject.truth, "green", "-")):
            if setting is not None:
                level = pick(where(rows, agent=setting.label)[:1], "minADE")
                series.append(level_series(setting.label, level, color, linestyle=line))
        y = f"minADE on {subset_name(subset)}, m"
        panels.append(Panel(series, "hypotheses H", y, count_ticks(pick(rows, "H")), limits=FROM_ZERO))
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
            series.append(level_series(control.label, level, "orange", linestyle="--"))
        series.append(level_series(subject.single.label, [0.0], "blue", linewidth=1.2))
        panels.append(Panel(series, "hypotheses H", f"bADE on {subset}, m,\ndifference", count_ticks(counts)))
    return Sketch(panels, size=(9.2, 3.3))


def _speed(findings: Findings, tables: Tables) -> Sketch:
    rows = sorted(tables["speed"].rows, key=lambda row: row.H)
    stages = {"tracking": "blue", "prediction": "vermillion", "whole": "grey"}
    series = [series_of(rows, "whole agent" if s == "whole" else s, color, "H", s) for s, color in stages.items()]
    panel = Panel(series, "hypotheses H", "time of a frame, ms", count_ticks(pick(rows, "H")), limits=FROM_ZERO)
    return Sketch([panel], f"{rows[0].frames} frames")


def _k_curve(findings: Findings, tables: Tables) -> Sketch:
    rows = few_and_most(tables["k_curve"].rows)
    series, ticks = agent_series(findings, rows, "k", "minADE"), count_ticks(pick(rows, "k"))
    x, y = "samples k (logarithmic)", "expected minADE, m"
    return Sketch([Panel(series, x, y, ticks, limits=FROM_ZERO, log=True)])


def _gaps(findings: Findings, tables: Tables) -> Sketch:
    rows, panels = tables["gaps"].rows, list[Panel]()
    if all(row.closed is None for row in rows):
        return Sketch(())
    pairs = {"closed": ("of all agents", "blue", "o"), "closed_own_predictor": ("of its own", "vermillion", "s")}
    rows = [row for row in few_and_most(rows) if any(getattr(row, field) is not None for field in pairs)]
    labels = list(dict.fromkeys(map(called, rows)))[::-1]
    known = [value for row in rows for field in pairs if (value := getattr(row, field)) is not None]
    limits = {"x": (1.15 * min([-0.1, *known]), max([1.05, *known])), "y": (-0.6, len(labels) - 0.4)}
    for subset in dict.fromkeys(pick(rows, "targets_of")):
        here, series = where(rows, targets_of=subset), list[Series]()
        for shift, (field, (label, color, marker)) in enumerate(pairs.items()):
            mine = [row for row in here if getattr(row, field) is not None]
            at = [labels.index(called(row)) + 0.16 - 0.32 * shift for row in mine]
            name = f"reference pair {label}"
            series.append(series_of(mine, name, color, at, field, kind="dots", style={"marker": marker}))
        places = [float(labels.index(called(row))) for row in here]
        series.append(paper_series(here, places, "paper_closed", "the paper's, by minADE"))
        series += [level_series("", [0.0], "soft", linewidth=0.8), level_series("", [1.0], "green", linewidth=0.8)]
        ticks = named_ticks(labels if not panels else [""] * len(labels))
        x = f"gap closed on {subset}, %"
        panels.append(Panel(series, "", x, ticks, limits=limits, across=True, percent=True))
    return Sketch(panels, size=(8.1, 1.5 + 0.42 * len(labels)), legend=2)


def _budgets(findings: Findings, tables: Tables) -> Sketch:
    series = agent_series(findings, tables["budgets"].rows, "allowed", "error", style={"markersize": 3})
    known = findings.table(findings.subject.single).budgets.false_known
    x = "false forecasts allowed per target" if known else "forecasts allowed per live frame"
    return Sketch([Panel(series, x, "error, m", limits=FROM_ZERO)], legend=2)


def _cuts(findings: Findings, tables: Tables) -> Sketch:
    rows, panels = tables["cuts"].rows, []
    for field, subset in (("error", "all"), ("error_ids", "ids")):
        series = []
        for agent, color in zip(threshold_agents(), ("blue", "vermillion", "orange"), strict=True):
            mine = where(rows, agent=agent)
            shares = [100 * row.true_detections_below for row in mine]
            series.append(series_of(mine, agent, color, shares, field))
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
    series = [series_of(rows, "minADE", "blue", places, "minADE", kind="bar")]
    series.append(paper_series(rows, places, "paper_minADE", "the paper's"))
    ticks = named_ticks(f"H = {row.H}\nre-tracking: {row.retracking}" for row in rows)
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
    "gain": ("targeted", _gain),
    "ranked": ("global", _ranked),
    "speed": ("speed", _speed),
    "surface": ("surface", _surface),
    "k_curve": ("k_curve", _k_curve),
    "gaps": ("gaps", _gaps),
    "budgets": ("budgets", _budgets),
    "cuts": ("cuts", _cuts),
    "people": ("people", _people),
    **PART_FIGURES,
}
