"""Evidence around an event that an agent does not state.

Positions are in metres, in the frame of the scene; rows are those of the run's tables.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..core import Bools, Detections, Floats, Ints, Truth
from ..scoring import PART_NAMES, Pairs, match, near_pairs, pieces
from .focus import Focus, nearest_box
from .run_replay import Replay

# share of the forecast gate between a track's box and its detection without motion
SMOOTHED_SHARE = 0.25
_WITH_DETECTION = ("no_forecast", "other_class", "off_place")  # keys of PART_NAMES


class Gate(NamedTuple):
    """Rule by which the scorer lets a track follow the object."""

    by_iou: bool  # else by the distance of the centres
    threshold: float  # least IoU in 3D, or greatest distance in m

    @property
    def text(self) -> str:
        """The rule in words."""
        if self.by_iou:
            return f"an IoU of {self.threshold:g}"
        return f"within {self.threshold:g} m"


def gate(focus: Focus) -> Gate:
    """Return the event gate of the object's class."""
    card = focus.replay.card
    rule = card.task.event_gate
    threshold = float(card.per_class(rule.threshold)[focus.at.class_id])
    return Gate(rule.measure == "iou_3d", threshold)


def reach(focus: Focus) -> float:
    """Return the distance within which boxes count as at the object, m.

    It is the forecast gate, or the event gate if that is larger.
    """
    rule = gate(focus)
    return focus.gate_m if rule.by_iou else max(focus.gate_m, rule.threshold)


def distance_to(focus: Focus, place: Floats) -> float:
    """Return the distance of a ``place`` to the object, m."""
    return float(np.hypot(*(place[:2] - focus.place(focus.at.frame))))


# ---- tracks


def trail(focus: Focus, track_id: int, t: int, frames: int) -> Floats:
    """Return places [n, 2] of a track until ``t``, now last.

    They are those of the last ``frames`` frames, up to a gap: none if the track is not
    output at ``t``.
    """
    rows = focus.until_gap(focus.track_rows(track_id), t, t - frames + 1)[::-1]
    return focus.replay.rollout.track_box[rows, :2].astype(np.float64)


def expected(focus: Focus, track_id: int, t: int) -> Floats | None:
    """Predict the place [2] of a track at ``t``.

    Its last two boxes before go on at constant velocity. None for a track that was not
    there then, and after a hole in time.
    """
    previous = trail(focus, track_id, t, 3)[:-1]  # from one alone it stands still
    return np.asarray(2 * previous[-1] - previous[0]) if len(previous) else None


def taken_detection(focus: Focus, track_id: int, t: int) -> int:
    """Return the row of the detection that a track took.

    It is -1 if the track coasts at ``t``. The tracks of the hypothesis are matched with
    detections one-to-one. A filter moves a track from its expected place towards its
    detection and stops short of it: the detection lies about as near to the box as the
    box has moved.
    """
    replay = focus.replay
    track_row = int(focus.track_rows(track_id)[t])
    matches = _matched_detections(replay, t, int(focus.hypothesis[t]), focus.near_m)
    detection_row = matches.get(track_row, -1)
    if detection_row < 0:
        return -1
    track_place = replay.rollout.track_box[track_row, :2].astype(np.float64)
    expected_place = expected(focus, track_id, t)
    moved_m = 0.0
    if expected_place is not None:
        moved_m = float(np.hypot(*(track_place - expected_place)))
    offset_m = track_place - replay.scene.detections.box[detection_row, :2]
    is_near = np.hypot(*offset_m) <= SMOOTHED_SHARE * focus.gate_m + moved_m
    if not is_near:
        return -1
    return detection_row


@lru_cache(maxsize=64)  # lists ask for all tracks of a frame, one after the other
def _matched_detections(
    replay: Replay, t: int, hypothesis: int, radius_m: float
) -> dict[int, int]:
    """Match tracks of a hypothesis with detections, by rows."""
    detections = replay.scene.detections
    rollout = replay.rollout
    track_rows = rollout.tracks.rows(t)
    tracks = np.arange(track_rows.start, track_rows.stop)
    tracks = tracks[replay.answers.hypotheses.member[tracks, hypothesis]]
    rows = detections.rows(t)
    offset_m = (
        rollout.track_box[tracks, None, :2].astype(float) - detections.box[rows, :2]
    )
    distance_m = np.hypot(offset_m[..., 0], offset_m[..., 1])
    track_class = rollout.track_class[tracks][:, None]
    same_class = (track_class == detections.class_id[rows]) | (track_class < 0)
    i, j = np.nonzero(same_class & (distance_m <= radius_m))
    matched = match(Pairs(i, j, distance_m[i, j]), len(tracks))
    pairs = zip(tracks.tolist(), matched.tolist(), strict=True)
    return {track: rows.start + column for track, column in pairs if column >= 0}


# ---- detections


def near_detections(focus: Focus, t: int) -> Ints:
    """Return rows of detections within `Focus.near_m`, the nearest first."""
    detections = focus.replay.scene.detections
    rows = detections.rows(t)
    distance_m = np.hypot(*(detections.box[rows, :2] - focus.place(t)).T)
    order = np.argsort(distance_m, kind="stable")
    return np.asarray(rows.start + order[: (distance_m <= focus.near_m).sum()])


def object_detection(focus: Focus, t: int) -> int:
    """Return the row of the detection of the object at ``t``.

    Without one it is the nearest of its class within `Focus.near_m`, or -1.
    """
    rows = near_detections(focus, t)
    rows = rows[focus.replay.scene.detections.class_id[rows] == focus.at.class_id]
    if not len(rows):
        return -1
    is_object = focus.replay.detected[rows] == focus.at.object_id
    return int(rows[np.argmax(is_object)])  # the first, or the nearest without one


def appeared(focus: Focus, t: int) -> int:
    """Return the object's first frame since a hole in time."""
    time_piece = pieces(focus.replay.scene, focus.replay.card)
    truth = focus.replay.scene.truth
    frames = truth.frame_of_rows[truth.object_id == focus.at.object_id]
    return int(frames[time_piece[frames] == time_piece[t]][0])


def last_detected(focus: Focus, t: int) -> int:
    """Return the last frame with a detection until ``t``, or -1."""
    is_object = focus.replay.detected == focus.at.object_id
    frames = focus.replay.scene.detections.frame_of_rows[is_object]
    in_time = (frames >= appeared(focus, t)) & (frames <= t)
    return int(frames[in_time].max(initial=-1))


def of_other_class(focus: Focus, t: int, table: Detections | Truth) -> int:
    """Return the row of the nearest box of another class, or -1.

    ``table``: the detections, or the true boxes.
    """
    rows = table.rows(t)
    is_other = table.class_id[rows] != focus.at.class_id
    return nearest_box(table.box, rows, is_other, focus.place(t), reach(focus))


def owner_of(focus: Focus, detection_row: int, t: int) -> int:
    """Return the row of the other object that a detection is of, or -1."""
    truth = focus.replay.scene.truth
    object_id = focus.replay.detected[detection_row]
    if object_id in (-1, focus.at.object_id):
        return -1
    matches = truth.object_id[truth.rows(t)] == object_id
    return truth.rows(t).start + int(np.argmax(matches)) if matches.any() else -1


@lru_cache(maxsize=4)  # asked for every moment of a run
def borrowed(replay: Replay) -> Bools:
    """Mask true boxes [R] with detections of other objects alone.

    Detections within two forecast gates count. Boxes are left out unless their error
    has one of the parts `_WITH_DETECTION`.
    """
    truth = replay.scene.truth
    detections = replay.scene.detections
    gate_m = np.asarray(replay.card.per_class(replay.card.task.forecast_gate), float)
    row, detection_row, distance_m = near_pairs(
        truth.frame_of_rows,
        truth.box[:, :2],
        detections.frame_of_rows,
        detections.box[:, :2],
        2 * float(gate_m.max()),
    )
    is_near = distance_m <= 2 * gate_m[truth.class_id[row]]
    owner_id = replay.detected[detection_row]
    is_other = is_near & (owner_id >= 0) & (owner_id != truth.object_id[row])
    count = np.bincount(row[is_near], minlength=len(truth.box))
    of_others = np.bincount(row[is_other], minlength=len(truth.box))
    columns = [list(PART_NAMES).index(key) for key in _WITH_DETECTION]
    explained = replay.part[:, columns].sum(axis=1) > 0
    if not len(replay.rollout.object_box):  # the agent alone explains them
        explained[:] = False
    return np.asarray((count > 0) & (count == of_others) & explained)
