"""Drawings of a leaderboard: intervals of differences, and curves."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from ...scoring import PairedDifference, Point
from .entries import Entry

# in SVG user units
WIDTH = 150.0  # of a drawing of an interval
PAD = 9.0  # left and right of the scale
MAX_TICKS = 5
_MAX_DISTANCE = 3.0  # of a value from 0, in medians
_MARGIN = 0.04  # of a scale beyond its values, on each side
_MAX_POINTS = 50  # of a curve
_EDGE = 1.0  # user units at the end of an axis, for half the width of a line
# axes of curves where false forecasts are known, and where they are not
_KNOWN_AXIS = "false forecasts allowed per target"
_KNOWN_TICKS = (0.0, 0.2, 0.5, 1.0, 2.0, 5.0)
_FRAME_AXIS = "forecasts allowed per frame"
_FRAME_TICKS = (1.0, 5.0, 10.0, 20.0, 40.0, 80.0)


@dataclass(frozen=True)
class Scale:
    """A linear scale from ``low`` to ``high`` metres."""

    low: float
    high: float
    ticks: tuple[float, ...]

    def share(self, value: float) -> float:
        """Return the place of a value, from 0 to 1.

        Values off the scale are at an end.
        """
        inside = min(max(value, self.low), self.high)
        return (inside - self.low) / (self.high - self.low)

    def x(self, value: float) -> float:
        """Return the horizontal place of a value, in user units."""
        return round(PAD + self.share(value) * (WIDTH - 2 * PAD), 1)


def scale_of(entries: Sequence[Entry]) -> Scale | None:
    """Return a scale that holds 0 and the differences to STP.

    The differences are those of compared entries, of all entries where none is
    compared. Values more than _MAX_DISTANCE times as far from 0 as the median are left
    off, so that the others can be told apart.
    """
    compared = [e for e in entries if e.compared and e.difference is not None]
    limits = []
    for entry in compared or entries:
        if entry.difference is not None:
            limits.append(_limits(entry.difference))
    if not limits:
        return None
    distances = np.abs(limits)
    max_distance = _MAX_DISTANCE * statistics.median_high(distances.max(axis=1))
    within = np.array(limits)[distances <= max_distance].tolist()
    return nice_scale(min(0.0, *within), max(0.0, *within))


def bar_of(
    scale: Scale | None, difference: PairedDifference | None
) -> dict[str, float] | None:
    """Place a difference and its interval on a scale, in user units.

    "below" and "above" are True where the interval goes on beyond the scale. Without
    an interval both ends are the difference.
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
    """Return a scale with a margin around ``low`` and ``high``.

    It has at least one tick, and few round ones.
    """
    # equal values need a span as well
    value_span = max(high - low, 1e-3 * max(abs(high), abs(low), 1.0))
    scale_middle = (low + high) / 2
    half_span = value_span * (0.5 + _MARGIN)
    min_step = value_span / (MAX_TICKS - 1)
    power_of_ten = 10.0 ** math.floor(math.log10(min_step))
    nice_steps = [factor * power_of_ten for factor in (1.0, 2.0, 5.0, 10.0)]
    rounding = 1e-9
    tick_step = next(step for step in nice_steps if step >= min_step * (1 - rounding))
    first_tick = math.ceil((scale_middle - half_span) / tick_step)
    last_tick = math.floor((scale_middle + half_span) / tick_step) + 1
    ticks = tuple(round(i * tick_step, 9) for i in range(first_tick, last_tick))
    return Scale(scale_middle - half_span, scale_middle + half_span, ticks)


def _limits(difference: PairedDifference) -> tuple[float, float]:
    """Return the interval of a difference, without one the difference twice."""
    return difference.interval or (difference.mean, difference.mean)


@dataclass(frozen=True)
class CurveChart:
    """Error of an entry over the false forecasts allowed, drawn in user units."""

    curve: Sequence[Point]
    stp_curve: Sequence[Point]  # empty without one, and for STP itself
    # end of the horizontal axis, which begins at 0 and is scaled by square roots
    max_forecasts: float
    scale: Scale  # of the vertical axis, m
    axis: str  # text of the horizontal axis
    ticks: Sequence[float]
    width: float = 340.0
    height: float = 180.0
    left_margin: float = 34.0
    bottom_margin: float = 20.0

    @property
    def label(self) -> str:
        """The curve in words."""
        return f"error from {self.curve[0][1]:.2f} m to {self.curve[-1][1]:.2f} m"

    def x(self, forecasts: float) -> float:
        """Return the horizontal place of a number of false forecasts."""
        inside = min(max(forecasts, 0.0), self.max_forecasts)
        share = math.sqrt(inside / self.max_forecasts)
        width = self.width - self.left_margin - _EDGE
        return round(self.left_margin + share * width, 1)

    def y(self, error_m: float) -> float:
        """Return the vertical place of an error."""
        height = self.height - self.bottom_margin - 2 * _EDGE
        return round(_EDGE + (1.0 - self.scale.share(error_m)) * height, 1)

    def line(self, curve: Sequence[Point]) -> str:
        """Return ``curve`` as the points of an SVG polyline.

        Of a level stretch they are its two ends.
        """
        line_points = [
            (self.x(forecasts), self.y(error_m)) for forecasts, error_m in curve
        ]
        point_texts = []
        for _, group in groupby(line_points, key=lambda point: point[1]):
            level_points = list(group)
            # one point alone is both ends
            for x, y in dict.fromkeys((level_points[0], level_points[-1])):
                point_texts.append(f"{x:g},{y:g}")
        return " ".join(point_texts)


def curve_chart(entry: Entry, reference: Entry | None) -> CurveChart | None:
    """Return the curve of an entry, with that of ``reference``.

    None without a curve.
    """
    curve = _curve_of(entry)
    stp_curve = []
    if reference is not None and reference is not entry:
        stp_curve = _curve_of(reference)
    points = np.array([*curve, *stp_curve]).reshape(-1, 2)
    max_forecasts, max_error_m = points.max(axis=0, initial=0.0).tolist()
    if not curve or max_forecasts <= 0:
        return None
    scale = nice_scale(float(points[:, 1].min()), max_error_m)
    axis = _FRAME_AXIS
    ticks = _FRAME_TICKS
    if entry.record.env.truth_complete:
        axis = _KNOWN_AXIS
        ticks = _KNOWN_TICKS
    shown_ticks = [tick for tick in ticks if tick <= max_forecasts]
    return CurveChart(curve, stp_curve, max_forecasts, scale, axis, shown_ticks)


def _curve_of(entry: Entry) -> list[Point]:
    """Return an entry's curve: numbers of false forecasts with errors, m.

    It is empty for records without one.
    """
    return sorted(entry.record.curve)[:_MAX_POINTS]
