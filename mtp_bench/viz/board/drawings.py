"""Drawings of a leaderboard: scales, intervals of differences, errors per scene, and errors over false forecasts."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from ...scoring import PairedDifference, Point
from .entries import Entry

WIDTH = 150.0  # of a drawing of an interval, user units
BAR = 120.0  # width of the longest bar of a scene, user units
PAD = 9.0  # left and right of the scale
MOST_TICKS = 5
FARTHEST = 3.0
MARGIN = 0.04  # of a scale beyond its values, on each side
MOST_SCENES = 40  # of an entry
_MOST_POINTS = 50
_TICKS = {
    True: (0.0, 0.2, 0.5, 1.0, 2.0, 5.0),
    False: (1.0, 5.0, 10.0, 20.0, 40.0, 80.0),
}
_AXIS = {
    True: "false forecasts allowed per target",
    False: "forecasts allowed per frame",
}


@dataclass(frozen=True)
class Scale:
    """A linear scale from ``low`` to ``high`` metres."""

    low: float
    high: float
    ticks: tuple[float, ...]

    def share(self, value: float) -> float:
        """Place of a value from 0 to 1; values off the scale stay at its ends."""
        return (min(max(value, self.low), self.high) - self.low) / (
            self.high - self.low
        )

    def x(self, value: float) -> float:
        """Horizontal place of a value."""
        return round(PAD + self.share(value) * (WIDTH - 2 * PAD), 1)


def scale_of(entries: Sequence[Entry]) -> Scale | None:
    """A scale around 0 that holds the differences to STP of the compared entries (of all, where none is).

    Values more than FARTHEST times as far from 0 as the median are left off, so that the others can be told apart.
    """
    shown = [
        entry for entry in entries if entry.compared and entry.difference()
    ] or entries
    ends = [
        _ends(difference)
        for entry in shown
        if (difference := entry.difference()) is not None
    ]
    if not ends:
        return None
    farthest = FARTHEST * statistics.median_high(
        [max(abs(low), abs(high)) for low, high in ends]
    )
    within = [
        0.0,
        *(value for pair in ends for value in pair if abs(value) <= farthest),
    ]
    return nice_scale(min(within), max(within))


def bar_of(
    scale: Scale | None, difference: PairedDifference | None
) -> dict[str, float] | None:
    """The bar of a difference and its interval, a point without one; arrows show that it goes on below or above."""
    if scale is None or difference is None:
        return None
    low, high = _ends(difference)
    places = {
        "low": scale.x(low),
        "high": scale.x(high),
        "at": scale.x(difference.mean),
    }
    return places | {"below": low < scale.low, "above": high > scale.high}


def nice_scale(low: float, high: float) -> Scale:
    """A scale from a little below ``low`` to a little above ``high``, with at least one and few round ticks."""
    span = max(high - low, 1e-3 * max(abs(high), abs(low), 1.0))
    middle, half = (low + high) / 2, span * (0.5 + MARGIN)
    least = span / (MOST_TICKS - 1)
    power = 10.0 ** math.floor(math.log10(least))
    step = next(
        factor * power
        for factor in (1.0, 2.0, 5.0, 10.0)
        if factor * power >= least * (1 - 1e-9)
    )
    first, last = math.ceil((middle - half) / step), math.floor((middle + half) / step)
    return Scale(
        middle - half,
        middle + half,
        tuple(round(i * step, 9) for i in range(first, last + 1)),
    )


def _ends(difference: PairedDifference) -> tuple[float, float]:
    return difference.interval or (difference.mean, difference.mean)


def scene_chart(entry: Entry, reference: Entry | None) -> list[dict[str, Any]]:
    """Bars of scenes, in the order of the record, with a mark at the error of ``reference`` where it has the scene.

    Of many scenes the MOST_SCENES with the largest sums of errors; of equal ones the first.
    """
    record = entry.record
    if not record.scenes:
        return []
    errors = _scene_errors(entry)
    reference_errors: dict[str, float] = {}
    if reference is not None and reference is not entry:
        reference_errors = _scene_errors(reference)
    sums = record.targets.scene_sums(record.unit_error("all"))
    targets = record.targets.scene_sums(record.unit_weight("all"))
    heaviest = np.argsort(-sums, kind="stable")[:MOST_SCENES]
    shown = [reference_errors[name] for name in errors if name in reference_errors]
    largest = max([*errors.values(), *shown], default=0.0)
    unit = BAR / largest if largest > 0 else 0.0
    bars = []
    for index in sorted(heaviest):
        scene = record.scenes[index]
        reference_error = reference_errors.get(scene)
        bars.append(
            {
                "scene": scene,
                "targets": round(targets[index]),
                "error": errors.get(scene),  # m
                "width": round(unit * errors.get(scene, 0.0), 1),  # user units
                "reference": (
                    None
                    if reference_error is None
                    else round(unit * reference_error, 1)
                ),
            }
        )
    return bars


def _scene_errors(entry: Entry) -> dict[str, float]:
    """Return the mean error of each scene with targets, metres."""
    record = entry.record
    if not record.scenes:
        return {}
    sums = record.targets.scene_sums(record.unit_error("all")).tolist()
    targets = record.targets.scene_sums(record.unit_weight("all")).tolist()
    return {
        scene: error / weight
        for scene, error, weight in zip(record.scenes, sums, targets, strict=True)
        if weight > 0
    }


@dataclass(frozen=True)
class CurveChart:
    """The curve of one entry, and its size in user units."""

    own: Sequence[Point]
    beside: Sequence[Point]  # of STP; empty without one, and for STP itself
    most: float  # of the horizontal axis, which is one of square roots: it begins at 0
    scale: Scale  # of the vertical axis, m
    axis: str  # text of the horizontal one
    ticks: tuple[float, ...]
    width: float = 340.0
    height: float = 180.0
    left: float = 34.0
    bottom: float = 20.0

    @property
    def label(self) -> str:
        """The curve in words."""
        return f"error from {self.own[0][1]:.2f} m to {self.own[-1][1]:.2f} m"

    def x(self, value: float) -> float:
        """Horizontal place of a number of false forecasts."""
        share = math.sqrt(min(max(value, 0.0), self.most) / self.most)
        return round(self.left + share * (self.width - self.left - 1.0), 1)

    def y(self, value: float) -> float:
        """Vertical place of an error."""
        return round(
            1.0 + (1.0 - self.scale.share(value)) * (self.height - self.bottom - 2.0), 1
        )

    def line(self, curve: Sequence[Point]) -> str:
        """Points of a line; of a level stretch its ends."""
        points = [(self.x(at), self.y(error)) for at, error in curve]
        stretches = [
            list(each) for _, each in groupby(points, key=lambda point: point[1])
        ]
        ends = [point for each in stretches for point in (each[0], *each[1:][-1:])]
        return " ".join(f"{x:g},{y:g}" for x, y in ends)


def curve_of(entry: Entry) -> list[Point]:
    """Numbers of false forecasts and errors in the record; empty where it has no such curve."""
    return sorted(entry.record.curve)[:_MOST_POINTS]


def curve_chart(entry: Entry, reference: Entry | None) -> CurveChart | None:
    """The curve of an entry, with that of ``reference`` beside it; None without a curve."""
    own = curve_of(entry)
    beside = [] if reference is None or reference is entry else curve_of(reference)
    points = [*own, *beside]
    most = max((at for at, _ in points), default=0.0)
    if not own or most <= 0:
        return None
    errors = [error for _, error in points]
    known = entry.record.env.truth_complete
    ticks = tuple(tick for tick in _TICKS[known] if tick <= most)
    return CurveChart(
        own, beside, most, nice_scale(min(errors), max(errors)), _AXIS[known], ticks
    )
