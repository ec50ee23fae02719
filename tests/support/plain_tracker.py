"""The tracker in plain NumPy, to compare with."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mtp_bench.agent import Observation, Tracks
from mtp_bench.tracking.parameters import ab3dmot_parameters
from mtp_bench.types import Bools, Floats, Ints, Task
from tests.support import plain_motion as motion
from tests.support.plain_affinity import gains
from tests.support.textbook_k_best import k_best


class _Seen(NamedTuple):
    """The detections of a frame."""

    box: Floats  # [D, 7]
    class_id: Ints  # [D]
    score: Floats  # [D]
    velocity: Floats | None  # [D, 2] m/s; None: not measured

    def velocity_of(self, detection: Ints) -> Floats | None:
        """Velocities of some detections."""
        return None if self.velocity is None else self.velocity[detection]


@dataclass(frozen=True, eq=False)
class _Leaves:
    """Distinct track states after a frame: one layer of the tree."""

    state: motion.MotionState
    class_id: Ints  # [N]
    track_id: Ints  # [N]
    hits: Ints  # [N] detections taken so far
    score: Floats  # [N] sum of their scores
    age: Ints  # [N] frames since the last one
    detection: Ints  # [N] taken in this frame, -1 none
    measured: Floats  # [N, 7] that detection's box (the state's where none was taken)
    parent: Ints  # [N] leaf of the frame before, -1 at birth


class PlainTracker:
    """AB3DMOT's filter and life cycle with the ``hypotheses`` best global associations."""

    def __init__(self, hypotheses: int = 1) -> None:
        self._hypotheses = hypotheses

    def reset(self, task: Task) -> None:
        """Forget everything."""
        self._parameters = ab3dmot_parameters(task.detector, task.classes)
        self._min_hits = np.array([p.min_hits for p in self._parameters])
        self._velocity, self._dt = task.velocity, task.dt
        self._max_age = np.array([p.max_age for p in self._parameters])
        self._frame = 0
        self._next_id = 0
        self._leaves = _no_leaves()
        self._member = np.ones((1, 0), dtype=bool)  # [H, N]
        self._cost = np.zeros(1)  # [H]
        self._layers: deque[_Leaves] = deque(maxlen=task.past)

    def step(self, observation: Observation) -> Tracks:
        """Tracks to output after this frame: hit often enough, and not unseen for too long."""
        seen = _seen(observation, self._velocity)
        self._frame += 1
        before = self._leaves
        ahead = motion.predicted(before.state)
        gain = gains(ahead.box, before.class_id, seen.box, seen.class_id, self._parameters)
        cost, column, parent = k_best(-gain, self._hypotheses, self._member, self._cost)
        self._grow(ahead, column, parent, seen)
        self._cost = cost - cost[0]
        self._merge_equal()
        self._layers.append(self._leaves)
        return self._output()

    def _grow(self, ahead: motion.MotionState, column: Ints, parent: Ints, seen: _Seen) -> None:
        """Replace the leaves by the distinct children of the new hypotheses.

        A child is named by a code: old leaf x (1 + detection), detection 0 standing for none, and after all of those
        the births.
        """
        before = self._leaves
        n, d = len(before.class_id), len(seen.box)
        held = self._member[parent]  # [H, N]
        code = np.where(held, np.arange(n) * (d + 1) + 1 + column, -1)
        taken = np.zeros((len(parent), d + 1), dtype=bool)  # the last column catches "unmatched"
        np.put_along_axis(taken, np.where(held, column, d), True, axis=1)
        birth = np.where(taken[:, :d], -1, n * (d + 1) + np.arange(d))
        code = np.concatenate([code, birth], axis=1)
        distinct = np.unique(code[code >= 0])
        dying = self._dying(distinct, n, d)
        distinct = distinct[~dying]
        self._leaves = self._children(ahead, distinct, seen)
        member = np.zeros((len(parent), len(distinct)), dtype=bool)
        row, place = np.nonzero(code >= 0)
        leaf = np.searchsorted(distinct, code[row, place])
        leaf = np.minimum(leaf, max(len(distinct) - 1, 0))
        alive = distinct[leaf] == code[row, place] if len(distinct) else np.zeros(len(row), dtype=bool)
        member[row[alive], leaf[alive]] = True
        self._member = member

    def _dying(self, code: Ints, n: int, d: int) -> Bools:
        """Children without a detection for too long."""
        old, unseen = code // (d + 1), code % (d + 1) == 0
        unseen &= code < n * (d + 1)
        dying = np.zeros(len(code), dtype=bool)
        old = old[unseen]
        dying[unseen] = self._leaves.age[old] + 1 >= self._max_age[self._leaves.class_id[old]]
        return dying

    def _children(self, ahead: motion.MotionState, code: Ints, seen: _Seen) -> _Leaves:
        before, n, d = self._leaves, len(self._leaves.class_id), len(seen.box)
        grown = code[code < n * (d + 1)]
        born = code[code >= n * (d + 1)] - n * (d + 1)
        parent, detection = grown // (d + 1), grown % (d + 1) - 1
        hit = detection >= 0
        state = ahead.take(parent)
        fresh = motion.updated(
            state.take(np.flatnonzero(hit)), seen.box[detection[hit]], seen.velocity_of(detection[hit]), self._dt
        )
        for whole, part in (
            (state.mean, fresh.mean),
            (state.covariance, fresh.covariance),
            (state.variance, fresh.variance),
        ):
            whole[hit] = part
        ids = self._next_id + np.arange(len(born))
        self._next_id += len(born)
        state = motion.joined(state, motion.born(seen.box[born], seen.velocity_of(born), self._dt))
        detection = np.concatenate([detection, born])
        measured, score = state.box.copy(), np.concatenate([before.score[parent], np.zeros(len(born))])
        took = np.flatnonzero(detection >= 0)
        measured[took] = seen.box[detection[took]]
        score[took] += seen.score[detection[took]]
        return _Leaves(
            state=state,
            class_id=np.concatenate([before.class_id[parent], seen.class_id[born]]),
            track_id=np.concatenate([before.track_id[parent], ids]),
            hits=np.concatenate([before.hits[parent] + hit, np.ones(len(born), dtype=np.int64)]),
            score=score,
            age=np.concatenate([np.where(hit, 0, before.age[parent] + 1), np.zeros(len(born), dtype=np.int64)]),
            detection=detection,
            measured=measured,
            parent=np.concatenate([parent, np.full(len(born), -1)]),
        )

    def _merge_equal(self) -> None:
        """Keep the cheapest of the hypotheses that hold the same tracks; they come cheapest first."""
        _, first = np.unique(np.packbits(self._member, axis=1), axis=0, return_index=True)
        keep = np.sort(first)
        self._member, self._cost = self._member[keep], self._cost[keep]

    def _output(self) -> Tracks:
        leaves = self._leaves
        confirmed = leaves.hits >= self._min_hits[leaves.class_id]
        confirmed |= self._frame <= self._min_hits[leaves.class_id]  # a recording does not wait for its first tracks
        out = np.flatnonzero(confirmed & self._member.any(axis=0))
        past, past_valid = self._history(out)
        weight = -self._cost
        return Tracks(
            track_id=leaves.track_id[out],
            box=leaves.state.box[out],
            class_id=leaves.class_id[out],
            score=leaves.score[out] / leaves.hits[out],
            detection=leaves.detection[out],
            past=past,
            past_valid=past_valid,
            member=self._member[:, out],
            log_weight=weight - np.logaddexp.reduce(weight),
        )

    def _history(self, leaf: Ints) -> tuple[Floats, Bools]:
        """Detections of the last P frames along the branches that end in ``leaf``."""
        length = self._layers.maxlen or 1
        past = np.zeros((len(leaf), length, 7))
        valid = np.zeros((len(leaf), length), dtype=bool)
        for back, layer in enumerate(reversed(self._layers)):
            exists = np.flatnonzero(leaf >= 0)
            at = leaf[exists]
            past[exists, length - 1 - back] = layer.measured[at]
            valid[exists, length - 1 - back] = layer.detection[at] >= 0
            leaf = leaf.copy()
            leaf[exists] = layer.parent[at]
        return past, valid


def _no_leaves() -> _Leaves:
    none = np.zeros(0, dtype=np.int64)
    return _Leaves(motion.born(np.zeros((0, 7))), none, none, none, np.zeros(0), none, none, np.zeros((0, 7)), none)


def _seen(observation: Observation, measured: bool) -> _Seen:
    valid = np.asarray(observation["detection_valid"]).astype(bool)
    return _Seen(
        np.asarray(observation["detection_box"], dtype=np.float64)[valid],
        np.asarray(observation["detection_class"], dtype=np.int64)[valid],
        np.asarray(observation["detection_score"], dtype=np.float64)[valid],
        np.asarray(observation["detection_velocity"], dtype=np.float64)[valid] if measured else None,
    )
