"""Curves of agents over the strength of errors of the detector."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...running import Robustness
from ...scoring import numbers_of
from .figures import NO_DATE, REFERENCE_COLOR, STYLE, add_legend, panels

_PANEL_WIDTH_IN = 2.0  # words stay legible on a page that is as narrow as a phone
_LEAST_WIDTH_IN = 4.5
DARK_STYLE = STYLE.with_name("dark.mplstyle")


def draw_curves(
    curves: Sequence[Robustness],
    path: Path,
    agents: Sequence[str] | None = None,
    dark: bool = False,
) -> None:
    """Draw two panels for each knob: values, and differences to stp with 95 % bands.

    A dashed line marks the detections as recorded. ``agents``: None for all.
    """
    from matplotlib import style

    styles: list[str | Path] = ["default", STYLE]
    if dark:
        styles.append(DARK_STYLE)
    with style.context(styles):
        figure, axes = panels(len(curves), 6.0, rows=2)
        figure.set_figwidth(max(_LEAST_WIDTH_IN, _PANEL_WIDTH_IN * len(curves)))
        for curve, (above, below) in zip(curves, axes.T, strict=True):
            rows = curve.on("all")
            for agent in agents or dict.fromkeys(row.agent for row in rows):
                _draw_agent(above, below, curve, agent)
            for axis in (above, below):
                axis.axvline(curve.recorded, color=REFERENCE_COLOR, linestyle="--")
            above.set(title=curve.env.replace("-v0", ""))
            below.set(xlabel=curve.knob)
        value = "drive score" if curves[0].is_drive else "bADE, m"
        axes[0, 0].set_ylabel(value)
        axes[1, 0].set_ylabel(f"{value}, less stp")
        add_legend(figure, axes[0, 0])
        figure.savefig(path, metadata=NO_DATE[path.suffix])


def _draw_agent(above: Any, below: Any, curve: Robustness, agent: str) -> None:
    rows = [row for row in curve.on("all") if row.agent == agent]
    level = [row.level for row in rows]
    (line,) = above.plot(level, [row.value for row in rows], label=agent)
    numbers = [numbers_of(curve.difference(row, "stp")) for row in rows]
    color = line.get_color()
    below.plot(level, [mean or 0 for mean, *_ in numbers], color=color, marker="")
    ends = [interval or (np.nan, np.nan) for _, interval, _ in numbers]
    below.fill_between(level, *np.transpose(ends), color=color, alpha=0.15, linewidth=0)
