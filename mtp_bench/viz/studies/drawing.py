"""Look and content of every figure: colours for colour blindness and print, letters, panels as data and their drawers.

A panel holds lines, bars, dots with intervals, and levels.
"""

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ...core import Floats, toml_beside
from ...scoring import Interval

WIDTH, HEIGHT = 5.6, 3.3  # inches
DOTS = 150  # per inch, of PNG files
TEXTS = toml_beside(__file__, "texts.toml")
COLORS: dict[str, str] = TEXTS["colors"]
SERIES = ("green", "blue", "orange", "vermillion", "purple", "sky", "grey")
MARKERS: dict[str, str] = dict(zip(SERIES, "osDv^P*", strict=True))
LINES: dict[str, str] = dict(
    zip(SERIES, ("-", "-", "--", "-", ":", "-.", "--"), strict=True)
)
HATCHES = ("", "////", "..", "\\\\\\\\", "xxxx", "", "||||")
_STYLE = Path(__file__).with_name("figure.mplstyle")


@dataclass(frozen=True)
class Drawing:
    """A drawn figure."""

    title: str
    sentence: str  # what it shows
    n: str  # number of targets, objects and scenes
    wide: bool  # needs the width of the page
    svg: str  # title and sentence are its label
    png: bytes


@dataclass(frozen=True)
class Series:
    """Values with one colour and one line of the legend."""

    label: str
    x: Sequence[float]
    y: Sequence[float | None]
    color: str = "grey"
    kind: Literal["line", "bar", "dots", "level", "paper"] = (
        "line"  # "paper": figures of the paper
    )
    intervals: Sequence[Interval | None] = ()
    texts: Sequence[object] = ()  # beside the values
    style: Mapping[str, Any] = field(default_factory=dict)  # of matplotlib


@dataclass(frozen=True)
class Panel:
    """Axes with some series."""

    series: Sequence[Series]
    x: str  # labels of the axes
    y: str = ""
    ticks: Sequence[
        tuple[float, str]
    ] = ()  # along the axis of x; none: as matplotlib places them
    limits: tuple[float | None, float | None] | None = None  # of y
    stacked: bool = False  # bars lie on each other, and x goes upwards
    log: bool = False


@dataclass(frozen=True)
class Sketch:
    """Content of a figure, without its title and sentence."""

    panels: Sequence[Panel]
    size: tuple[float, float] | None = None  # width and height, inches
    rows: int = 1  # of panels
    legend: int = 3  # columns


def draw(name: str, title: str, sentence: str, n: str, sketch: Sketch) -> Drawing:
    """A figure with its texts; ``name``: of its file."""
    from matplotlib import style

    salt: Any = {
        "svg.hashsalt": name
    }  # ids are stable, and differ between figures of a page
    with style.context(
        ["default", _STYLE, salt]
    ):  # whatever file of settings is in the current folder
        from matplotlib.figure import Figure

        across = -(-len(sketch.panels) // sketch.rows)
        width, height = sketch.size or (
            WIDTH if across == 1 else WIDTH * 1.45,
            HEIGHT * sketch.rows,
        )
        canvas = Figure(figsize=(width, height), layout="constrained")
        draw_panels(
            canvas.subplots(sketch.rows, across, squeeze=False).ravel()[
                : len(sketch.panels)
            ],
            sketch,
        )
        text, png = io.StringIO(), io.BytesIO()
        about = {"Title": title, "Description": f"{sentence} n: {n}."}
        canvas.savefig(
            text,
            format="svg",
            bbox_inches="tight",
            metadata={**about, "Date": None, "Creator": None},
        )
        options: Any = {"dpi": DOTS, "pil_kwargs": {"optimize": True}}
        canvas.savefig(
            png,
            format="png",
            bbox_inches="tight",
            metadata={**about, "Software": None},
            **options,
        )
    svg = text.getvalue()
    svg = re.sub(
        r"<style[^>]*>.*?</style>", "", svg[svg.index("<svg") :], flags=re.DOTALL
    )  # pages have a style
    svg = svg.replace("'DejaVu Sans'", "system-ui, 'DejaVu Sans', sans-serif")
    label = f'<svg role="img" aria-label="{escape(f"{title}. {sentence}")}" data-figure="{name}" '
    return Drawing(
        title,
        sentence,
        n,
        width > WIDTH * 1.2,
        svg.replace("<svg ", label, 1),
        png.getvalue(),
    )


def draw_panels(axes: Any, sketch: Sketch) -> None:
    """Draw each panel of a sketch on its axes, with one legend above all: that of the panel with most entries."""
    for axis, panel in zip(axes, sketch.panels, strict=True):
        draw_panel(axis, panel)
    entries = [axis.get_legend_handles_labels() for axis in axes]
    handles, labels = max(entries, key=lambda pair: len(pair[1]))
    if labels:
        axes[0].figure.legend(
            handles,
            labels,
            loc="outside upper left",
            ncols=sketch.legend,
            borderaxespad=0.2,
            columnspacing=1.2,
            handlelength=1.8,
        )


def draw_panel(axis: Any, panel: Panel) -> None:
    """Draw the series of a panel, its ticks and labels."""
    axis.grid(axis="x" if panel.stacked else "y")
    bars = [series for series in panel.series if series.kind == "bar"]
    base = np.zeros(
        (2, max((len(series.x) for series in bars), default=0))
    )  # tops of positive and negative bars
    for series in panel.series:
        if series.kind == "bar":
            _bar(axis, panel, series, bars.index(series), len(bars), base)
        elif series.kind == "level":
            _level(axis, panel, series)
        else:
            _marks(axis, panel, series)
    if panel.log:
        axis.set_xscale("log")
        axis.minorticks_off()
    if panel.ticks:
        (axis.set_yticks if panel.stacked else axis.set_xticks)(
            *zip(*panel.ticks, strict=True)
        )
    axis.set(
        **(
            {"xlabel": panel.y, "ylabel": panel.x}
            if panel.stacked
            else {"xlabel": panel.x, "ylabel": panel.y}
        )
    )
    if any(series.texts for series in panel.series):
        axis.margins(**{"x" if panel.stacked else "y": 0.12})
    if panel.limits is not None:
        axis.set_ylim(*panel.limits)


def _bar(
    axis: Any, panel: Panel, series: Series, number: int, count: int, base: Floats
) -> None:
    value, at = np.array(series.y, dtype=float), np.array(series.x, dtype=float)
    style = {
        "color": COLORS[series.color],
        "hatch": HATCHES[number % len(HATCHES)],
        "edgecolor": "white",
    }
    style |= {"label": series.label, **series.style}
    if panel.stacked:
        axis.barh(at, value, 0.62, left=np.where(value >= 0, base[0], base[1]), **style)
        base += [np.maximum(value, 0), np.minimum(value, 0)]
        return
    at += 0.76 * ((number + 0.5) / count - 0.5)
    axis.bar(at, value, 0.72 / count if count > 1 else 0.55, **style)
    _intervals(axis, at, series.intervals, "ink")
    for place, y, text in zip(at, value, series.texts, strict=False):
        axis.text(place, y, text, ha="center", va="bottom", fontsize=8.5)


def _level(axis: Any, panel: Panel, series: Series) -> None:
    style = {
        "color": COLORS[series.color],
        "linewidth": 1.5,
        "label": series.label or None,
        **series.style,
    }
    for level in series.y:
        if level is not None:
            (axis.axvline if panel.stacked else axis.axhline)(level, **style)


def _marks(axis: Any, panel: Panel, series: Series) -> None:
    """A line or dots with intervals; the intervals of a line are a band."""
    name, color, value = (
        series.color,
        COLORS[series.color],
        np.array(series.y, dtype=float),
    )
    style: dict[str, Any] = {
        "color": color,
        "marker": MARKERS.get(name, "o"),
        "label": series.label or None,
    }
    if series.kind == "line":
        style |= {
            "linestyle": LINES.get(name, "-"),
            "markersize": 4.5,
            "linewidth": 1.7,
        }
    elif series.kind == "dots":
        style |= {"linestyle": "none", "markersize": 5}
    else:
        style |= {"linestyle": "none", "marker": "D", "markerfacecolor": "none"}
    x, y = (value, series.x) if panel.stacked else (series.x, value)
    axis.plot(x, y, **{**style, **series.style})
    for *place, text in zip(x, y, series.texts, strict=False):
        axis.annotate(
            text,
            place,
            xytext=(6, 0),
            textcoords="offset points",
            va="center",
            fontsize=8.5,
            color=color,
        )
    if series.kind == "line" and series.intervals:
        low, high = np.array(
            [pair or (np.nan, np.nan) for pair in series.intervals], dtype=float
        ).T
        axis.fill_between(series.x, low, high, color=color, alpha=0.14, linewidth=0)
    elif series.intervals:
        _intervals(axis, series.x, series.intervals, name)


def _intervals(
    axis: Any, x: Any, intervals: Sequence[Interval | None], name: str
) -> None:
    """Thin lines from the low to the high ends, where these are known."""
    known = [
        (place, *interval)
        for place, interval in zip(x, intervals, strict=False)
        if interval is not None
    ]
    if known:
        axis.vlines(*zip(*known, strict=True), color=COLORS[name], linewidth=1.2)
