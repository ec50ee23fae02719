"""Drawings of a leaderboard: intervals of differences, errors per scene, curves."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from ...core import Floats
from ...scoring import PairedDifference, Point
from .entries import Entry

# user units
WIDTH = 150.0  # of a drawing of an interval
BAR = 120.0  # width of the longest bar of a scene
PAD = 9.0  # left and right of the scale
MAX_TICKS = 5
MAX_SCENES = 40  # of an entry
_FARTHEST = 3.0  # of the median
_MARGIN = 0.04  # of a scale beyond its values, on each side
_MAX_POINTS = 50
# by whether false forecasts are known
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
        """Return the place of a value from 0 to 1; values off the scale are at an end."""
        inside = min(max(value, self.low), self.high)
        return (inside - self.low) / (self.high - self.low)

    def x(self, value: float) -> float:
        """Return the horizontal place of a value."""
        return round(PAD + self.share(value) * (WIDTH - 2 * PAD), 1)


def scale_of(entries: Sequence[Entry]) -> Scale | None:
    """Return a scale around 0 that holds the differences to STP of compared entries.

    Of all entries where none is compared. Values more than _FARTHEST times as far from
    0 as the median are left off, so that the others can be told apart.
    """
    compared = [entry for entry in entries if entry.compared and entry.difference()]
    differences = [entry.difference() for entry in compared or entries]
    limits = [
        _limits(difference) for difference in differences if difference is not None
    ]
    if not limits:
        return None
    distances = [max(abs(low), abs(high)) for low, high in limits]
    farthest = _FARTHEST * statistics.median_high(distances)
    within = [limit for pair in limits for limit in pair if abs(limit) <= farthest]
    return nice_scale(min(0.0, *within), max(0.0, *within))


def bar_of(
    scale: Scale | None, difference: PairedDifference | None
) -> dict[str, float] | None:
    """Return the bar of a difference and its interval, a point without one.

    Arrows show that it goes on below or above the scale.
    """
    if scale is None or difference is None:
        return None
    low, high = _limits(difference)
    return {
        "low": scale.x(low),
        "high": scale.x(high),
        "at": scale.x(difference.mean),
        "below": low < scale.low,
        "above": high > scale.high,
    }


def nice_scale(low: float, high: float) -> Scale:
    """Return a scale from a little below ``low`` to a little above ``high``.

    It has at least one tick, and few round ones.
    """
    span = max(high - low, 1e-3 * max(abs(high), abs(low), 1.0))
    middle = (low + high) / 2
    half = span * (0.5 + _MARGIN)
    min_step = span / (MAX_TICKS - 1)
    power = 10.0 ** math.floor(math.log10(min_step))
    steps = [factor * power for factor in (1.0, 2.0, 5.0, 10.0)]
    step = next(step for step in steps if step >= min_step * (1 - 1e-9))
    first = math.ceil((middle - half) / step)
    last = math.floor((middle + half) / step)
    ticks = tuple(round(i * step, 9) for i in range(first, last + 1))
    return Scale(middle - half, middle + half, ticks)


def _limits(difference: PairedDifference) -> tuple[float, float]:
    return difference.interval or (difference.mean, difference.mean)


def scene_chart(entry: Entry, reference: Entry | None) -> list[dict[str, Any]]:
    """Return bars of scenes, with a mark at the error of ``reference``.

    Of many scenes those MAX_SCENES with the largest sums of errors, of equal ones the
    first; in the order of the record.
    """
    errors = _scene_errors(entry)
    reference_errors: dict[str, float] = {}
    if reference is not None and reference is not entry:
        reference_errors = _scene_errors(reference)
    shown = [reference_errors[scene] for scene in errors if scene in reference_errors]
    largest = max([*errors.values(), *shown], default=0.0)
    unit = BAR / largest if largest > 0 else 0.0
    sums, targets = _scene_sums(entry)
    heaviest = np.argsort(-sums, kind="stable")[:MAX_SCENES]
    bars = []
    for index in sorted(heaviest.tolist()):
        scene = entry.record.scenes[index]
        mark = reference_errors.get(scene)
        bars.append(
            {
                "scene": scene,
                "targets": round(targets[index]),
                "error": errors.get(scene),  # m
                # user units
                "width": round(unit * errors.get(scene, 0.0), 1),
                "reference": None if mark is None else round(unit * mark, 1),
            }
        )
    return bars


def _scene_sums(entry: Entry) -> tuple[Floats, Floats]:
    """Return the sums of errors, metres, and the targets of each scene, [S] both."""
    record = entry.record
    targets = record.targets
    errors = targets.scene_sums(record.unit_error("all"))
    return errors, targets.scene_sums(record.unit_weight("all"))


def _scene_errors(entry: Entry) -> dict[str, float]:
    """Return the mean error of each scene with targets, metres."""
    sums, targets = _scene_sums(entry)
    errors = {}
    for scene, total, count in zip(entry.record.scenes, sums, targets, strict=True):
        if count > 0:
            errors[scene] = float(total / count)
    return errors


@dataclass(frozen=True)
class CurveChart:
    """The curve of one entry, and its size in user units."""

    own: Sequence[Point]
    beside: Sequence[Point]  # of STP; empty without one, and for STP itself
    most: float  # of the horizontal axis, which is one of square roots from 0
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
        """Return the horizontal place of a number of false forecasts."""
        share = math.sqrt(min(max(value, 0.0), self.most) / self.most)
        return round(self.left + share * (self.width - self.left - 1.0), 1)

    def y(self, value: float) -> float:
        """Return the vertical place of an error."""
        height = self.height - self.bottom - 2.0
        return round(1.0 + (1.0 - self.scale.share(value)) * height, 1)

    def line(self, curve: Sequence[Point]) -> str:
        """Return the points of a line; of a level stretch its two ends."""
        points = [(self.x(at), self.y(error)) for at, error in curve]
        corners = []
        for _, group in groupby(points, key=lambda point: point[1]):
            stretch = list(group)
            corners += stretch if len(stretch) == 1 else [stretch[0], stretch[-1]]
        return " ".join(f"{x:g},{y:g}" for x, y in corners)


def curve_of(entry: Entry) -> list[Point]:
    """Return numbers of false forecasts and errors; empty without such a curve."""
    return sorted(entry.record.curve)[:_MAX_POINTS]


def curve_chart(entry: Entry, reference: Entry | None) -> CurveChart | None:
    """Return the curve of an entry, with that of ``reference``; None without a curve."""
    curve = curve_of(entry)
    beside = []
    if reference is not None and reference is not entry:
        beside = curve_of(reference)
    points = [*curve, *beside]
    most = max((at for at, _ in points), default=0.0)
    if not curve or most <= 0:
        return None
    errors = [error for _, error in points]
    are_known = entry.record.env.truth_complete
    ticks = tuple(tick for tick in _TICKS[are_known] if tick <= most)
    scale = nice_scale(min(errors), max(errors))
    return CurveChart(curve, beside, most, scale, _AXIS[are_known], ticks)
