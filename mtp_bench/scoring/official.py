"""Numbers of MFEval and of UniAD, from recorded forecasts of nuScenes.

Definitions: docs/definitions/official.md.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core import Bools, Floats, Rollout, Scene, Truth, joined, to_metres
from .definitions import MISS_RATE_GATE
from .details import end_to_end_accuracy, forecast_average_precision
from .matching import match
from .pairs import Pairs, near_pairs
from .rows import OfficialRow
from .statistics import ratio

OFFICIAL_STEPS = 12  # of a forecast, at 2 Hz
_MATCH_M = 2.0  # between a forecast object and a true one
_MISS_M = 4.0  # of the final place, in MFEval
_LONGEST_S = 6.15  # to the last step of a future
_MFEVAL_CLASSES = ("car", "bus", "truck")
_VEHICLES = (*_MFEVAL_CLASSES, "construction_vehicle")
_UNIAD_CAR = "UniAD EPA, car"
_UNIAD_PEDESTRIAN = "UniAD EPA, pedestrian"
_UNIAD_SCORES = (0.0, 0.3, 0.5)
_F1_GUARD = 1e-5  # of MFEval: its choice of a confidence depends on it

Names = NDArray[np.str_]
_Number = tuple[str, int, float | None]  # its name, its targets, and itself


@dataclass(frozen=True, eq=False)
class OfficialForecasts:
    """Forecasts [S], with the class that each program gives them.

    The class is empty where a program leaves a forecast out.
    """

    score: Floats
    mfeval_class: Names
    mfeval_hit: Bools  # takes a target that it forecasts within 4 m
    uniad_class: Names
    uniad_matched: Bools  # takes a target
    uniad_hit: Bools  # takes a target that it forecasts within 2 m


@dataclass(frozen=True, eq=False)
class OfficialScene:
    """Forecasts of a scene, the number of targets, and MFEval's pairs [E] of both."""

    forecasts: OfficialForecasts
    targets: Counter[str]  # by class
    pairs: Pairs  # forecasts and true boxes
    errors: Floats  # [E, 2] m, minADE and minFDE


def official_scene(
    rollout: Rollout, classes: Sequence[str], scene: Scene, truth: Truth, names: Names
) -> OfficialScene:
    """Return what the programs count in one scene.

    ``classes`` of the task. ``truth``: all boxes [R] of the scene, eligible where they
    are listed as targets; ``names`` [R] of their classes.
    """
    frame = rollout.objects.frame_of_rows
    place = rollout.object_box[:, :2]
    score = rollout.object_confidence
    class_name = np.array(classes)[rollout.object_class]
    true_frame = truth.frame_of_rows
    true_place = truth.box[:, :2]
    future = _futures(truth, scene.time)
    pairs = Pairs(*near_pairs(frame, place, true_frame, true_place, _MATCH_M))
    errors = _pair_errors(pairs, rollout, future)
    # MFEval leaves out the forecasts of vehicles that are not listed
    is_judged = np.isin(class_name, _MFEVAL_CLASSES)
    is_vehicle = np.isin(names, _VEHICLES) & np.isfinite(future[:, 0, 0])
    vehicle_pairs = pairs.keep(is_judged[pairs.row] & is_vehicle[pairs.column])
    matched = match(vehicle_pairs, len(frame))
    is_judged &= np.isin(frame, true_frame[truth.eligible])
    # a forecast without a match has the number -1, and takes the last value
    is_judged &= np.append(truth.eligible, True)[matched]
    mfeval_class = np.where(is_judged, class_name, "")
    mfeval_target = np.where(truth.eligible & ~truth.neutral, names, "none")
    uniad_class = _merged_class(class_name, place - scene.ego[frame, :2])
    uniad_target = _merged_class(names, true_place - scene.ego[true_frame, :2])
    uniad_target[truth.neutral] = ""
    in_mfeval = mfeval_class[pairs.row] == mfeval_target[pairs.column]
    in_uniad = uniad_class[pairs.row] == uniad_target[pairs.column]
    final_error = errors[:, 1]
    forecasts = OfficialForecasts(
        score,
        mfeval_class,
        _first_come(pairs, score, in_mfeval, final_error < _MISS_M),
        uniad_class,
        _first_come(pairs, score, in_uniad, in_uniad),
        _first_come(pairs, score, in_uniad, final_error < MISS_RATE_GATE),
    )
    targets = Counter([*mfeval_target.tolist(), *uniad_target.tolist()])
    return OfficialScene(forecasts, targets, pairs.keep(in_mfeval), errors[in_mfeval])


def official_rows(agent: str, scenes: Sequence[OfficialScene]) -> list[OfficialRow]:
    """Return the rows of MFEval and of UniAD over all ``scenes`` of an agent."""
    forecasts = joined([scene.forecasts for scene in scenes])
    targets = sum((scene.targets for scene in scenes), Counter[str]())
    numbers = [
        *_mfeval_numbers(scenes, forecasts, targets),
        *_uniad_numbers(forecasts, targets),
    ]
    return [
        OfficialRow(agent=agent, number=name, targets=count, value=value)
        for name, count, value in numbers
    ]


def _mfeval_numbers(
    scenes: Sequence[OfficialScene],
    forecasts: OfficialForecasts,
    targets: Counter[str],
) -> Iterator[_Number]:
    precisions: list[float] = []
    errors = [np.zeros((0, 2))]
    for name in _MFEVAL_CLASSES:
        of_class = forecasts.mfeval_class == name
        hit = forecasts.mfeval_hit[of_class]
        score = forecasts.score[of_class]
        precision = forecast_average_precision(hit, score, targets[name])
        precisions.append(precision or 0.0)
        least_score = _best_score(hit, score, targets[name])
        for scene in scenes:
            pairs = scene.pairs
            is_kept = scene.forecasts.mfeval_class == name
            is_kept &= scene.forecasts.score >= least_score
            matched = match(pairs.keep(is_kept[pairs.row]), len(is_kept))
            errors.append(scene.errors[matched[pairs.row] == pairs.column])
    min_ade, min_fde = np.concatenate(errors).T
    count = len(min_ade)
    values = {
        "minADE, m": ratio(min_ade.sum(), count),
        "minFDE, m": ratio(min_fde.sum(), count),
        "MR": ratio((min_fde > _MISS_M).sum(), count),
        "mAPf": float(np.mean(precisions)),
    }
    all_targets = sum(targets[name] for name in _MFEVAL_CLASSES)
    for name, value in values.items():
        yield f"MFEval {name}", all_targets, value


def _best_score(hit: Bools, score: Floats, targets: int) -> float:
    """Return the least confidence that MFEval keeps, that of the best F1."""
    order = np.argsort(-score, kind="stable")
    hits = np.cumsum(hit[order])
    precision = hits / np.arange(1, len(hits) + 1)
    recall = hits / max(targets, 1)
    f1 = precision * recall / (precision + recall + _F1_GUARD)
    return float(score[order[f1.argmax()]]) if len(score) else 0.0


def _uniad_numbers(
    forecasts: OfficialForecasts, targets: Counter[str]
) -> Iterator[_Number]:
    for name in (_UNIAD_CAR, _UNIAD_PEDESTRIAN):
        for least_score in _UNIAD_SCORES:
            counted = forecasts.uniad_class == name
            counted &= forecasts.score >= least_score
            hits = forecasts.uniad_hit[counted].sum()
            false_forecasts = (~forecasts.uniad_matched[counted]).sum()
            value = end_to_end_accuracy(hits, false_forecasts, targets[name])
            yield f"{name}, from {least_score}", targets[name], value


def _merged_class(names: Names, offset: Floats) -> Names:
    """Return UniAD's class [n], empty for others and beyond reach.

    ``offset`` [n, 2] m from the ego.
    """
    is_pedestrian = names == "pedestrian"
    merged = np.where(is_pedestrian, _UNIAD_PEDESTRIAN, _UNIAD_CAR)
    reach_m = np.where(is_pedestrian, 40.0, 50.0)
    is_counted = np.linalg.norm(offset, axis=1) < reach_m
    is_counted &= ~np.isin(names, ("traffic_cone", "barrier"))
    return np.where(is_counted, merged, "")


def _first_come(pairs: Pairs, score: Floats, used: Bools, hit: Bools) -> Bools:
    """Return which forecasts [S] take a true box, the most confident first.

    ``score`` [S]. Each looks at the nearest free box among the ``used`` pairs [E], and
    takes it if the pair is a ``hit`` [E].
    """
    order = np.lexsort((pairs.cost, pairs.row, -score[pairs.row]))
    seen: set[int] = set()
    taken: set[int] = set()
    takes = np.zeros(len(score), dtype=bool)
    for pair in order[used[order]].tolist():
        row = pairs.row.item(pair)
        column = pairs.column.item(pair)
        if row in seen or column in taken:
            continue
        seen.add(row)
        if hit[pair]:
            taken.add(column)
            takes[row] = True
    return takes


def _futures(truth: Truth, time: Floats) -> Floats:
    """Return the next places [R, 12, 2] of each box, inf where the object has none.

    As in the official kit, a frame without the object does not count as a step.
    """
    frame = truth.frame_of_rows
    order = np.lexsort((frame, truth.object_id))
    future = np.full((len(frame), OFFICIAL_STEPS, 2), np.inf)
    for step in range(1, OFFICIAL_STEPS + 1):
        present = order[:-step]
        later = order[step:]
        follows = truth.object_id[present] == truth.object_id[later]
        follows &= time[frame[later]] - time[frame[present]] < _LONGEST_S
        future[present[follows], step - 1] = truth.box[later[follows], :2]
    return future


def _pair_errors(pairs: Pairs, rollout: Rollout, future: Floats) -> Floats:
    """Return minADE, and minFDE at the last known step of a future [E, 2]."""
    center = rollout.object_box[pairs.row, None, None, :2]
    true_path = future[pairs.column]
    offset = center + to_metres(rollout.forecast[pairs.row]) - true_path[:, None]
    distance = np.linalg.norm(offset, axis=-1)
    distance[np.isneginf(rollout.forecast_log_weight[pairs.row])] = np.inf
    # -1, a step that is inf, without any
    last_step = np.isfinite(true_path[..., 0]).sum(axis=1) - 1
    final = np.take_along_axis(distance, last_step[:, None, None], axis=2)[..., 0]
    errors = np.stack([distance.mean(axis=2), final]).min(axis=2)
    return np.asarray(errors.T)
