"""The figures of a study: each is drawn from a table, with units, n and a sentence."""

from __future__ import annotations

from collections.abc import Callable

from ..findings import Findings
from ..table import Tables
from .bars import causes_figure, frequency_figure, gaps_figure, pasts_figure, people_figure
from .bins import age_figure, bins_figure, since_figure
from .events import distance_figure, frames_figure, shared_figure
from .lines import (
    budgets_figure,
    calibration_figure,
    cuts_figure,
    gain_figure,
    k_figure,
    ranked_figure,
    speed_figure,
)
from .style import Figure as Figure
from .surface import surface_figure

Draw = Callable[[Findings, Tables], Figure | None]  # None: nothing of it is known
DRAWN: tuple[tuple[str, Draw], ...] = (  # the table that a figure needs, and who draws it
    ("pasts", pasts_figure),
    ("frequency", frequency_figure),
    ("distance", distance_figure),
    ("targeted", gain_figure),
    ("global", ranked_figure),
    ("shared", shared_figure),
    ("frames", frames_figure),
    ("speed", speed_figure),
    ("surface", surface_figure),
    ("k_curve", k_figure),
    ("causes", causes_figure),
    ("gaps", gaps_figure),
    ("since", since_figure),
    ("age", age_figure),
    ("bins", bins_figure),
    ("budgets", budgets_figure),
    ("calibration", calibration_figure),
    ("cuts", cuts_figure),
    ("people", people_figure),
)


def make_figures(found: Findings, tables: Tables) -> dict[str, Figure]:
    """Every figure of which something is known, by name."""
    figures = [make(found, tables) for name, make in DRAWN if name in tables]
    return {figure.name: figure for figure in figures if figure is not None}
