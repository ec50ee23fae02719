"""The error over allowed false forecasts, drawn: small in the row of an entry, larger in its details."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from pydantic import TypeAdapter, ValidationError

from ...scoring.rows import Point
from .entries import Entry
from .scale import Scale, nice_scale

_POINTS = TypeAdapter(list[Point])
_MOST_POINTS = 50
_LARGEST = 1e9  # of what is drawn: a record may say anything here
_TICKS = {True: (0.0, 0.2, 0.5, 1.0, 2.0, 5.0), False: (1.0, 5.0, 10.0, 20.0, 40.0, 80.0)}
_LABEL = {True: "false forecasts allowed per target", False: "forecasts allowed per frame"}


@dataclass(frozen=True)
class Frame:
    """A drawing of curves: its size in user units, and what its axes reach to."""

    width: float
    height: float
    left: float
    bottom: float
    most: float  # of the horizontal axis, which is one of square roots: it begins at 0
    scale: Scale  # of the vertical axis, m

    def x(self, value: float) -> float:
        """Where a number of false forecasts is drawn."""
        share = math.sqrt(min(max(value, 0.0), self.most) / self.most)
        return round(self.left + share * (self.width - self.left - 1.0), 1)

    def y(self, value: float) -> float:
        """Where an error is drawn."""
        share = (min(max(value, self.scale.low), self.scale.high) - self.scale.low) / (self.scale.high - self.scale.low)
        return round(1.0 + (1.0 - share) * (self.height - self.bottom - 2.0), 1)

    def line(self, curve: Sequence[Point]) -> str:
        """Points of a line; of a level stretch its ends."""
        points = [(self.x(at), self.y(error)) for at, error in curve]
        stretches = [list(each) for _, each in groupby(points, key=lambda point: point[1])]
        ends = [point for each in stretches for point in (each[0], *each[1:][-1:])]
        return " ".join(f"{x:g},{y:g}" for x, y in ends)


@dataclass(frozen=True)
class CurveChart:
    """The larger drawing of one entry."""

    frame: Frame
    label: str  # of the horizontal axis
    ticks: tuple[float, ...]
    own: str
    reference: str  # of STP; empty where there is none, or the entry is STP


def curve_of(entry: Entry) -> list[Point]:
    """False forecasts and errors of the record, as its scorer wrote them; empty where it has no such curve."""
    try:
        curve = _POINTS.validate_python(entry.record.details.get("curve", []))
    except ValidationError:
        return []
    sound = all(0 <= number <= _LARGEST for point in curve for number in point)
    return sorted(curve)[:_MOST_POINTS] if sound else []


def small_frame(entries: Sequence[Entry]) -> Frame | None:
    """The frame that all small drawings of one environment share; None without a curve."""
    shown = [entry for entry in entries if entry.compared] or entries  # what is not may have any error
    return _frame([curve_of(entry) for entry in shown], 64.0, 20.0, 1.0, 0.0)


def curve_chart(entry: Entry, reference: Entry | None) -> CurveChart | None:
    """The larger drawing of an entry, with the curve of ``reference`` beside it; None without a curve."""
    own = curve_of(entry)
    beside = [] if reference is None or reference is entry else curve_of(reference)
    frame = _frame([own, beside], 340.0, 180.0, 34.0, 20.0)
    if frame is None or not own:
        return None
    known = entry.record.env.truth_complete
    ticks = tuple(tick for tick in _TICKS[known] if tick <= frame.most)
    return CurveChart(frame, _LABEL[known], ticks, frame.line(own), frame.line(beside))


def _frame(curves: Sequence[list[Point]], width: float, height: float, left: float, bottom: float) -> Frame | None:
    most = max((at for curve in curves for at, _ in curve), default=0.0)
    if most <= 0:
        return None
    errors = [error for curve in curves for _, error in curve]
    return Frame(width, height, left, bottom, most, nice_scale(min(errors), max(errors)))
