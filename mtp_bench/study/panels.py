"""Panels of figures, as data, and the few drawers of them: lines, bars, dots with intervals, levels and maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from ..scoring.rows import Interval
from ..types import Floats
from .drawing import GRID, SERIES, hex_color

MARKERS: dict[str, str] = dict(zip(SERIES, "osDv^P*", strict=True))
LINES: dict[str, str] = dict(zip(SERIES, ("-", "-", "--", "-", ":", "-.", "--"), strict=True))
HATCHES = ("", "////", "..", "\\\\\\\\", "xxxx", "", "||||")


@dataclass(frozen=True)
class Series:
    """Values with one colour and one line of the legend."""

    label: str
    x: Sequence[float]
    y: Sequence[float | None]
    color: str = "grey"
    kind: Literal["line", "bar", "dots", "level", "paper"] = "line"  # "paper": figures of the paper
    intervals: Sequence[Interval | None] = ()
    texts: Sequence[object] = ()  # beside the values
    style: Mapping[str, Any] = field(default_factory=dict)  # of matplotlib


@dataclass(frozen=True)
class Panel:
    """Axes with some series."""

    series: Sequence[Series]
    x: str  # labels of the axes
    y: str = ""
    ticks: Sequence[tuple[float, str]] = ()  # along the axis of x; none: as matplotlib places them
    title: str = ""
    limits: Mapping[str, tuple[float | None, float | None]] = field(default_factory=dict)  # by "x" and "y"
    across: bool = False  # x goes upwards, y to the right
    stacked: bool = False
    log: bool = False
    square: bool = False  # both axes have one scale, without grid
    small: bool = False  # letters of the ticks
    percent: bool = False  # shares of y are shown as percentages


@dataclass(frozen=True)
class Map:
    """A map with a number in each cell."""

    value: Floats  # [len(y), len(x)]; NaN leaves a cell empty
    x: Sequence[str]  # ticks
    y: Sequence[str]
    title: str
    x_label: str
    y_label: str


def draw_panels(axes: Sequence[Any], panels: Sequence[Panel | Map], legend: int = 3) -> None:
    """Draw each panel, with one legend of so many columns above all of them, of the first that has most entries."""
    for axis, panel in zip(axes, panels, strict=True):
        if isinstance(panel, Map):
            _draw_map(axis, panel)
        else:
            draw_panel(axis, panel)
    entries = [axis.get_legend_handles_labels() for axis in axes]
    handles, labels = max(entries, key=lambda pair: len(pair[1]))
    if labels and legend:
        axes[0].figure.legend(
            handles, labels, loc="outside upper left", ncols=legend, borderaxespad=0.2, columnspacing=1.2,
            handlelength=1.8,
        )  # fmt: skip


def draw_panel(axis: Any, panel: Panel) -> None:
    """Draw the series of a panel, its ticks and labels."""
    if not panel.square:
        axis.grid(axis="x" if panel.across else "y", color=GRID, linewidth=0.8)
    bars = [series for series in panel.series if series.kind == "bar"]
    base = np.zeros((2, max((len(series.x) for series in bars), default=0)))  # tops of positive and negative bars
    for series in panel.series:
        if series.kind == "bar":
            _bar(axis, panel, series, bars.index(series), len(bars), base)
        elif series.kind == "level":
            _level(axis, panel, series)
        else:
            _marks(axis, panel, series)
    xs, ys = (axis.set_yticks, axis.set_xlabel) if panel.across else (axis.set_xticks, axis.set_ylabel)
    if panel.log:
        axis.set_xscale("log")
        axis.minorticks_off()
    if panel.ticks:
        xs(*zip(*panel.ticks, strict=True), **({"fontsize": 7.5} if panel.small else {}))
    ys(panel.y)
    (axis.set_ylabel if panel.across else axis.set_xlabel)(panel.x)
    if panel.across or any(series.texts for series in bars):
        axis.margins(**{"x" if panel.across else "y": 0.12})
    if panel.square:
        axis.set_aspect("equal")
    if panel.title:
        axis.set_title(panel.title, loc="left")
    if panel.percent:
        axis.xaxis.set_major_formatter(lambda value, _: f"{100 * value:.0f}".replace("-", "−"))
    for name, limits in panel.limits.items():
        getattr(axis, f"set_{name}lim")(*limits)


def _bar(axis: Any, panel: Panel, series: Series, number: int, count: int, base: Floats) -> None:
    value = np.array(series.y, dtype=float)
    share = 1 if panel.stacked else count
    width = np.asarray(series.style.get("width", 0.76 / share if share > 1 else 0.58))
    at = np.array(series.x, dtype=float) + (0 if panel.stacked else 0.76 * ((number + 0.5) / count - 0.5))
    style = {"color": hex_color(series.color), "hatch": HATCHES[number % len(HATCHES)], "edgecolor": "white"}
    style |= {key: given for key, given in series.style.items() if key != "width"}
    start = np.where(value >= 0, base[0], base[1]) if panel.stacked else np.zeros(len(value))
    if panel.across:
        axis.barh(at, value, width, left=start, label=series.label, **style)
    else:
        axis.bar(at, value, width * 0.95, bottom=start, label=series.label, **style)
    if panel.stacked:
        base += [np.maximum(value, 0), np.minimum(value, 0)]
    _intervals(axis, panel, at, series.intervals, "ink")
    for place, y, text in zip(at, value, series.texts, strict=False):
        axis.text(place, y, text, ha="center", va="bottom", fontsize=8.5)


def _level(axis: Any, panel: Panel, series: Series) -> None:
    style = {"color": hex_color(series.color), "linewidth": 1.5, "label": series.label or None, **series.style}
    for level in series.y:
        if level is not None:
            (axis.axvline if panel.across else axis.axhline)(level, **style)


def _marks(axis: Any, panel: Panel, series: Series) -> None:
    """A line or dots with intervals; the intervals of a line are a band."""
    name, value = series.color, np.array(series.y, dtype=float)
    style: dict[str, Any] = {"color": hex_color(name), "marker": MARKERS.get(name, "o"), "label": series.label or None}
    if series.kind == "line":
        style |= {"linestyle": LINES.get(name, "-"), "markersize": 4.5, "linewidth": 1.7}
    elif series.kind == "dots":
        style |= {"linestyle": "none", "markersize": 5}
    else:
        style |= {"linestyle": "none", "marker": "D", "markerfacecolor": "none"}
    pair = (value, series.x) if panel.across else (series.x, value)
    axis.plot(*pair, **{**style, **series.style})
    for x, y, text in zip(*pair, series.texts, strict=False):
        side: Any = {"xytext": (6, 0), "va": "center"} if panel.across else {"xytext": (0, 4), "ha": "center"}
        axis.annotate(text, (x, y), textcoords="offset points", fontsize=8.5, color=hex_color(name), **side)
    if series.kind == "line" and series.intervals:
        low, high = np.array([pair or (np.nan, np.nan) for pair in series.intervals], dtype=float).T
        axis.fill_between(series.x, low, high, color=hex_color(name), alpha=0.14, linewidth=0)
    elif series.intervals:
        _intervals(axis, panel, series.x, series.intervals, name)


def _intervals(axis: Any, panel: Panel, x: Any, intervals: Sequence[Interval | None], name: str) -> None:
    """Thin lines from the low to the high ends, where these are known."""
    known = [(place, *interval) for place, interval in zip(x, intervals, strict=False) if interval is not None]
    if known:
        lines = axis.hlines if panel.across else axis.vlines
        lines(*zip(*known, strict=True), color=hex_color(name), linewidth=1.2)


def _draw_map(axis: Any, each: Map) -> None:
    import matplotlib as mpl

    value, low, high = each.value, np.nanmin(each.value), np.nanmax(each.value)
    cells, shade = np.ma.masked_invalid(value), mpl.colormaps["cividis"]
    axis.pcolormesh(cells, cmap=shade, vmin=low, vmax=high, edgecolors=hex_color("paper"), linewidth=2)
    for i, j in zip(*np.nonzero(np.isfinite(value)), strict=True):
        dark = (value[i, j] - low) / max(high - low, 1e-12) > 0.5
        ink = "#000001" if dark else "#fffffe"  # cells are the same on light and dark pages
        axis.text(j + 0.5, i + 0.5, f"{value[i, j]:.2f}", ha="center", va="center", color=ink, fontsize=9)
    axis.set_xticks(np.arange(len(each.x)) + 0.5, each.x)
    axis.set_yticks(np.arange(len(each.y)) + 0.5, each.y)
    axis.set_xlabel(each.x_label)
    axis.set_ylabel(each.y_label)
    axis.set_title(each.title, loc="left")
