"""Forecast objects against true objects: which forecast is whose, and the missing-aware error (protocol, "Numbers")."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..types import Bools, Floats, Ints, Rollout, Scene, Truth, to_metres
from .definitions import CURVE_KS
from .displacement import displacement, k_curve, sample_errors
from .error import capped_error, false_forecast_error
from .matching import Matched, columns_to_rows, match
from .pairs import Pairs, box_pairs
from .targets import Targets

_CHUNK = 1 << 19  # sample points held at a time
_ABSENT = -1e30  # log-weights below stand for "no such sample"


@dataclass(frozen=True, eq=False)
class ObjectMatch:
    """Whose forecast object is whose; rows of the truth and rows of the objects."""

    object_of_truth: Matched  # [R] forecast object of each true box, -1 none
    unmatched: Bools  # [objects] belongs to no true box at all, be it evaluated or neutral


@dataclass(frozen=True, eq=False)
class ForecastErrors:
    """Errors per target; those of uncovered ones are inf, ``miss`` is True there."""

    covered: Bools  # [n] has a matched object with at least one sample, all samples finite
    min_ade: Floats  # [n] m
    min_fde: Floats  # [n] m
    miss: Bools  # [n]
    energy_score: Floats  # [n] m
    curve: Floats  # [n, len(ks)] m, expected minADE of a random k-subset
    ks: tuple[int, ...]  # of CURVE_KS, those up to the number of samples


def match_objects(truth: Truth, object_frame: Ints, object_box: Floats, object_class: Ints, card: Card) -> ObjectMatch:
    """Match forecast objects to true boxes by BEV centre distance, per frame and class, inside the forecast gate.

    ``truth``: true boxes of the scene; ``object_frame`` [n], ``object_box`` [n, 7] and ``object_class`` [n] of the
    forecast objects, sorted by frame; ``card``: gates and classes.
    All evaluated true boxes take part, targets or not; objects left over are then offered to the neutral ones.
    """
    gates = card.per_class(card.task.forecast_gate)
    pairs = box_pairs(
        truth.frame_of_rows, truth.box, truth.class_id, object_frame, object_box, object_class, "center_distance", gates
    )
    return match_neutral_last(pairs, truth.neutral, len(object_frame))


def forecast_errors(targets: Targets, objects: ObjectMatch, rollout: Rollout) -> ForecastErrors:
    """Errors of a rollout's forecasts for every target of its scene."""
    _, samples, horizon, _ = rollout.forecast.shape
    ks = tuple(k for k in CURVE_KS if k <= samples)
    table = np.full((len(targets), 3 + len(ks)), np.inf)  # min_ade, min_fde, energy_score, curve
    covered, miss = np.zeros(len(targets), dtype=bool), np.ones(len(targets), dtype=bool)
    column = objects.object_of_truth[targets.row]
    matched = np.flatnonzero(column >= 0)
    size = max(1, _CHUNK // max(1, samples * horizon))
    for low in range(0, len(matched), size):
        part = matched[low : low + size]
        row = column[part]
        center = np.asarray(rollout.object_box[row, :2], dtype=np.float64)
        guess = center[:, None, None] + to_metres(rollout.forecast[row])
        result = displacement(guess, targets.future[part], sample_weights(rollout.forecast_log_weight[row]))
        covered[part], miss[part] = result.valid, result.miss
        table[part, :3] = np.stack([result.min_ade, result.min_fde, result.energy_score], axis=1)
        table[part, 3:] = k_curve(result.ade, ks)
    return ForecastErrors(covered, table[:, 0], table[:, 1], miss, table[:, 2], table[:, 3:], ks)


def frame_error(
    scene: Scene,
    targets: Targets,
    card: Card,
    t: int,
    object_box: Floats,
    object_class: Ints,
    forecast_xy: Floats,
    log_weight: Floats,
) -> float:
    """Missing-aware error of frame ``t``, metres: the sum over targets and false forecasts per target.

    ``targets``: of the ``scene`` under ``card``. ``object_box`` [O, 7] and ``object_class`` [O] of the forecast
    objects; ``forecast_xy`` [O, K, T, 2] m, absolute in the scene's frame; ``log_weight`` [O, K], -inf for an absent
    sample. Without a target in the frame the sum is not divided; without a false forecast either it is 0. False
    forecasts count where the truth is complete.
    """
    rows, here = scene.truth.rows(t), targets.rows(t)
    miss_error = np.asarray(card.per_class(card.task.miss_error))
    box, class_id = scene.truth.box[rows], scene.truth.class_id[rows]
    gates = card.per_class(card.task.forecast_gate)
    same = np.zeros(len(box), dtype=np.intp), np.zeros(len(object_box), dtype=np.intp)
    pairs = box_pairs(same[0], box, class_id, same[1], object_box, object_class, "center_distance", gates)
    objects = match_neutral_last(pairs, scene.truth.neutral[rows], len(object_box))
    false_error = false_forecast_error(miss_error[object_class[objects.unmatched]], scene.truth_complete)
    error = miss_error[targets.class_id[here]]
    column = objects.object_of_truth[targets.row[here] - rows.start]
    matched = np.flatnonzero(column >= 0)
    row = column[matched]
    ade, _, _ = sample_errors(forecast_xy[row], targets.future[here][matched], sample_weights(log_weight[row]))
    error[matched] = capped_error(ade.min(axis=1, initial=np.inf), error[matched])
    return (false_error + float(error.sum())) / max(1, len(error))


def match_neutral_last(pairs: Pairs, neutral: Bools, objects: int) -> ObjectMatch:
    """Match ``objects`` boxes to evaluated truth first; what is left over may belong to neutral truth.

    ``neutral`` [R] as in `Truth`; the boxes need not be forecasts.
    """
    return offer_neutral(match(pairs.keep(~neutral[pairs.row]), len(neutral)), pairs, neutral, objects)


def offer_neutral(matched: Matched, pairs: Pairs, neutral: Bools, objects: int) -> ObjectMatch:
    """The matching of evaluated truth, and of what it left over with neutral truth."""
    free = columns_to_rows(matched, objects) < 0
    second = match(pairs.keep(neutral[pairs.row] & free[pairs.column]), len(neutral))
    matched = np.where(matched >= 0, matched, second)
    return ObjectMatch(matched, columns_to_rows(matched, objects) < 0)


def sample_weights(log_weight: Floats) -> NDArray[np.float64]:
    """Weights [n, K] from log-weights: 0 for an absent sample, above 0 for any other, however light."""
    logs = np.asarray(log_weight, dtype=np.float64)
    present = logs > _ABSENT
    top = np.where(present, logs, -np.inf).max(axis=1, initial=_ABSENT, keepdims=True)
    weight = np.exp(np.clip(np.where(present, logs, 0.0) - top, -600.0, 0.0))
    return np.where(present, weight, 0.0)
