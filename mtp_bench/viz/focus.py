"""An event of a run with its object, tracks and forecasts by frame.

Positions are in metres, in the frame of the scene.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..core import Bools, Floats, Ints, to_metres
from ..scoring import drop_light_samples, pieces, sample_weights
from .incident import Incident
from .run_replay import Replay


def nearest_box(
    box: Floats, rows: slice, is_candidate: Bools, place: Floats, radius_m: float
) -> int:
    """Return the row of the candidate nearest to ``place`` [2], or -1.

    ``rows``: those of one frame, of which ``is_candidate`` masks some. Those farther
    than ``radius_m`` are left out.
    """
    distance_m = np.hypot(*(box[rows, :2] - place).T)
    distance_m[~is_candidate] = np.inf
    if distance_m.min(initial=np.inf) > radius_m:
        return -1
    return int(rows.start + np.argmin(distance_m))


@dataclass(frozen=True, eq=False)
class ObjectForecast:
    """One forecast of the object."""

    frame: int  # in which it was made
    track_id: int  # of the hypothesis that is looked at, -1 for none
    start: Floats  # [2] m
    samples: Floats  # [K, T, 2] m, one per frame after ``frame``
    nearest: int  # sample nearest to the true future; without one the heaviest

    @property
    def nearest_path(self) -> Floats:
        """The nearest sample with its start [T + 1, 2]."""
        return np.concatenate([self.start[None], self.samples[self.nearest]])


@dataclass(frozen=True, eq=False)
class Focus:
    """An event and the run in which it happened; rows are those of the run's tables.

    Tracks are those of the best hypothesis of the event's frame, back along its
    lineage. In later frames they are those of the best hypothesis of that frame.
    """

    replay: Replay
    at: Incident
    # rad, direction that points to the right; None: that of the object's way
    facing: float | None = None

    @property
    def noun(self) -> str:
        """Class of the object, in words."""
        return self.replay.class_noun(self.at.class_id)

    @property
    def named(self) -> str:
        """Name of the object."""
        return self.replay.object_name(self.at.object_id, self.at.class_id)

    @property
    def gate_m(self) -> float:
        """Forecast gate of the object's class, m."""
        card = self.replay.card
        return float(card.per_class(card.task.forecast_gate)[self.at.class_id])

    @property
    def near_m(self) -> float:
        """Radius around the object that has its detections, m."""
        return 2 * self.gate_m

    def name_of(self, truth_row: int) -> str:
        """Return the name of a true box, empty for row -1."""
        if truth_row < 0:
            return ""
        truth = self.replay.scene.truth
        object_id = int(truth.object_id[truth_row])
        return self.replay.object_name(object_id, truth.class_id[truth_row])

    def track_name(self, track_id: int) -> str:
        """Return the name of a track, with its stored id."""
        stored_name = self.replay.scene.track_names.get(track_id)
        name = f"track {track_id}"
        return name if stored_name is None else f"{name} ({stored_name} in its file)"

    def seconds(self, t: int) -> float:
        """Return the time of frame ``t`` since the first frame."""
        return self.replay.scene.seconds(t)

    # ---- the object

    @cached_property
    def rows(self) -> Ints:
        """Row [F] of the object in the truth, or -1."""
        truth = self.replay.scene.truth
        is_object = (truth.object_id == self.at.object_id) & ~truth.neutral
        return self._rows_by_frame(
            is_object & (self.at.object_id >= 0), truth.frame_of_rows
        )

    def _rows_by_frame(self, chosen: Bools, frame: Ints) -> Ints:
        """Return the ``chosen`` row [F] of each frame, or -1.

        ``chosen`` masks rows of a table, at most one of each ``frame``.
        """
        rows = np.full(self.replay.frames, -1)
        rows[frame[chosen]] = np.flatnonzero(chosen)
        return rows

    def until_gap(self, rows: Ints, first_frame: int, last_frame: int) -> Ints:
        """Return the ``rows`` [F] of an interval up to a gap.

        A gap is a row of -1 or a hole in time; for the object's own rows, annotated
        frames alone count. If the last frame lies before the first, the rows go back in
        time.
        """
        frame_step = 1
        if last_frame < first_frame:
            frame_step = -1
        time_piece = pieces(self.replay.scene, self.replay.card)
        frames = np.arange(first_frame, last_frame + frame_step, frame_step)
        frames = frames[(frames >= 0) & (frames < len(rows))]
        if rows is self.rows:
            frames = frames[np.isin(frames, self.replay.scene.annotated_frames)]
        is_gap = (rows[frames] < 0) | (time_piece[frames] != time_piece[frames[:1]])
        count = int(np.argmax(np.append(is_gap, True)))
        return rows[frames[:count]]

    def place(self, t: int) -> Floats:
        """Return the place [2] of the object at frame ``t``, m.

        In frames without the object it is its place nearest in time.
        """
        frames = np.flatnonzero(self.rows >= 0)
        if len(frames):
            nearest = frames[np.argmin(np.abs(frames - t))]
            return self.replay.scene.truth.box[self.rows[nearest], :2]
        track_row = self.track_rows(self.at.new_id)[t]
        if track_row < 0:
            return np.array(self.at.position[:2])
        return self.replay.rollout.track_box[track_row, :2].astype(np.float64)

    def path(self, first_frame: int, last_frame: int) -> Floats:
        """Return places [n, 2] of the object up to a gap.

        Between annotated frames it moves on straight lines.
        """
        truth = self.replay.scene.truth
        rows = self.until_gap(self.rows, first_frame, last_frame)
        if not len(rows):
            return truth.box[rows, :2]
        step = np.abs(truth.frame_of_rows[rows] - first_frame)
        steps = np.arange(step[0], step[-1] + 1)
        x, y = truth.box[rows, :2].T
        return np.column_stack([np.interp(steps, step, x), np.interp(steps, step, y)])

    def future(self, t: int) -> Floats:
        """Return places [n, 2] within the horizon, now first."""
        return self.path(t, t + self.replay.card.task.future)

    # ---- its tracks

    @cached_property
    def hypothesis(self) -> Ints:
        """The hypothesis [F] that is looked at in each frame."""
        return self.replay.answers.hypotheses.seen_from(self.at.frame)

    @cached_property
    def shown(self) -> Bools:
        """Mask [N] of the tracks of this hypothesis."""
        frame = self.replay.rollout.tracks.frame_of_rows
        member = self.replay.answers.hypotheses.member
        return member[np.arange(len(frame)), self.hypothesis[frame]]

    def track_rows(self, track_id: int) -> Ints:
        """Return the row [F] of a track in each frame, or -1."""
        rollout = self.replay.rollout
        is_track = self.shown & (rollout.track_id == track_id) & (track_id >= 0)
        return self._rows_by_frame(is_track, rollout.tracks.frame_of_rows)

    @cached_property
    def track_of_truth(self) -> Ints:
        """Row [R] of the track of each true box in this hypothesis, or -1."""
        replay = self.replay
        frame = replay.scene.truth.frame_of_rows
        chosen = self.hypothesis[frame]
        matched = replay.matched[np.arange(len(frame)), chosen]
        is_best = chosen == replay.answers.hypotheses.best[frame]
        # of the best hypothesis the scorer's own matching is known
        return np.where(is_best, replay.truth_track, matched)

    @cached_property
    def truth_of_track(self) -> Ints:
        """Row [N + 1] of the true box of each track, or -1, also for track row -1."""
        truth_rows = np.full(len(self.replay.rollout.track_id) + 1, -1)
        matched = np.flatnonzero(self.track_of_truth >= 0)
        truth_rows[self.track_of_truth[matched]] = matched
        return truth_rows

    def followers(self, first_frame: int, last_frame: int) -> Ints:
        """Return ids [n] of the object's tracks up to a gap.

        They are those of the frames of an interval, -1 without a track.
        """
        track_ids = np.append(self.replay.rollout.track_id, -1)
        return track_ids[
            self.track_of_truth[self.until_gap(self.rows, first_frame, last_frame)]
        ]

    def follower(self, t: int) -> int:
        """Return the id of the object's track at ``t``, or -1."""
        return next(iter(self.followers(t, t).tolist()), -1)

    @cached_property
    def regained(self) -> int:
        """First frame after the event with a track, or -1."""
        later_tracks = self.followers(self.at.frame, self.replay.frames - 1)[1:]
        followed = np.flatnonzero(later_tracks >= 0)
        return self.at.frame + 1 + int(followed[0]) if len(followed) else -1

    def other_object(self, track_id: int, t: int) -> int:
        """Return the row of another object that a track follows at ``t``, or -1."""
        truth_row = int(self.truth_of_track[self.track_rows(track_id)[t]])
        return -1 if truth_row == self.rows[t] else truth_row

    def nearest_track(self, t: int) -> int:
        """Return the id of the nearest track in the gate, or -1."""
        rollout = self.replay.rollout
        rows = rollout.tracks.rows(t)
        row = nearest_box(
            rollout.track_box, rows, self.shown[rows], self.place(t), self.gate_m
        )
        return int(np.append(rollout.track_id, -1)[row])

    def tracks_at(self, t: int) -> tuple[int, ...]:
        """Return ids of the tracks in colour in frame ``t``."""
        around = range(max(0, t - 1), min(self.replay.frames, t + 2))
        track_ids = [self.at.old_id, self.at.new_id]
        track_ids += [self.follower(frame) for frame in around]
        track_ids += [forecast.track_id for _, forecast in self.forecasts(t)]
        track_ids.append(self.nearest_track(t))
        return tuple(track_id for track_id in dict.fromkeys(track_ids) if track_id >= 0)

    # ---- its forecasts

    def forecast(self, t: int) -> ObjectForecast | None:
        """Return the forecast that the scorer matches to the object at ``t``.

        Without one it is that of the object's track then. None without either.
        """
        row = self._forecast_row(t)
        if row < 0:
            return None
        rollout = self.replay.rollout
        sample_weight = drop_light_samples(
            sample_weights(rollout.forecast_log_weight[row : row + 1])
        )[0]
        if not sample_weight.any():
            return None
        start = rollout.object_box[row, :2].astype(np.float64)
        samples = (start + to_metres(rollout.forecast[row]))[sample_weight > 0]
        future = self.future(t)[1:]
        if len(future):
            offset_m = samples[:, : len(future)] - future
            nearest = np.argmin(
                np.hypot(offset_m[..., 0], offset_m[..., 1]).sum(axis=1)
            )
        else:
            nearest = np.argmax(sample_weight[sample_weight > 0])
        track_id = int(self.replay.answers.object_track_id[row])
        if self.track_rows(track_id)[t] < 0:
            track_id = -1
        return ObjectForecast(t, track_id, start, samples, int(nearest))

    def _forecast_row(self, t: int) -> int:
        """Return the row of the forecast of frame ``t``, or -1."""
        row = int(np.append(self.replay.truth_forecast, -1)[self.rows[t]])
        if row >= 0:
            return row
        track_id = self.at.old_id if t < self.at.frame else self.at.new_id
        if track_id < 0:  # a false forecast without a track stands alone
            stands_alone = self.at.kind == "spurious" and t == self.at.frame
            return self.at.row if stands_alone else -1
        rows = self.replay.rollout.objects.rows(t)
        of_track = self.replay.answers.object_track_id[rows] == track_id
        return rows.start + int(np.argmax(of_track)) if of_track.any() else -1

    def forecasts(self, t: int) -> list[tuple[str, ObjectForecast]]:
        """Return role and forecast of those shown in frame ``t``.

        From the event on the one before the event stays in sight: the event spoilt it.
        """
        frames = {"before": min(t, self.at.frame - 1), "now": t}
        if t < self.at.frame:
            del frames["now"]
        elif self.at.frame == 0 or self.at.kind == "spurious":
            del frames["before"]
        shown = [(role, self.forecast(frame)) for role, frame in frames.items()]
        return [(role, forecast) for role, forecast in shown if forecast is not None]
