"""Figures of a study, drawn from the rows of its report."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...agent import controls
from ...running import HYPOTHESIS_CONTROLS
from ...scoring import (
    PART_NAMES,
    SUBSET_NAMES,
    Report,
    Row,
    Subset,
)
from ..pages import data_uri
from ..terminal.notes import REFERENCES, label_of
from ..terminal.settings_table import AgentLine, agent_lines, main_lines, sort_error

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# after Okabe and Ito: people with any kind of colour vision tell them apart
PART_COLORS = dict(
    zip(
        PART_NAMES,
        (
            "#009e73",
            "#56b4e9",
            "#0072b2",
            "#d55e00",
            "#a8d890",
            "#e69f00",
            "#f0e442",
            "#cc79a7",
            "#6b3410",
            "#555b61",
            "#6000d8",
        ),
        strict=True,
    )
)
AGENT_COLOR = "#0072b2"
REFERENCE_COLOR = "#8a929a"  # of agents that saw the truth
CONTROL_COLOR = "#6000d8"
FILE_SUFFIXES = (".svg", ".pdf", ".png")
NO_DATE: dict[str, dict[str, None]] = {  # equal figures have equal bytes
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
    ".png": {"Software": None},
}
_SUBSETS: tuple[Subset, ...] = ("all", "ids", "reacquired")
_WIDTH_IN = 9.0
_ROW_HEIGHT_IN = 0.3
STYLE = Path(__file__).with_name("figure.mplstyle")


class FigureSpec(NamedTuple):
    """Texts of a figure, and the function that draws it.

    The function returns None without values.
    """

    title: str
    caption: str
    draw: "Callable[[Report], Figure | None]"


@dataclass(frozen=True)
class DrawnFigure:
    """A figure in the files ``name``.svg, .pdf and .png."""

    name: str
    title: str
    caption: str
    data_uri: str  # the SVG, for a page


def draw_figures(
    report: Report, folder: Path, has_parts: bool = True
) -> list[DrawnFigure]:
    """Draw the figures of a report as SVG, PDF and PNG.

    Figures without values are left out, that of the parts unless ``has_parts``.
    """
    from matplotlib import style

    figures: list[DrawnFigure] = []
    if not _scored_lines(report):  # no targets
        return figures
    with style.context(["default", STYLE]):
        for name, spec in FIGURES.items():
            figure = spec.draw(report)
            if figure is None or (name == "parts" and not has_parts):
                continue
            for suffix in FILE_SUFFIXES:
                path = folder / f"{name}{suffix}"
                figure.savefig(path, metadata=NO_DATE[suffix])
            svg = data_uri((folder / f"{name}.svg").read_bytes(), "image/svg+xml")
            figures.append(DrawnFigure(name, spec.title, spec.caption, svg))
    return figures


def _draw_errors(report: Report) -> "Figure":
    """Draw bADE with intervals, a panel per subset."""
    lines = _scored_lines(report)
    subsets = _subsets_with(lines, "error")
    figure, axes = _row_panels(len(subsets), lines)
    for axis, subset in zip(axes, subsets, strict=True):
        for place, row in enumerate(_on(lines, subset)):
            color = AGENT_COLOR
            if row.unranked_because in REFERENCES:
                color = REFERENCE_COLOR
            axis.plot(row.error, place, marker="o", color=color)
            if row.interval is not None:
                axis.hlines(place, *row.interval, color=color)
        axis.set(title=SUBSET_NAMES[subset], xlabel="bADE, m")
    return figure


def _draw_parts(report: Report) -> "Figure":
    """Draw the parts of bADE as stacked bars.

    Negative parts extend to the left.
    """
    lines = _scored_lines(report)
    figure, (axis,) = _row_panels(1, lines)
    places = np.arange(len(lines))
    right_m = np.zeros(len(lines))
    left_m = np.zeros(len(lines))
    for key, name in PART_NAMES.items():
        part_m = _values(_on(lines, "all"), f"cost_{key}")
        part_m = np.nan_to_num(np.array(part_m, dtype=float))
        start_m = np.where(part_m >= 0, right_m, left_m)
        axis.barh(places, part_m, left=start_m, color=PART_COLORS[key], label=name)
        right_m += np.maximum(part_m, 0)
        left_m += np.minimum(part_m, 0)
    axis.set(xlabel="bADE, m")
    figure.legend(loc="outside right upper")
    return figure


def _draw_hypotheses(report: Report) -> "Figure | None":
    """Draw the gain over stp by hypotheses, beside the controls."""
    agents = _lines_by_agent(report)
    swept = {agent: lines for agent, lines in agents.items() if len(lines) > 1}
    if not swept:
        return None
    swept_lines = list(chain.from_iterable(swept.values()))
    subsets = _subsets_with(swept_lines, "difference_to_stp")
    figure, (axes,) = panels(len(subsets))
    for axis, subset in zip(axes, subsets, strict=True):
        axis.axhline(0.0, color=REFERENCE_COLOR, label="stp")
        for agent, lines in swept.items():
            _plot_sweep(axis, agent, _on(lines, subset))
        for role, line_style in zip(HYPOTHESIS_CONTROLS, ("--", ":"), strict=True):
            agent = controls()[role]
            level_m = agents[agent][0].rows[subset].difference_to_stp
            axis.axhline(
                level_m, color=CONTROL_COLOR, linestyle=line_style, label=agent
            )
        axis.set(title=SUBSET_NAMES[subset], xlabel="hypotheses H")
    axes[0].set_ylabel("bADE less that of stp, m")
    add_legend(figure, axes[0])
    return figure


def _plot_sweep(axis: Any, agent: str, rows: Sequence[Row]) -> None:
    """Plot differences to stp over hypotheses, with intervals as vertical lines."""
    counts = _values(rows, "hypotheses")
    (line,) = axis.plot(counts, _values(rows, "difference_to_stp"), label=agent)
    for row in rows:
        if row.difference_interval is not None:
            low_m, high_m = row.difference_interval
            axis.vlines(row.hypotheses, low_m, high_m, color=line.get_color())
    axis.set_xticks(counts)


def _lines_by_agent(report: Report) -> dict[str, list[AgentLine]]:
    """Return the settings of each agent at equal k."""
    lines: dict[str, list[AgentLine]] = defaultdict(list)
    for line in agent_lines(report):
        if line.details.budget == "equal":
            lines[line.details.agent].append(line)
    return lines


def _scored_lines(report: Report) -> list[AgentLine]:
    """Return the main setting of each agent with targets, lowest bADE first."""
    lines = [line for line in main_lines(report) if line.rows["all"].error is not None]
    return sorted(lines, key=sort_error)


def _subsets_with(lines: Sequence[AgentLine], key: str) -> list[Subset]:
    """Return the subsets on which the field ``key`` has a value in every line."""
    return [
        subset for subset in _SUBSETS if None not in _values(_on(lines, subset), key)
    ]


def _on(lines: Sequence[AgentLine], subset: Subset) -> list[Row]:
    """Return the rows of ``lines`` on a subset."""
    return [line.rows[subset] for line in lines]


def _values(rows: Sequence[Row], key: str) -> list[Any]:
    return [getattr(row, key) for row in rows]


def panels(count: int, height_in: float = 3.6, rows: int = 1) -> "tuple[Figure, Any]":
    """Return a figure and its axes [rows, ``count``]."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_WIDTH_IN, height_in), layout="constrained")
    return figure, figure.subplots(rows, count, squeeze=False)


def _row_panels(
    count: int, lines: Sequence[AgentLine]
) -> "tuple[Figure, Sequence[Any]]":
    """Return a figure of ``count`` panels with a row per agent."""
    figure, (axes,) = panels(count, 1.2 + _ROW_HEIGHT_IN * len(lines))
    for axis in axes:
        axis.grid(axis="x")
        axis.set_yticks(range(len(lines)), [""] * len(lines))
        axis.set_ylim(len(lines) - 0.5, -0.5)  # the first row is at the top
    axes[0].set_yticklabels(list(map(label_of, _on(lines, "all"))))
    return figure, axes


def add_legend(figure: "Figure", axis: Any) -> None:
    """Draw one legend above all panels."""
    figure.legend(*axis.get_legend_handles_labels(), loc="outside upper left", ncols=4)


FIGURES = {
    "errors": FigureSpec(
        "bADE of each agent",
        "Dots are bADE, lines its 95 % interval over recordings. Agents in grey saw "
        "the truth or which detections are of one object, and are never ranked.",
        _draw_errors,
    ),
    "parts": FigureSpec(
        "Parts of bADE over all targets",
        "The parts of a bar add up to bADE. Those left of zero take away from it. "
        "The rest is the error of forecasts that no reference run splits. Parts from "
        "“below threshold” on are of targets without a forecast.",
        _draw_parts,
    ),
    "hypotheses": FigureSpec(
        "Gain of hypotheses at equal k",
        "Differences to one hypothesis at equal k, with 95 % intervals. A gain of "
        "hypotheses must exceed that of both controls: more samples of one hypothesis, "
        "and futures of neighbours. The table of differences has the paired tests.",
        _draw_hypotheses,
    ),
}
