"""Re-tracking: forecasts of tracks are tracked again, which mends short identity switches and misses.

Source: Yu, Zhou 2021, "Towards Robust Human Trajectory Prediction in Raw Videos". Theirs has one hypothesis; here it is
done in every hypothesis of a tracker.
"""

from __future__ import annotations

from collections import deque
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np

from ..agent import Frame, Observation, Predictor, Tracker, Tracks
from ..errors import ShapeError
from ..types import Bools, Floats, Ints, Task, joined, select
from .joint import k_best
from .repair import bridged, smoothed

FORCED = 0.15  # m, distances below it match before all others
_SURE = 100.0  # m, what such a match is worth: more than any other


@dataclass(frozen=True, eq=False)
class Memory:
    """The R tracks that re-tracking keeps after a frame, and the hypotheses that share them."""

    track_id: Ints  # [R]
    box: Floats  # [R, 7] now; where nothing was observed the place is the forecast one
    class_id: Ints  # [R]
    score: Floats  # [R] sum of the scores of the detections taken
    last_score: Floats  # [R] of the last detection taken
    detection: Ints  # [R] the detection of this frame, -1: none
    hits: Ints  # [R] detections taken
    streak: Ints  # [R] detections taken since the last gap
    misses: Ints  # [R] frames since the last detection
    age: Ints  # [R] frames since the first detection, this one included
    past: Floats  # [R, P', 7] as observed, neither bridged nor smoothed; P and the longest gap, so that it has an end
    past_valid: Bools  # [R, P']
    future: Floats  # [R, T, 2] m, forecast in the frame of the last detection


class ReTracker:
    """A tracker whose identities and pasts are mended by tracking the forecasts of another tracker's tracks.

    Every frame the tracks of ``tracker`` that took a detection are forecast. These forecasts are the observations, and
    are assigned to what is kept by how far they are from the forecasts made of it before, see `forecast_distances`:
    the sum of distance - ``gate`` is least, pairs beyond the gate do not match, and pairs closer than 0.15 m match
    first. Gaps in the past are then bridged.

    ``predictor``: asked for one sample of each track (k = 1), and asked twice per frame: for the tracks of ``tracker``
    and for those that are kept. A copy is used, so the predictor of a pipeline may be given.
    ``max_misses``: frames without an observation that a track survives.
    ``min_hits``: after a gap a track is output again from so many observations in a row on.
    ``coasting``: frames without an observation in which it is still output.
    ``smooth``: whether the pasts are smoothed too, see `repair.smoothed`. ``gate``: m by the square root of steps.

    The defaults are the best on the training splits of MTP-WILDTRACK-v0 and MTP-PETS-v0 with a Kalman predictor. Yu and
    Zhou, who predict with an LSTM, have ``min_hits=2, coasting=0, smooth=True, gate=3.0``, match as many tracks as they
    can, and compare future frames only.
    """

    def __init__(
        self,
        tracker: Tracker,
        predictor: Predictor,
        max_misses: int = 8,
        min_hits: int = 1,
        coasting: int = 1,
        smooth: bool = False,
        gate: float = 1.5,
    ) -> None:
        if min(max_misses, min_hits, coasting) < 0:
            raise ShapeError(f"max_misses, min_hits, coasting are {max_misses, min_hits, coasting}, expected 0 or more")
        if not 0 < gate < np.inf:
            raise ShapeError(f"gate is {gate}, expected a finite number above 0")
        self._tracker, self._predictor = tracker, deepcopy(predictor)
        self._max_misses, self._min_hits, self._coasting = max_misses, min_hits, coasting
        self._smooth, self._gate = smooth, gate

    def reset(self, task: Task) -> None:
        """Forget everything."""
        self._tracker.reset(task)
        self._predictor.reset(replace(task, k=1))  # one forecast of each track, which is its likeliest future
        self._past, self._frame = task.past, 0
        self._observed: deque[Observation] = deque(maxlen=task.past)
        none = np.zeros(0, dtype=np.int64)
        no_tracks = Tracks.of_one_hypothesis(none, np.zeros((0, 7)), none)
        self._memory = _born(no_tracks, none, 0, 1, (task.past + self._max_misses, task.future))
        self._member = np.ones((1, 0), dtype=bool)  # [H, R]
        self._next_id = 0

    def step(self, observation: Observation) -> Tracks:
        """Tracks to output after this frame, in the hypotheses of the tracker and with their weights."""
        tracks = self._tracker.step(observation)
        self._frame += 1
        self._observed.append(observation)
        parent = self._parents(tracks)
        seen = np.flatnonzero(tracks.detection >= 0)
        path = np.concatenate([tracks.past[seen, -1:, :2], self._forecast(tracks, seen)], axis=1)
        gain = self._gains(tracks.class_id[seen], path)
        row, column, member = _matched(gain, self._member[parent], tracks.member[:, seen], tracks.detection[seen])
        memory = self._grown(row, column, tracks, seen, observation)
        alive = memory.misses <= self._max_misses
        self._memory, self._member = select(memory, alive), member[:, alive]
        self._look_ahead(tracks, parent)
        shown = (self._memory.streak >= self._min_hits) & (self._memory.misses <= self._coasting)
        return self._as_tracks(np.flatnonzero(shown), tracks, parent)

    def _parents(self, tracks: Tracks) -> Ints:
        """The hypothesis of the frame before that each hypothesis descends from, [H]."""
        if tracks.parent is not None:
            return tracks.parent
        if len(tracks.member) > 1 or len(self._member) > 1:
            raise ShapeError("the tracker has several hypotheses without stated parents, which re-tracking needs")
        return np.zeros(1, dtype=np.int64)

    def _forecast(self, tracks: Tracks, leaf: Ints) -> Floats:
        """One future [n, T, 2] of each track ``leaf`` [n]."""
        part = tracks.select(leaf)
        forecasts = self._predictor.predict(Frame(self._frame - 1, part, tuple(self._observed)))
        weight = np.zeros(forecasts.samples.shape[:2]) if forecasts.log_weight is None else forecasts.log_weight
        likeliest: Floats = forecasts.samples[np.arange(len(weight)), weight.argmax(axis=1)]
        heaviest = part.member.argmax(axis=0)  # of the hypotheses that hold each track
        return np.asarray(likeliest[forecasts.rows_of(part)[heaviest, np.arange(len(leaf))]])

    def _gains(self, class_id: Ints, path: Floats) -> Floats:
        """Costs [R, L] below 0 of matching a kept track with one of ``class_id`` [L] seen on ``path`` [L, 1 + T, 2]."""
        distance = forecast_distances(self._memory.future, self._memory.misses + 1, path, self._gate)
        distance[self._memory.class_id[:, None] != class_id] = np.inf
        return np.where(distance < FORCED, -_SURE, distance - self._gate)

    def _grown(self, row: Ints, column: Ints, tracks: Tracks, seen: Ints, observation: Observation) -> Memory:
        """Successors [E] of the tracks ``row`` (-1: new) that take the tracks ``seen[column]`` (-1: none).

        New tracks come first.
        """
        score = np.asarray(observation["detection_score"], dtype=np.float64)
        born = seen[column[row < 0]]
        lengths = self._memory.past.shape[1], self._memory.future.shape[1]
        new = _born(tracks, born, self._next_id, self._min_hits, lengths)
        self._next_id += len(born)
        old, column = select(self._memory, row[row >= 0]), column[row >= 0]
        missed, found = _missed(old), np.flatnonzero(column >= 0)
        return joined([new, _found(missed, found, tracks, seen[column[found]], score)])

    def _look_ahead(self, tracks: Tracks, parent: Ints) -> None:
        """Forecast the tracks that took a detection in this frame; the others keep their forecasts."""
        fresh = np.flatnonzero(self._memory.misses == 0)
        future = self._memory.future.copy()
        future[fresh] = self._forecast(self._as_tracks(fresh, tracks, parent), np.arange(len(fresh)))
        self._memory = replace(self._memory, future=future)

    def _as_tracks(self, rows: Ints, tracks: Tracks, parent: Ints) -> Tracks:
        """The tracks ``rows`` [n] of the memory with mended pasts, in the hypotheses of the tracker."""
        own = select(self._memory, rows)
        whole, known = bridged(own.past, own.past_valid)
        past, past_valid = whole[:, -self._past :], known[:, -self._past :]
        return Tracks(
            track_id=own.track_id,
            box=own.box,
            class_id=own.class_id,
            score=own.score / own.hits,
            detection=own.detection,
            past=smoothed(past, past_valid) if self._smooth else past,
            past_valid=past_valid,
            member=self._member[:, rows],
            log_weight=tracks.log_weight,
            parent=parent,
            last_score=own.last_score,
            hits=own.hits,
            age=own.age,
        )


def forecast_distances(kept: Floats, gap: Ints, seen: Floats, gate: float) -> Floats:
    """Distance [R, L], m by the square root of steps, of kept and seen tracks by their forecasts; inf above ``gate``.

    ``kept`` [R, T, 2]: forecasts made ``gap`` [R] frames ago; ``seen`` [L, 1 + T, 2]: places now and their forecasts.
    It is the largest, over the frames from now on that both know, of their distance by the square root of the sum of
    their steps, as the deviation of a random walk grows (Yu, Zhou 2021). Two tracks without such a frame do not match.
    """
    steps, last = np.arange(seen.shape[1]), kept.shape[1]
    overlap = gap[:, None] + steps <= last  # [R, 1 + T]
    ahead = np.take_along_axis(kept, np.minimum(gap[:, None] + steps, last)[:, :, None] - 1, axis=1)
    spread = np.where(overlap, np.sqrt(gap[:, None] + 2 * steps), np.inf)
    cost = np.full((len(kept), len(seen)), np.inf)
    # Pairs too far apart in the first frame do not match: few pairs are compared in full.
    first = np.linalg.norm(ahead[:, None, 0] - seen[None, :, 0], axis=-1)
    row, column = np.nonzero((first <= gate * spread[:, :1]) & overlap[:, :1])
    largest = (np.linalg.norm(ahead[row] - seen[column], axis=-1) / spread[row]).max(axis=1)
    near = largest <= gate
    cost[row[near], column[near]] = largest[near]
    return cost


def _matched(gain: Floats, kept: Bools, seen: Bools, detection: Ints) -> tuple[Ints, Ints, Bools]:
    """Kept track and seen track of each distinct successor, -1 for none, and the hypotheses that hold it.

    ``gain`` [R, L]; ``kept`` [H, R] and ``seen`` [H, L]: what the hypotheses hold; ``detection`` [L]. What follows of
    a kept track depends on the detection alone, so that seen tracks which took the same one share a successor; the one
    of the heaviest hypothesis stands for them. Successors without a kept track, which are new, come first.
    """
    row, column, hypothesis = [], [], []
    for h in range(len(kept)):
        mine, there = np.flatnonzero(kept[h]), np.flatnonzero(seen[h])
        choice = k_best(gain[np.ix_(mine, there)], 1)[1][0]
        new = np.setdiff1d(np.arange(len(there)), choice)
        row += [np.full(len(new), -1), mine]
        column += [there[new], np.append(there, -1)[choice]]
        hypothesis.append(np.full(len(new) + len(mine), h))
    rows, columns = np.concatenate(row), np.concatenate(column)
    target = np.where(rows < 0, columns, np.append(detection, -1)[columns])
    pairs, first, place = np.unique(np.stack([rows, target]), axis=1, return_index=True, return_inverse=True)
    member = np.zeros((len(kept), pairs.shape[1]), dtype=bool)
    member[np.concatenate(hypothesis), place.ravel()] = True
    return rows[first], columns[first], member


def _born(tracks: Tracks, leaf: Ints, first_id: int, streak: int, lengths: tuple[int, int]) -> Memory:
    """New tracks that go on from the tracks ``leaf`` [n], with their pasts; they are output at once.

    ``lengths``: frames of past and of future that are kept.
    """
    hits = tracks.past_valid.sum(axis=1) if tracks.hits is None else tracks.hits
    age = tracks.past_valid.shape[1] - tracks.past_valid.argmax(axis=1) if tracks.age is None else tracks.age
    last = tracks.score if tracks.last_score is None else tracks.last_score
    earlier = lengths[0] - tracks.past.shape[1]
    return Memory(
        track_id=first_id + np.arange(len(leaf)),
        box=tracks.box[leaf],
        class_id=tracks.class_id[leaf],
        score=(tracks.score * hits)[leaf],
        last_score=last[leaf],
        detection=tracks.detection[leaf],
        hits=hits[leaf],
        streak=np.full(len(leaf), max(streak, 1)),
        misses=np.zeros(len(leaf), dtype=np.int64),
        age=age[leaf],
        past=np.pad(tracks.past[leaf], ((0, 0), (earlier, 0), (0, 0))),
        past_valid=np.pad(tracks.past_valid[leaf], ((0, 0), (earlier, 0))),
        future=np.zeros((len(leaf), lengths[1], 2)),
    )


def _missed(old: Memory) -> Memory:
    """The tracks one frame later if nothing of them was seen."""
    n, length, _ = old.future.shape
    box = old.box.copy()
    box[:, :2] = old.future[np.arange(n), np.minimum(old.misses, length - 1)]
    return replace(
        old,
        box=box,
        detection=np.full(n, -1),
        misses=old.misses + 1,
        age=old.age + 1,
        past=np.concatenate([old.past[:, 1:], box[:, None]], axis=1),
        past_valid=np.concatenate([old.past_valid[:, 1:], np.zeros((n, 1), dtype=bool)], axis=1),
    )


def _found(missed: Memory, rows: Ints, tracks: Tracks, leaf: Ints, score: Floats) -> Memory:
    """As ``missed``, but the tracks ``rows`` [n] took the detections of the tracks ``leaf`` [n]; ``score`` [D]."""
    new = deepcopy(missed)
    new.box[rows] = tracks.box[leaf]
    new.detection[rows] = tracks.detection[leaf]
    new.last_score[rows] = score[tracks.detection[leaf]]
    new.score[rows] += new.last_score[rows]
    new.hits[rows] += 1
    new.streak[rows] = np.where(new.misses[rows] > 1, 1, new.streak[rows] + 1)
    new.misses[rows] = 0
    new.past[rows, -1] = tracks.past[leaf, -1]
    new.past_valid[rows, -1] = True
    return new
