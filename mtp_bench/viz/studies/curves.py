"""Curves of agents over the strength of errors of the detector."""

from collections.abc import Sequence
from pathlib import Path

from ...running import Robustness
from .figures import NO_DATE, STYLE, add_legend, panels


def draw_curves(curves: Sequence[Robustness], path: Path, dark: bool = False) -> None:
    """Draw a panel for each knob: bADE, or drive score, with bands of 95 %."""
    from matplotlib import style

    background = ["dark_background"] if dark else []
    with style.context(["default", *background, STYLE]):
        figure, axes = panels(len(curves))
        for axis, curve in zip(axes, curves, strict=True):
            rows = curve.on("all")
            for agent in dict.fromkeys(row.agent for row in rows):
                line = [
                    row
                    for row in rows
                    if row.agent == agent and row.interval is not None
                ]
                level = [row.level for row in line]
                (drawn,) = axis.plot(level, [row.value for row in line], label=agent)
                low, high = zip(*(row.interval or () for row in line), strict=True)
                axis.fill_between(
                    level, low, high, color=drawn.get_color(), alpha=0.12, linewidth=0
                )
            axis.set(title=curve.env, xlabel=curve.knob)
        axes[0].set_ylabel("drive score" if curves[0].is_drive else "bADE, m")
        add_legend(figure, axes[0])
        figure.savefig(path, metadata=NO_DATE[path.suffix])
