"""Matching of forecasts to true objects, at every confidence threshold (docs/definitions, "bADE")."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..core import ABSENT_BELOW, Bools, Floats, Ints, Rollout, Scene, Truth, to_metres
from .bade import Cuts
from .definitions import CURVE_KS
from .displacements import displacement, floored, k_curve, sample_errors
from .incremental_matching import NEVER, Additions, add_in_order, final_match
from .matching import Matched, columns_to_rows, match
from .neutral import neutral_places
from .pairs import Pairs, Rows, box_pairs
from .targets import Targets

_CHUNK = 1 << 19  # sample points held at a time


@dataclass(frozen=True, eq=False)
class ObjectMatch:
    """A matching of true boxes and other boxes."""

    object_of_truth: Matched  # [R] box of each true box, -1 none
    unmatched: (
        Bools  # [objects] matched neither to an evaluated nor to a neutral true box
    )


@dataclass(frozen=True, eq=False)
class ForecastErrors:
    """Errors per target with every forecast kept; for uncovered targets they are inf and ``miss`` is True."""

    covered: (
        Bools  # [n] has a matched object with at least one sample, all samples finite
    )
    min_ade: Floats  # [n] m
    min_fde: Floats  # [n] m
    miss: Bools  # [n]
    energy_score: Floats  # [n] m
    centred_ade: Floats  # [n] m, min_ade with the present place of the forecast moved to the truth
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
        """All forecasts of a rollout."""
        objects = rollout.object_box, rollout.object_class, rollout.object_confidence
        return cls(
            rollout.objects.frame_of_rows,
            *objects,
            rollout.forecast,
            rollout.forecast_log_weight,
        )

    def paths(self, row: Ints, samples: int | None = None) -> NDArray[np.float64]:
        """Samples [n, K, T, 2] of these rows [n], m, absolute; the first ``samples`` alone."""
        center = np.asarray(self.box[row, :2], dtype=np.float64)
        return center[:, None, None] + to_metres(self.offset[row, :samples])


@dataclass(frozen=True, eq=False)
class IncrementalMatching:
    """The matching of forecasts as they are added by falling confidence."""

    order: Rows  # [A] forecasts in live frames, most confident first
    additions: Additions
    false: Bools  # [S] false if all are kept: neither at a neutral place nor matched to a neutral object
    false_step: Rows  # steps that add a false forecast


@dataclass(frozen=True, eq=False)
class Candidates:
    """Forecasts inside the gate of a true object, with their errors as forecasts of targets."""

    scene: Scene
    targets: Targets
    forecasts: RecordedForecasts
    live: Bools  # [S] in a live frame
    pairs: Pairs  # true boxes, neutral ones too, and forecasts inside the gate
    target_of_row: (
        Rows  # [R] index of the target, -1 for a true box that is not a target
    )
    error: Floats  # [E] m, minADE of these pairs, inf for an unusable forecast; 0 for a box that is not a target

    @classmethod
    def of(
        cls,
        scene: Scene,
        targets: Targets,
        forecasts: RecordedForecasts,
        live: Bools,
        card: Card,
    ) -> "Candidates":
        """The candidates among ``forecasts``; ``live`` [F]: which frames of the ``scene`` are live."""
        pairs = near_truth(
            scene.truth, forecasts.frame, forecasts.box, forecasts.class_id, card
        )
        place = np.full(len(scene.truth.box), -1, dtype=np.intp)
        place[targets.row] = np.arange(len(targets))
        found = cls(
            scene,
            targets,
            forecasts,
            live[forecasts.frame],
            pairs,
            place,
            np.zeros(len(pairs)),
        )
        return replace(found, error=_pair_errors(found))

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
        """Errors of every target with all forecasts kept, and the forecast of each true box [R], -1 for none."""
        targets, forecasts = self.targets, self.forecasts
        _, samples, horizon, _ = forecasts.offset.shape
        ks = tuple(k for k in CURVE_KS if k <= samples)
        table = np.full(
            (len(targets), 4 + len(ks)), np.inf
        )  # min_ade, min_fde, energy_score, centred_ade, curve
        covered, miss = (
            np.zeros(len(targets), dtype=bool),
            np.ones(len(targets), dtype=bool),
        )
        object_of_truth = final_match(matching.additions, len(self.scene.truth.box))
        column = object_of_truth[targets.row]
        matched = np.flatnonzero(column >= 0)
        size = max(1, _CHUNK // max(1, samples * horizon))
        for low in range(0, len(matched), size):
            part = matched[low : low + size]
            row = column[part]
            paths, future = forecasts.paths(row), targets.future[part]
            weight = sample_weights(forecasts.log_weight[row])
            result = displacement(paths, future, weight)
            covered[part], miss[part] = result.valid, result.miss
            away = forecasts.box[row, :2] - self.scene.truth.box[targets.row[part], :2]
            centred = sample_errors(paths, future + away[:, None], floored(weight))[
                0
            ].min(axis=1, initial=np.inf)
            table[part, :4] = np.stack(
                [result.min_ade, result.min_fde, result.energy_score, centred], axis=1
            )
            table[part, 4:] = k_curve(result.ade, ks)
        errors = ForecastErrors(
            covered,
            table[:, 0],
            table[:, 1],
            miss,
            table[:, 2],
            table[:, 3],
            table[:, 4:],
            ks,
        )
        return errors, object_of_truth


def _pair_errors(found: Candidates) -> Floats:
    """MinADE [E] of the pairs as `Candidates.error`."""
    targets, forecasts = found.targets, found.forecasts
    target = found.target_of_row[found.pairs.row]
    error = np.zeros(len(found.pairs))
    of_target = np.flatnonzero(target >= 0)
    size = max(1, _CHUNK // max(1, int(np.prod(forecasts.offset.shape[1:3]))))
    for low in range(0, len(of_target), size):
        part = of_target[low : low + size]
        row = found.pairs.column[part]
        weight = floored(sample_weights(forecasts.log_weight[row]))
        count = (
            int(np.flatnonzero(weight.any(axis=0)).max(initial=-1)) + 1
        )  # all others are absent
        ade, _, _ = sample_errors(
            forecasts.paths(row, count), targets.future[target[part]], weight[:, :count]
        )
        error[part] = ade.min(axis=1, initial=np.inf)
    return error


def match_by_confidence(found: Candidates, confidence: Floats) -> IncrementalMatching:
    """Match the forecasts of live frames by falling ``confidence`` [S], equal ones by position.

    The order of rows never decides: forecasts of one class at one position have the same pairs.
    """
    live = np.flatnonzero(found.live)
    x, y = found.forecasts.box[live, :2].T
    order = live[np.lexsort((y, x, -confidence[live]))]
    step = np.full(len(found.live), NEVER)
    step[order] = np.arange(len(order))
    neutral = found.scene.truth.neutral[found.pairs.row]
    additions = add_in_order(
        found.pairs.keep(~neutral), step, confidence, found.error[~neutral]
    )
    left = np.where(found.neutral_place, NEVER, additions.dropped)
    excused = add_in_order(
        found.pairs.keep(neutral), left, confidence, np.zeros(int(neutral.sum()))
    )
    false = excused.dropped != NEVER
    return IncrementalMatching(order, additions, false, excused.dropped[false])


def target_errors(
    found: Candidates, matching: IncrementalMatching
) -> tuple[Rows, Rows, Floats]:
    """Changes as forecasts are added: step [E] and target [E], and the target's minADE [E] from then on, m."""
    additions, columns = matching.additions, len(found.live)
    key = found.pairs.row * columns + found.pairs.column
    order = np.argsort(key)
    error = found.error[
        order[np.searchsorted(key[order], additions.row * columns + additions.column)]
    ]
    target = found.target_of_row[additions.row]
    of_target = target >= 0
    return additions.step[of_target], target[of_target], error[of_target]


def cuts(
    found: Candidates,
    matching: IncrementalMatching,
    confidence: Floats,
    miss_error: Floats,
) -> Cuts:
    """The cuts of the forecasts by ``confidence`` [S]; ``miss_error`` [n] of the targets."""
    order = matching.order
    step, target, error = target_errors(found, matching)
    false = np.zeros(len(order), dtype=bool)
    false[matching.false_step] = True
    return Cuts(
        confidence=confidence[order],
        frame=found.forecasts.frame[order],
        class_id=found.forecasts.class_id[order],
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
    """Match boxes to true boxes by BEV centre distance, per frame and class, inside the forecast gate.

    ``frame`` [n], ``box`` [n, 7] and ``class_id`` [n] of the boxes, sorted by frame. Evaluated true boxes
    are matched first; the boxes left over are then matched to neutral ones.
    """
    return match_neutral_last(
        near_truth(truth, frame, box, class_id, card), truth.neutral, len(frame)
    )


def near_truth(
    truth: Truth, frame: Ints, box: Floats, class_id: Ints, card: Card
) -> Pairs:
    """Pairs of true boxes and other boxes inside the forecast gate; arguments as of `match_objects`."""
    at = truth.frame_of_rows, truth.box, truth.class_id
    return box_pairs(
        *at,
        frame,
        box,
        class_id,
        "center_distance",
        card.per_class(card.task.forecast_gate),
    )


def match_neutral_last(pairs: Pairs, neutral: Bools, objects: int) -> ObjectMatch:
    """Match ``objects`` boxes to evaluated truth first, the boxes left over to neutral truth.

    ``neutral`` [R] as in `Truth`; the boxes need not be forecasts.
    """
    return offer_neutral(
        match(pairs.keep(~neutral[pairs.row]), len(neutral)), pairs, neutral, objects
    )


def offer_neutral(
    matched: Matched, pairs: Pairs, neutral: Bools, objects: int
) -> ObjectMatch:
    """A matching of evaluated truth, extended by matching the boxes left over to neutral truth."""
    free = columns_to_rows(matched, objects) < 0
    second = match(pairs.keep(neutral[pairs.row] & free[pairs.column]), len(neutral))
    matched = np.where(matched >= 0, matched, second)
    return ObjectMatch(matched, columns_to_rows(matched, objects) < 0)


def sample_weights(log_weight: Floats) -> NDArray[np.float64]:
    """Weights [n, K] from log-weights: 0 for an absent sample, above 0 for any other."""
    logs = np.asarray(log_weight, dtype=np.float64)
    present = logs >= ABSENT_BELOW
    top = np.where(present, logs, -np.inf).max(
        axis=1, initial=ABSENT_BELOW, keepdims=True
    )
    weight = np.exp(np.clip(np.where(present, logs, 0.0) - top, -600.0, 0.0))
    return np.where(present, weight, 0.0)
