"""Figures of a study, as data: each is made of the rows of tables, and drawn by the drawers of `drawing`."""

import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

from ...core import Table
from ...running import Setting
from ...scoring import PARTS
from ..terminal.output import counted
from .drawing import (
    COLORS,
    HATCHES,
    LINES,
    MARKERS,
    SERIES,
    Drawing,
    Panel,
    Series,
    Sketch,
    draw,
)
from .rows import subset_name, texts_of
from .runs import Findings

Tables = dict[str, Table]  # by name
PART_COLORS = (
    "green",
    "sky",
    "blue",
    "vermillion",
    "lime",
    "orange",
    "yellow",
    "purple",
    "brown",
    "grey",
    "violet",
)
EVENT_COLORS = {
    "ids": "vermillion",
    "lost": "orange",
    "reacquired": "sky",
    "frag": "blue",
}
FROM_ZERO = (0.0, None)


def make_figures(findings: Findings, tables: Tables) -> dict[str, Drawing]:
    """Every figure whose table has the values that it shows, by name."""
    figures = {}
    for name, (table, sketch_of) in FIGURES.items():
        sketch = (
            sketch_of(findings, tables[table].rows) if table in tables else Sketch(())
        )
        if sketch.panels:
            figures[name] = draw(
                name, *texts_of("figures", name, findings), n_of(findings), sketch
            )
    return figures


def n_of(findings: Findings) -> str:
    """Numbers of targets, objects, scenes and seeds."""
    row = findings.row(findings.subject.single, "all")
    parts = (
        (row.targets, "target"),
        (row.objects, "object"),
        (row.scenes, "scene"),
        (row.seeds, "seed"),
    )
    return ", ".join(counted(*part) for part in parts)


def _cost(findings: Findings, rows: Sequence[Any]) -> Sketch:
    pasts = {
        "GT tracks": (findings.subject.truth, "green"),
        "tracklets": (findings.subject.reference, "blue"),
    }
    names = [
        row.targets_of
        for row in _where(rows, agent=pasts["tracklets"][0].label)
        if row.minADE is not None
    ]
    names, series = list(dict.fromkeys(names)), []
    for i, (past, (setting, color)) in enumerate(pasts.items()):
        own = [
            row for row in _where(rows, agent=setting.label) if row.targets_of in names
        ]
        own = list({row.targets_of: row for row in own}.values())
        x = [float(names.index(row.targets_of)) for row in own]
        series.append(_series_of(own, past, color, x, "minADE", kind="bar"))
        series.append(
            _paper_series(
                own, [at + 0.38 * (i - 0.5) for at in x], "the paper's" if i else ""
            )
        )
    counts = {row.targets_of: row.targets for row in rows}
    ticks = _named_ticks(
        f"{textwrap.fill(name, 10)}\nn = {counts[name]}" for name in names
    )
    return Sketch(
        [
            Panel(
                series,
                "targets with an event of this kind",
                "minADE, m",
                ticks,
                FROM_ZERO,
            )
        ]
    )


def _gain(findings: Findings, rows: Sequence[Any]) -> Sketch:
    subject, panels = findings.subject, []
    levels = {**_rivals(findings), "green": subject.truth}
    for subset in map(subset_name, ("paper_ids", "ids", "all")):
        here = _where(rows, targets_of=subset)
        if all(row.minADE is None for row in here):
            continue
        single = _where(
            here, agent=subject.single.label, H=subject.single.hypotheses or 1
        )[:1]
        series = []
        for sampling, color, label in (
            ("k of all", "vermillion", "k samples"),
            ("none", "sky", "H·k samples"),
        ):
            own = single + [
                row
                for row in _where(here, agent=subject.name, sampling=sampling)
                if row.H > 1
            ]
            series.append(
                _series_of(
                    own, f"{subject.name}, {label}", color, "H", "minADE", intervals=()
                )
            )
            style = {"linestyle": ":", "marker": MARKERS[color]}
            series.append(
                _paper_series(
                    own, _pick(own, "H"), f"the paper's, {label}", color, **style
                )
            )
        series += [
            _level_of(here, setting, "minADE", color)
            for color, setting in levels.items()
        ]
        ticks = _count_ticks(_pick(here, "H"))
        panels.append(
            Panel(series, "hypotheses H", f"minADE on {subset}, m", ticks, FROM_ZERO)
        )
    return Sketch(panels, size=(9.2, 3.7), legend=2)


def _ranked(findings: Findings, rows: Sequence[Any]) -> Sketch:
    subject, panels = findings.subject, []
    for subset in map(subset_name, ("all", "ids", "reacquired")):
        here = _where(rows, targets_of=subset)
        own = [
            r
            for r in _where(here, agent=subject.name, sampling="k of all")
            if r.to_single is not None
        ]
        counts, differences = [1, *_pick(own, "H")], [0.0, *_pick(own, "to_single")]
        intervals = [(0.0, 0.0), *_pick(own, "to_single_interval")]
        series = [
            Series(subject.name, counts, differences, "vermillion", intervals=intervals)
        ]
        series += [
            _level_of(here, setting, "to_single", color)
            for color, setting in _rivals(findings).items()
        ]
        series.append(_level(subject.single.label, [0.0], "blue", linewidth=1.2))
        panels.append(
            Panel(
                series,
                "hypotheses H",
                f"bADE on {subset}, m,\ndifference",
                _count_ticks(counts),
            )
        )
    return Sketch(panels, size=(9.2, 3.3))


def _events(findings: Findings, rows: Sequence[Any]) -> Sketch:
    rows, lines = _where(rows, agent=findings.subject.name), []
    single = _where(rows, H=1)
    style = {
        "color": [COLORS[EVENT_COLORS[row.kind]] for row in single],
        "hatch": HATCHES[: len(single)],
    }
    bars = _series_of(
        single,
        "",
        "blue",
        range(len(single)),
        "per_trajectory",
        kind="bar",
        style=style,
    )
    bars = replace(bars, texts=_pick(single, "events"))
    one = _level("", [1.0], "soft", linestyle=":")
    panels = [
        Panel(
            [bars, one],
            "kind of event",
            "events per trajectory",
            _named_ticks(_pick(single, "kind")),
        )
    ]
    for kind in ("ids", "lost", "reacquired"):
        own = [row for row in _where(rows, kind=kind) if row.left is not None]
        if own:
            shares = [100 * row.left for row in own]
            lines.append(
                Series(
                    f"{kind} (n = {own[0].events})",
                    _pick(own, "H"),
                    shares,
                    EVENT_COLORS[kind],
                )
            )
    if len(rows) > len(single):
        y, ticks = (
            "events in every hypothesis,\n% of those with one",
            _count_ticks(_pick(rows, "H")),
        )
        panels.append(Panel(lines, "hypotheses H", y, ticks, (0, 105)))
    return Sketch(panels)


def _samples(findings: Findings, rows: Sequence[Any]) -> Sketch:
    rows = _where(rows, agent=findings.subject.name)
    colors = dict(zip(dict.fromkeys(_pick(rows, "H")), SERIES, strict=False))
    series = [
        _series_of(_where(rows, H=h), f"H = {h}", color, "k", "minADE")
        for h, color in colors.items()
    ]
    ticks = _count_ticks(_pick(rows, "k"))
    return Sketch(
        [
            Panel(
                series,
                "samples k (logarithmic)",
                "expected minADE, m",
                ticks,
                FROM_ZERO,
                log=True,
            )
        ]
    )


def _parts(findings: Findings, rows: Sequence[Any]) -> Sketch:
    rows = _where(rows, targets_of="all")
    rows = [row for row in rows if row.H in (1, max(_pick(rows, "H")))][::-1]
    if findings.few:  # controls whose errors are not split
        own = {
            label
            for each in findings.plan.subjects
            for label in (each.single.label, each.most.label)
        }
        rows = [
            row for row in rows if row.cost_ground_truth is not None or row.agent in own
        ]
    places = range(len(rows))
    names = {**PARTS, "rest": "rest (not split)"}
    values = {
        name: [getattr(row, f"cost_{key}") or 0.0 for row in rows]
        for key, name in names.items()
    }
    colored = zip(values.items(), PART_COLORS, strict=True)
    series = [
        Series(name, places, part, color, "bar") for (name, part), color in colored
    ]
    mark = {"marker": "|", "markersize": 17, "markeredgewidth": 2}
    series.append(
        _series_of(rows, "bADE", "ink", places, "error", kind="dots", style=mark)
    )
    ends = [
        max(row.error, sum(part[i] for part in values.values() if part[i] > 0))
        for i, row in enumerate(rows)
    ]
    texts = [f"{row.error:.2f}" for row in rows]
    series.append(Series("", places, ends, "ink", "dots", (), texts, {"marker": ""}))
    series.append(_level("", [0.0], "soft", linewidth=0.8))
    x = "bADE, m, averaged over budgets of false forecasts"
    agents = [
        f"{row.agent}, H = {row.H}" if row.H > 1 else str(row.agent) for row in rows
    ]
    panel = Panel(series, "", x, _named_ticks(agents), stacked=True)
    return Sketch([panel], size=(8.1, 1.3 + 0.36 * len(rows)), legend=4)


def _where(rows: Iterable[Any], **values: Any) -> list[Any]:
    return [
        row
        for row in rows
        if all(getattr(row, name) == value for name, value in values.items())
    ]


def _pick(rows: Iterable[Any], name: str) -> list[Any]:
    return [getattr(row, name) for row in rows]


def _series_of(
    rows: Sequence[Any],
    label: str,
    color: str,
    x: str | Sequence[float],
    y: str,
    **more: Any,
) -> Series:
    """A series of the column ``y`` of rows over their column ``x`` or over given numbers, with its intervals if any."""
    at = _pick(rows, x) if isinstance(x, str) else x
    intervals = [getattr(row, f"{y}_interval", None) for row in rows]
    return Series(
        label,
        at,
        _pick(rows, y),
        color,
        **{"intervals": intervals if any(intervals) else (), **more},
    )


def _paper_series(
    rows: Sequence[Any],
    x: Sequence[float],
    label: str,
    color: str = "ink",
    **style: Any,
) -> Series:
    """The paper's minADE, at those rows for which the paper states one."""
    known = {
        at: row.paper_minADE
        for at, row in zip(x, rows, strict=True)
        if row.paper_minADE is not None
    }
    return Series(
        label if known else "", [*known], [*known.values()], color, "paper", style=style
    )


def _level(
    label: str, values: Sequence[float | None], color: str, **style: Any
) -> Series:
    """Straight lines across a panel at these values."""
    return Series(label, (), values, color, "level", style=style)


def _rivals(findings: Findings) -> dict[str, Setting]:
    """The controls that a gain of hypotheses must exceed, by the colour of their level."""
    return dict(zip(("orange", "purple"), findings.plan.rivals, strict=True))


def _level_of(rows: Sequence[Any], setting: Setting, column: str, color: str) -> Series:
    """The level of a setting's value in a column of ``rows``."""
    values = _pick(_where(rows, agent=setting.label)[:1], column)
    return _level(setting.label, values, color, linestyle=LINES[color])


def _named_ticks(names: Iterable[str]) -> list[tuple[float, str]]:
    return [(float(i), name) for i, name in enumerate(names)]


def _count_ticks(values: Iterable[int]) -> list[tuple[float, str]]:
    return [(float(value), str(value)) for value in sorted(set(values))]


FIGURES: dict[
    str, tuple[str, Callable[[Findings, Sequence[Any]], Sketch]]
] = {  # name -> its table, and its content
    "cost": ("errors", _cost),
    "gain": ("errors", _gain),
    "ranked": ("errors", _ranked),
    "events": ("events", _events),
    "samples": ("samples", _samples),
    "parts": ("parts", _parts),
}
