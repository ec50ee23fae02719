"""How much of the gap between tracks and true pasts each entry closes: a record alone cannot tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...scoring.statistics import paired_interval
from .entries import SUBSETS, Entry, Row, condition_of, finite

STP, TRUTH = "stp", "truth_past"
Array = NDArray[np.float64]


def with_gaps(entries: Sequence[Entry]) -> list[Entry]:
    """The entries of one environment with ``gap_closed`` in their rows, where it is not there and can be known.

    G = (E_STP - E) / (E_STP - E_truth) with the errors E without false forecasts (protocol, "gap closed"), from the
    ranked record of STP and the one that saw the truth. None where either is missing, and where the interval of the
    denominator covers 0; the false forecasts of STP, of which a record holds the sum alone, are taken there to be
    spread evenly over the targets.
    """
    stp = next((e for e in entries if e.name == STP and e.rank is not None), None)
    truth = next((e for e in entries if e.name == TRUTH and e.record["status"] == "finished"), None)
    if stp is None or truth is None or condition_of(stp) != condition_of(truth):
        return list(entries)
    known = [subset for subset in ("all", *SUBSETS) if _differ(stp.record, truth.record, subset)]
    return [_filled(entry, stp, truth, known) if _alike(entry, stp) else entry for entry in entries]


def _alike(entry: Entry, stp: Entry) -> bool:
    same = condition_of(entry) == condition_of(stp) and entry.record["status"] == "finished"
    return same and entry.row().get("samples") == stp.row().get("samples")


def _filled(entry: Entry, stp: Entry, truth: Entry, known: Sequence[str]) -> Entry:
    rows = [
        {**row, "gap_closed": _gap(entry, stp, truth, row["subset"])}
        if row.get("gap_closed") is None and row["subset"] in known
        else row
        for row in entry.record.get("rows") or ()
    ]
    return replace(entry, record={**entry.record, "rows": rows})


def _gap(entry: Entry, stp: Entry, truth: Entry, subset: str) -> float | None:
    here, high, low = (_error(e, subset) for e in (entry, stp, truth))
    return None if here is None or high is None or low is None or high == low else (high - here) / (high - low)


def _error(entry: Entry, subset: str) -> float | None:
    """Mean over the targets of min(minADE, c), c where missing."""
    error = entry.number("missing_aware", subset)
    return error if error is None or subset != "all" else error - _false(entry.record)


def _false(record: Row) -> float:
    """The part of the error over all targets that false forecasts make, metres."""
    return finite(((record.get("details") or {}).get("parts") or {}).get("false")) or 0.0


def _differ(stp: Row, truth: Row, subset: str) -> bool:
    """Whether the interval of E_STP - E_truth does not cover 0."""
    count = _count(stp, subset)
    if not np.array_equal(count, _count(truth, subset)) or count.sum() == 0:
        return False
    high, low = (_sums(record, subset) for record in (stp, truth))
    interval = paired_interval(high, low, count)
    return interval is not None and not interval[0] <= 0.0 <= interval[1]


def _count(record: Row, subset: str) -> Array:
    return np.array([scene["counts"].get(subset, 0) for scene in record["per_scene"]], dtype=np.float64)


def _sums(record: Row, subset: str) -> Array:
    """Errors without false forecasts summed per scene [S], mean over seeds."""
    sums = np.array([_mean(scene["errors"], subset) for scene in record["per_scene"]])
    return sums - _false(record) * _count(record, subset) if subset == "all" else sums


def _mean(errors: Mapping[str, Sequence[float]], subset: str) -> float:
    return float(np.mean(errors[subset])) if errors.get(subset) else 0.0
