"""Drawings of a leaderboard: intervals of differences."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...scoring import PairedDifference
from .entries import Entry

# in SVG user units
WIDTH = 150.0  # of a drawing of an interval
PAD = 9.0  # left and right of the scale
MAX_TICKS = 5
_MAX_DISTANCE = 3.0  # of a value from 0, in medians
_MARGIN = 0.04  # of a scale beyond its values, on each side


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
