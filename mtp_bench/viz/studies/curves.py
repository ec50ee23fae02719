"""Curves of agents over the strength of errors of the detector."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...cards import PerturbSection
from ...running import LevelRow, Robustness
from .figures import NO_DATE, REFERENCE_COLOR, STYLE, add_legend, panels


def draw_curves(curves: Sequence[Robustness], path: Path, dark: bool = False) -> None:
    """Draw two panels for each knob: values, and differences to stp with 95 % bands.

    A dashed line marks the detections as recorded.
    """
    from matplotlib import style

    background = ["dark_background"] if dark else []
    with style.context(["default", *background, STYLE]):
        figure, axes = panels(len(curves), 6.0, rows=2)
        for curve, (above, below) in zip(curves, axes.T, strict=True):
            rows = curve.on("all")
            for agent in dict.fromkeys(row.agent for row in rows):
                _draw_agent(above, below, [row for row in rows if row.agent == agent])
            for axis in (above, below):
                recorded = getattr(PerturbSection(), curve.knob)
                axis.axvline(recorded, color=REFERENCE_COLOR, linestyle="--")
            above.set(title=f"{curve.env}, {curve.knob}")
            below.set(xlabel=curve.knob)
        value = "drive score" if curves[0].is_drive else "bADE, m"
        axes[0, 0].set_ylabel(value)
        axes[1, 0].set_ylabel(f"{value}, less that of stp")
        add_legend(figure, axes[0, 0])
        figure.savefig(path, metadata=NO_DATE[path.suffix])


def _draw_agent(above: Any, below: Any, rows: Sequence[LevelRow]) -> None:
    level = [row.level for row in rows]
    (line,) = above.plot(level, [row.value for row in rows], label=rows[0].agent)
    below.plot(level, [row.stp for row in rows], color=line.get_color(), marker="")
    known = [row for row in rows if row.stp_interval is not None]
    if known:
        low, high = zip(*(row.stp_interval or () for row in known), strict=True)
        band = {"color": line.get_color(), "alpha": 0.15, "linewidth": 0}
        below.fill_between([row.level for row in known], low, high, **band)
