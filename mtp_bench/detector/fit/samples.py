"""What a detector made of the true boxes of a class, over all scenes: hits, errors, scores, false positives."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from ...errors import DataError
from ...geometry import center_distance, wrap_angle
from ...types import Bools, Detections, Floats, Ints, Scene, Truth, joined, starts_of_sorted
from ..sight import Sensor, covered, polar, sight, within
from ..sight import features as features_of

RADIAL, TANGENTIAL, HEIGHT, HEADING, SIZE = 0, 1, 2, 3, slice(4, 7)  # columns of ``ObjectSamples.error``

_GATES = {"pedestrian": 1.0, "cyclist": 1.5, "bicycle": 1.5, "motorcycle": 1.5}
_VEHICLE_GATE = 2.0
_BESIDE = 0.75  # m: a second detection that near to the first one is of the same object


@dataclass(frozen=True, eq=False)
class ObjectSamples:
    """The covered true boxes of a class, neutral ones left out, sorted by object and frame."""

    object: Ints  # [R] unique over scenes
    frame: Ints  # [R] within the scene
    hit: Bools  # [R]
    feature: Floats  # [R, 6] 1, distance / 10 m, partly occluded, largely occluded, hidden, truncated
    error: Floats  # [R, 7] detected less true: radial, tangential, z m, heading rad, l w h m; NaN where undetected
    velocity_error: Floats  # [R, 2] m/s; NaN where undetected or not measured
    score: Floats  # [R] NaN where undetected
    scene: Ints  # [R] number of the scene
    place: Floats  # [R, 2] m, of the true box
    toward: Floats  # [R] rad, from the sensor to it

    def pairs(self, lag: int = 1) -> tuple[Ints, Ints]:
        """Rows of the same object, earlier and later, ``lag`` frames apart."""
        width = int(self.frame.max(initial=0)) + lag + 1
        key = self.object * width + self.frame
        later = np.searchsorted(key, key + lag)
        found = np.flatnonzero(later < len(key))
        found = found[key[later[found]] == key[found] + lag]
        return found, later[found]

    def hit_pairs(self, lag: int = 1) -> tuple[Ints, Ints]:
        """The pairs of which both were hit."""
        earlier, later = self.pairs(lag)
        both = self.hit[earlier] & self.hit[later]
        return earlier[both], later[both]


@dataclass(frozen=True, eq=False)
class FalsePositiveSamples:
    """The false positives of a class inside the sensor's coverage."""

    count: Ints  # [F] per frame, all scenes one after another
    duplicate: Bools  # [D] a second detection of an object
    score: Floats  # [D]
    size: Floats  # [D, 3] m
    distance: Floats  # [D] m from the sensor
    scene: Ints  # [D] number of the scene
    frame: Ints  # [D] within the scene
    place: Floats  # [D, 2] m
    beside: Floats  # [D] m to the nearest true box of the class, or of one that is pooled with it; inf without any
    of_class: Bools  # [D] that box has the class of the detection
    parent: Floats  # [D] score of that box' own detection, NaN where it is undetected


Samples = tuple[ObjectSamples, FalsePositiveSamples]


def collect(
    scenes: Iterable[Scene],
    classes: Sequence[str],
    sensor: Sensor,
    floor: Mapping[str, float] | None = None,
    features: bool = True,
    pooled: Mapping[str, str] | None = None,
) -> dict[str, Samples]:
    """Samples per class over ``scenes``; only detections with a score of at least ``floor`` of their class count.

    ``classes``: the task's, in the order of class indices; ``sensor``: what the detector can see, in metres and
    radians. Without ``features``, which take half of the time, those are 0. ``pooled``: classes, and the class whose
    samples theirs are added to; boxes are matched class by class all the same. Raises DataError without a scene.
    """
    pooled = pooled or {}
    parts: dict[str, list[Samples]] = {name: [] for name in classes if name not in pooled}
    objects = 0  # in the scenes so far
    for number_of_scene, scene in enumerate(scenes):
        found = at_floor(scene.detections, classes, floor)
        matches = match(scene.truth, found, classes)
        known, number = np.unique(scene.truth.object_id, return_inverse=True)
        seen: Floats = np.zeros((len(number), 6))
        if features:
            seen = features_of(sight(scene.truth, scene.ego, sensor, scene.visible))
        every = _objects(scene, found, matches.detection, objects + number, seen, number_of_scene)
        inside = covered(scene.truth, scene.ego, sensor) & ~scene.truth.neutral
        for name, samples in parts.items():
            own = [i for i, one in enumerate(classes) if pooled.get(one, one) == name]
            row = np.flatnonzero(inside & np.isin(scene.truth.class_id, own))
            row = row[np.lexsort((every.frame[row], number[row]))]
            false = _false_positives(scene, found, matches, own, sensor, number_of_scene)
            samples.append((_selected(every, row), false))
        objects += len(known)
    if not any(parts.values()):
        raise DataError("no scenes to compare detections with true boxes in, expected at least one")
    return {name: (joined([a for a, _ in part]), joined([b for _, b in part])) for name, part in parts.items()}


def _objects(
    scene: Scene, detections: Detections, detection: Ints, number: Ints, feature: Floats, number_of_scene: int
) -> ObjectSamples:
    """Samples of all true rows, with the detections ``detection`` (-1: undetected)."""
    true, frame, hit = scene.truth.box, scene.truth.frame_of_rows, detection >= 0
    found, velocity, score = (np.full((len(true), *shape), np.nan) for shape in ((7,), (2,), ()))
    found[hit] = detections.box[detection[hit]]
    score[hit] = detections.score[detection[hit]]
    if detections.velocity.any():  # zeros everywhere: some formats write them where nothing was measured
        velocity[hit] = detections.velocity[detection[hit]]
    off, away = found[:, :2] - true[:, :2], true[:, :2] - scene.ego[frame, :2]
    away = away / np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-9)[:, None]
    return ObjectSamples(
        object=number,
        frame=frame,
        hit=hit,
        feature=feature,
        error=np.column_stack(
            [
                (away * off).sum(axis=1),
                away[:, 0] * off[:, 1] - away[:, 1] * off[:, 0],
                found[:, 2] - true[:, 2],
                wrap_angle(found[:, 3] - true[:, 3]),
                found[:, 4:] - true[:, 4:],
            ]
        ),
        velocity_error=velocity - scene.truth.velocity,
        score=score,
        scene=np.full(len(true), number_of_scene),
        place=true[:, :2],
        toward=np.arctan2(away[:, 1], away[:, 0]),
    )


def _false_positives(
    scene: Scene, detections: Detections, matches: Matches, class_ids: Sequence[int], sensor: Sensor, number: int
) -> FalsePositiveSamples:
    frame = detections.frame_of_rows
    row = np.flatnonzero(matches.false & np.isin(detections.class_id, class_ids))
    distance, bearing = polar(detections.box[row, :2], scene.ego[frame[row]])
    inside = within(distance, bearing, sensor)
    row, distance = row[inside], distance[inside]
    frame, place = frame[row], detections.box[row, :2]
    first = starts_of_sorted(frame, scene.frames)
    beside, of_class, parent = _parents(scene, detections, matches, row, class_ids)
    return FalsePositiveSamples(
        count=np.diff(first),
        duplicate=matches.duplicate[row],
        score=detections.score[row],
        size=detections.box[row, 4:7],
        distance=distance,
        scene=np.full(len(row), number),
        frame=frame,
        place=place,
        beside=beside,
        of_class=of_class,
        parent=parent,
    )


def _parents(
    scene: Scene, detections: Detections, matches: Matches, row: Ints, class_ids: Sequence[int]
) -> tuple[Floats, Bools, Floats]:
    """Of detections ``row``: distance to the nearest true box of the classes, whether of its class, its score."""
    truth, frame = scene.truth, detections.frame_of_rows[row]
    nearest, beside = nearest_true(truth, np.isin(truth.class_id, class_ids), frame, detections.box[row])
    of_class = np.append(truth.class_id, -1)[nearest] == detections.class_id[row]
    detection = np.append(matches.detection, -1)[nearest]
    return beside, of_class, np.append(detections.score, np.nan)[detection]


def nearest_true(truth: Truth, own: Bools, frame: Ints, box: Floats) -> tuple[Ints, Floats]:
    """The nearest of the true boxes ``own`` ``[R]`` in the frame of each box ``[D, 7]``: its row, and m to it.

    -1, an index of what is appended, and inf where the frame has none.
    """
    nearest, distance = np.full(len(box), -1), np.full(len(box), np.inf)
    for t in np.unique(frame):
        rows = truth.rows(int(t))
        true = rows.start + np.flatnonzero(own[rows])
        if len(true):
            here = np.flatnonzero(frame == t)
            off = center_distance(box[here, None], truth.box[None, true])
            nearest[here], distance[here] = true[off.argmin(axis=1)], off.min(axis=1)
    return nearest, distance


def _selected(record: ObjectSamples, row: Ints) -> ObjectSamples:
    return ObjectSamples(**{one.name: getattr(record, one.name)[row] for one in fields(record)})


@dataclass(frozen=True, eq=False)
class Matches:
    """Pairs of true boxes and detections of a scene."""

    detection: Ints  # [R] per true box: row of its detection, -1 where it is undetected
    false: Bools  # [D] detections without a true box, those beside neutral true boxes left out
    duplicate: Bools  # [D] false ones beside the detection of a true box


def gate(class_name: str) -> float:
    """Largest distance (BEV, metres) of a detection from its true box; 2 m unless the class is a small one."""
    return _GATES.get(class_name, _VEHICLE_GATE)


def at_floor(detections: Detections, classes: Sequence[str], floor: Mapping[str, float] | None) -> Detections:
    """The detections whose score reaches the ``floor`` of their class; classes without one keep all."""
    if not floor:
        return detections
    least = np.array([floor.get(name, -np.inf) for name in classes])
    return detections.those(detections.score >= least[detections.class_id])


def match(truth: Truth, detections: Detections, classes: Sequence[str]) -> Matches:
    """Match true boxes and detections one to one, frame by frame within each class.

    As many pairs as the gates allow, and among those answers the least sum of BEV distances. Neutral true boxes take
    part, so that they absorb detections that are theirs.
    """
    detection = np.full(len(truth.box), -1)
    false = np.ones(len(detections.box), dtype=bool)
    duplicate = np.zeros(len(detections.box), dtype=bool)
    for t in range(truth.frames):
        true_rows, rows = truth.rows(t), detections.rows(t)
        for class_id, name in enumerate(classes):
            i = true_rows.start + np.flatnonzero(truth.class_id[true_rows] == class_id)
            j = rows.start + np.flatnonzero(detections.class_id[rows] == class_id)
            if not len(i) or not len(j):
                continue
            distance = center_distance(truth.box[i, None], detections.box[None, j])
            pair_i, pair_j = _assign(distance, gate(name))
            detection[i[pair_i]] = j[pair_j]
            near = distance <= gate(name)
            false[j[pair_j]] = False
            false[j[near[truth.neutral[i]].any(axis=0)]] = False
            beside = center_distance(detections.box[j[pair_j], None], detections.box[None, j]) <= _BESIDE
            duplicate[j[beside.any(axis=0)]] = True
    return Matches(detection=detection, false=false, duplicate=duplicate & false)


def _assign(distance: Floats, largest: float) -> tuple[Ints, Ints]:
    """Rows and columns of the pairs within ``largest``: the most pairs first, then the least sum."""
    from scipy.optimize import linear_sum_assignment

    near = distance <= largest
    beyond = (min(distance.shape) + 1) * (largest + 1.0)  # dearer than all pairs together
    row, column = linear_sum_assignment(np.where(near, distance, beyond))
    kept = near[row, column]
    return row[kept], column[kept]
