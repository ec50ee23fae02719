"""Multi-hypothesis tracking by detection.

The H best global associations are kept every frame. Each hypothesis spawns its best
children, the H best of all survive, children with equal tracks are merged. Hypotheses
share their tracks (`tree`). With one hypothesis this is the Hungarian tracker.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from typing import Any, get_args

import numpy as np

from ..core import (
    Affinity,
    Floats,
    Ints,
    Observation,
    ShapeError,
    Task,
    Tracks,
    require_known,
)
from .given import GivenIdentities
from .joint import k_best
from .kernels.affinity_kernels import CENTER_DISTANCE, GIOU_3D, IOU_3D, sparse_pairs
from .kernels.association import joint_k_best
from .parameters import Assignment, ClassParameters, recommended_parameters
from .tree import FrameDetections, HypothesisTree

ASSIGNMENTS = ("hungarian", "as_parameters", "greedy")
_AFFINITY_KINDS: dict[str, int] = {
    "center_distance": CENTER_DISTANCE,
    "iou_3d": IOU_3D,
    "giou_3d": GIOU_3D,
}


class HypothesisTracker:
    """AB3DMOT's filter and life cycle with the best global associations.

    Args:
        hypotheses: number of global associations that are kept.
        parameters: one per class of the task. None: those that the task's card states,
            otherwise those of its detector.
        temperature: turns costs into weights, exp(-cost / temperature).
        assignment: "hungarian" for the best assignments. With one hypothesis also
            "as_parameters", which is greedy for the classes whose parameters say so, as
            in AB3DMOT, or "greedy" for all classes.
        min_detection_score: detections with lower scores are ignored; a number, or one
            per class name.

    In an env with ``observe="associated"`` one hypothesis keeps the given identities:
    `GivenIdentities`.
    """

    def __init__(
        self,
        hypotheses: int = 1,
        parameters: tuple[ClassParameters, ...] | None = None,
        temperature: float = 1.0,
        assignment: str = "hungarian",
        min_detection_score: float | Mapping[str, float] | None = None,
    ) -> None:
        if not isinstance(hypotheses, (int, np.integer)) or hypotheses < 1:
            raise ShapeError(
                f"hypotheses is {hypotheses}, expected a whole number, 1 or more"
            )
        if not temperature > 0:
            raise ShapeError(f"temperature is {temperature}, expected a number above 0")
        if assignment not in ASSIGNMENTS:
            allowed = " or ".join(map(repr, ASSIGNMENTS))
            raise ShapeError(f"assignment is {assignment!r}, expected {allowed}")
        if assignment != "hungarian" and hypotheses > 1:
            raise ShapeError(
                f"assignment {assignment!r} works with 1 hypothesis, got {hypotheses}"
            )
        _require_scores(min_detection_score)
        self._hypotheses = hypotheses
        self._given_parameters = parameters
        self._temperature = temperature
        self._assignment = assignment
        self._min_detection_score = min_detection_score

    def reset(self, task: Task) -> None:
        """Forget all tracks.

        Raises ShapeError for a task that does not fit.
        """
        if task.observe == "associated" and self._hypotheses > 1:
            raise ShapeError(
                f'observe="associated" works with 1 hypothesis, got {self._hypotheses}'
            )
        parameters = self._given_parameters or recommended_parameters(task)
        if self._assignment == "greedy":
            parameters = tuple(replace(p, assignment="greedy") for p in parameters)
        if len(parameters) != len(task.classes):
            raise ShapeError(
                f"got parameters of {len(parameters)} classes, "
                f"the task has {len(task.classes)}"
            )
        self._parameters = parameters
        self._rules = rules_of(parameters)
        self._min_hits = np.array([p.min_hits for p in parameters])
        self._max_age = np.array([p.max_age for p in parameters])
        self._min_score = _min_scores(self._min_detection_score, task)
        self._task = task
        self._begin(0)

    def _begin(self, next_id: int) -> None:
        """Begin a scene, or what follows a hole in time: without tracks."""
        self._frame = 0
        self._tree = HypothesisTree(self._task.past, next_id)
        self._cost = np.zeros(1)  # [H]
        self._identities = None
        if self._task.observe == "associated":
            self._identities = GivenIdentities()

    def step(self, observation: Observation) -> Tracks:
        """Return the tracks that were hit often enough, and seen recently.

        A hole in time ends all tracks.
        """
        if self._task.after_hole(observation):
            self._begin(self._tree.next_id)
        rows = self._counted_rows(observation)
        detections = _frame_detections(observation, rows, self._task.velocity)
        if self._identities is not None:
            self._identities.observe(observation["detection_id"][rows])
        tree = self._tree
        self._frame += 1
        tree.predict()
        cost, column, parent = self._associate(detections)
        max_age = self._max_age[tree.class_id]
        tree.grow(column, parent, detections, max_age, self._task.dt)
        if self._identities is not None:
            self._identities.grow(tree.old_leaf, tree.detection)
        distinct = tree.merge_equal()
        # relative to the best hypothesis, so that sums do not grow
        self._cost = cost[distinct] - cost[0]
        return self._output(parent[distinct], rows)

    def _counted_rows(self, observation: Observation) -> Ints:
        """Return the rows of detections that have the score of their class."""
        rows = np.flatnonzero(observation["detection_valid"])
        score = observation["detection_score"][rows]
        class_id = observation["detection_class"][rows]
        return rows[score >= self._min_score[class_id]]

    def _associate(self, detections: FrameDetections) -> tuple[Floats, Ints, Ints]:
        """Return the new hypotheses: costs [K], detections of leaves [K, N], parents.

        A parent [K] is the old hypothesis that a new one comes from.
        """
        tree = self._tree
        indptr, column, gain = sparse_gains(
            tree.box, tree.class_id, detections.box, detections.class_id, self._rules
        )
        if self._identities is not None:
            indptr, column, gain = self._identities.free_pairs(indptr, column, gain)
        self._pairs = indptr, detections.row[column], gain
        detection_count = len(detections.box)
        if self._assignment == "hungarian":
            cost, assigned, parent = joint_k_best(
                indptr,
                column,
                -gain,
                detection_count,
                tree.member,
                self._cost,
                self._hypotheses,
            )
        else:
            pair_cost = np.full((len(tree.class_id), detection_count), np.inf)
            leaf = np.repeat(np.arange(len(pair_cost)), np.diff(indptr))
            pair_cost[leaf, column] = -gain
            greedy = _greedy_where_asked(pair_cost, tree.class_id, self._parameters)
            cost = np.zeros(1)
            assigned = greedy[None]
            parent = np.zeros(1, dtype=np.int64)
        if self._identities is not None:
            assigned = self._identities.assign(assigned)
        return cost, assigned, parent

    def _output(self, parent: Ints, rows: Ints) -> Tracks:
        """Return the confirmed tracks.

        ``parent`` [H]: hypotheses of the frame before; ``rows`` [D]: of detections.
        """
        tree = self._tree
        min_hits = self._min_hits[tree.class_id]
        # a recording does not wait for its first tracks
        is_confirmed = (tree.hits >= min_hits) | (self._frame <= min_hits)
        leaf = np.flatnonzero(is_confirmed)
        past_box, past_row = tree.history(leaf)
        log_weight = -self._cost / self._temperature
        return Tracks(
            track_id=tree.track_id[leaf],
            box=tree.box[leaf],
            class_id=tree.class_id[leaf],
            score=tree.score_sum[leaf] / tree.hits[leaf],
            # index -1 picks the appended -1
            detection=np.append(rows, -1)[tree.detection[leaf]],
            past=past_box,
            past_valid=past_row >= 0,
            member=tree.member.take(leaf, axis=1),
            log_weight=log_weight - np.logaddexp.reduce(log_weight),
            parent=parent,
            last_score=tree.last_score[leaf],
            hits=tree.hits[leaf],
            age=tree.age[leaf],
            past_detection=past_row,
            covariance=tree.covariance(leaf),
            affinity=Affinity(tree.old_leaf[leaf], *self._pairs),
        )


MinScore = float | Mapping[str, float] | None


def _require_scores(min_score: MinScore) -> None:
    """Raise ShapeError unless ``min_score`` holds numbers."""
    scores: Iterable[Any] = [] if min_score is None else [min_score]
    if isinstance(min_score, Mapping):
        scores = min_score.values()
    for score in scores:
        is_number = isinstance(score, Real) and not isinstance(score, bool)
        if not is_number or np.isnan(float(score)):
            raise ShapeError(
                f"min_detection_score is {min_score!r}, expected a number, "
                "a number per class name, or None for no threshold"
            )


def _min_scores(min_score: MinScore, task: Task) -> Floats:
    """Return the lowest score of each class of the task [C].

    Raises UnknownNameError for a name of another class.
    """
    if min_score is None:
        return np.full(len(task.classes), -np.inf)
    if not isinstance(min_score, Mapping):
        return np.full(len(task.classes), min_score)
    for name in min_score:
        require_known("class in min_detection_score", name, task.classes)
    return np.array([min_score.get(name, -np.inf) for name in task.classes])


def _frame_detections(
    observation: Observation, rows: Ints, velocity_is_measured: bool
) -> FrameDetections:
    velocity = np.zeros((0, 2))
    if velocity_is_measured:
        velocity = observation["detection_velocity"][rows].astype(np.float64)
    return FrameDetections(
        box=observation["detection_box"][rows].astype(np.float64),
        class_id=observation["detection_class"][rows].astype(np.int64),
        score=observation["detection_score"][rows].astype(np.float64),
        velocity=velocity,
        row=rows,
    )


def _greedy_where_asked(
    cost: Floats, class_id: Ints, parameters: tuple[ClassParameters, ...]
) -> Ints:
    """Return the column of each row, -1 for none.

    Greedy classes take the cheapest pair first (AB3DMOT), others the least total cost.
    """
    column = np.full(len(cost), -1)
    for class_number, rule in enumerate(parameters):
        rows = np.flatnonzero(class_id == class_number)
        if rule.assignment == "hungarian":
            _, row_to_column, _ = k_best(cost[rows], k=1)
            column[rows] = row_to_column[0]
            continue
        open_cost = cost[rows].copy()
        while open_cost.size and np.isfinite(open_cost.min()):
            i, j = np.unravel_index(np.argmin(open_cost), open_cost.shape)
            column[rows[i]] = j
            open_cost[i, :] = np.inf
            open_cost[:, j] = np.inf
    return column


def rules_of(parameters: Sequence[ClassParameters]) -> tuple[Ints, Floats]:
    """Return kinds of affinity [C] and gates [C] for `sparse_gains`.

    Raises UnknownNameError for an unknown affinity, ShapeError for an unknown
    assignment.
    """
    for rule in parameters:
        if rule.assignment not in get_args(Assignment):
            allowed = " or ".join(map(repr, get_args(Assignment)))
            raise ShapeError(
                f"assignment of ClassParameters is {rule.assignment!r}, "
                f"expected {allowed}"
            )
        require_known("affinity", rule.affinity, _AFFINITY_KINDS)
    kinds = [_AFFINITY_KINDS[rule.affinity] for rule in parameters]
    gates = [rule.gate for rule in parameters]
    return np.array(kinds, dtype=np.int64), np.array(gates, dtype=np.float64)


def sparse_gains(
    tracks: Floats,
    track_class: Ints,
    detections: Floats,
    detection_class: Ints,
    rules: tuple[Ints, Floats],
) -> tuple[Ints, Ints, Floats]:
    """Return the allowed pairs of track boxes with detected boxes.

    Args:
        tracks: boxes [N, 7].
        track_class: their classes [N].
        detections: boxes [D, 7].
        detection_class: their classes [D].
        rules: see `rules_of`.

    Returns:
        ``indptr`` [N + 1], ``column`` and ``gain`` [E]. The pairs of track i, of one
        class, are ``indptr[i]:indptr[i + 1]``, by ascending column. Two boxes without
        any volume between them, whose GIoU is 0 / 0, may or may not match.
    """
    return sparse_pairs(
        # a view of longer rows will do, but it must be writable
        np.require(tracks, np.float64, "W"),
        np.require(track_class, np.int64, ["C", "W"]),
        np.require(detections, np.float64, "W"),
        np.require(detection_class, np.int64, ["C", "W"]),
        *rules,
    )
