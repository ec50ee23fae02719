"""Figures of a study, drawn with matplotlib from the rows of its report."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...agent import controls
from ...running import HYPOTHESIS_CONTROLS
from ...scoring import (
    NAMES,
    PARTS,
    Details,
    Report,
    Row,
    Subset,
    blocks_of,
    main_settings,
)
from ..terminal.notes import REFERENCES, label_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# after Okabe and Ito: people with any kind of colour vision tell them apart
PART_COLORS = dict(
    zip(
        PARTS,
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
FILE_SUFFIXES = (".svg", ".pdf", ".png")
_NO_DATE: dict[str, dict[str, None]] = {  # equal figures have equal bytes
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
    ".png": {"Software": None},
}
_EVENT_KINDS: tuple[Subset, ...] = ("ids", "lost", "reacquired")
_SUBSETS: tuple[Subset, ...] = ("all", "ids", "reacquired")
_WIDTH_IN = 9.0
_ROW_HEIGHT_IN = 0.3
_STYLE = Path(__file__).with_name("figure.mplstyle")

Block = Mapping[Subset, Row]  # rows of one agent and setting


class FigureSpec(NamedTuple):
    """Texts of a figure, and the function that draws it; None without values."""

    title: str
    caption: str
    draw: "Callable[[Report], Figure | None]"


@dataclass(frozen=True)
class DrawnFigure:
    """A figure in the files ``name``.svg, .pdf and .png."""

    name: str
    title: str
    caption: str
    svg: bytes


def draw_figures(report: Report, folder: Path) -> list[DrawnFigure]:
    """Draw the figures that the report has values for, each as SVG, PDF and PNG."""
    from matplotlib import style

    figures = []
    with style.context(["default", _STYLE]):
        for name, spec in FIGURES.items():
            figure = spec.draw(report)
            if figure is None:
                continue
            for suffix in FILE_SUFFIXES:
                path = folder / f"{name}{suffix}"
                figure.savefig(path, metadata=_NO_DATE[suffix])
            svg = (folder / f"{name}.svg").read_bytes()
            figures.append(DrawnFigure(name, spec.title, spec.caption, svg))
    return figures


def _draw_errors(report: Report) -> "Figure":
    """Draw bADE with its interval, a panel per subset and a row per agent."""
    blocks = _main_blocks(report)
    subsets = _subsets_with(blocks, "error")
    figure, axes = _row_panels(
        len(subsets), [label_of(block["all"]) for block in blocks]
    )
    for axis, subset in zip(axes, subsets, strict=True):
        for place, block in enumerate(blocks):
            row = block[subset]
            is_reference = row.unranked_because in REFERENCES
            color = REFERENCE_COLOR if is_reference else AGENT_COLOR
            axis.plot(row.error, place, marker="o", color=color)
            if row.interval is not None:
                axis.hlines(place, *row.interval, color=color)
        axis.set(title=NAMES[subset], xlabel="bADE, m")
    return figure


def _draw_parts(report: Report) -> "Figure":
    """Draw the parts of bADE as stacked bars; negative ones extend to the left."""
    rows = [block["all"] for block in _main_blocks(report)]
    figure, (axis,) = _row_panels(1, [label_of(row) for row in rows])
    places = np.arange(len(rows))
    right_m = np.zeros(len(rows))
    left_m = np.zeros(len(rows))
    for key, name in PARTS.items():
        part_m = np.array([getattr(row, f"cost_{key}") or 0.0 for row in rows])
        start_m = np.where(part_m >= 0, right_m, left_m)
        axis.barh(places, part_m, left=start_m, color=PART_COLORS[key], label=name)
        right_m += np.maximum(part_m, 0)
        left_m += np.minimum(part_m, 0)
    axis.set(xlabel="bADE, m")
    figure.legend(loc="outside right upper")
    return figure


def _draw_hypotheses(report: Report) -> "Figure | None":
    """Draw the gain over stp by the number of hypotheses, beside the controls."""
    curves = _blocks_by_agent(report)
    swept = {agent: blocks for agent, blocks in curves.items() if len(blocks) > 1}
    if not swept:
        return None
    levels = [controls()[role] for role in HYPOTHESIS_CONTROLS]
    swept_blocks = [block for blocks in swept.values() for block in blocks]
    subsets = _subsets_with(swept_blocks, "difference_to_stp")
    figure, axes = _panels(len(subsets))
    for axis, subset in zip(axes, subsets, strict=True):
        axis.axhline(0.0, color=REFERENCE_COLOR, label="stp")
        for agent, blocks in swept.items():
            _plot_sweep(axis, agent, [block[subset] for block in blocks])
        for agent, style in zip(levels, ("--", ":"), strict=True):
            level_m = curves[agent][0][subset].difference_to_stp
            axis.axhline(level_m, color="#6000d8", linestyle=style, label=agent)
        axis.set(title=NAMES[subset], xlabel="hypotheses H")
    axes[0].set_ylabel("bADE less that of stp, m")
    _add_legend(figure, axes[0])
    return figure


def _plot_sweep(axis: Any, agent: str, rows: Sequence[Row]) -> None:
    """Plot differences to stp over hypotheses, with intervals as vertical lines."""
    counts = [row.hypotheses for row in rows]
    (line,) = axis.plot(counts, [row.difference_to_stp for row in rows], label=agent)
    for row in rows:
        if row.difference_interval is not None:
            low_m, high_m = row.difference_interval
            axis.vlines(row.hypotheses, low_m, high_m, color=line.get_color())
    axis.set_xticks(counts)


def _draw_samples(report: Report) -> "Figure":
    """Draw expected minADE over k, of the setting of each agent with most samples."""
    largest: dict[str, Details] = {}
    agents = [block["all"].agent for block in _main_blocks(report)]
    for details in sorted(report.details, key=lambda details: details.samples):
        if details.agent in agents:
            largest[details.agent] = details
    figure, (axis,) = _panels(1)
    tick_labels: dict[int, str] = {}
    for details in largest.values():
        tick_labels |= {int(k): k for k in details.k_curve}
        counts = [int(k) for k in details.k_curve]
        axis.plot(counts, list(details.k_curve.values()), label=details.agent)
    axis.set(xlabel="samples k", ylabel="expected minADE, m", xscale="log")
    axis.set_xticks(list(tick_labels), list(tick_labels.values()))
    axis.minorticks_off()
    _add_legend(figure, axis)
    return figure


def _draw_events(report: Report) -> "Figure":
    """Draw the number of each agent's own events, a panel per kind."""
    blocks = _main_blocks(report)
    by_setting = {_setting(details): details for details in report.details}
    chosen = [by_setting[_setting(block["all"])] for block in blocks]
    labels = [label_of(block["all"]) for block in blocks]
    figure, axes = _row_panels(len(_EVENT_KINDS), labels)
    for axis, kind in zip(axes, _EVENT_KINDS, strict=True):
        counts = [details.own_events[kind] for details in chosen]
        bars = axis.barh(range(len(counts)), counts, color=AGENT_COLOR)
        axis.bar_label(bars, padding=2)
        axis.margins(x=0.2)
        axis.set(title=NAMES[kind], xlabel="events")
    return figure


def _blocks_by_agent(report: Report) -> dict[str, list[Block]]:
    """Return the settings of each agent with the k samples of the environment."""
    blocks: dict[str, list[Block]] = {}
    for block in blocks_of(report):
        if block["all"].budget == "equal":
            blocks.setdefault(block["all"].agent, []).append(block)
    return blocks


def _main_blocks(report: Report) -> list[Block]:
    """Return the rows of each agent in its main setting, the lowest bADE first."""
    blocks = main_settings(report).values()
    scored = [block for block in blocks if block["all"].error is not None]
    return sorted(scored, key=lambda block: block["all"].error or 0.0)


def _subsets_with(blocks: Sequence[Block], key: str) -> list[Subset]:
    """Return the subsets on which every row has a value of ``key``."""
    return [
        subset
        for subset in _SUBSETS
        if all(getattr(block[subset], key) is not None for block in blocks)
    ]


def _setting(row: Row | Details) -> tuple[str, int, int]:
    return row.agent, row.hypotheses, row.samples


def _panels(count: int, height_in: float = 3.6) -> "tuple[Figure, Sequence[Any]]":
    """Return a figure with ``count`` axes in a row."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_WIDTH_IN, height_in), layout="constrained")
    return figure, figure.subplots(1, count, squeeze=False)[0]


def _row_panels(count: int, labels: Sequence[str]) -> "tuple[Figure, Sequence[Any]]":
    """Return a figure with ``count`` axes whose rows are agents, the first on top."""
    figure, axes = _panels(count, 1.2 + _ROW_HEIGHT_IN * len(labels))
    for axis in axes:
        axis.grid(axis="x")
        axis.set_yticks(range(len(labels)), [""] * len(labels))
        axis.set_ylim(len(labels) - 0.5, -0.5)
    axes[0].set_yticklabels(labels)
    return figure, axes


def _add_legend(figure: "Figure", axis: Any) -> None:
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
    "samples": FigureSpec(
        "Error by the number of samples",
        "Expected minADE of k random samples, over targets with a forecast. It falls "
        "with k even where samples are worthless.",
        _draw_samples,
    ),
    "events": FigureSpec(
        "Events of each agent's own tracks",
        "Numbers of identity switches, losses and re-acquisitions along the best "
        "hypothesis in the first seed, on targets or not.",
        _draw_events,
    ),
}
