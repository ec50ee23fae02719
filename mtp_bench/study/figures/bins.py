"""Figures of bins: time since an event, age of the track, distance, class and motion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..findings import Findings
from ..table import Tables
from .common import agents, called, colors_of, n_of, pick, where
from .style import MARKERS, Figure, beside, caps, color, draw

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PLAIN = ("plain_error", "low", "high", "plain error, m")
COVERED = ("minADE", "minADE_low", "minADE_high", "minADE, m")


def _by_bins(
    axis: Axes, rows: list[Any], names: list[str], told: dict[str, str], of: tuple[str, str, str, str] = PLAIN
) -> None:
    """One number of each agent in each bin, with its interval, and how many targets the bin has."""
    value, low, high, label = of
    rows = [row for row in rows if getattr(row, value) is not None]
    for shift, (agent, count) in enumerate(agents(rows)):
        mine = where(rows, agent=agent, H=count)
        at = np.array([names.index(row.bin) for row in mine]) + 0.12 * (shift - 1.5)
        name = told.get(agent, "grey")
        caps(axis, at, pick(mine, value), pick(mine, low), pick(mine, high), name=name)
        axis.plot(
            at, pick(mine, value), linestyle="none", marker=MARKERS.get(name, "o"), color=color(name),
            markersize=5, label=called(agent, count),
        )  # fmt: skip
    counts = {row.bin: row.targets for row in rows}
    names_shown = [f"{name}\n{counts.get(name, 0)}" for name in names]
    axis.set_xticks(range(len(names)), names_shown, fontsize=7.5 if len(names) > 6 else 8.5)
    axis.set_ylabel(label)
    axis.set_ylim(0, _top(pick(rows, value), pick(rows, high)))


def _top(values: list[float], ends: list[float | None]) -> float:
    """Where the axis ends: intervals of a handful of targets must not squeeze the rest."""
    most = max(values, default=1.0)
    return float(max(most, min(max((end or 0.0 for end in ends), default=most), 1.35 * most)) * 1.07) or 1.0


def since_figure(found: Findings, tables: Tables) -> Figure:
    """How long an event hurts."""
    table = tables["since"]
    told = colors_of(found)
    kinds = [kind for kind in ("ids", "reacquired") if where(table.rows, by=kind)]

    def paint(*axes: Axes) -> None:
        for axis, kind in zip(axes, kinds, strict=True):
            rows = where(table.rows, by=kind)
            names = list(dict.fromkeys(pick(rows, "bin")))
            _by_bins(axis, rows, names, told, COVERED)
            axis.set_xlabel(f"frames since the last {kind}; below: targets")
        beside(axes[0], ncols=4)

    return draw(
        "since", table.title, table.sentence, n_of(found), paint, rows=len(kinds), panels=len(kinds), size=(8.1, 5.8)
    )


def age_figure(found: Findings, tables: Tables) -> Figure:
    """The error over the age of the track."""
    table = tables["age"]

    def paint(axis: Axes) -> None:
        _by_bins(axis, list(table.rows), list(dict.fromkeys(pick(table.rows, "bin"))), colors_of(found))
        axis.set_xlabel("age of the track, frames; below: targets")
        beside(axis, ncols=2)

    return draw("age", table.title, table.sentence, n_of(found), paint, size=(6.8, 3.6))


def bins_figure(found: Findings, tables: Tables) -> Figure:
    """The error by distance, class and motion."""
    table = tables["bins"]
    kinds = [by for by in ("distance", "class", "motion") if where(table.rows, by=by)]
    labels = {"distance": "distance to the ego, m", "class": "class", "motion": "motion, and weighted for planning"}

    def paint(*axes: Axes) -> None:
        for axis, by in zip(axes, kinds, strict=True):
            rows = where(table.rows, by=by) + (where(table.rows, by="planning") if by == "motion" else [])
            _by_bins(axis, rows, list(dict.fromkeys(pick(rows, "bin"))), colors_of(found))
            axis.set_xlabel(f"{labels[by]}; below: targets")
        beside(axes[0], ncols=4)

    height = 2.7 * len(kinds) + 0.4
    return draw(
        "bins", table.title, table.sentence, n_of(found), paint, rows=len(kinds), panels=len(kinds), size=(8.1, height)
    )
