"""An event of a run with its object, tracks, forecasts and detections by frame; metres, frame of the scene."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..core import Bools, Floats, Ints, to_metres
from ..scoring import box_pairs, floored, pieces, sample_weights
from .incident import Incident
from .run_replay import Replay


@dataclass(frozen=True, eq=False)
class ObjectForecast:
    """One forecast of the object."""

    frame: int  # in which it was made
    track_id: int  # of the hypothesis that is looked at, -1 for none
    start: Floats  # [2] m
    path: Floats  # [K, T, 2] m, one per frame after ``frame``
    nearest: (
        int  # the sample nearest to the true future; the heaviest if that is unknown
    )

    @property
    def nearest_path(self) -> Floats:
        """The nearest sample with its start [T + 1, 2]."""
        return np.concatenate([self.start[None], self.path[self.nearest]])


@dataclass(frozen=True, eq=False)
class Focus:
    """An event and the run it happened in; rows are those of the tables of the run.

    Tracks are those of the best hypothesis of the event's frame, back along its lineage; later, of the best then.
    """

    replay: Replay
    at: Incident
    facing: float | None = (
        None  # rad, direction that points to the right; None: that of the object's way
    )

    @property
    def noun(self) -> str:
        """Class of the object, in words."""
        return self.replay.card.task.classes[self.at.class_id].replace("_", " ")

    @property
    def named(self) -> str:
        """Name of the object, such as "car 8" or, with the id of its source, "car c1958768"."""
        return f"{self.noun} {self.replay.scene.short_name(self.at.object_id)}"

    @property
    def gate(self) -> float:
        """Forecast gate of the object's class, m."""
        return float(
            self.replay.card.per_class(self.replay.card.task.forecast_gate)[
                self.at.class_id
            ]
        )

    @property
    def near(self) -> float:
        """Radius around the object, m: detections farther away are not of it."""
        return 2 * self.gate

    @cached_property
    def named_tracks(self) -> tuple[int, ...]:
        """Ids of the tracks that texts name: of the event, the frames around it and the next one, and at the object."""
        at, last = self.at, self.replay.frames - 1
        frames = [
            t
            for t in (*range(at.frame - 1, at.frame + 2), self.regained)
            if 0 <= t <= last
        ]
        named = dict.fromkeys(
            [
                at.old_id,
                at.new_id,
                *map(self.follower, frames),
                *self.tracks_at(at.frame),
            ]
        )
        return tuple(track_id for track_id in named if track_id >= 0)

    @cached_property
    def regained(self) -> int:
        """First frame after the event's in which a track follows the object; -1 if it is gone before, or a log ends."""
        followed = np.flatnonzero(
            self.followers(self.at.frame, self.replay.frames - 1)[1:] >= 0
        )
        return self.at.frame + 1 + int(followed[0]) if len(followed) else -1

    def name_of(self, row: int) -> str:
        """Name of the object of a row of the truth; empty for row -1."""
        truth, classes = self.replay.scene.truth, self.replay.card.task.classes
        name = self.replay.scene.short_name(int(truth.object_id[row]))
        return (
            f"{classes[truth.class_id[row]].replace('_', ' ')} {name}"
            if row >= 0
            else ""
        )

    def seconds(self, t: int) -> float:
        """Time of a frame since the first one."""
        return float(self.replay.scene.time[t] - self.replay.scene.time[0])

    @cached_property
    def rows(self) -> Ints:
        """Row [F] of the object in the truth, -1 in frames without it; all -1 for a false forecast."""
        truth = self.replay.scene.truth
        own = (
            (truth.object_id == self.at.object_id)
            & ~truth.neutral
            & (self.at.object_id >= 0)
        )
        return self._by_frame(own, truth.frame_of_rows)

    def until_gap(self, rows: Ints, first: int, last: int) -> Ints:
        """The ``rows`` [F] of the frames from ``first`` until a gap (-1), a hole in time or ``last``, or backwards."""
        step = 1 if last >= first else -1
        frames, piece = (
            np.arange(first, last + step, step),
            pieces(self.replay.scene, self.replay.card),
        )
        frames = frames[(frames >= 0) & (frames < len(rows))]
        gap = np.flatnonzero((rows[frames] < 0) | (piece[frames] != piece[frames[:1]]))
        return rows[frames[: gap[0]]] if len(gap) else rows[frames]

    def _by_frame(self, own: Bools, frame: Ints) -> Ints:
        """Row [F] in each frame of those in the mask ``own``, -1 without one."""
        rows = np.full(self.replay.frames, -1)
        rows[frame[own]] = np.flatnonzero(own)
        return rows

    def place(self, t: int) -> Floats:
        """Place [2] of the object at frame ``t``; in frames without it, its nearest known place in time."""
        known = np.flatnonzero(self.rows >= 0)
        if len(known):
            nearest = known[np.argmin(np.abs(known - t))]
            return self.replay.scene.truth.box[self.rows[nearest], :2]
        row = self.track_rows(self.at.new_id)[t]
        return (
            np.array(self.at.position[:2])
            if row < 0
            else self.replay.rollout.track_box[row, :2].astype(np.float64)
        )

    def path(self, first: int, last: int) -> Floats:
        """Places [n, 2] of the object from frame ``first`` on until a gap or ``last``, forwards or backwards."""
        return self.replay.scene.truth.box[self.until_gap(self.rows, first, last), :2]

    def future(self, t: int) -> Floats:
        """Places [n, 2] of the object within the horizon, now first."""
        return self.path(t, t + self.replay.card.task.future)

    @cached_property
    def hypothesis(self) -> Ints:
        """The hypothesis [F] that is looked at in each frame."""
        return self.replay.answers.hypotheses.seen_from(self.at.frame)

    @cached_property
    def shown(self) -> Bools:
        """Tracks [N] that this hypothesis holds."""
        frame = self.replay.rollout.tracks.frame_of_rows
        return self.replay.answers.hypotheses.member[
            np.arange(len(frame)), self.hypothesis[frame]
        ]

    def track_rows(self, track_id: int) -> Ints:
        """Row [F] of a track in each frame, -1 where it is not output."""
        rollout = self.replay.rollout
        own = self.shown & (rollout.track_id == track_id) & (track_id >= 0)
        return self._by_frame(own, rollout.tracks.frame_of_rows)

    @cached_property
    def track_of_truth(self) -> Ints:
        """Track [R] matched to each true box in this hypothesis, -1 without one."""
        frame, chosen = (
            self.replay.scene.truth.frame_of_rows,
            self.hypothesis[self.replay.scene.truth.frame_of_rows],
        )
        matched = self.replay.matched[np.arange(len(frame)), chosen]
        best = chosen == self.replay.answers.hypotheses.best[frame]
        return np.where(best, self.replay.truth_track, matched)

    @cached_property
    def truth_of_track(self) -> Ints:
        """True box [N + 1] that each track is matched to, -1 without one; -1 for row -1."""
        rows = np.full(len(self.replay.rollout.track_id) + 1, -1)
        matched = np.flatnonzero(self.track_of_truth >= 0)
        rows[self.track_of_truth[matched]] = matched
        return rows

    def follower(self, t: int) -> int:
        """Id of the track that follows the object at frame ``t``, -1 without one."""
        return int(
            np.append(self.replay.rollout.track_id, -1)[
                np.append(self.track_of_truth, -1)[self.rows[t]]
            ]
        )

    def followers(self, first: int, last: int) -> Ints:
        """Ids [n] of the tracks that follow the object from ``first`` until a gap or ``last``, or backwards."""
        return np.append(self.replay.rollout.track_id, -1)[
            self.track_of_truth[self.until_gap(self.rows, first, last)]
        ]

    def rival(self, t: int) -> int:
        """Id of the nearest track in the event gate of the object that follows another one; -1 if one follows it."""
        run, card, row, truth = (
            self.replay.rollout,
            self.replay.card,
            self.rows[t],
            self.replay.scene.truth,
        )
        if row < 0 or self.follower(t) >= 0:
            return -1
        rows, own, gate = run.tracks.rows(t), slice(row, row + 1), card.task.event_gate
        tracks = rows.start + np.flatnonzero(
            self.shown[rows] & (self.truth_of_track[:-1][rows] >= 0)
        )
        frames, others = (
            np.zeros(1 + len(tracks), dtype=np.int64),
            (run.track_box[tracks], run.track_class[tracks]),
        )
        one, rule = (
            (truth.box[own], truth.class_id[own]),
            (gate.measure, card.per_class(gate.threshold)),
        )
        pairs = box_pairs(frames[:1], *one, frames[1:], *others, *rule)
        return int(
            np.append(run.track_id[tracks[pairs.column[np.argsort(pairs.cost)]]], -1)[0]
        )

    @cached_property
    def doubled(self) -> int:
        """Row of the true object that a false forecast is a second one of: of its class in its gate; -1 without one."""
        truth, rows = (
            self.replay.scene.truth,
            self.replay.scene.truth.rows(self.at.frame),
        )
        far = np.hypot(*(truth.box[rows, :2] - self.place(self.at.frame)).T)
        far[truth.class_id[rows] != self.at.class_id] = np.inf
        near = self.at.kind == "spurious" and far.min(initial=np.inf) <= self.gate
        return rows.start + int(far.argmin()) if near else -1

    def counted(self, row: int) -> int:
        """Id of the track whose forecast counts for a true box, -1 without one."""
        return int(
            np.append(self.replay.answers.object_track_id, -1)[
                np.append(self.replay.truth_forecast, -1)[row]
            ]
        )

    def tracks_at(self, t: int) -> tuple[int, ...]:
        """Ids of the tracks at the object in a picture of frame ``t``: of its forecasts, and its `rival`; -1: none."""
        return (
            *(each.track_id for _, each in self.forecasts(t)),
            self.rival(t),
            self.counted(self.doubled),
        )

    def other(self, track_id: int, t: int) -> int:
        """Row of the true box, other than the object, that a track follows at frame ``t``, -1 without one."""
        row = int(self.truth_of_track[self.track_rows(track_id)[t]])
        return -1 if row == self.rows[t] else row

    def forecast(self, t: int) -> ObjectForecast | None:
        """The forecast of frame ``t`` that the scorer matches to the object, else that of its track then."""
        row, rollout = self._forecast_row(t), self.replay.rollout
        weight = (
            floored(sample_weights(rollout.forecast_log_weight[row : row + 1]))[0]
            if row >= 0
            else np.zeros(0)
        )
        stated = weight > 0
        if not stated.any():
            return None
        start = rollout.object_box[row, :2].astype(np.float64)
        path = (start + to_metres(rollout.forecast[row]))[stated]
        future = self.future(t)[1:]
        gap = np.hypot(*np.moveaxis(path[:, : len(future)] - future, -1, 0)).sum(axis=1)
        nearest = int(np.argmin(gap) if len(future) else np.argmax(weight[stated]))
        track_id = int(self.replay.answers.object_track_id[row])
        return ObjectForecast(
            t,
            track_id if self.track_rows(track_id)[t] >= 0 else -1,
            start,
            path,
            nearest,
        )

    def _forecast_row(self, t: int) -> int:
        row = int(np.append(self.replay.truth_forecast, -1)[self.rows[t]])
        if row >= 0:
            return row
        own = self.at.old_id if t < self.at.frame else self.at.new_id
        if (
            self.at.kind == "spurious" and own < 0
        ):  # a forecast without a track stands alone
            return self.at.row if t == self.at.frame else -1
        objects = self.replay.rollout.objects.rows(t)
        rows = np.flatnonzero(
            (self.replay.answers.object_track_id[objects] == own) & (own >= 0)
        )
        return objects.start + int(rows[0]) if len(rows) else -1

    def forecasts(self, t: int) -> list[tuple[str, ObjectForecast]]:
        """The forecasts that a picture of frame ``t`` shows, each with its role, the most important one last.

        From the event on the one before it stays in sight: the switch has spoilt it.
        """
        at, after = self.at, t >= self.at.frame
        frames = (
            [("before", min(t, at.frame - 1))]
            if not after or (at.frame > 0 and at.kind != "spurious")
            else []
        )
        shown = (
            (role, self.forecast(frame))
            for role, frame in [*frames, *[("now", t)] * after]
        )
        return [(role, forecast) for role, forecast in shown if forecast is not None]
