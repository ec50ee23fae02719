"""Identities from elsewhere: stored tracks, true ones, and perfect association."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core import (
    NO_ROWS,
    UNBORN,
    UNKNOWN_OBJECT,
    Bools,
    Floats,
    Ints,
    Observation,
    SubmissionError,
    Task,
    Tracks,
)


class TrackReport(NamedTuple):
    """A track of a frame with an id from elsewhere, and its detection."""

    id: int  # no id twice in a frame
    box: Floats  # [7] now
    class_id: int
    score: float  # used until the track takes a detection
    detection: int  # row of the observation, -1 for none
    measured: Floats  # [7] box of that detection; without one, the track's own


@dataclass
class _History:
    first_frame: int  # in which it was first reported
    # frame, detection, measured box of the last P frames
    reports: deque[tuple[int, int, Floats]]
    hits: int = 0
    score_sum: float = 0.0  # over the detections that it took
    last_score: float = 0.0

    @property
    def mean_score(self) -> float:
        """Mean score of the detections taken, else the score of the last report."""
        return self.score_sum / self.hits if self.hits else self.last_score

    def append(self, frame: int, report: TrackReport, detection_score: Floats) -> None:
        """Enter the report of a frame, with its ``detection_score`` [D]."""
        self.reports.append((frame, report.detection, report.measured))
        if report.detection >= 0:
            self.hits += 1
            self.last_score = float(detection_score[report.detection])
            self.score_sum += self.last_score
        elif not self.hits:
            self.last_score = report.score


class Histories:
    """Track histories for external ids of a scene.

    A gap does not end a track.
    """

    def __init__(self, past: int) -> None:
        self._past = past
        self._frame = 0
        self._by_id: dict[int, _History] = {}

    def after(self, reports: Sequence[TrackReport], detection_score: Floats) -> Tracks:
        """Return the tracks of one hypothesis after the next frame.

        ``detection_score`` [D]: scores of all rows of the observation.
        """
        self._frame += 1
        for report in reports:
            history = self._by_id.setdefault(
                report.id, _History(self._frame, deque(maxlen=self._past))
            )
            history.append(self._frame, report, detection_score)
        histories = [self._by_id[report.id] for report in reports]
        past_box, past_row = self._window(histories)
        hits = np.array([history.hits for history in histories], dtype=np.int64)
        first = np.array([history.first_frame for history in histories], dtype=np.int64)
        return Tracks.of_one_hypothesis(
            np.array([report.id for report in reports], dtype=np.int64),
            np.array([report.box for report in reports]).reshape(-1, 7),
            np.array([report.class_id for report in reports], dtype=np.int64),
            score=np.array([history.mean_score for history in histories]),
            detection=np.array([report.detection for report in reports], dtype=int),
            past=past_box,
            past_valid=past_row >= 0,
            parent=np.zeros(1, dtype=np.int64),
            last_score=np.array([history.last_score for history in histories]),
            hits=np.maximum(hits, 1),
            age=self._frame - first + 1,
            past_detection=past_row,
        )

    def _window(self, histories: list[_History]) -> tuple[Floats, Ints]:
        """Return boxes [N, P, 7] and rows taken [N, P] of the last P frames.

        Between two reports of an identity its box moves on a straight line. Before its
        first report in the window the track counts as unborn, even if there is an
        older report: how the object moved since then is not known.
        """
        track_count = len(histories)
        past_box = np.zeros((track_count, self._past, 7))
        past_row = np.full((track_count, self._past), UNBORN)
        reported = np.zeros(past_row.shape, dtype=bool)
        for track, history in enumerate(histories):
            for frame, row, box in history.reports:
                column = self._past - 1 - self._frame + frame
                if column >= 0:
                    # until a later report replaces it
                    past_box[track, column:] = box
                    past_row[track, column:] = -1
                    past_row[track, column] = row
                    reported[track, column] = True
        return bridged(past_box, reported), past_row


def bridged(past_box: Floats, valid: Bools) -> Floats:
    """Return boxes with x and y of gaps on straight lines between reports.

    ``past_box`` [N, P, 7], oldest first; ``valid`` [N, P]: frames with a report.
    """
    length = valid.shape[1]
    frame = np.arange(length)
    last_report = np.maximum.accumulate(np.where(valid, frame, -1), axis=1)
    backwards = np.where(valid, frame, length)[:, ::-1]
    next_report = np.minimum.accumulate(backwards, axis=1)[:, ::-1]
    track, gap = np.nonzero((last_report >= 0) & (next_report < length) & ~valid)
    low = last_report[track, gap]
    high = next_report[track, gap]
    share = ((gap - low) / (high - low))[:, None]
    low_place = past_box[track, low, :2]
    high_place = past_box[track, high, :2]
    bridged_box = past_box.copy()
    bridged_box[track, gap, :2] = (1 - share) * low_place + share * high_place
    return bridged_box


class GivenTracker:
    """One hypothesis made of stored tracks.

    It needs an env with ``observe="tracks"``. A stored box counts as a detection that
    its track took, since the file does not state which boxes were measured.
    """

    def reset(self, task: Task) -> None:
        """Forget all tracks.

        Raises SubmissionError for another kind of env.
        """
        if task.observe != "tracks":
            raise SubmissionError(
                'GivenTracker needs an env made with observe="tracks", '
                f"got observe={task.observe!r}; name the stored tracks with --tracks"
            )
        self._task = task
        self._histories = Histories(task.past)

    def step(self, observation: Observation) -> Tracks:
        """Return the stored tracks of this frame with their pasts.

        A hole in time ends all pasts.
        """
        if self._task.after_hole(observation):
            self._histories = Histories(self._task.past)
        rows = np.flatnonzero(observation["detection_valid"]).tolist()
        ids = observation["detection_id"].tolist()
        class_id = observation["detection_class"].tolist()
        box = observation["detection_box"].astype(np.float64)
        score = observation["detection_score"].astype(np.float64)
        reports = [
            TrackReport(ids[i], box[i], class_id[i], float(score[i]), i, box[i])
            for i in rows
        ]
        return self._histories.after(reports, score)


class TruthTracker:
    """One hypothesis made of true boxes and ids.

    It needs an env with ``observe="truth"``.
    """

    def reset(self, task: Task) -> None:
        """Forget all objects.

        Raises SubmissionError for another kind of env.
        """
        if task.observe != "truth":
            raise SubmissionError(
                'TruthTracker needs an env made with observe="truth", '
                f"got observe={task.observe!r}"
            )
        self._task = task
        self._frames: deque[tuple[Ints, Floats]] = deque(maxlen=task.past)

    def step(self, observation: Observation) -> Tracks:
        """Return the true objects of this frame with their true pasts.

        A hole in time ends all pasts.
        """
        if self._task.after_hole(observation):
            self._frames.clear()
        valid = observation["detection_valid"].astype(bool)
        box = observation["detection_box"].astype(np.float64)[valid]
        ids = observation["detection_id"].astype(np.int64)[valid]
        self._frames.append((ids, box))
        length = self._task.past
        past_box = np.zeros((len(ids), length, 7))
        past_row = np.full((len(ids), length), UNBORN)
        for age, (past_ids, boxes) in enumerate(reversed(self._frames)):
            track, row = np.nonzero(ids[:, None] == past_ids[None, :])
            past_box[track, length - 1 - age] = boxes[row]
            past_row[track, length - 1 - age] = row
        born = np.maximum.accumulate(past_row, axis=1) >= 0
        past_row[born & (past_row < 0)] = -1  # hidden for a while
        return Tracks.of_one_hypothesis(
            ids,
            box,
            observation["detection_class"].astype(np.int64)[valid],
            score=observation["detection_score"].astype(np.float64)[valid],
            detection=np.arange(len(ids)),
            past=past_box,
            past_valid=past_row >= 0,
            parent=np.zeros(1, dtype=np.int64),
            past_detection=past_row,
        )


class GivenIdentities:
    """True objects of the tracks of one hypothesis.

    The object of a track is that of the detection which started it, -1 for none. A
    detection of an object may only continue or start the track of that object, at any
    distance; a track that has ended is not resumed. Detections and tracks without an
    object are associated as always, and so are all tracks where objects are unknown.
    """

    def __init__(self) -> None:
        self._track_object: Ints = NO_ROWS  # [N] of each leaf
        self._detection_object: Ints = NO_ROWS  # [D] of this frame

    def observe(self, detection_id: Ints) -> None:
        """Take the objects [D] of the next frame's detections.

        Each object comes once.
        """
        self._detection_object = detection_id

    def free_pairs(
        self, indptr: Ints, column: Ints, gain: Floats
    ) -> tuple[Ints, Ints, Floats]:
        """Return the pairs in which neither side has an object, or it is unknown.

        Arguments and results are those of `sparse_gains`.
        """
        track_object = np.repeat(self._track_object, np.diff(indptr))
        detection_object = self._detection_object[column]
        is_free = (track_object < 0) & (detection_object < 0)
        is_free |= detection_object == UNKNOWN_OBJECT
        # the new indptr counts the free pairs before each old one
        return np.append(0, np.cumsum(is_free))[indptr], column[is_free], gain[is_free]

    def assign(self, column: Ints) -> Ints:
        """Return the assignment ``column`` [1, N] with those of objects.

        A track of an object takes the detection of that object.
        """
        same_object = self._track_object[:, None] == self._detection_object
        track, detection = np.nonzero(same_object & (self._detection_object >= 0))
        assigned = column.copy()
        assigned[0, track] = detection
        return assigned

    def grow(self, old_leaf: Ints, detection: Ints) -> None:
        """Hand the objects on to the new leaves [N].

        ``old_leaf``: the leaf that each continues, -1 for a new track; ``detection``:
        the one that each took, -1 for none.
        """
        # index -1 picks the appended -1
        started = np.append(self._detection_object, -1)[detection]
        inherited = np.append(self._track_object, -1)[old_leaf]
        self._track_object = np.where(old_leaf >= 0, inherited, started)
