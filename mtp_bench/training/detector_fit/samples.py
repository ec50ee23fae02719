"""Samples to fit a detector to: hits and errors of the true boxes of each class, and its false positives."""

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

# m, largest BEV distance of a detection from its true box
_GATES = {"pedestrian": 1.0, "cyclist": 1.5, "bicycle": 1.5, "motorcycle": 1.5}
_VEHICLE_GATE = 2.0
_DUPLICATE = 0.75  # m: a second detection this near to the matched one belongs to the same object


@dataclass(frozen=True, eq=False)
class ObjectSamples:
    """Covered true boxes of a class without the neutral ones, sorted by object and frame."""

    object: Ints  # [R] unique over scenes
    frame: Ints  # [R] within the scene
    hit: Bools  # [R]
    feature: Floats  # [R, 7] see `quality_features`
    error: Floats  # [R, 7] detected less true: radial, tangential, z m, heading rad, l w h m; NaN where undetected
    velocity_error: Floats  # [R, 2] m/s; NaN where undetected or not measured
    score: Floats  # [R] NaN where undetected
    scene: Ints  # [R] number of the scene
    place: Floats  # [R, 2] m, of the true box
    direction: Floats  # [R] rad, from the sensor to it

    def pairs(self, lag: int = 1) -> tuple[Ints, Ints]:
        """Rows of the same object, earlier and later, ``lag`` frames apart."""
        width = int(self.frame.max(initial=0)) + lag + 1
        key = self.object * width + self.frame
        later = np.searchsorted(key, key + lag)
        earlier = np.flatnonzero(later < len(key))
        earlier = earlier[key[later[earlier]] == key[earlier] + lag]
        return earlier, later[earlier]

    def hit_pairs(self, lag: int = 1) -> tuple[Ints, Ints]:
        """The pairs with two hits."""
        earlier, later = self.pairs(lag)
        both = self.hit[earlier] & self.hit[later]
        return earlier[both], later[both]


@dataclass(frozen=True, eq=False)
class FalsePositiveSamples:
    """False positives of a class inside the sensor's coverage."""

    count: Ints  # [F] per frame, all scenes one after another
    duplicate: Bools  # [D] a second detection of an object
    score: Floats  # [D]
    size: Floats  # [D, 3] m
    distance: Floats  # [D] m from the sensor
    scene: Ints  # [D] number of the scene
    frame: Ints  # [D] within the scene
    place: Floats  # [D, 2] m
    beside: (
        Floats  # [D] m to the nearest true box of the pooled classes; inf without one
    )
    of_class: Bools  # [D] that box has the class of the detection
    parent: Floats  # [D] score of that box' own detection, NaN where it is undetected


@dataclass(frozen=True, eq=False)
class Matches:
    """Pairs of true boxes and detections of a scene."""

    detection: Ints  # [R] row of each true box' detection, -1 where it is undetected
    false: Bools  # [D] detections without a true box, except those beside neutral true boxes
    duplicate: Bools  # [D] false ones beside the detection of a true box


Samples = tuple[ObjectSamples, FalsePositiveSamples]


def collect_samples(
    scenes: Iterable[Scene],
    classes: Sequence[str],
    sensor: Sensor,
    floor: Mapping[str, float] | None = None,
    pooled: Mapping[str, str] | None = None,
) -> dict[str, Samples]:
    """Samples per class over ``scenes``; raises DataError without a scene.

    ``floor``: least score per class of the detections that count; ``pooled``: classes, and the class whose samples
    theirs are added to. Boxes are matched class by class in any case.
    """
    pooled = pooled or {}
    parts: dict[str, list[Samples]] = {
        name: [] for name in classes if name not in pooled
    }
    object_count = 0  # in the scenes so far
    for scene_number, scene in enumerate(scenes):
        detections = above_floor(scene.detections, classes, floor)
        matches = match_boxes(scene.truth, detections, classes)
        ids, number = np.unique(scene.truth.object_id, return_inverse=True)
        rows = _object_samples(
            scene,
            detections,
            matches.detection,
            object_count + number,
            sensor,
            scene_number,
        )
        kept = covered(scene.truth, scene.ego, sensor) & ~scene.truth.neutral
        for name, samples in parts.items():
            class_ids = [
                k for k, other in enumerate(classes) if pooled.get(other, other) == name
            ]
            row = np.flatnonzero(kept & np.isin(scene.truth.class_id, class_ids))
            row = row[np.lexsort((rows.frame[row], number[row]))]
            false = _false_positive_samples(
                scene, detections, matches, class_ids, sensor, scene_number
            )
            samples.append((select(rows, row), false))
        object_count += len(ids)
    if not any(parts.values()):
        raise DataError(
            "no scenes to compare detections with true boxes in, expected at least one"
        )
    return {
        name: (joined([a for a, _ in part]), joined([b for _, b in part]))
        for name, part in parts.items()
    }


def _object_samples(
    scene: Scene,
    detections: Detections,
    detection: Ints,
    number: Ints,
    sensor: Sensor,
    scene_number: int,
) -> ObjectSamples:
    """Samples of all true rows, with the detections ``detection`` (-1: undetected)."""
    true = scene.truth.box
    frame = scene.truth.frame_of_rows
    hit = detection >= 0
    box, velocity, score = (
        np.full((len(true), *shape), np.nan) for shape in ((7,), (2,), ())
    )
    box[hit] = detections.box[detection[hit]]
    score[hit] = detections.score[detection[hit]]
    if (
        detections.velocity.any()
    ):  # some formats write zeros everywhere where velocities were not measured
        velocity[hit] = detections.velocity[detection[hit]]
    offset = box[:, :2] - true[:, :2]
    away = true[:, :2] - scene.ego[frame, :2]
    away = away / np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-9)[:, None]
    radial = (away * offset).sum(axis=1)
    tangential = away[:, 0] * offset[:, 1] - away[:, 1] * offset[:, 0]
    heading = wrap_angle(box[:, 3] - true[:, 3])
    return ObjectSamples(
        object=number,
        frame=frame,
        hit=hit,
        feature=quality_features(
            visibility_of(scene.truth, scene.ego, sensor, scene.visible)
        ),
        error=np.column_stack(
            [
                radial,
                tangential,
                box[:, 2] - true[:, 2],
                heading,
                box[:, 4:] - true[:, 4:],
            ]
        ),
        velocity_error=velocity - scene.truth.velocity,
        score=score,
        scene=np.full(len(true), scene_number),
        place=true[:, :2],
        direction=np.arctan2(away[:, 1], away[:, 0]),
    )


def _false_positive_samples(
    scene: Scene,
    detections: Detections,
    matches: Matches,
    class_ids: Sequence[int],
    sensor: Sensor,
    scene_number: int,
) -> FalsePositiveSamples:
    all_frames = detections.frame_of_rows
    truth = scene.truth
    row = np.flatnonzero(matches.false & np.isin(detections.class_id, class_ids))
    distance, bearing = polar(detections.box[row, :2], scene.ego[all_frames[row]])
    inside = sensor.covers(distance, bearing)
    row = row[inside]
    frame = all_frames[row]
    box = detections.box[row]
    nearest, beside = nearest_true_boxes(
        truth, np.isin(truth.class_id, class_ids), frame, box
    )
    return FalsePositiveSamples(
        count=np.diff(starts_of_sorted(frame, scene.frames)),
        duplicate=matches.duplicate[row],
        score=detections.score[row],
        size=box[:, 4:7],
        distance=distance[inside],
        scene=np.full(len(row), scene_number),
        frame=frame,
        place=box[:, :2],
        beside=beside,
        of_class=np.append(truth.class_id, -1)[nearest] == detections.class_id[row],
        parent=np.append(detections.score, np.nan)[
            np.append(matches.detection, -1)[nearest]
        ],
    )


def nearest_true_boxes(
    truth: Truth, kept: Bools, frame: Ints, box: Floats
) -> tuple[Ints, Floats]:
    """Row of the nearest true box of ``kept`` ``[R]`` in the frame of each box ``[D, 7]``, and the distance in m.

    -1 (the index of an appended value) and inf in frames without one.
    """
    nearest = np.full(len(box), -1)
    distance = np.full(len(box), np.inf)
    for t in np.unique(frame):
        rows = truth.rows(int(t))
        true = rows.start + np.flatnonzero(kept[rows])
        if len(true):
            index = np.flatnonzero(frame == t)
            distances = center_distance(box[index, None], truth.box[None, true])
            nearest[index] = true[distances.argmin(axis=1)]
            distance[index] = distances.min(axis=1)
    return nearest, distance


def above_floor(
    detections: Detections, classes: Sequence[str], floor: Mapping[str, float] | None
) -> Detections:
    """Detections with at least the score ``floor`` of their class; a class without one keeps all."""
    if not floor:
        return detections
    least = np.array([floor.get(name, -np.inf) for name in classes])
    return detections.select(detections.score >= least[detections.class_id])


def match_boxes(
    truth: Truth, detections: Detections, classes: Sequence[str]
) -> Matches:
    """Match true boxes and detections one to one, frame by frame within each class.

    As many pairs as the gates allow, then the least sum of BEV distances. Neutral true boxes take part, so that their
    detections are not false positives.
    """
    detection = np.full(len(truth.box), -1)
    false = np.ones(len(detections.box), dtype=bool)
    duplicate = np.zeros(len(detections.box), dtype=bool)
    for t in range(truth.frames):
        true_rows = truth.rows(t)
        rows = detections.rows(t)
        for class_id, name in enumerate(classes):
            i = true_rows.start + np.flatnonzero(truth.class_id[true_rows] == class_id)
            j = rows.start + np.flatnonzero(detections.class_id[rows] == class_id)
            if not len(i) or not len(j):
                continue
            distance = center_distance(truth.box[i, None], detections.box[None, j])
            gate = _GATES.get(name, _VEHICLE_GATE)
            # more than all pairs together
            near = distance <= gate
            beyond = (min(distance.shape) + 1) * (gate + 1.0)
            pair_i, pair_j = linear_sum_assignment(np.where(near, distance, beyond))
            kept = near[pair_i, pair_j]
            pair_i = pair_i[kept]
            pair_j = pair_j[kept]
            detection[i[pair_i]] = j[pair_j]
            false[j[pair_j]] = False
            false[j[near[truth.neutral[i]].any(axis=0)]] = False
            beside = (
                center_distance(
                    detections.box[j[pair_j], None], detections.box[None, j]
                )
                <= _DUPLICATE
            )
            duplicate[j[beside.any(axis=0)]] = True
    return Matches(detection=detection, false=false, duplicate=duplicate & false)
