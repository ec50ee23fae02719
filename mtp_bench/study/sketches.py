"""Content of figures: series and ticks of the rows of tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from ..tables import Table
from ..viz.terminal.output import counted
from .drawing import SERIES
from .findings import Findings
from .panels import Map, Panel, Series

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
    for label in dict.fromkeys([*others, *(subject.reference.label for subject in plan.subjects)]):
        if label not in colors:
            colors[label] = left.pop(0) if left else "grey"
    return colors


def where(rows: Iterable[Any], **values: Any) -> list[Any]:
    """Rows whose attributes have these values."""
    return [row for row in rows if all(getattr(row, name) == value for name, value in values.items())]


def pick(rows: Iterable[Any], name: str) -> list[Any]:
    """Values of the attribute ``name`` of each row."""
    return [getattr(row, name) for row in rows]


def called(row: Any) -> str:
    """Label of the agent of a row."""
    return f"{row.agent}, H = {row.H}" if row.H > 1 else str(row.agent)


def series_of(rows: Sequence[Any], label: str, color: str, x: str | Sequence[float], y: str, **more: Any) -> Series:
    """A series of the column ``y`` of rows over their column ``x`` or over given numbers, with its intervals if any."""
    at = pick(rows, x) if isinstance(x, str) else x
    intervals = [getattr(row, f"{y}_interval", None) for row in rows]
    return Series(label, at, pick(rows, y), color, intervals=intervals if any(intervals) else (), **more)


def agent_series(findings: Findings, rows: Sequence[Any], x: str, y: str, **more: Any) -> list[Series]:
    """A series of each agent with each number of hypotheses."""
    colors, agents = colors_of(findings), dict.fromkeys((row.agent, row.H) for row in rows)
    every = [where(rows, agent=agent, H=count) for agent, count in agents]
    return [series_of(own, called(own[0]), colors.get(own[0].agent, "grey"), x, y, **more) for own in every]


def paper_series(
    rows: Sequence[Any], x: Sequence[float], y: str, label: str, color: str = "ink", **style: Any
) -> Series:
    """The paper's values of ``y``, at those rows for which the paper states one."""
    known = [(at, row) for at, row in zip(x, rows, strict=True) if getattr(row, y) is not None]
    own = [row for _, row in known]
    return series_of(own, label if known else "", color, [at for at, _ in known], y, kind="paper", style=style)


def level_series(label: str, values: Sequence[float | None], color: str, **style: Any) -> Series:
    """Horizontal lines across a panel at these values."""
    return Series(label, (), values, color, "level", style=style)


def few_and_most(rows: Sequence[Any]) -> list[Any]:
    """Rows with one hypothesis or the largest number of them."""
    return [row for row in rows if row.H in (1, max(pick(rows, "H")))]


def named_ticks(names: Iterable[str]) -> list[tuple[float, str]]:
    """Ticks 0, 1, 2, ... with these names."""
    return [(float(i), name) for i, name in enumerate(names)]


def count_ticks(values: Iterable[int]) -> list[tuple[float, str]]:
    """Ticks at these numbers."""
    return [(float(value), str(value)) for value in sorted(set(values))]
