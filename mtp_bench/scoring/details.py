"""Diagnostics of one agent: calibration, curves, bins, tracking, own events."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..cards import Card
from ..core import Bools, Floats, ShapeError
from .definitions import (
    CURVE_BUDGETS,
    DISTANCE_BINS,
    EPA_ALPHA,
    FORECAST_AP_GATES,
    PLANNING_SIGMA,
)
from .rows import Bin, Clear, Details, Errors, Reliability, Tracking
from .score import KINDS, Outcome, SceneScore
from .statistics import ratio
from .stream import StreamCounts, hota, idf1
from .table import AgentTable, run_errors

OWN = ("own_ids", "own_frag", "all_h_ids", "all_h_frag")
_COUNTS = ("truth", "tp", "fp", "fn", "ids", "frag", "cost")
_IDENTITY = ("shared", "hits", "association")
_RECALLS = 101  # points of the precision-recall curve
_LEAST = 0.1  # recall and precision below do not count, as in nuScenes detection
_RANGES = 10  # of confidence
MOST_OFF = 0.05  # by which the mean confidence may be off
_BEYOND_CHANCE = 2.58  # standard deviations, p = .01


def details(table: AgentTable, card: Card) -> Details:
    """Details of one agent over all targets."""
    setting = table.setting
    first = setting.seeds[0]
    count = len(table.miss_error)
    nearness = np.exp(
        -(table.approach**2) / (2.0 * PLANNING_SIGMA**2)
    )  # of a target to the ego
    invalid = np.sum([score.invalid for score in table.scores], axis=0).tolist()
    everything = np.ones(count, dtype=bool)
    stated = _stated(table, table.scores)
    brier, reliability = (None, []) if stated is None else calibration(*stated)
    false = sum(score.false_forecasts for score in table.scores)
    return Details(
        **setting.key,
        seeds=len(setting.seeds),
        nothing_predicted=ratio(table.miss_error.sum(), count),
        miss_rate=ratio(
            count * len(setting.seeds) - table.hit.sum(), count * len(setting.seeds)
        ),
        PI_ADE=ratio((nearness * table.capped).sum(), nearness.sum())
        if card.has_ego
        else None,
        EPA=_accuracy(table, everything, false),
        AP_f=_average_precision(table, card),
        brier=brier,
        reliability=reliability,
        forecasts_per_frame=sum(score.forecasts for score in table.scores)
        / max(table.live, 1),
        false_per_frame=ratio(false, table.live) if table.complete else None,
        curve=_curve(table),
        k_curve={
            str(k): ratio(table.curve[:, i].sum(), table.covered.sum())
            for i, k in enumerate(first[0].ks)
        },
        bins=_bins(table, card),
        own={name: _own(table, name) for name in OWN},
        own_events={
            kind: sum(score.own_events[kind] for score in first) for kind in KINDS
        },
        guessed_parents=ratio(
            sum(score.guessed_parents for score in first),
            sum(score.frames for score in first),
        ),
        tracking=_tracking([score.counts for score in first], card, table.complete),
        invalid=dict(zip(("tracks", "hypotheses", "objects"), invalid, strict=True)),
        dropped_detections=sum(score.dropped for score in table.scores),
    )


def _curve(table: AgentTable) -> list[tuple[float, float]]:
    """The error at budgets of false forecasts per target, mean over seeds; else of forecasts per live frame."""
    count, budgets = len(table.miss_error), table.budgets
    if not count:
        return []
    allowed = (
        np.array(CURVE_BUDGETS) * count
        if budgets.false_known
        else np.array([1.0, 2, 5, 10, 15, 20, 30, 40, 60, 80])
    )
    runs = [
        run_errors(run, allowed, budgets.false_known, "cuts").error.mean(axis=1)
        for run in table.setting.seeds
    ]
    at = allowed / count if budgets.false_known else allowed
    return list(zip(at.tolist(), np.mean(runs, axis=0).tolist(), strict=True))


def _stated(
    table: AgentTable, scores: Sequence[SceneScore]
) -> tuple[Floats, Bools] | None:
    """Confidences [n] of forecasts that are not neutral, and whether each is of a true object; None if unknown."""
    outcome = np.concatenate([score.outcome for score in scores])
    counted = outcome != Outcome.NEUTRAL
    if not table.complete or not counted.any():
        return None
    confidence = np.concatenate([score.cuts.confidence for score in scores])[
        counted
    ].astype(float)
    return confidence, outcome[counted] > Outcome.NEUTRAL


def calibration(confidence: Floats, there: Bools) -> tuple[float, list[Reliability]]:
    """Brier score of n confidences against ``there`` [n], of a true object, and the reliability curve."""
    place = np.minimum((confidence * _RANGES).astype(int), _RANGES - 1)
    ranges = [place == i for i in range(_RANGES)]
    curve = [
        Reliability(
            confidence=float(confidence[here].mean()),
            matched=float(there[here].mean()),
            forecasts=int(here.sum()),
        )
        for here in ranges
        if here.any()
    ]
    return float(((confidence - there) ** 2).mean()), curve


def misstated(table: AgentTable) -> tuple[float, float] | None:
    """Return the mean confidence and the share that is of a true object, of the first seed, if they do not agree.

    They differ by more than `MOST_OFF`, and by more than chance (p < .01). Forecasts of one frame count as independent,
    and those of the next frames as repetitions for a quarter of a unit, 5 s: the variance of the number of matches is
    that of independent forecasts times these frames. On nuScenes mini a false forecast of STP lasts 2.4 s (mean
    weighted by length). None if they agree, if false forecasts are not known, and if no forecast is near a
    target, since the cause lies elsewhere.
    """
    run = table.setting.seeds[0]
    stated = _stated(table, run)
    if stated is None or not table.covered.any():
        return None
    confidence, there = stated
    frames = sum(score.live for score in run) / max(
        4 * sum(score.units for score in run), 1
    )
    chance = np.sqrt((confidence * (1 - confidence)).sum() * max(1.0, frames)) / len(
        there
    )
    mean, matched = float(confidence.mean()), float(there.mean())
    return (
        (mean, matched)
        if abs(mean - matched) > max(MOST_OFF, _BEYOND_CHANCE * chance)
        else None
    )


def _accuracy(table: AgentTable, mask: Bools, false_forecasts: int) -> float | None:
    if not table.complete:
        return None
    seeds = len(table.setting.seeds)
    return end_to_end_accuracy(
        table.hit[mask].sum() / seeds, false_forecasts / seeds, int(mask.sum())
    )


def _average_precision(table: AgentTable, card: Card) -> float | None:
    """Mean over the classes with targets, over all seeds; forecasts of objects other than targets do not count."""
    if not table.complete:
        return None
    class_id, sure, outcome = (
        np.concatenate(part)
        for part in zip(
            *((s.cuts.class_id, s.cuts.confidence, s.outcome) for s in table.scores),
            strict=True,
        )
    )
    near = (
        np.concatenate([score.final_error for score in table.scores])
        <= FORECAST_AP_GATES[1]
    )
    counted = (outcome == Outcome.FALSE_POSITIVE) | (outcome == Outcome.TARGET)
    values = []
    for c in range(len(card.task.classes)):
        mine = counted & (class_id == c)
        targets = int((table.class_id == c).sum()) * len(table.setting.seeds)
        value = forecast_average_precision(near[mine], sure[mine], targets)
        if value is not None:
            values.append(value)
    return float(np.mean(values)) if values else None


def _bins(table: AgentTable, card: Card) -> list[Bin]:
    """Errors by distance to the ego (where there is one), by class, moving or static."""
    bins = []
    for low, high in pairwise(DISTANCE_BINS) if card.has_ego else ():
        name = f"{low:g}-{high:g} m" if np.isfinite(high) else f"beyond {low:g} m"
        mask = (table.distance >= low) & (table.distance < high)
        bins.append(Bin(by="distance", bin=name, errors=_errors(table, mask)))
    for c, name in enumerate(card.task.classes):
        mask = table.class_id == c
        false = sum(
            int((s.cuts.class_id[s.outcome == Outcome.FALSE_POSITIVE] == c).sum())
            for s in table.scores
        )
        accuracy = _accuracy(table, mask, false)
        bins.append(
            Bin(by="class", bin=name, errors=_errors(table, mask), EPA=accuracy)
        )
    for name, mask in (("moving", table.moving), ("static", ~table.moving)):
        bins.append(Bin(by="motion", bin=name, errors=_errors(table, mask)))
    return bins


def _errors(table: AgentTable, mask: Bools) -> Errors:
    targets, covered = int(mask.sum()), table.covered[mask].sum()

    def mean(value: Floats) -> float | None:
        return ratio(float(value[mask].sum()), targets)

    return Errors(
        minADE=ratio(table.min_ade[mask].sum(), covered),
        minFDE=ratio(table.min_fde[mask].sum(), covered),
        error=mean(table.of_all.error),
        plain_error=mean(table.capped),
        coverage=ratio(covered / len(table.setting.seeds), targets),
        targets=targets,
        objects=len(np.unique(table.person[mask])),
        scenes=len(np.unique(table.scene[mask])),
    )


def _own(table: AgentTable, name: str) -> Errors:
    """Errors where the agent itself (its first seed) has the event."""
    return _errors(
        table,
        np.concatenate([getattr(score, name) for score in table.setting.seeds[0]]),
    )


def _tracking(counts: list[StreamCounts], card: Card, complete: bool) -> Tracking:
    """Tracking numbers of all classes and per class; false output only where the truth is complete.

    A false track without a class is false in every class and in none, so then a single class has none of these numbers.
    """
    summed = {
        name: np.sum([getattr(count, name) for count in counts], axis=0)
        for name in _COUNTS
    }
    summed |= {
        name: np.sum([getattr(count.identity, name) for count in counts], axis=0)
        for name in _IDENTITY
    }
    classes, known = enumerate(card.task.classes), complete and not summed["fp"][-1]
    return Tracking(
        all=_clear(
            {name: value.sum(axis=0) for name, value in summed.items()}, card, complete
        ),
        classes={
            name: _clear({k: v[i] for k, v in summed.items()}, card, known)
            for i, name in classes
        },
        false_positives=sum(count.false_positives for count in counts)
        if complete
        else None,
        false_tracks=sum(count.false_tracks for count in counts) if complete else None,
    )


def _clear(count: dict[str, Any], card: Card, complete: bool) -> Clear:
    truth, tp, fp, fn, switches, fragments, cost = (
        float(count[name]) for name in _COUNTS
    )
    mean = ratio(cost, tp)
    return Clear(
        TP=int(tp),
        FP=int(fp) if complete else None,
        FN=int(fn),
        IDS=int(switches),
        FRAG=int(fragments),
        MOTA=1.0 - (fn + fp + switches) / truth if complete and truth else None,
        MOTP=None
        if mean is None
        else 1.0 - mean
        if card.task.event_gate.measure == "iou_3d"
        else mean,
        IDF1=idf1(float(count["shared"]), truth, tp + fp) if complete else None,
        HOTA=hota(count["hits"], count["association"], truth, tp + fp)
        if complete
        else None,
    )


def end_to_end_accuracy(
    hits: float, false_forecasts: float, targets: float
) -> float | None:
    """EPA (ViP3D, Gu et al. 2023): (hits - alpha x false forecasts) / targets; None without a target.

    A hit is a target with a matched forecast and a minFDE of at most 2 m. ViP3D matches within 2 m; the benchmark uses
    the forecast gate of its card, which is 2 m for vehicles.
    """
    return (
        float((hits - EPA_ALPHA * false_forecasts) / targets) if targets > 0 else None
    )


def forecast_average_precision(
    correct: ArrayLike, score: ArrayLike, targets: int
) -> float | None:
    """AP_f (Peri et al. 2022; Xu et al. 2024) of forecasts with a confidence; None without a target.

    ``correct`` [n]: matched to a target now (2 m), and the best final point within 4 m; ``score`` [n]. The mean of the
    precision over 101 recalls, what lies below .1 of either cut off, as nuScenes does for detection. Equal scores are
    one point of the curve, so the order of the rows does not matter; an agent without confidences has one point.
    Raises ShapeError for arrays that do not fit or more correct forecasts than targets.
    """
    right, confidence = (
        np.asarray(correct, dtype=bool),
        np.asarray(score, dtype=np.float64),
    )
    if right.ndim != 1 or right.shape != confidence.shape:
        raise ShapeError(
            f"correct has shape {right.shape} and score {confidence.shape}, expected one length for both"
        )
    if right.sum() > targets:
        raise ShapeError(
            f"{int(right.sum())} correct forecasts of {targets} targets, expected at most one each"
        )
    if targets == 0:
        return None
    if len(right) == 0:
        return 0.0
    order = np.argsort(-confidence, kind="stable")
    last = np.append(np.diff(confidence[order]) != 0, True)
    hits = np.cumsum(right[order])[last]
    precision, recall = hits / np.flatnonzero(np.append(False, last)), hits / targets
    curve = np.interp(np.linspace(0.0, 1.0, _RECALLS), recall, precision, right=0.0)
    counted = curve[round(100 * _LEAST) + 1 :]
    return float(np.maximum(counted - _LEAST, 0.0).mean() / (1.0 - _LEAST))
