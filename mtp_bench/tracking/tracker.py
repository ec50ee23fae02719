"""Multi-hypothesis tracking by detection: the H best global associations, kept every frame.

Each hypothesis spawns its best children, the H best of all survive, children with equal tracks are merged. Hypotheses
share their tracks (`tree`). With one hypothesis this is the Hungarian tracker.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from numbers import Real
from typing import get_args

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
from .tree import HypothesisTree, Seen

ASSIGNMENTS = ("hungarian", "as_parameters", "greedy")
_KINDS: dict[str, int] = {
    "center_distance": CENTER_DISTANCE,
    "iou_3d": IOU_3D,
    "giou_3d": GIOU_3D,
}


class HypothesisTracker:
    """AB3DMOT's filter and life cycle with the ``hypotheses`` best global associations.

    ``parameters``: one per class of the task; None takes those of the task's card, else of its detector.
    ``temperature`` turns costs into weights, exp(-cost / temperature). ``assignment``: with one hypothesis also
    "as_parameters", greedy for the classes whose parameters say so, as in AB3DMOT, or "greedy" for all.
    ``min_detection_score``: detections with lower scores are ignored; a number, or one per class name.
    In an env with ``observe="associated"`` one hypothesis keeps the given identities: `GivenIdentities`.
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
            raise ShapeError(
                f"assignment is {assignment!r}, expected {' or '.join(map(repr, ASSIGNMENTS))}"
            )
        if assignment != "hungarian" and hypotheses > 1:
            raise ShapeError(
                f"assignment {assignment!r} works with 1 hypothesis, got {hypotheses}"
            )
        least = min_detection_score
        for value in (
            least.values()
            if isinstance(least, Mapping)
            else ()
            if least is None
            else (least,)
        ):
            if (
                isinstance(value, bool)
                or not isinstance(value, Real)
                or np.isnan(float(value))
            ):
                raise ShapeError(
                    f"min_detection_score is {least!r}, expected a number, a number per class name, or None for no cut"
                )
        self._hypotheses, self._given, self._temperature = (
            hypotheses,
            parameters,
            temperature,
        )
        self._assignment, self._min_detection_score = assignment, min_detection_score

    def reset(self, task: Task) -> None:
        """Forget everything."""
        if task.observe == "associated" and self._hypotheses > 1:
            raise ShapeError(
                f'observe="associated" works with 1 hypothesis, got {self._hypotheses}'
            )
        self._parameters = self._given or recommended_parameters(task)
        if self._assignment == "greedy":
            self._parameters = tuple(
                replace(rule, assignment="greedy") for rule in self._parameters
            )
        if len(self._parameters) != len(task.classes):
            raise ShapeError(
                f"got parameters of {len(self._parameters)} classes, the task has {len(task.classes)}"
            )
        self._rules = rules_of(self._parameters)
        self._min_hits = np.array([p.min_hits for p in self._parameters])
        self._max_age = np.array([p.max_age for p in self._parameters])
        self._least = _per_class(self._min_detection_score, task)
        self._task = task
        self._begin(0)

    def _begin(self, next_id: int) -> None:
        """Begin a scene, or what follows a hole in time: without tracks."""
        self._frame = 0
        self._tree = HypothesisTree(self._task.past, next_id)
        self._identities = (
            GivenIdentities() if self._task.observe == "associated" else None
        )
        self._cost = np.zeros(1)  # [H]

    def step(self, observation: Observation) -> Tracks:
        """Tracks to output after this frame: hit often enough, and not unseen for too long; a hole in time ends all."""
        if self._task.after_hole(observation):
            self._begin(self._tree.next_id)
        rows = _rows(observation, self._least)
        seen = _seen(observation, rows, self._task.velocity)
        if self._identities is not None:
            self._identities.observe(observation["detection_id"][rows])
        self._frame += 1
        self._tree.predict()
        cost, column, parent = self._associate(seen)
        self._tree.grow(
            column, parent, seen, self._max_age[self._tree.class_id], self._task.dt
        )
        if self._identities is not None:
            self._identities.grow(self._tree.before, self._tree.detection)
        kept = self._tree.merge_equal()
        self._cost = cost[kept] - cost[0]
        return self._output(parent[kept], rows)

    def _associate(self, seen: Seen) -> tuple[Floats, Ints, Ints]:
        """Costs [K] of the new hypotheses, the detection of each leaf in them [K, N], and their parents [K]."""
        tree = self._tree
        pairs = sparse_gains(
            tree.box, tree.class_id, seen.box, seen.class_id, self._rules
        )
        if self._identities is not None:
            pairs = self._identities.free_pairs(*pairs)
        self._pairs = pairs[0], seen.row[pairs[1]], pairs[2]
        cost, column, parent = self._solve(seen, *pairs)
        return (
            cost,
            column if self._identities is None else self._identities.assign(column),
            parent,
        )

    def _solve(
        self, seen: Seen, indptr: Ints, column: Ints, gain: Floats
    ) -> tuple[Floats, Ints, Ints]:
        tree = self._tree
        if self._assignment != "hungarian":
            cost = np.full((len(tree.class_id), len(seen.box)), np.inf)
            cost[np.repeat(np.arange(len(cost)), np.diff(indptr)), column] = -gain
            chosen = _greedy_where_asked(cost, tree.class_id, self._parameters)
            return np.zeros(1), chosen[None], np.zeros(1, dtype=np.int64)
        return joint_k_best(
            indptr,
            column,
            -gain,
            len(seen.box),
            tree.member,
            self._cost,
            self._hypotheses,
        )

    def _output(self, parent: Ints, rows: Ints) -> Tracks:
        tree = self._tree
        least = self._min_hits[tree.class_id]
        confirmed = (tree.hits >= least) | (
            self._frame <= least
        )  # a recording does not wait for its first tracks
        out = np.flatnonzero(confirmed)
        past, taken = tree.history(out)
        weight = -self._cost / self._temperature
        return Tracks(
            track_id=tree.track_id[out],
            box=tree.box[out],
            class_id=tree.class_id[out],
            score=tree.score[out] / tree.hits[out],
            detection=np.append(rows, -1)[tree.detection[out]],
            past=past,
            past_valid=taken >= 0,
            member=tree.member.take(out, axis=1),
            log_weight=weight - np.logaddexp.reduce(weight),
            parent=parent,
            last_score=tree.last_score[out],
            hits=tree.hits[out],
            age=tree.age[out],
            past_detection=taken,
            covariance=tree.covariance(out),
            affinity=Affinity(tree.before[out], *self._pairs),
        )


def _per_class(least: float | Mapping[str, float] | None, task: Task) -> Floats:
    """Lowest score of each class of the task [C]; raises UnknownNameError for a name of another class."""
    if not isinstance(least, Mapping):
        return np.full(len(task.classes), -np.inf if least is None else least)
    for name in least:
        require_known("class in min_detection_score", name, task.classes)
    return np.array([least.get(name, -np.inf) for name in task.classes])


def _rows(observation: Observation, least: Floats) -> Ints:
    """The rows of the detections that count, of ``least`` score by class [C]."""
    rows = np.flatnonzero(observation["detection_valid"])
    score, class_id = (
        observation["detection_score"][rows],
        observation["detection_class"][rows],
    )
    return rows[score >= least[class_id]]


def _seen(observation: Observation, rows: Ints, measured: bool) -> Seen:
    velocity = (
        observation["detection_velocity"][rows].astype(np.float64)
        if measured
        else np.zeros((0, 2))
    )
    box, score = (
        observation[f"detection_{name}"][rows].astype(np.float64)
        for name in ("box", "score")
    )
    return Seen(
        box,
        observation["detection_class"][rows].astype(np.int64),
        score,
        velocity,
        rows,
    )


def _greedy_where_asked(
    cost: Floats, class_id: Ints, parameters: tuple[ClassParameters, ...]
) -> Ints:
    """Column of each row, -1 for none: cheapest pair first for greedy classes (AB3DMOT), else least total cost."""
    column = np.full(len(cost), -1)
    for c, rule in enumerate(parameters):
        rows = np.flatnonzero(class_id == c)
        if rule.assignment == "hungarian":
            column[rows] = k_best(cost[rows], 1)[1][0]
            continue
        left = cost[rows].copy()
        while left.size and np.isfinite(left.min()):
            i, j = np.unravel_index(np.argmin(left), left.shape)
            column[rows[i]] = j
            left[i, :] = left[:, j] = np.inf
    return column


def rules_of(parameters: Sequence[ClassParameters]) -> tuple[Ints, Floats]:
    """Kinds of affinity [C] and gates [C] of the classes, as `sparse_gains` takes them.

    Raises UnknownNameError for an unknown affinity, ShapeError for an unknown assignment.
    """
    for rule in parameters:
        if rule.assignment not in get_args(Assignment):
            allowed = " or ".join(map(repr, get_args(Assignment)))
            raise ShapeError(
                f"assignment of ClassParameters is {rule.assignment!r}, expected {allowed}"
            )
        require_known("affinity", rule.affinity, _KINDS)
    kinds = np.array([_KINDS[rule.affinity] for rule in parameters], dtype=np.int64)
    return kinds, np.array([rule.gate for rule in parameters], dtype=np.float64)


def sparse_gains(
    tracks: Floats,
    track_class: Ints,
    detections: Floats,
    detection_class: Ints,
    rules: tuple[Ints, Floats],
) -> tuple[Ints, Ints, Floats]:
    """Allowed pairs of track boxes with detected boxes: ``indptr`` [N + 1], ``column`` and ``gain`` [E].

    ``tracks`` [N, 7] of ``track_class`` [N], ``detections`` [D, 7] of ``detection_class`` [D]; ``rules``: see
    `rules_of`. The pairs of track i, of one class, are ``indptr[i]:indptr[i + 1]``, by ascending column. Two boxes
    without any volume between them, whose GIoU is 0 / 0, may or may not match.
    """
    return sparse_pairs(
        np.require(
            tracks, np.float64, "W"
        ),  # a view of longer rows will do, but writable
        np.require(track_class, np.int64, ["C", "W"]),
        np.require(detections, np.float64, "W"),
        np.require(detection_class, np.int64, ["C", "W"]),
        *rules,
    )
