"""Samples to fit a detector to: hits and errors of true boxes, and false positives."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from ...core import (
    Bools,
    DataError,
    Detections,
    Floats,
    Ints,
    Scene,
    Truth,
    center_distance,
    joined,
    select,
    starts_of_sorted,
    wrap_angle,
)
from ...detector import Sensor, covered, polar, quality_features, visibility_of

# columns of ``ObjectSamples.error``
RADIAL = 0
TANGENTIAL = 1
HEIGHT = 2
HEADING = 3
SIZE = slice(4, 7)
DISTANCE = 1  # column of ``ObjectSamples.feature``, in units of 10 m

# m, largest BEV distance of a detection from its true box
_GATES_M = {"pedestrian": 1.0, "cyclist": 1.5, "bicycle": 1.5, "motorcycle": 1.5}
_VEHICLE_GATE_M = 2.0
# a second detection this close to the matched one belongs to the same object
_DUPLICATE_DISTANCE_M = 0.75


@dataclass(frozen=True, eq=False)
class ObjectSamples:
    """Covered true boxes of a class without the neutral ones.

    They are sorted by object and frame.
    """

    object: Ints  # [R] unique over scenes
    frame: Ints  # [R] within the scene
    hit: Bools  # [R]
    feature: Floats  # [R, 7] see `quality_features`
    # [R, 7] detected less true: radial, tangential, z m, heading rad, l w h m; NaN
    # where undetected
    error: Floats
    velocity_error: Floats  # [R, 2] m/s; NaN where undetected or not measured
    score: Floats  # [R] NaN where undetected
    scene: Ints  # [R] number of the scene
    place: Floats  # [R, 2] m, of the true box
    direction: Floats  # [R] rad, from the sensor to it

    def moments(self) -> Ints:
        """Return numbers [R] of frames that are unique over scenes."""
        return self.scene * (int(self.frame.max(initial=0)) + 1) + self.frame

    def pairs(self, lag: int = 1) -> tuple[Ints, Ints]:
        """Return rows of the same object, ``lag`` frames apart: earlier, later.

        Rows are sorted by object and frame, so the keys are too.
        """
        width = int(self.frame.max(initial=0)) + lag + 1
        key = self.object * width + self.frame
        later = np.searchsorted(key, key + lag)
        earlier = np.flatnonzero(later < len(key))
        earlier = earlier[key[later[earlier]] == key[earlier] + lag]
        return earlier, later[earlier]

    def hit_pairs(self, lag: int = 1) -> tuple[Ints, Ints]:
        """Return the pairs with two hits."""
        earlier, later = self.pairs(lag)
        hit_twice = self.hit[earlier] & self.hit[later]
        return earlier[hit_twice], later[hit_twice]


@dataclass(frozen=True, eq=False)
class FalsePositiveRows:
    """False positives of a class over scenes, real or simulated."""

    scene: Ints  # [D] number of the scene
    frame: Ints  # [D] within the scene
    place: Floats  # [D, 2] m
    score: Floats  # [D]
    # [D] m to the nearest true box of the pooled classes; inf without one
    object_distance: Floats
    # [D] score of that box' own detection; NaN or -inf where it is undetected
    parent_score: Floats


@dataclass(frozen=True, eq=False)
class FalsePositiveSamples(FalsePositiveRows):
    """False positives of a class inside the sensor's coverage."""

    count: Ints  # [F] per frame, all scenes one after another
    duplicate: Bools  # [D] a second detection of an object
    size: Floats  # [D, 3] m
    distance: Floats  # [D] m from the sensor
    of_class: Bools  # [D] the nearest true box has the class of the detection


@dataclass(frozen=True, eq=False)
class Matches:
    """Pairs of true boxes and detections of a scene."""

    detection: Ints  # [R] row of each true box' detection, -1 where it is undetected
    # [D] detections without a true box, except those close to neutral true boxes
    false: Bools
    duplicate: Bools  # [D] false ones close to the detection of a true box


Samples = tuple[ObjectSamples, FalsePositiveSamples]


def collect_samples(
    scenes: Iterable[Scene],
    classes: Sequence[str],
    sensor: Sensor,
    floor: Mapping[str, float] | None = None,
    pooled: Mapping[str, str] | None = None,
) -> dict[str, Samples]:
    """Collect the samples of each class over ``scenes``.

    ``floor``: by class, the least score of the detections that count; ``pooled``: by
    class, another class whose samples its own are added to. Boxes are matched class by
    class in any case. Raises DataError without a scene.
    """
    pooled = pooled or {}
    sample_names = np.array([pooled.get(name, name) for name in classes])
    names = [name for name in classes if name not in pooled]
    object_parts = defaultdict[str, list[ObjectSamples]](list)
    false_parts = defaultdict[str, list[FalsePositiveSamples]](list)
    object_count = 0  # in the scenes so far
    scene_count = 0
    for scene in scenes:
        detections = above_floor(scene.detections, classes, floor)
        matches = match_boxes(scene.truth, detections, classes)
        ids, number = np.unique(scene.truth.object_id, return_inverse=True)
        objects = _object_samples(
            scene,
            detections,
            matches.detection,
            object_count + number,
            sensor,
            scene_count,
        )
        counts = covered(scene.truth, scene.ego, sensor) & ~scene.truth.neutral
        for name in names:
            class_ids = np.flatnonzero(sample_names == name)
            true_rows = np.flatnonzero(
                counts & np.isin(scene.truth.class_id, class_ids)
            )
            true_rows = true_rows[
                np.lexsort((objects.frame[true_rows], number[true_rows]))
            ]
            object_parts[name].append(select(objects, true_rows))
            false_positives = _false_positive_samples(
                scene, detections, matches, class_ids, sensor, scene_count
            )
            false_parts[name].append(false_positives)
        object_count += len(ids)
        scene_count += 1
    if not scene_count:
        raise DataError(
            "no scenes to compare detections with true boxes in, expected at least one"
        )
    return {
        name: (joined(object_parts[name]), joined(false_parts[name])) for name in names
    }


def _object_samples(
    scene: Scene,
    detections: Detections,
    detection: Ints,
    object_number: Ints,
    sensor: Sensor,
    scene_number: int,
) -> ObjectSamples:
    """Return samples of all true rows [R] of a scene.

    ``detection`` [R]: rows of their detections, -1 where they are undetected;
    ``object_number`` [R]: numbers that are unique over scenes.
    """
    true_box = scene.truth.box
    rows = len(true_box)
    frame = scene.truth.frame_of_rows
    hit = detection >= 0
    box = np.full((rows, 7), np.nan)
    box[hit] = detections.box[detection[hit]]
    score = np.full(rows, np.nan)
    score[hit] = detections.score[detection[hit]]
    velocity = np.full((rows, 2), np.nan)
    # some formats write zeros everywhere where velocities were not measured
    if detections.velocity.any():
        velocity[hit] = detections.velocity[detection[hit]]
    offset = box[:, :2] - true_box[:, :2]
    away = true_box[:, :2] - scene.ego[frame, :2]
    away = away / np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-9)[:, None]
    # in the order of RADIAL, TANGENTIAL, HEIGHT, HEADING, SIZE
    error = [
        (away * offset).sum(axis=1),
        away[:, 0] * offset[:, 1] - away[:, 1] * offset[:, 0],
        box[:, 2] - true_box[:, 2],
        wrap_angle(box[:, 3] - true_box[:, 3]),
        box[:, 4:] - true_box[:, 4:],
    ]
    visibility = visibility_of(scene.truth, scene.ego, sensor, scene.visible)
    return ObjectSamples(
        object=object_number,
        frame=frame,
        hit=hit,
        feature=quality_features(visibility),
        error=np.column_stack(error),
        velocity_error=velocity - scene.truth.velocity,
        score=score,
        scene=np.full(rows, scene_number),
        place=true_box[:, :2],
        direction=np.arctan2(away[:, 1], away[:, 0]),
    )


def _false_positive_samples(
    scene: Scene,
    detections: Detections,
    matches: Matches,
    class_ids: Ints,
    sensor: Sensor,
    scene_number: int,
) -> FalsePositiveSamples:
    """Return the covered false positives of a scene of the pooled ``class_ids``."""
    truth = scene.truth
    false_row = np.flatnonzero(matches.false & np.isin(detections.class_id, class_ids))
    frame = detections.frame_of_rows[false_row]
    distance_m, bearing = polar(detections.box[false_row, :2], scene.ego[frame])
    is_covered = sensor.covers(distance_m, bearing)
    false_row = false_row[is_covered]
    frame = frame[is_covered]
    box = detections.box[false_row]
    of_classes = np.isin(truth.class_id, class_ids)
    nearest_row, object_distance = nearest_true_boxes(truth, of_classes, frame, box)
    # the last values are those of frames without a true box
    class_of_object = np.append(truth.class_id, -1)
    detection_of_object = np.append(matches.detection, -1)
    score_of_detection = np.append(detections.score, np.nan)
    return FalsePositiveSamples(
        scene=np.full(len(false_row), scene_number),
        frame=frame,
        place=box[:, :2],
        score=detections.score[false_row],
        object_distance=object_distance,
        parent_score=score_of_detection[detection_of_object[nearest_row]],
        count=np.diff(starts_of_sorted(frame, scene.frames)),
        duplicate=matches.duplicate[false_row],
        size=box[:, 4:7],
        distance=distance_m[is_covered],
        of_class=class_of_object[nearest_row] == detections.class_id[false_row],
    )


def nearest_true_boxes(
    truth: Truth, candidates: Bools, frame: Ints, box: Floats
) -> tuple[Ints, Floats]:
    """Return the nearest true box of each box: rows [D], and distances [D] in m.

    ``candidates`` ``[R]``: mask of the true boxes to choose from; ``frame`` [D] and
    ``box`` ``[D, 7]``. In frames without a candidate the row is -1, the index of a
    value that callers append, and the distance is inf.
    """
    nearest_row = np.full(len(box), -1)
    distance_m = np.full(len(box), np.inf)
    for t in np.unique(frame):
        rows = truth.rows(int(t))
        true_rows = rows.start + np.flatnonzero(candidates[rows])
        if len(true_rows):
            index = np.flatnonzero(frame == t)
            distances = center_distance(box[index, None], truth.box[None, true_rows])
            nearest_row[index] = true_rows[distances.argmin(axis=1)]
            distance_m[index] = distances.min(axis=1)
    return nearest_row, distance_m


def above_floor(
    detections: Detections, classes: Sequence[str], floor: Mapping[str, float] | None
) -> Detections:
    """Return detections with at least the score ``floor`` of their class.

    A class without one keeps all.
    """
    if not floor:
        return detections
    least_score = np.array([floor.get(name, -np.inf) for name in classes])
    return detections.select(detections.score >= least_score[detections.class_id])


def match_boxes(
    truth: Truth, detections: Detections, classes: Sequence[str]
) -> Matches:
    """Match true boxes and detections by frame and class.

    As many pairs as the gates allow, then the least sum of BEV distances. Neutral true
    boxes take part, so that their detections are not false positives.
    """
    detection = np.full(len(truth.box), -1)
    false = np.ones(len(detections.box), dtype=bool)
    duplicate = np.zeros(len(detections.box), dtype=bool)
    for t in range(truth.frames):
        true_rows = truth.rows(t)
        rows = detections.rows(t)
        for class_id, class_name in enumerate(classes):
            i = true_rows.start + np.flatnonzero(truth.class_id[true_rows] == class_id)
            j = rows.start + np.flatnonzero(detections.class_id[rows] == class_id)
            if not len(i) or not len(j):
                continue
            distance_m = center_distance(truth.box[i, None], detections.box[None, j])
            gate_m = _GATES_M.get(class_name, _VEHICLE_GATE_M)
            in_gate = distance_m <= gate_m
            # costs more than all pairs inside the gate together
            beyond_gate = (min(distance_m.shape) + 1) * (gate_m + 1.0)
            cost = np.where(in_gate, distance_m, beyond_gate)
            pair_i, pair_j = linear_sum_assignment(cost)
            is_pair = in_gate[pair_i, pair_j]
            matched = j[pair_j[is_pair]]
            detection[i[pair_i[is_pair]]] = matched
            false[matched] = False
            false[j[in_gate[truth.neutral[i]].any(axis=0)]] = False
            # the matched ones too: `false` leaves them out in the end
            matched_box = detections.box[matched, None]
            distance_m = center_distance(matched_box, detections.box[None, j])
            is_close = distance_m <= _DUPLICATE_DISTANCE_M
            duplicate[j[is_close.any(axis=0)]] = True
    return Matches(detection=detection, false=false, duplicate=duplicate & false)
