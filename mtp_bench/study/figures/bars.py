"""Figures of bars: pasts, frequency, causes, gaps, people."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...scoring.causes import CAUSES
from ...viz.terminal.paper import figures_of
from ..findings import Findings
from ..table import Tables
from ..tables.where import CAUSE_NAMES
from .common import called, n_of, pick, where
from .style import HATCHES, Figure, beside, caps, color, diamonds, draw

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CAUSE_COLORS = ("grey", "yellow", "orange", "green", "sky", "vermillion", "purple")


def pasts_figure(found: Findings, tables: Tables) -> Figure:
    """Table I as bars."""
    rows = where(tables["pasts"].rows, agent=found.subject.name)
    rows = [row for row in rows if row.minADE is not None]
    names = list(dict.fromkeys(pick(rows, "targets_of")))

    def paint(axis: Axes) -> None:
        for i, (past, name) in enumerate((("true pasts", "green"), ("tracklets", "blue"))):
            here = {row.targets_of: row for row in where(rows, past=past)}
            at = np.array([j for j, n in enumerate(names) if n in here]) + 0.38 * (i - 0.5)
            mine = [here[n] for n in names if n in here]
            axis.bar(at, pick(mine, "minADE"), 0.36, color=color(name), hatch=HATCHES[i], edgecolor="white", label=past)
            caps(axis, at, pick(mine, "minADE"), pick(mine, "minADE_low"), pick(mine, "minADE_high"))
            papers = [(x, row.paper_minADE) for x, row in zip(at, mine, strict=True) if row.paper_minADE is not None]
            if papers:
                x, y = zip(*papers, strict=True)
                diamonds(axis, x, y, "the paper's" if i else None, markersize=6)
        counts = {row.targets_of: row.targets for row in rows}
        axis.set_xticks(range(len(names)), [f"{n}\nn = {counts[n]}" for n in names])
        axis.set_ylabel("minADE, m")
        axis.set_xlabel("targets with an event of this kind")
        axis.set_ylim(bottom=0)
        beside(axis)

    return draw(
        "pasts",
        "What tracking errors cost",
        "minADE of the same predictor from true pasts and from the tracks of one hypothesis, over targets with a "
        "forecast, with 95 % intervals"
        + (
            "; diamonds are the paper's figures, of another predictor."
            if figures_of(found.bench.of_paper, "stp", "equal", 1)
            else "."
        ),
        n_of(found),
        paint,
    )


def frequency_figure(found: Findings, tables: Tables) -> Figure:
    """Events per trajectory and per frame."""
    rows = tables["frequency"].rows

    def paint(*axes: Axes) -> None:
        for axis, field, unit in zip(axes, ("per_trajectory", "per_frame"), ("trajectory", "frame"), strict=True):
            values = pick(rows, field)
            names = ("vermillion", "orange", "sky", "blue")
            bars = axis.bar(range(len(rows)), values, 0.6, color=[color(n) for n in names], edgecolor="white")
            for bar, hatch in zip(bars, HATCHES, strict=False):
                bar.set_hatch(hatch)
            for at, value in enumerate(values):
                axis.text(at, value, f"{value:.2g}", ha="center", va="bottom", fontsize=9)
            axis.set_xticks(range(len(rows)), pick(rows, "kind"))
            axis.set_ylabel(f"events per {unit}")
            axis.set_xlabel("kind of event")
            if unit == "trajectory":
                axis.axhline(1, color=color("soft"), linestyle=":", linewidth=1.2)
            axis.margins(y=0.14)

    first = rows[0]
    return draw(
        "frequency",
        "How often identities err",
        f"Events of {found.subject.single.label} on all evaluated true objects; the dotted line is one per trajectory, "
        "which the paper finds for fragments on KITTI and for both kinds on nuScenes.",
        f"{first.trajectories} trajectories, {first.frames} frames, {first.boxes} boxes",
        paint,
        panels=2,
    )


def causes_figure(found: Findings, tables: Tables) -> Figure:
    """One stacked bar per agent that adds up to the error that ranks."""
    rows = where(tables["causes"].rows, targets_of="all")
    rows = [row for row in rows if row.H in (1, max(pick(rows, "H")))][::-1]

    def paint(axis: Axes) -> None:
        place = np.arange(len(rows))
        up, down = np.zeros(len(rows)), np.zeros(len(rows))
        for cause, name, hatch in zip(CAUSES, CAUSE_COLORS, HATCHES, strict=True):
            value, label = np.array(pick(rows, cause)), CAUSE_NAMES[cause]
            left = np.where(value >= 0, up, down)
            axis.barh(place, value, 0.62, left=left, color=color(name), hatch=hatch, edgecolor="white", label=label)
            up, down = up + np.maximum(value, 0), down + np.minimum(value, 0)
        axis.plot(pick(rows, "error"), place, "|", color=color("ink"), markersize=17, markeredgewidth=2, label="error")
        for at, row in zip(place, rows, strict=True):
            axis.text(max(up[int(at)], row.error), float(at), f"  {row.error:.2f}", va="center", fontsize=9)
        axis.axvline(0, color=color("soft"), linewidth=0.8)
        axis.set_yticks(place, [called(row.agent, row.H) for row in rows])
        axis.set_xlabel("error that ranks, m, averaged over budgets of false forecasts")
        axis.margins(x=0.1)
        beside(axis, ncols=4)

    return draw(
        "causes",
        "Where the remaining error comes from",
        "Parts of the error over all targets that add up to it (black mark); those left of zero take away from it. "
        "Undetected, withheld, not forecast: targets without a forecast; the others are parts of forecasts.",
        n_of(found),
        paint,
        size=(8.1, 1.3 + 0.36 * len(rows)),
        grid="x",
    )


def gaps_figure(found: Findings, tables: Tables) -> Figure | None:
    """What share of the gap is closed, with intervals; None where no share is known."""
    rows = tables["gaps"].rows
    if all(row.closed is None for row in rows):
        return None
    rows = [row for row in rows if row.H in (1, max(pick(rows, "H")))]
    rows = [row for row in rows if row.closed is not None or row.closed_own_predictor is not None]
    subsets = list(dict.fromkeys(pick(rows, "targets_of")))
    labels = list(dict.fromkeys(called(row.agent, row.H) for row in rows))[::-1]

    def paint(*axes: Axes) -> None:
        for axis, subset in zip(axes, subsets, strict=True):
            for shift, (field, low, high, name, marker, label) in enumerate(_GAPS):
                mine = [row for row in where(rows, targets_of=subset) if getattr(row, field) is not None]
                at = [labels.index(called(row.agent, row.H)) + 0.16 - 0.32 * shift for row in mine]
                value = [100 * v for v in pick(mine, field)]
                least, most = ([None if v is None else 100 * v for v in pick(mine, end)] for end in (low, high))
                caps(axis, at, value, least, most, across=True, name=name)
                axis.plot(value, at, marker, color=color(name), markersize=6, label=label)
            for row in where(rows, targets_of=subset):
                if row.paper_closed is not None:
                    at_paper = labels.index(called(row.agent, row.H))
                    diamonds(axis, 100 * row.paper_closed, at_paper, "the paper's, by minADE")
            axis.axvline(0, color=color("soft"), linewidth=0.8)
            axis.axvline(100, color=color("green"), linewidth=0.8)
            axis.set_xlim(*_limits(rows))
            axis.set_yticks(range(len(labels)), labels if axis is axes[0] else [""] * len(labels))
            axis.set_ylim(-0.6, len(labels) - 0.4)
            axis.set_xlabel(f"gap closed on {subset}, %")
        beside(axes[0], ncols=2)

    return draw(
        "gaps",
        "How much of the gap is closed",
        "0 % is one hypothesis, 100 % is prediction from true pasts; with 95 % intervals. No mark: the gap is not "
        "significantly above 0, or the ends are not stated.",
        n_of(found),
        paint,
        panels=len(subsets),
        size=(8.1, 1.5 + 0.42 * len(labels)),
        grid="x",
    )


def _limits(rows: list[Any]) -> tuple[float, float]:
    """From a little below zero to 100 % and a little more, or as far as the marks lie."""
    known = [100 * v for row in rows for v in (row.closed, row.closed_own_predictor) if v is not None]
    return min([-10.0, *known]) * 1.15, max([105.0, *known])


_GAPS: Any = (
    ("closed", "low", "high", "blue", "o", "between stp and truth_past"),
    ("closed_own_predictor", "own_low", "own_high", "vermillion", "s", "between ends with its own predictor"),
)


def people_figure(found: Findings, tables: Tables) -> Figure:
    """Table V as bars."""
    rows = tables["people"].rows

    def paint(axis: Axes) -> None:
        place = np.arange(len(rows))
        axis.bar(place, pick(rows, "minADE"), 0.55, color=color("blue"), edgecolor="white", label="minADE")
        papers = [(x, row.paper_minADE) for x, row in zip(place, rows, strict=True) if row.paper_minADE is not None]
        if papers:
            x, y = zip(*papers, strict=True)
            diamonds(axis, x, y, "the paper's")
        names = [f"H = {row.H}\nre-tracking: {row.retracking}" for row in rows]
        axis.set_xticks(place, names)
        axis.set_ylabel("minADE, m")
        axis.set_xlabel("SORT and Social-LSTM")
        beside(axis)

    return draw(
        "people",
        "Re-tracking and hypotheses",
        "minADE of SORT and Social-LSTM, with re-tracking, with hypotheses, and with both; diamonds are the paper's.",
        n_of(found),
        paint,
    )
