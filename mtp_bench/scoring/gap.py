"""How much of the gap between tracks and true pasts an agent closes (protocol, "gap closed")."""

from __future__ import annotations

from typing import NamedTuple

from numpy.typing import ArrayLike

from .statistics import Array, as_sums, paired_interval, share_interval


class Gap(NamedTuple):
    """Share of the gap that is closed."""

    closed: float  # 0: as STP, 1: as on true pasts
    interval: tuple[float, float] | None  # 95 %, over resampled scenes


def gap_closed(error: ArrayLike, stp: ArrayLike, truth: ArrayLike, targets: ArrayLike) -> Gap | None:
    """(E_STP - E) / (E_STP - E_truth) from errors without false forecasts, summed over the targets of each scene [S].

    ``error`` is of the agent, ``stp`` of STP and ``truth`` of STP on true pasts, all with the same k; ``targets`` [S]
    counts them. None where the interval of the denominator covers 0.
    """
    high: Array = as_sums("stp", stp)
    low = as_sums("truth", truth)
    interval = paired_interval(high, low, targets)
    if interval is None or interval[0] <= 0.0 <= interval[1]:
        return None
    closed, whole = high - as_sums("error", error), high - low
    return Gap(float(closed.sum() / whole.sum()), share_interval(closed, whole))
