"""Closed loops: plans of the ego, and the outputs of the stages before a collision."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..core import HARD_BRAKING, Bools, Drive, Floats, to_metres
from ..traffic import RATE, drive_rows
from .focus import Focus, nearest_box
from .run_replay import Replay

BEFORE_SECONDS = 3.0  # before a collision, in which outputs are counted
# of frames with an output, and mean confidence, below which a stage failed
MIN_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class ShownPlan:
    """One decision of the planner."""

    path: Floats  # [T + 1, 2] m, of the ego, from now on
    hard: Bools  # [T] steps in which it brakes by more than `HARD_BRAKING`
    acceleration: float  # m/s2, of now
    risk: float  # severity-weighted contact score along the path, in [0, 1]
    slower: Floats  # [0 or 1, 7] box of the forecast object that slows the ego


def plan_at(replay: Replay, t: int) -> ShownPlan | None:
    """Return the plan in frame ``t``.

    None without a closed loop.
    """
    drive = replay.rollout.drive
    if drive is None or t >= len(drive.plan):
        return None
    rate_hz = replay.card.task.rate
    # the traffic has RATE steps per second, of which each frame has several
    acceleration = float(drive.acceleration[t * round(RATE / rate_hz)])
    # [T] m/s, means of the steps
    speed = np.hypot(*np.diff(drive.plan[t], axis=0).T) * rate_hz
    hard = np.append(acceleration, np.diff(speed) * rate_hz) < HARD_BRAKING
    objects = replay.rollout.objects.rows(t - replay.first)
    boxes = replay.rollout.object_box[objects].astype(np.float64)
    slower = boxes[np.arange(len(boxes)) == drive.cause[t]]
    return ShownPlan(drive.plan[t], hard, acceleration, float(drive.risk[t]), slower)


def in_state(replay: Replay, t: int, drive: Drive, state: int) -> Replay:
    """Move the ego and the true boxes of frame ``t`` to a state of the drive.

    The collision is an incident of the last state.
    """
    scene = replay.scene
    truth = scene.truth
    ego = scene.ego.copy()
    along, *columns = drive.route.T
    station = drive.station[state]
    ego[t, [0, 1, 3]] = [np.interp(station, along, values) for values in columns]
    box = truth.box.copy()
    is_present = truth.frame_of_rows == t
    box[is_present, 0] += 1e5  # m: road users that have left are out of the picture
    for row in drive_rows(drive):
        if row[0] == state:
            box[is_present & (truth.object_id == row[1])] = row[3:10]
    scene = replace(scene, ego=ego, truth=replace(truth, box=box))
    incidents = replay.incidents
    if state < len(drive.station) - 1:
        incidents = tuple(one for one in incidents if one.kind != "collision")
    return replace(replay, scene=scene, incidents=incidents)


class CollisionEvidence(NamedTuple):
    """Outputs of the stages for one object in the seconds before the ego hits it."""

    frames: int
    detected_frames: int
    forecast_frames: int
    # mean over frames, of the nearest sample at the collision; NaN without forecasts
    forecast_error_m: float
    confidence: float  # mean over frames; NaN without forecasts
    switch_s: float  # time of the last identity switch; NaN without one
    gate_m: float  # forecast gate of the object's class

    @property
    def cause(self) -> tuple[str, str]:
        """The first stage that failed, else the planner, and its reason."""
        min_frames = MIN_SHARE * self.frames
        forecast_is_off = self.forecast_error_m > self.gate_m
        if self.detected_frames < min_frames:
            return "detector", "not detected before"
        if self.forecast_frames < min_frames:
            return "tracker", "not forecast before"
        if forecast_is_off and not np.isnan(self.switch_s):
            return "tracker", "switched before"
        if self.confidence < MIN_SHARE:
            return "confidence", "unsure before"
        if forecast_is_off:
            return "predictor", "forecast off"
        return "planner", "plan"


def collision_evidence(focus: Focus) -> CollisionEvidence:
    """Measure outputs of the stages before a collision."""
    replay = focus.replay
    t = focus.at.frame
    object_id = focus.at.object_id
    first = max(0, t - round(BEFORE_SECONDS * replay.card.task.rate))
    frames = first + np.flatnonzero(focus.rows[first:t] >= 0)
    if not len(frames):  # the object has just appeared
        frames = np.array([t])
    detected_in = replay.scene.detections.frame_of_rows[replay.detected == object_id]
    switch_s = np.nan
    for event in replay.events:
        if (event.kind, event.object_id) == ("ids", object_id) and event.frame >= first:
            switch_s = focus.seconds(event.frame)
    pairs = [_forecast_then(focus, frame) for frame in frames.tolist()]
    forecasts = [pair for pair in pairs if pair is not None]
    means = np.mean(forecasts or [(np.nan, np.nan)], axis=0)
    error_m, confidence = means.tolist()
    return CollisionEvidence(
        frames=len(frames),
        detected_frames=int(np.isin(frames, detected_in).sum()),
        forecast_frames=len(forecasts),
        forecast_error_m=error_m,
        confidence=confidence,
        switch_s=switch_s,
        gate_m=focus.gate_m,
    )


def _forecast_then(focus: Focus, frame: int) -> tuple[float, float] | None:
    """Return the error of a forecast at the collision, m, and its confidence.

    It is the forecast made in ``frame`` that begins nearest to the object, inside its
    gate: the scorer matches no forecast this late. None without a forecast.
    """
    rollout = focus.replay.rollout
    rows = rollout.objects.rows(frame)
    same_class = rollout.object_class[rows] == focus.at.class_id
    place = focus.place(frame)
    row = nearest_box(rollout.object_box, rows, same_class, place, focus.gate_m)
    if row < 0:
        return None
    samples = rollout.forecast[row][np.isfinite(rollout.forecast_log_weight[row])]
    if not len(samples):
        return None
    step = min(max(1, focus.at.frame - frame), samples.shape[1]) - 1
    ends = rollout.object_box[row, :2] + to_metres(samples[:, step])
    error_m = np.hypot(*(ends - focus.place(focus.at.frame)).T).min()
    return float(error_m), float(rollout.object_confidence[row])
