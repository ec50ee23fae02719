"""Correlations of scores, errors, misses and false positives of a detector, real or simulated.

These figures say what a tracker meets: whether a low score tells of a large error or of a miss to come, whether
neighbours fail together, whether false positives stand in groups and stay.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mtp_bench.core import Bools, Floats, Ints
from mtp_bench.core.geometry import rotate
from mtp_bench.training.detector_fit.samples import FalsePositiveSamples, ObjectSamples

DISTANCES = (
    0.0,
    20.0,
    40.0,
    60.0,
    80.0,
)  # m, ends of the bins that recall, score and error are given for
_NARROW = 10.0  # m, width of the bins within which scores and misses are compared
_FEW = 30  # rows or pairs from which a figure is taken
_BOUND = 0.5  # m: one wild error does not make a correlation
_CLOSE, _APART = 5.0, 10.0  # m, between neighbours
_TOGETHER = 3.0  # m, between false positives
_SAME_PLACE = 1.0  # m: a false positive that near in the next frame is the same one
_LONG = 3  # frames


@dataclass(frozen=True)
class Couplings:
    """Figures of one class; NaN where there is too little to measure."""

    score_and_error: (
        float  # Spearman of score and centre error, mean over bins of distance
    )
    miss_ahead: float  # AUC of a low score now for a miss in the next frame, mean over bins of distance
    misses_together: float  # correlation of misses of pairs 5 to 10 m apart, less what distance explains
    errors_together: float  # correlation of position errors of pairs nearer than 5 m
    change: float  # m, median change of the position error between frames
    false_together: float  # share of false positives with another one within 3 m
    false_long: (
        float  # share of false positives that are seen in 3 frames on end or more
    )
    duplicates: float  # per 1 000 hits
    false_per_frame: float
    recall: tuple[float, ...]  # by distance
    score: tuple[float, ...]  # mean of hits, by distance
    error: tuple[float, ...]  # m, median centre error, by distance


def couplings(objects: ObjectSamples, false: FalsePositiveSamples) -> Couplings:
    """Figures of one class."""
    distance, hits = 10 * objects.feature[:, 1], max(int(objects.hit.sum()), 1)
    error = np.hypot(objects.error[:, 0], objects.error[:, 1])
    miss, undetected = (~objects.hit).astype(np.float64), np.zeros(len(distance))
    for rows in _bins(distance, np.arange(0.0, DISTANCES[-1] + _NARROW, _NARROW)):
        undetected[rows] = miss[rows].mean() if len(rows) else 0.0
    wide = _bins(distance, np.array(DISTANCES))
    return Couplings(
        score_and_error=_score_and_error(objects, error, wide),
        miss_ahead=_miss_ahead(objects, distance),
        misses_together=_correlation(
            miss - undetected, *_pairs(objects, _CLOSE, _APART)
        ),
        errors_together=_errors_together(objects),
        change=_change(objects),
        false_together=_share(_together(false)),
        false_long=_share(lives(false) >= _LONG),
        duplicates=1000.0 * float(false.duplicate.sum()) / hits,
        false_per_frame=float(false.count.mean()),
        recall=tuple(_share(objects.hit[rows]) for rows in wide),
        score=tuple(
            _of_hits(objects.score, objects.hit, rows, np.mean) for rows in wide
        ),
        error=tuple(_of_hits(error, objects.hit, rows, np.median) for rows in wide),
    )


def _bins(distance: Floats, end: Floats) -> list[Ints]:
    """Rows of every bin."""
    number = np.digitize(distance, end) - 1
    return [np.flatnonzero(number == one) for one in range(len(end) - 1)]


def _share(yes: Bools) -> float:
    return float(yes.mean()) if len(yes) >= _FEW else float("nan")


def _of_hits(
    value: Floats, hit: Bools, rows: Ints, middle: Callable[[Floats], Any]
) -> float:
    rows = rows[hit[rows]]
    return float(middle(value[rows])) if len(rows) >= _FEW else float("nan")


def _weighted(value: list[float], weight: list[int]) -> float:
    return float(np.average(value, weights=weight)) if value else float("nan")


def _score_and_error(objects: ObjectSamples, error: Floats, bins: list[Ints]) -> float:
    from scipy.stats import rankdata

    found = [rows[objects.hit[rows]] for rows in bins]
    found = [
        rows for rows in found if len(rows) >= _FEW and np.ptp(objects.score[rows]) > 0
    ]
    return _weighted(
        [_plain(rankdata(objects.score[r]), rankdata(error[r])) for r in found],
        [len(r) for r in found],
    )


def _plain(one: Floats, other: Floats) -> float:
    return float(np.corrcoef(one, other)[0, 1])


def _miss_ahead(objects: ObjectSamples, distance: Floats) -> float:
    from scipy.stats import rankdata

    earlier, later = objects.pairs()
    earlier, later = earlier[objects.hit[earlier]], later[objects.hit[earlier]]
    value, weight = [], []
    for rows in _bins(
        distance[earlier], np.arange(0.0, DISTANCES[-1] + _NARROW, _NARROW)
    ):
        miss = ~objects.hit[later[rows]]
        count = int(miss.sum())
        if count and count < len(rows) and np.ptp(objects.score[earlier[rows]]) > 0:
            rank = rankdata(-objects.score[earlier[rows]])
            value.append(
                (rank[miss].sum() - count * (count + 1) / 2)
                / (count * (len(rows) - count))
            )
            weight.append(count)
    return _weighted(value, weight) if sum(weight) >= _FEW else float("nan")


def _pairs(
    objects: ObjectSamples, nearest: float, farthest: float
) -> tuple[Ints, Ints]:
    """Pairs of rows of a frame, by their distance."""
    from scipy.spatial import KDTree

    if not len(objects.place):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    width = int(objects.frame.max()) + 1
    apart = np.column_stack(
        [objects.place, 2 * farthest * (objects.scene * width + objects.frame)]
    )
    pairs = KDTree(apart).query_pairs(farthest, output_type="ndarray").reshape(-1, 2)
    off = np.hypot(*(objects.place[pairs[:, 0]] - objects.place[pairs[:, 1]]).T)
    return pairs[off > nearest, 0], pairs[off > nearest, 1]


def _correlation(value: Floats, one: Ints, other: Ints) -> float:
    """Of both members of pairs; each pair counts in both directions."""
    if len(one) < _FEW:
        return float("nan")
    first, second = (
        np.append(value[one], value[other]),
        np.append(value[other], value[one]),
    )
    return float(np.corrcoef(first, second)[0, 1])


def _errors_together(objects: ObjectSamples) -> float:
    one, other = _pairs(objects, 0.0, _CLOSE)
    both = objects.hit[one] & objects.hit[other]
    off = np.clip(rotate(objects.error[:, :2], objects.direction), -_BOUND, _BOUND)
    of_x = _correlation(off[:, 0], one[both], other[both])
    return (of_x + _correlation(off[:, 1], one[both], other[both])) / 2


def _change(objects: ObjectSamples) -> float:
    earlier, later = objects.hit_pairs()
    off = rotate(objects.error[:, :2], objects.direction)
    return (
        float(np.median(np.hypot(*(off[later] - off[earlier]).T)))
        if len(earlier) >= _FEW
        else float("nan")
    )


def _together(false: FalsePositiveSamples) -> Bools:
    """Which have another one within 3 m ``[D]``."""
    from scipy.spatial import KDTree

    moment = 10.0 * (false.scene * 1e5 + false.frame)
    at = np.column_stack([false.place, moment])
    if not len(at):
        return np.zeros(0, dtype=bool)
    return np.asarray(
        KDTree(at).query_ball_point(at, _TOGETHER, return_length=True) > 1
    )


def lives(false: FalsePositiveSamples) -> Ints:
    """For each the number of frames on end in which it is seen ``[D]``: chains of pairs within 1 m, one to one."""
    following = np.full(len(false.frame), -1)
    previous = np.full(len(false.frame), -1)
    moment = false.scene * 100_000 + false.frame
    order = np.argsort(moment, kind="stable")
    start = np.flatnonzero(np.diff(moment[order], prepend=-2))
    groups = np.split(order, start[1:])
    for here, there in itertools.pairwise(groups):
        if moment[there[0]] == moment[here[0]] + 1:
            one, other = _same(false.place[here], false.place[there])
            following[here[one]], previous[there[other]] = there[other], here[one]
    length = np.zeros(len(following), dtype=np.int64)
    for first in np.flatnonzero(previous < 0):
        chain = [int(first)]
        while following[chain[-1]] >= 0:
            chain.append(int(following[chain[-1]]))
        length[chain] = len(chain)
    return length


def _same(here: Floats, there: Floats) -> tuple[Ints, Ints]:
    """Pairs within 1 m, nearest first, each in one pair at most."""
    off = np.hypot(
        here[:, None, 0] - there[None, :, 0], here[:, None, 1] - there[None, :, 1]
    )
    one, other = np.nonzero(off <= _SAME_PLACE)
    pairs: dict[int, int] = {}
    taken: set[int] = set()
    for number in np.argsort(off[one, other], kind="stable"):
        a, b = int(one[number]), int(other[number])
        if a not in pairs and b not in taken:
            pairs[a] = b
            taken.add(b)
    return np.array(list(pairs), dtype=np.int64), np.array(
        list(pairs.values()), dtype=np.int64
    )
