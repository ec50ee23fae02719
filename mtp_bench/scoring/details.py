"""Diagnostics of one agent: calibration, curves, bins, tracking, own events."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..cards import Card
from ..core import Bools, Floats
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
from .table import AgentTable, join_scenes, run_errors

OWN_SUBSETS = ("own_ids", "own_frag", "all_h_ids", "all_h_frag")
# forecasts per live frame, where false ones cannot be known
_FRAME_BUDGETS = (1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 60.0, 80.0)
_COUNTS = ("truth", "tp", "fp", "fn", "ids", "frag", "cost")
_IDENTITY_COUNTS = ("shared", "hits", "association")
_RECALLS = 101  # points of the precision-recall curve
# recall and precision below do not count, as in nuScenes detection
_MIN_PRECISION = 0.1
_RANGES = 10  # of confidence
MAX_BIAS = 0.05  # by which the mean confidence may be off
_BEYOND_CHANCE = 2.58  # standard deviations, p = .01


def details(table: AgentTable, card: Card) -> Details:
    """Return the details of one agent over all targets."""
    setting = table.setting
    first_run = setting.seeds[0]
    scores = table.scores
    seeds = len(setting.seeds)
    targets = len(table.miss_error)
    nearness = np.exp(-(table.approach**2) / (2.0 * PLANNING_SIGMA**2))  # to the ego
    planning_error = ratio((nearness * table.capped).sum(), nearness.sum())
    false_forecasts = sum(score.false_forecasts for score in scores)
    forecasts = sum(score.forecasts for score in scores)
    confidences = _confidences(table, scores)
    brier, reliability = calibration(*confidences) if confidences else (None, [])
    invalid = np.sum([score.invalid for score in scores], axis=0).tolist()
    tracking = _no_tracking(card)
    if table.has_tracks:
        counts = [score.counts for score in first_run]
        tracking = _tracking(counts, card, table.complete)
    return Details(
        **setting.key,
        seeds=seeds,
        nothing_predicted=ratio(table.miss_error.sum(), targets),
        miss_rate=ratio(targets * seeds - table.hit.sum(), targets * seeds),
        PI_ADE=planning_error if card.has_ego else None,
        EPA=_accuracy(table, np.ones(targets, dtype=bool), false_forecasts),
        AP_f=_average_precision(table, card),
        brier=brier,
        reliability=reliability,
        forecasts_per_frame=forecasts / max(table.live, 1),
        false_per_frame=(
            ratio(false_forecasts, table.live) if table.complete else None
        ),
        curve=_curve(table),
        k_curve=_k_curve(table, first_run[0].ks),
        bins=_bins(table, card),
        **_own_fields(table, first_run),
        tracking=tracking,
        invalid=dict(zip(("tracks", "hypotheses", "objects"), invalid, strict=True)),
        dropped_detections=sum(score.dropped for score in scores),
    )


def _k_curve(table: AgentTable, ks: Sequence[int]) -> dict[str, float | None]:
    covered = table.covered.sum()
    sums = [table.curve[:, i].sum() for i in range(len(ks))]
    return {str(k): ratio(total, covered) for k, total in zip(ks, sums, strict=True)}


def _own_fields(table: AgentTable, run: Sequence[SceneScore]) -> dict[str, Any]:
    """Return fields of a `Details` on the events of the agent itself in one run.

    Undefined without tracks: None.
    """
    if not table.has_tracks:
        return {
            "own": dict.fromkeys(OWN_SUBSETS),
            "own_events": dict.fromkeys(KINDS),
            "guessed_parents": None,
        }
    own_events = {}
    for kind in KINDS:
        own_events[kind] = sum(score.own_events[kind] for score in run)
    guessed_parents = sum(score.guessed_parents for score in run)
    return {
        "own": {name: _errors(table, join_scenes(run, name)) for name in OWN_SUBSETS},
        "own_events": own_events,
        "guessed_parents": ratio(guessed_parents, sum(score.frames for score in run)),
    }


def _curve(table: AgentTable) -> list[tuple[float, float]]:
    """Return pairs of budget and error, m, mean over seeds.

    Budgets are false forecasts per target, or forecasts per live frame where false ones
    are not known.
    """
    targets = len(table.miss_error)
    if not targets:
        return []
    false_known = table.budgets.false_known
    rates = np.array(CURVE_BUDGETS if false_known else _FRAME_BUDGETS)
    allowed = rates
    if false_known:
        allowed = rates * targets
        rates = allowed / targets  # of these budgets, up to rounding
    errors = [
        run_errors(run, allowed, false_known).error.mean(axis=1)
        for run in table.setting.seeds
    ]
    return list(zip(rates.tolist(), np.mean(errors, axis=0).tolist(), strict=True))


def _confidences(
    table: AgentTable, scores: Sequence[SceneScore]
) -> tuple[Floats, Bools] | None:
    """Return confidences [n] of forecasts, and whether each is of a true object.

    Neutral forecasts are left out. None without any other, and if the truth is not
    complete.
    """
    outcome = join_scenes(scores, "outcome")
    counted = outcome != Outcome.NEUTRAL
    if not table.complete or not counted.any():
        return None
    confidence = np.concatenate([score.cuts.confidence for score in scores])
    # above: NON_TARGET and TARGET
    return confidence[counted].astype(float), outcome[counted] > Outcome.NEUTRAL


def calibration(confidence: Floats, matched: Bools) -> tuple[float, list[Reliability]]:
    """Return the Brier score of n confidences, and the reliability curve.

    ``matched`` [n]: it is of a true object.
    """
    range_index = np.minimum((confidence * _RANGES).astype(int), _RANGES - 1)
    curve = []
    for i in np.unique(range_index):
        in_range = range_index == i
        curve.append(
            Reliability(
                confidence=float(confidence[in_range].mean()),
                matched=float(matched[in_range].mean()),
                forecasts=int(in_range.sum()),
            )
        )
    return float(((confidence - matched) ** 2).mean()), curve


def misstated(table: AgentTable) -> tuple[float, float] | None:
    """Return the mean confidence, and the share of true forecasts.

    They are of the first seed. None unless the two differ by more than `MAX_BIAS`, and
    by more than chance (p < .01). Forecasts of one frame count as independent, and
    those of the next frames as repetitions for a quarter of a unit, 5 s: the variance
    of the number of matches is that of independent forecasts times these frames. On
    nuScenes mini a false forecast of STP lasts 2.4 s (mean weighted by length). None
    also if false forecasts cannot be known, and if no forecast is near a target, since
    the cause lies elsewhere then.
    """
    run = table.setting.seeds[0]
    confidences = _confidences(table, run)
    if confidences is None or not table.covered.any():
        return None
    confidence, matched = confidences
    live_frames = sum(score.live for score in run)
    # frames of a quarter of a unit
    repetitions = max(1.0, live_frames / max(4 * sum(score.units for score in run), 1))
    variance = (confidence * (1 - confidence)).sum() * repetitions
    deviation = np.sqrt(variance) / len(matched)
    mean_confidence = float(confidence.mean())
    matched_share = float(matched.mean())
    bias = abs(mean_confidence - matched_share)
    if bias > max(MAX_BIAS, _BEYOND_CHANCE * deviation):
        return mean_confidence, matched_share
    return None


def _accuracy(table: AgentTable, mask: Bools, false_forecasts: int) -> float | None:
    """Return EPA over the targets of a ``mask``, mean over seeds."""
    if not table.complete:
        return None
    seeds = len(table.setting.seeds)
    hits = table.hit[mask].sum()
    return end_to_end_accuracy(hits / seeds, false_forecasts / seeds, int(mask.sum()))


def _average_precision(table: AgentTable, card: Card) -> float | None:
    """Return AP_f, mean over the classes with targets, over all seeds.

    Forecasts of objects other than targets do not count.
    """
    if not table.complete:
        return None
    scores = table.scores
    class_id = np.concatenate([score.cuts.class_id for score in scores])
    confidence = np.concatenate([score.cuts.confidence for score in scores])
    outcome = join_scenes(scores, "outcome")
    correct = join_scenes(scores, "final_error") <= FORECAST_AP_GATES[1]
    counted = (outcome == Outcome.FALSE_POSITIVE) | (outcome == Outcome.TARGET)
    values = []
    for c in range(len(card.task.classes)):
        rows = counted & (class_id == c)
        targets = int((table.class_id == c).sum()) * len(table.setting.seeds)
        value = forecast_average_precision(correct[rows], confidence[rows], targets)
        if value is not None:
            values.append(value)
    return float(np.mean(values)) if values else None


def _bins(table: AgentTable, card: Card) -> list[Bin]:
    """Return errors by distance to the ego (if there is one), class and motion."""
    bins = []
    for low, high in pairwise(DISTANCE_BINS) if card.has_ego else ():
        name = f"{low:g}-{high:g} m" if np.isfinite(high) else f"beyond {low:g} m"
        mask = (table.distance >= low) & (table.distance < high)
        bins.append(Bin(by="distance", bin=name, errors=_errors(table, mask)))
    scores = table.scores
    false_positive = join_scenes(scores, "outcome") == Outcome.FALSE_POSITIVE
    false_class = np.concatenate([score.cuts.class_id for score in scores])
    false_class = false_class[false_positive]
    for c, name in enumerate(card.task.classes):
        mask = table.class_id == c
        accuracy = _accuracy(table, mask, int((false_class == c).sum()))
        errors = _errors(table, mask)
        bins.append(Bin(by="class", bin=name, errors=errors, EPA=accuracy))
    for name, mask in (("moving", table.moving), ("static", ~table.moving)):
        bins.append(Bin(by="motion", bin=name, errors=_errors(table, mask)))
    return bins


def _errors(table: AgentTable, mask: Bools) -> Errors:
    targets = int(mask.sum())
    covered = table.covered[mask].sum()
    return Errors(
        minADE=ratio(table.min_ade[mask].sum(), covered),
        minFDE=ratio(table.min_fde[mask].sum(), covered),
        error=ratio(table.of_all.error[mask].sum(), targets),
        plain_error=ratio(table.capped[mask].sum(), targets),
        coverage=ratio(covered / len(table.setting.seeds), targets),
        targets=targets,
        objects=len(np.unique(table.person[mask])),
        scenes=len(np.unique(table.scene[mask])),
    )


def _no_tracking(card: Card) -> Tracking:
    """Return the tracking numbers of an agent without tracks: all are undefined."""
    undefined = Clear(**dict.fromkeys(Clear.model_fields))
    classes = dict.fromkeys(card.task.classes, undefined)
    return Tracking(
        all=undefined, classes=classes, false_positives=None, false_tracks=None
    )


def _tracking(counts: list[StreamCounts], card: Card, complete: bool) -> Tracking:
    """Return the tracking numbers of all classes and per class.

    None stands for numbers of false output unless the truth is ``complete``. It does so
    for single classes too if a false track is without a class: it may be of any.
    """
    sums = _summed(counts, _COUNTS)
    sums |= _summed([count.identity for count in counts], _IDENTITY_COUNTS)
    overall = {name: value.sum(axis=0) for name, value in sums.items()}
    # the last entry: tracks without a class
    class_complete = complete and not sums["fp"][-1]
    classes = {}
    for i, class_name in enumerate(card.task.classes):
        of_class = {name: value[i] for name, value in sums.items()}
        classes[class_name] = _clear(of_class, card, class_complete)
    false_output: dict[str, int | None] = {}
    for name in ("false_positives", "false_tracks"):
        total = sum(getattr(count, name) for count in counts)
        false_output[name] = total if complete else None
    return Tracking(
        all=_clear(overall, card, complete), classes=classes, **false_output
    )


def _summed(counts: Sequence[Any], names: Sequence[str]) -> dict[str, Any]:
    """Return the sums over scenes of the attributes of these names."""
    return {
        name: np.sum([getattr(count, name) for count in counts], axis=0)
        for name in names
    }


def _clear(count: dict[str, Any], card: Card, complete: bool) -> Clear:
    truth, tp, fp, fn, switches, fragments, cost = (
        float(count[name]) for name in _COUNTS
    )
    motp = ratio(cost, tp)
    if motp is not None and card.task.event_gate.measure == "iou_3d":
        motp = 1.0 - motp
    of_false: dict[str, Any] = dict.fromkeys(("FP", "MOTA", "IDF1", "HOTA"))
    if complete:
        of_false = {
            "FP": int(fp),
            "MOTA": 1.0 - (fn + fp + switches) / truth if truth else None,
            "IDF1": idf1(float(count["shared"]), truth, tp + fp),
            "HOTA": hota(count["hits"], count["association"], truth, tp + fp),
        }
    return Clear(
        TP=int(tp),
        FN=int(fn),
        IDS=int(switches),
        FRAG=int(fragments),
        MOTP=motp,
        **of_false,
    )


def end_to_end_accuracy(
    hits: float, false_forecasts: float, targets: float
) -> float | None:
    """Return EPA: (hits - alpha x false forecasts) / targets.

    None without a target.
    ViP3D, Gu et al. 2023. A hit is a target with a matched forecast and a minFDE of at
    most 2 m. ViP3D matches within 2 m; the benchmark uses the forecast gate of its
    card, which is 2 m for vehicles.
    """
    return ratio(hits - EPA_ALPHA * false_forecasts, targets)


def forecast_average_precision(
    correct: ArrayLike, score: ArrayLike, targets: int
) -> float | None:
    """Return AP_f of forecasts with a confidence.

    None without a target.
    Peri et al. 2022; Xu et al. 2024. ``correct`` [n]: matched to a target now (2 m),
    and the best final point within 4 m; ``score`` [n]. The mean of the precision over
    101 recalls, what lies below .1 of either cut off, as nuScenes does for detection.
    Equal scores are one point of the curve, so the order of the rows does not matter;
    an agent without confidences has one point.
    """
    is_correct = np.asarray(correct, dtype=bool)
    confidence = np.asarray(score, dtype=np.float64)
    if targets == 0:
        return None
    if len(is_correct) == 0:
        return 0.0
    order = np.argsort(-confidence, kind="stable")
    is_last = np.append(np.diff(confidence[order]) != 0, True)
    hits = np.cumsum(is_correct[order])[is_last]
    precision = hits / (1 + np.flatnonzero(is_last))
    recalls = np.linspace(0.0, 1.0, _RECALLS)
    curve = np.interp(recalls, hits / targets, precision, right=0.0)
    # recalls above the least
    counted = curve[round((_RECALLS - 1) * _MIN_PRECISION) + 1 :]
    return float(
        np.maximum(counted - _MIN_PRECISION, 0.0).mean() / (1.0 - _MIN_PRECISION)
    )
