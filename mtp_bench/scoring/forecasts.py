"""Matching of forecasts to true objects, at every confidence threshold.

Definitions: docs/definitions, "bADE".
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..core import (
    ABSENT_BELOW,
    Bools,
    Detections,
    Floats,
    Ints,
    Rollout,
    Scene,
    Truth,
    to_metres,
)
from .bade import Cuts
from .definitions import CURVE_KS
from .displacements import displacement, drop_light_samples, k_curve, sample_errors
from .incremental_matching import NEVER, Additions, add_in_order, final_match
from .matching import Matched, columns_to_rows, match
from .pairs import Pairs, Rows, box_pairs
from .targets import Targets, neutral_places

_CHUNK = 1 << 19  # sample points held at a time


@dataclass(frozen=True, eq=False)
class ObjectMatch:
    """A matching of true boxes and other boxes."""

    object_of_truth: Matched  # [R] box of each true box, -1 none
    # [objects] matched neither to an evaluated nor to a neutral true box
    unmatched: Bools


@dataclass(frozen=True, eq=False)
class ForecastErrors:
    """Errors per target with every forecast kept.

    An uncovered target has the error inf, and its ``miss`` is True.
    """

    # [n] has a matched object with at least one sample, all samples finite
    covered: Bools
    min_ade: Floats  # [n] m
    min_fde: Floats  # [n] m
    miss: Bools  # [n]
    energy_score: Floats  # [n] m
    # [n] m, min_ade with the present place of the forecast moved to the truth
    centred_ade: Floats
    curve: Floats  # [n, len(ks)] m, expected minADE of a random k-subset
    ks: tuple[int, ...]  # of CURVE_KS, those up to the number of samples


@dataclass(frozen=True, eq=False)
class RecordedForecasts:
    """Forecast objects of some frames, S of them, sorted by frame."""

    frame: Ints  # [S]
    box: Floats  # [S, 7]
    class_id: Ints  # [S]
    confidence: Floats  # [S]
    offset: Ints  # [S, K, T, 2] cm from the object's centre
    log_weight: Floats  # [S, K]

    @classmethod
    def of(cls, rollout: Rollout) -> "RecordedForecasts":
        """Return all forecasts of a rollout."""
        return cls(
            rollout.objects.frame_of_rows,
            rollout.object_box,
            rollout.object_class,
            rollout.object_confidence,
            rollout.forecast,
            rollout.forecast_log_weight,
        )

    def paths(
        self, row: Ints, step: Ints, samples: int | None = None
    ) -> NDArray[np.float64]:
        """Return samples [n, K, T, 2] of these rows [n], m, absolute.

        ``step`` [n, T] as in `Targets`; ``samples``: number of the first samples to
        take; None: all.
        """
        center = np.asarray(self.box[row, :2], dtype=np.float64)
        offset = self.offset[row, :samples]
        if step.shape[1] < offset.shape[2]:  # else they are all its steps
            offset = np.take_along_axis(offset, step[:, None, :, None], axis=2)
        return center[:, None, None] + to_metres(offset)


@dataclass(frozen=True, eq=False)
class IncrementalMatching:
    """The matching of forecasts as they are added by falling confidence."""

    order: Rows  # [A] forecasts in live frames, most confident first
    additions: Additions
    # [S] false if all are kept: neither at a neutral place nor matched to a neutral
    # object
    false: Bools
    false_step: Rows  # steps that add a false forecast


@dataclass(frozen=True, eq=False)
class Candidates:
    """Forecasts in the gate of a true object, with their errors for targets."""

    scene: Scene
    targets: Targets
    forecasts: RecordedForecasts
    live: Bools  # [S] in a live frame
    pairs: Pairs  # true boxes, neutral ones too, and forecasts inside the gate
    # [R] index of the target, -1 for a true box that is not a target
    target_of_row: Rows
    # [E] m, minADE of these pairs, inf for an unusable forecast; 0 for a box that is
    # not a target
    error: Floats

    @classmethod
    def of(
        cls,
        scene: Scene,
        targets: Targets,
        forecasts: RecordedForecasts,
        live: Bools,
        card: Card,
    ) -> "Candidates":
        """Return the candidates among ``forecasts``.

        ``live`` [F]: which frames of the ``scene`` are live.
        """
        pairs = near_truth(
            scene.truth, forecasts.frame, forecasts.box, forecasts.class_id, card
        )
        target_of_row = np.full(len(scene.truth.box), -1, dtype=np.intp)
        target_of_row[targets.row] = np.arange(len(targets))
        return cls(
            scene,
            targets,
            forecasts,
            live[forecasts.frame],
            pairs,
            target_of_row,
            _pair_errors(pairs, target_of_row[pairs.row], targets, forecasts),
        )

    @cached_property
    def neutral_place(self) -> Bools:
        """Forecasts [S] at places where no label could confirm an object."""
        forecasts = self.forecasts
        return neutral_places(
            self.scene, forecasts.frame, forecasts.box[:, :2], forecasts.class_id
        )

    def final_errors(
        self, matching: IncrementalMatching
    ) -> tuple[ForecastErrors, Matched]:
        """Return the errors of every target with all forecasts kept.

        The second result is the forecast object of each true box [R], -1 if it has
        none.
        """
        targets = self.targets
        forecasts = self.forecasts
        count = len(targets)
        _, samples, horizon, _ = forecasts.offset.shape
        ks = tuple(k for k in CURVE_KS if k <= samples)
        errors = ForecastErrors(
            covered=np.zeros(count, dtype=bool),
            min_ade=np.full(count, np.inf),
            min_fde=np.full(count, np.inf),
            miss=np.ones(count, dtype=bool),
            energy_score=np.full(count, np.inf),
            centred_ade=np.full(count, np.inf),
            curve=np.full((count, len(ks)), np.inf),
            ks=ks,
        )
        object_of_truth = final_match(matching.additions, len(self.scene.truth.box))
        object_row = object_of_truth[targets.row]
        matched = np.flatnonzero(object_row >= 0)
        chunk = max(1, _CHUNK // max(1, samples * horizon))
        for low in range(0, len(matched), chunk):
            part = matched[low : low + chunk]
            row = object_row[part]
            paths = forecasts.paths(row, targets.step[part])
            future = targets.future[part]
            weight = sample_weights(forecasts.log_weight[row])
            result = displacement(paths, future, weight)
            truth_xy = self.scene.truth.box[targets.row[part], :2]
            # as if the forecast began at the truth: the true path is shifted instead
            shift = forecasts.box[row, :2] - truth_xy
            centred, _, _ = sample_errors(
                paths, future + shift[:, None], drop_light_samples(weight)
            )
            errors.covered[part] = result.valid
            errors.min_ade[part] = result.min_ade
            errors.min_fde[part] = result.min_fde
            errors.miss[part] = result.miss
            errors.energy_score[part] = result.energy_score
            errors.centred_ade[part] = centred.min(axis=1, initial=np.inf)
            errors.curve[part] = k_curve(result.ade, ks)
        return errors, object_of_truth


def _pair_errors(
    pairs: Pairs, target: Rows, targets: Targets, forecasts: RecordedForecasts
) -> Floats:
    """Return the minADE [E] of pairs as `Candidates.error`.

    ``target`` [E], -1 none.
    """
    error = np.zeros(len(pairs))
    of_target = np.flatnonzero(target >= 0)
    _, total_samples, horizon, _ = forecasts.offset.shape
    chunk = max(1, _CHUNK // max(1, total_samples * horizon))
    for low in range(0, len(of_target), chunk):
        part = of_target[low : low + chunk]
        row = pairs.column[part]
        weight = drop_light_samples(sample_weights(forecasts.log_weight[row]))
        # all samples beyond are absent
        samples = int(np.flatnonzero(weight.any(axis=0)).max(initial=-1)) + 1
        paths = forecasts.paths(row, targets.step[target[part]], samples)
        future = targets.future[target[part]]
        ade, _, _ = sample_errors(paths, future, weight[:, :samples])
        error[part] = ade.min(axis=1, initial=np.inf)
    return error


def match_by_confidence(
    candidates: Candidates, confidence: Floats
) -> IncrementalMatching:
    """Match the forecasts of live frames by falling ``confidence`` [S].

    Equal ones by position: the order of rows never decides, as forecasts of one class
    at one position have the same pairs.
    """
    live = np.flatnonzero(candidates.live)
    x, y = candidates.forecasts.box[live, :2].T
    order = live[np.lexsort((y, x, -confidence[live]))]
    step = np.full(len(candidates.live), NEVER)
    step[order] = np.arange(len(order))
    pairs = candidates.pairs
    neutral = candidates.scene.truth.neutral[pairs.row]
    additions = add_in_order(
        pairs.keep(~neutral), step, confidence, candidates.error[~neutral]
    )
    # what evaluated objects leave over is offered to neutral ones, from the step on at
    # which it is dropped
    unmatched = np.where(candidates.neutral_place, NEVER, additions.dropped)
    no_ties = np.zeros(int(neutral.sum()))
    at_neutral = add_in_order(pairs.keep(neutral), unmatched, confidence, no_ties)
    false = at_neutral.dropped != NEVER
    return IncrementalMatching(order, additions, false, at_neutral.dropped[false])


def target_errors(
    candidates: Candidates, matching: IncrementalMatching
) -> tuple[Rows, Rows, Floats]:
    """Return the changes of targets as forecasts are added.

    Step [E] and target [E], and the target's minADE [E] from then on, m.
    """
    # the candidate pair of each addition has its error
    pairs = candidates.pairs
    additions = matching.additions
    columns = len(candidates.live)
    key = pairs.row * columns + pairs.column
    order = np.argsort(key)
    added_key = additions.row * columns + additions.column
    error = candidates.error[order[np.searchsorted(key[order], added_key)]]
    target = candidates.target_of_row[additions.row]
    of_target = target >= 0
    return additions.step[of_target], target[of_target], error[of_target]


def cuts(
    candidates: Candidates,
    matching: IncrementalMatching,
    confidence: Floats,
    miss_error: Floats,
) -> Cuts:
    """Return the cuts of the forecasts by ``confidence`` [S].

    ``miss_error`` [n] of the targets, m.
    """
    order = matching.order
    step, target, error = target_errors(candidates, matching)
    false = np.zeros(len(order), dtype=bool)
    false[matching.false_step] = True
    return Cuts(
        confidence=confidence[order],
        frame=candidates.forecasts.frame[order],
        class_id=candidates.forecasts.class_id[order],
        false=false,
        step=step,
        target=target,
        error=np.minimum(error, miss_error[target]),
        covered=np.isfinite(error),
        miss_error=miss_error,
    )


def match_objects(
    truth: Truth, frame: Ints, box: Floats, class_id: Ints, card: Card
) -> ObjectMatch:
    """Match boxes to true boxes by BEV centre distance, inside the forecast gate.

    Per frame and class. ``frame`` [n], ``box`` [n, 7] and ``class_id`` [n] of the
    boxes, sorted by frame. Evaluated true boxes are matched first; the boxes left over
    are then matched to neutral ones.
    """
    pairs = near_truth(truth, frame, box, class_id, card)
    return match_neutral_last(pairs, truth.neutral, len(frame))


def near_truth(
    truth: Truth | Detections, frame: Ints, box: Floats, class_id: Ints, card: Card
) -> Pairs:
    """Return the pairs of true boxes and other boxes inside the forecast gate.

    Arguments as of `match_objects`.
    """
    return box_pairs(
        truth.frame_of_rows,
        truth.box,
        truth.class_id,
        frame,
        box,
        class_id,
        "center_distance",
        card.per_class(card.task.forecast_gate),
    )


def match_neutral_last(pairs: Pairs, neutral: Bools, objects: int) -> ObjectMatch:
    """Match ``objects`` boxes to evaluated truth, those left over to neutral truth.

    ``neutral`` [R] as in `Truth`; the boxes need not be forecasts.
    """
    matched = match(pairs.keep(~neutral[pairs.row]), len(neutral))
    return offer_neutral(matched, pairs, neutral, objects)


def offer_neutral(
    matched: Matched, pairs: Pairs, neutral: Bools, objects: int
) -> ObjectMatch:
    """Extend a matching of evaluated truth by matching other boxes to neutral truth."""
    free = columns_to_rows(matched, objects) < 0
    neutral_pairs = pairs.keep(neutral[pairs.row] & free[pairs.column])
    neutral_match = match(neutral_pairs, len(neutral))
    matched = np.where(matched >= 0, matched, neutral_match)
    return ObjectMatch(matched, columns_to_rows(matched, objects) < 0)


def sample_weights(log_weight: Floats) -> NDArray[np.float64]:
    """Return the weights [n, K] of log-weights, 0 for an absent sample.

    Others are above 0.
    """
    logs = np.asarray(log_weight, dtype=np.float64)
    present = logs >= ABSENT_BELOW
    max_log = np.where(present, logs, -np.inf).max(
        axis=1, initial=ABSENT_BELOW, keepdims=True
    )
    # exp(-600) is still above 0
    weight = np.exp(np.clip(np.where(present, logs, 0.0) - max_log, -600.0, 0.0))
    return np.where(present, weight, 0.0)
