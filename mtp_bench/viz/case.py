"""One event of a run, frame by frame: object, tracks, forecasts, detections; and its counterpart in another run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..scoring.displacement import floored
from ..scoring.forecasts import sample_weights
from ..types import Floats, Ints, to_metres
from .replay import NO_EVENT, Incident, Replay, known


@dataclass(frozen=True, eq=False)
class ObjectForecast:
    """One forecast of the object, in the frame of reference of the scene."""

    frame: int  # in which it was made
    track_id: int  # that it belongs to, -1 without one
    start: Floats  # [2] m
    path: Floats  # [K, T, 2] m, one per frame after ``frame``
    weight: Floats  # [K] 0 to 1
    nearest: int  # the sample nearest to the true future; the heaviest if that is unknown

    @property
    def nearest_path(self) -> Floats:
        """The nearest sample with its start [T + 1, 2]."""
        return np.concatenate([self.start[None], self.path[self.nearest]])


@dataclass(frozen=True, eq=False)
class Case:
    """An event and the run it happened in.

    Tracks are those of the best hypothesis of the event's frame, back along its lineage; after it, of the best of each
    frame. Rows are those of the tables of the run.
    """

    replay: Replay
    at: Incident

    @cached_property
    def hypothesis(self) -> Ints:
        """The hypothesis [F] that is looked at in each frame."""
        return self.replay.answers.hypotheses.seen_from(self.at.frame)

    @property
    def noun(self) -> str:
        """Class of the object, in words."""
        return self.replay.card.task.classes[self.at.class_id].replace("_", " ")

    @property
    def near(self) -> float:
        """Radius around the object, m: detections farther away are not of it."""
        return 2 * float(self.replay.card.per_class(self.replay.card.task.forecast_gate)[self.at.class_id])

    def name_of(self, row: int) -> str:
        """Name of the object of a row of the truth, such as "car 8"."""
        truth, classes = self.replay.scene.truth, self.replay.card.task.classes
        return f"{classes[truth.class_id[row]].replace('_', ' ')} {int(truth.object_id[row])}"

    def seconds(self, t: int) -> float:
        """Time of a frame since the first one."""
        time = self.replay.scene.time
        return float(time[t] - time[0])

    @cached_property
    def rows(self) -> Ints:
        """Row [F] of the object in the truth, -1 in frames without it; all -1 for a false forecast."""
        truth = self.replay.scene.truth
        own = np.flatnonzero((truth.object_id == self.at.object_id) & ~truth.neutral)
        rows = np.full(self.replay.frames, -1, dtype=np.int64)
        if self.at.object_id >= 0:
            rows[truth.frame_of_rows[own]] = own
        return rows

    def place(self, t: int) -> NDArray[np.float64]:
        """Place [2] of the object at frame ``t``; in frames without it, its nearest known place in time."""
        known = np.flatnonzero(self.rows >= 0)
        if len(known):
            nearest = known[np.argmin(np.abs(known - t))]
            return np.asarray(self.replay.scene.truth.box[self.rows[nearest], :2], dtype=np.float64)
        row = self.track_row(self.at.new_id, t)
        return np.array(self.at.position[:2]) if row < 0 else self.replay.rollout.track_box[row, :2].astype(np.float64)

    def path(self, first: int, last: int) -> Floats:
        """Places [n, 2] of the object from frame ``first`` on until a gap or ``last``, forwards or backwards."""
        step, places = (1 if last >= first else -1), []
        for t in range(first, last + step, step):
            if not 0 <= t < self.replay.frames or self.rows[t] < 0:
                break
            places.append(self.replay.scene.truth.box[self.rows[t], :2])
        return np.array(places, dtype=np.float64).reshape(-1, 2)

    def future(self, t: int) -> Floats:
        """Places [n, 2] of the object within the horizon, now first."""
        return self.path(t, t + self.replay.card.task.future)

    def track_rows(self, t: int) -> Ints:
        """Rows of the tracks at frame ``t``."""
        rows = self.replay.rollout.tracks.rows(t)
        member = self.replay.answers.hypotheses.member[rows, self.hypothesis[t]]
        return np.asarray(rows.start + np.flatnonzero(member))

    def track_row(self, track_id: int, t: int) -> int:
        """Row of a track at frame ``t``, -1 if it is not output then."""
        rows = self.track_rows(t)
        own = rows[self.replay.rollout.track_id[rows] == track_id] if track_id >= 0 else rows[:0]
        return int(own[0]) if len(own) else -1

    def follower(self, t: int) -> int:
        """Id of the track that follows the object at frame ``t``, -1 without one."""
        row = self.rows[t]
        return -1 if row < 0 else int(np.append(self.replay.rollout.track_id, -1)[self._matched(t)[row]])

    def _matched(self, t: int) -> Ints:
        """Track [R] matched to each true box in the hypothesis of frame ``t``, -1 without one."""
        best = self.hypothesis[t] == self.replay.answers.hypotheses.best[t]
        return self.replay.truth_track if best else self.replay.matched[:, self.hypothesis[t]]

    def followed(self, track_id: int, t: int) -> int:
        """Row of the true box, other than the object, that a track follows at frame ``t``, -1 without one."""
        row = self._followed(track_id, t)
        return -1 if row == self.rows[t] else row

    def _followed(self, track_id: int, t: int) -> int:
        """Row of the true box that a track follows at frame ``t``, -1 without one."""
        row, truth = self.track_row(track_id, t), self.replay.scene.truth.rows(t)
        own = np.flatnonzero((self._matched(t)[truth] == row) & (row >= 0))
        return truth.start + int(own[0]) if len(own) else -1

    def last_followed(self, track_id: int, t: int) -> tuple[int, int] | None:
        """Before frame ``t`` without a gap: frames since a track last followed an object, and the row of that."""
        for ago in range(1, self.age(track_id, t) + 1):
            row = self._followed(track_id, t - ago)
            if row >= 0:
                return ago, row
        return None

    def age(self, track_id: int, t: int) -> int:
        """Number of frames just before ``t`` in which a track was output."""
        count = 0
        while t - count > 0 and self.track_row(track_id, t - count - 1) >= 0:
            count += 1
        return count

    def trail(self, track_id: int, t: int, frames: int) -> Floats:
        """Places [n, 2] of a track in the last ``frames`` frames until ``t``, now last; empty if it is not output."""
        if self.track_row(track_id, t) < 0:
            return np.zeros((0, 2))
        first = t - min(self.age(track_id, t), frames - 1)
        rows = [self.track_row(track_id, s) for s in range(first, t + 1)]
        return np.asarray(self.replay.rollout.track_box[rows, :2], dtype=np.float64)

    def detections(self, t: int) -> Ints:
        """Rows of the detections within ``near`` metres of the object at frame ``t``, the nearest first."""
        table = self.replay.scene.detections
        rows = table.rows(t)
        far = np.hypot(*(table.box[rows, :2] - self.place(t)).T)
        order = np.argsort(far, kind="stable")
        return np.asarray(rows.start + order[far[order] <= self.near])

    def forecast(self, t: int) -> ObjectForecast | None:
        """The forecast of frame ``t`` that the scorer matches to the object, else that of its track then."""
        row, rollout = self._forecast_row(t), self.replay.rollout
        if row < 0:
            return None
        start = rollout.object_box[row, :2].astype(np.float64)
        weight = floored(sample_weights(rollout.forecast_log_weight[row : row + 1]))[0]
        path = (start + to_metres(rollout.forecast[row]))[weight > 0]
        weight = weight[weight > 0]
        if not len(weight):
            return None
        nearest = _nearest(path, weight, self.future(t)[1:])
        return ObjectForecast(t, int(self.replay.answers.object_track_id[row]), start, path, weight, nearest)

    def _forecast_row(self, t: int) -> int:
        row = int(np.append(self.replay.truth_forecast, -1)[self.rows[t]])
        if row >= 0:
            return row
        own = self.at.old_id if t < self.at.frame else self.at.new_id
        if self.at.kind == "spurious" and own < 0:  # a forecast without a track stands alone
            return self.at.row if t == self.at.frame else -1
        objects = self.replay.rollout.objects.rows(t)
        rows = np.flatnonzero((self.replay.answers.object_track_id[objects] == own) & (own >= 0))
        return objects.start + int(rows[0]) if len(rows) else -1


def _nearest(path: Floats, weight: Floats, future: Floats) -> int:
    """The sample of ``path`` [K, T, 2] with the least mean distance to ``future`` [n, 2], else the heaviest."""
    if not len(future):
        return int(np.argmax(weight))
    gap = path[:, : len(future)] - future
    return int(np.argmin(np.hypot(gap[..., 0], gap[..., 1]).mean(axis=1)))


def counterpart(run: Replay, at: Incident) -> Incident:
    """The incident of ``run`` at the place of ``at``, an incident of another run of the same scene.

    It is the event of the object in that frame, or the false forecast near that place; without either, an incident of
    kind NO_EVENT with the track that follows the object and the error of its forecast.
    """
    if at.object_id < 0:
        return _false_forecast(run, at)
    own = [i for i in run.events if (i.object_id, i.frame) == (at.object_id, at.frame)]
    return own[0] if own else _no_event(run, at)


def _false_forecast(run: Replay, at: Incident) -> Incident:
    """The false forecast nearest to the place, within the gate of forecasts."""
    rows = run.rollout.objects.rows(at.frame)
    row = rows.start + np.flatnonzero(run.forecast_false[rows] & (run.rollout.object_class[rows] == at.class_id))
    far = np.hypot(*(run.rollout.object_box[row, :2] - np.array(at.position[:2])).T)
    if not (far <= run.card.per_class(run.card.task.forecast_gate)[at.class_id]).any():
        return replace(at, kind=NO_EVENT, name="no event", row=-1, new_id=-1, confidence=None)
    best = int(row[np.argmin(far)])
    track = int(run.answers.object_track_id[best])
    for each in run.incidents:
        spurious = each.kind == "spurious" and each.frame <= at.frame <= each.until
        if spurious and (each.row == best or each.new_id == track >= 0):
            x, y, z = (float(value) for value in run.rollout.object_box[best, :3])
            return replace(each, frame=at.frame, row=best, position=(x, y, z))
    raise AssertionError("every false forecast is in a run of them")


def _no_event(run: Replay, at: Incident) -> Incident:
    """The track that follows the object, without an event."""
    track = int(np.append(run.rollout.track_id, -1)[run.truth_track[at.row]])
    before = np.flatnonzero((run.scene.truth.object_id == at.object_id) & (run.scene.truth.frame_of_rows < at.frame))
    min_ade, error, confidence = map(known, run.worth[at.row])
    return replace(
        at,
        kind=NO_EVENT,
        name="no event",
        old_id=track,
        new_id=track,
        wrong=False,
        minADE=min_ade,
        error=error,
        error_before=known(run.worth[before[-1], 1]) if len(before) else None,
        confidence=confidence,
    )
