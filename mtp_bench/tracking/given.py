"""Identities that come from elsewhere: another program's tracks, the true ones, and perfect association."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core import (
    NO_ROWS,
    UNBORN,
    Bools,
    Floats,
    Ints,
    Observation,
    SubmissionError,
    Task,
    Tracks,
)


class TrackReport(NamedTuple):
    """A track of a frame, with an id from elsewhere, and the detection that it took."""

    id: int  # no id twice in a frame
    box: Floats  # [7] now
    class_id: int
    score: float  # used until the track takes a detection
    detection: int  # row of the observation, -1 for none
    measured: (
        Floats  # [7] box of the detection taken; of a track that took none, its own
    )


@dataclass
class _History:
    first: int  # frame in which it was first reported
    reports: deque[
        tuple[int, int, Floats]
    ]  # frame, detection, measured box; the last P
    hits: int = 0
    scores: float = 0.0  # sum over the detections that it took
    last_score: float = 0.0

    def append(self, frame: int, report: TrackReport, detection_score: Floats) -> None:
        """Enter the report of a frame; ``detection_score`` [D] of its observation."""
        self.reports.append((frame, report.detection, report.measured))
        if report.detection >= 0:
            self.hits += 1
            self.last_score = float(detection_score[report.detection])
            self.scores += self.last_score
        elif not self.hits:
            self.last_score = report.score


class Histories:
    """Track histories for external ids of a scene; an id that reappears after a gap continues its track."""

    def __init__(self, past: int) -> None:
        self._past, self._frame = past, 0
        self._by_id: dict[int, _History] = {}

    def after(self, reports: Sequence[TrackReport], detection_score: Floats) -> Tracks:
        """Tracks of one hypothesis after the next frame; ``detection_score`` [D] of all rows of its observation."""
        self._frame += 1
        for report in reports:
            history = self._by_id.setdefault(
                report.id, _History(self._frame, deque(maxlen=self._past))
            )
            history.append(self._frame, report, detection_score)
        histories = [self._by_id[report.id] for report in reports]
        past, taken = self._window(histories)
        return Tracks.of_one_hypothesis(
            np.array([report.id for report in reports], dtype=np.int64),
            np.array([report.box for report in reports]).reshape(-1, 7),
            np.array([report.class_id for report in reports], dtype=np.int64),
            score=np.array(
                [
                    one.scores / one.hits if one.hits else one.last_score
                    for one in histories
                ]
            ),
            detection=np.array(
                [report.detection for report in reports], dtype=np.int64
            ),
            past=past,
            past_valid=taken >= 0,
            parent=np.zeros(1, dtype=np.int64),
            last_score=np.array([one.last_score for one in histories]),
            hits=np.array([max(one.hits, 1) for one in histories], dtype=np.int64),
            age=np.array(
                [self._frame - one.first + 1 for one in histories], dtype=np.int64
            ),
            past_detection=taken,
        )

    def _window(self, histories: list[_History]) -> tuple[Floats, Ints]:
        """Boxes [N, P, 7] of the last P frames and the rows taken [N, P].

        Between two reports of an identity its box moves on a straight line. Before its first report in the window the
        track counts as unborn, also if there was a report earlier: the way from there is unknown.
        """
        length = self._past
        past, taken = (
            np.zeros((len(histories), length, 7)),
            np.full((len(histories), length), UNBORN),
        )
        reported = np.zeros(taken.shape, dtype=bool)
        for i, history in enumerate(histories):
            for frame, row, box in history.reports:
                column = length - 1 - self._frame + frame
                if column >= 0:
                    past[i, column:] = box
                    taken[i, column:] = -1
                    taken[i, column] = row
                    reported[i, column] = True
        return bridged(past, reported), taken


def bridged(past: Floats, valid: Bools) -> Floats:
    """Pasts [N, P, 7], oldest first, with x and y of gaps between two reports, ``valid`` [N, P], on a straight line."""
    length = valid.shape[1]
    frame = np.arange(length)
    before = np.maximum.accumulate(np.where(valid, frame, -1), axis=1)
    after = np.minimum.accumulate(np.where(valid, frame, length)[:, ::-1], axis=1)[
        :, ::-1
    ]
    row, gap = np.nonzero((before >= 0) & (after < length) & ~valid)
    low, high = before[row, gap], after[row, gap]
    share = ((gap - low) / (high - low))[:, None]
    whole = past.copy()
    whole[row, gap, :2] = (1 - share) * past[row, low, :2] + share * past[row, high, :2]
    return whole


class GivenTracker:
    """One hypothesis made of stored tracks; needs an env with ``observe="tracks"``.

    A stored box counts as a detection that its track took, since the file does not state which boxes were measured.
    """

    def reset(self, task: Task) -> None:
        """Forget everything."""
        if task.observe != "tracks":
            raise SubmissionError(
                f'GivenTracker needs an env made with observe="tracks", got observe={task.observe!r}; '
                "name the stored tracks with --tracks"
            )
        self._task, self._histories = task, Histories(task.past)

    def step(self, observation: Observation) -> Tracks:
        """The stored tracks of this frame with their pasts, which a hole in time ends."""
        if self._task.after_hole(observation):
            self._histories = Histories(self._task.past)
        rows = np.flatnonzero(observation["detection_valid"])
        ids, class_id = (
            observation[f"detection_{name}"].tolist() for name in ("id", "class")
        )
        box = observation["detection_box"].astype(np.float64)
        score = observation["detection_score"].astype(np.float64)
        reports = [
            TrackReport(ids[i], box[i], class_id[i], float(score[i]), i, box[i])
            for i in rows.tolist()
        ]
        return self._histories.after(reports, score)


class TruthTracker:
    """One hypothesis made of true boxes and ids; needs an env with ``observe="truth"``."""

    def reset(self, task: Task) -> None:
        """Forget everything."""
        if task.observe != "truth":
            raise SubmissionError(
                f'TruthTracker needs an env made with observe="truth", got observe={task.observe!r}'
            )
        self._task = task
        self._frames: deque[tuple[Ints, Floats]] = deque(maxlen=task.past)

    def step(self, observation: Observation) -> Tracks:
        """The true objects of this frame with their true pasts, which a hole in time ends."""
        if self._task.after_hole(observation):
            self._frames.clear()
        valid = observation["detection_valid"].astype(bool)
        box = observation["detection_box"].astype(np.float64)[valid]
        ids = observation["detection_id"].astype(np.int64)[valid]
        self._frames.append((ids, box))
        length = self._frames.maxlen or 1
        past = np.zeros((len(ids), length, 7))
        taken = np.full((len(ids), length), UNBORN)
        for back, (then_ids, then_box) in enumerate(reversed(self._frames)):
            mine, then = np.nonzero(ids[:, None] == then_ids[None, :])
            past[mine, length - 1 - back] = then_box[then]
            taken[mine, length - 1 - back] = then
        taken[
            (np.maximum.accumulate(taken, axis=1) >= 0) & (taken < 0)
        ] = -1  # hidden for a while
        return Tracks.of_one_hypothesis(
            ids,
            box,
            observation["detection_class"].astype(np.int64)[valid],
            score=observation["detection_score"].astype(np.float64)[valid],
            detection=np.arange(len(ids)),
            past=past,
            past_valid=taken >= 0,
            parent=np.zeros(1, dtype=np.int64),
            past_detection=taken,
        )


class GivenIdentities:
    """True objects of the tracks of one hypothesis: that of the detection which started a track, -1 for none.

    A detection of an object may only continue or start the track of that object, at any distance; a track that
    has ended is not resumed. Detections and tracks without an object are associated as always.
    """

    def __init__(self) -> None:
        self._track: Ints = NO_ROWS  # [N] object of each leaf
        self._detection = NO_ROWS  # [D] object of each detection of this frame

    def observe(self, detection_id: Ints) -> None:
        """Take the objects [D] of the detections of the next frame; none of them occurs twice."""
        self._detection = detection_id

    def free_pairs(
        self, indptr: Ints, column: Ints, gain: Floats
    ) -> tuple[Ints, Ints, Floats]:
        """The pairs of tracks and detections that are both without an object; arguments as of `sparse_gains`."""
        free = (np.repeat(self._track, np.diff(indptr)) < 0) & (
            self._detection[column] < 0
        )
        return np.append(0, np.cumsum(free))[indptr], column[free], gain[free]

    def assign(self, column: Ints) -> Ints:
        """The assignment [1, N], where tracks of an object take its detection."""
        same = (self._track[:, None] == self._detection) & (self._detection >= 0)
        assigned = column.copy()
        track, detection = np.nonzero(same)
        assigned[0, track] = detection
        return assigned

    def grow(self, before: Ints, detection: Ints) -> None:
        """Hand the objects on to the new leaves: old leaf (-1: a new track) and detection of each, [N]."""
        started = np.append(self._detection, -1)[detection]
        self._track = np.where(before >= 0, np.append(self._track, -1)[before], started)
