"""Evidence around an event that an agent does not state, worked out from its answers in the same way for every agent.

Places are in the frame of reference of the scene, metres; rows are those of the tables of the run.
"""

from dataclasses import dataclass

import numpy as np

from ..geometry import iou_3d, wrap_angle
from ..scoring.holes import pieces
from ..scoring.matching import match
from ..scoring.pairs import Pairs
from ..types import Floats, Ints, to_metres
from .focus import Focus, ObjectForecast

STILL = 1.0  # m, within the horizon: an object that moves less stands still
SHORT, LONG = 0.75, 1.33  # shares of a distance between which it is the same
ASIDE, BACK = np.deg2rad(25.0), np.deg2rad(120.0)
SMOOTHED = 0.25  # share of the forecast gate that a track's box may lie beside its detection without having moved


@dataclass(frozen=True)
class Gate:
    """Rule by which the scorer lets a track follow the object: least IoU in 3D, or greatest distance of the centres."""

    iou: bool
    threshold: float  # IoU, or m

    @property
    def text(self) -> str:
        """The rule in words."""
        return f"an IoU of {self.threshold:g}" if self.iou else f"within {self.threshold:g} m"


def gate(focus: Focus) -> Gate:
    """Event gate of the object's class."""
    rule, card = focus.replay.card.task.event_gate, focus.replay.card
    return Gate(rule.measure == "iou_3d", float(card.per_class(rule.threshold)[focus.at.class_id]))


def reach(focus: Focus) -> float:
    """Distance within which a box lies at the object, m: its forecast gate, or its event gate if that is larger."""
    rule = gate(focus)
    return focus.gate if rule.iou else max(focus.gate, rule.threshold)


def expected(focus: Focus, track_id: int, t: int) -> Floats | None:
    """Place [2] where a track was expected at frame ``t`` by its own forecast of the frame before.

    It is the first step of the heaviest sample; without a forecast the last two boxes go on at constant velocity. None
    for a track that was not there in the frame before, and after a hole in time.
    """
    row = int(focus.track_rows(track_id)[t])
    place = _expected(focus, np.array([row]), t)[0]
    return None if row < 0 or np.isnan(place[0]) else place


def _expected(focus: Focus, rows: Ints, t: int) -> Floats:
    """The same of the tracks of ``rows`` [n] of frame ``t`` [n, 2], NaN where unknown."""
    run, rollout = focus.replay, focus.replay.rollout
    places = np.full((len(rows), 2), np.nan)
    if t == 0 or np.diff(pieces(run.scene, run.card)[t - 1 : t + 1]) > 0:
        return places
    earlier, chosen = run.answers.earlier, focus.hypothesis
    before = np.where(rows >= 0, earlier[rows, chosen[t]], -1)
    last = np.where(before >= 0, earlier[before, chosen[t - 1]], -1)
    known = before >= 0
    box = np.append(rollout.track_box[:, :2].astype(np.float64), np.full((1, 2), np.nan), axis=0)
    places[known] = (2 * box[before] - box[np.where(last >= 0, last, before)])[known]
    objects = rollout.objects.rows(t - 1)
    for i in np.flatnonzero(known):
        own = objects.start + np.flatnonzero(run.answers.object_track[objects] == before[i])
        if len(own):
            sample = int(np.argmax(rollout.forecast_log_weight[own[0]]))
            places[i] = rollout.object_box[own[0], :2] + to_metres(rollout.forecast[own[0], sample, 0])
    return places


def taken(focus: Focus, track_id: int, t: int) -> int:
    """Row of the detection that a track took at frame ``t``, -1 for none: it coasts.

    A filter moves a track from its expected place towards its detection and stops short of it: the detection lies about
    as near to the box as the box has moved. All tracks of the hypothesis are matched with detections one-to-one.
    """
    row, run = int(focus.track_rows(track_id)[t]), focus.replay
    if row < 0:
        return -1
    tracks = run.rollout.tracks.rows(t)
    rows = tracks.start + np.flatnonzero(focus.shown[tracks])
    box, class_id = run.rollout.track_box[rows, :2].astype(np.float64), run.rollout.track_class[rows]
    seen = run.scene.detections.rows(t)
    detected, seen_class = run.scene.detections.box[seen, :2], run.scene.detections.class_id[seen]
    distance = np.hypot(*np.moveaxis(box[:, None] - detected[None], -1, 0))
    moved = np.nan_to_num(np.hypot(*(box - _expected(focus, rows, t)).T))
    near = SMOOTHED * np.append(run.card.per_class(run.card.task.forecast_gate), focus.gate)[class_id]
    fits = (class_id[:, None] == seen_class) | (class_id[:, None] < 0)
    i, j = np.nonzero(fits & (distance <= (near + moved)[:, None]))
    matched = match(Pairs(i, j, distance[i, j]), len(rows))[rows == row]
    return -1 if matched[0] < 0 else int(seen.start + matched[0])


def confusing(focus: Focus, t: int) -> int:
    """Row of the detection of another class at the object at frame ``t``, the nearest one; -1 without one."""
    table = focus.replay.scene.detections
    if focus.rows[t] < 0:
        return -1
    rows = np.arange(len(table.box))[table.rows(t)]
    rows = rows[table.class_id[rows] != focus.at.class_id]
    return _nearest(focus, table.box[rows, :2], t, rows)


def mistaken(focus: Focus, t: int) -> int:
    """Row of the true object of another class at a false forecast at frame ``t``, the nearest one; -1 without one."""
    truth = focus.replay.scene.truth
    rows = np.arange(len(truth.box))[truth.rows(t)]
    rows = rows[truth.class_id[rows] != focus.at.class_id]
    return _nearest(focus, truth.box[rows, :2], t, rows)


def _nearest(focus: Focus, places: Floats, t: int, rows: Ints) -> int:
    """The row of ``rows`` [n] whose place in ``places`` [n, 2] is nearest to the object, -1 if none is in reach."""
    far = np.hypot(*(places - focus.place(t)).T)
    return int(rows[np.argmin(far)]) if (far <= reach(focus)).any() else -1


def says(focus: Focus, row: int) -> str:
    """Class and score of a detection: "pedestrian, .85"."""
    name = focus.replay.card.task.classes[focus.replay.scene.detections.class_id[row]].replace("_", " ")
    return f"{name}, {score(focus, row)}"


def score(focus: Focus, row: int) -> str:
    """Score of a detection, such as ".85"."""
    return share(float(focus.replay.scene.detections.score[row]))


def share(value: float) -> str:
    """A number below 1 in two digits, such as ".85"."""
    return f"{value:.2f}".removeprefix("0")


def overlap(focus: Focus, track_id: int, t: int) -> float:
    """IoU in 3D of the object and a track that is output at frame ``t``."""
    row, own = focus.track_rows(track_id)[t], focus.rows[t]
    return float(iou_3d(focus.replay.scene.truth.box[own], focus.replay.rollout.track_box[row].astype(np.float64)))


def distance(focus: Focus, t: int) -> float | None:
    """Distance of the object to the ego at frame ``t``, m; None without an ego."""
    run = focus.replay
    return float(np.hypot(*(focus.place(t) - run.scene.ego[t, :2]))) if run.card.has_ego else None


def visible(focus: Focus, t: int) -> float | None:
    """Share of the object in line of sight at frame ``t``, 0 to 1; None where the source does not state it."""
    shares, row = focus.replay.scene.visible, int(focus.rows[t])
    return None if shares is None or row < 0 else float(shares[row])


def went(focus: Focus, forecast: ObjectForecast) -> str:
    """The nearest sample beside what the object does."""
    t = forecast.frame
    future, past = focus.future(t), focus.path(t, t - round(focus.replay.card.task.rate))
    path = forecast.nearest_path[: len(future)]
    true, way = future[-1] - future[0], path[-1] - path[0]
    start = (past[0] - past[-1]) * (len(future) - 1) / (len(past) - 1) if len(past) > 1 else true  # at its speed now
    far, length, fast = (float(np.hypot(*each)) for each in (true, way, start))
    turned, turns = (_turn(each, start if fast > STILL else true) for each in (true, way))
    cases = (
        (far < STILL and length < STILL, "stands still like it"),
        (far < STILL, "moves off while it stands" if fast < STILL else "goes on while it stops"),
        (length < max(STILL, 0.2 * far), "stands still while it moves"),
        (abs(wrap_angle(turns - turned)) > BACK, "goes back"),
        (abs(wrap_angle(turns - turned)) > ASIDE, _beside(turns, turned)),
        (length < SHORT * far, "falls short" if far < LONG * fast else "keeps its speed while it speeds up"),
        (length > LONG * far, "goes too far" if far > SHORT * fast else "keeps its speed while it brakes"),
        (True, "goes the right way"),
    )
    text = next(text for applies, text in cases if applies)
    return f"{text} and ends {np.hypot(*(path[-1] - future[-1])):.1f} m off"


def _turn(way: Floats, start: Floats) -> float:
    """Angle from ``start`` to ``way``, rad, to the left above 0."""
    return float(wrap_angle(np.arctan2(way[1], way[0]) - np.arctan2(start[1], start[0])))


def _beside(turns: float, turned: float) -> str:
    """Turn of a forecast beside that of the object, both in rad."""
    own, true = (
        "turns left" if a > ASIDE / 2 else "turns right" if a < -ASIDE / 2 else "goes straight" for a in (turns, turned)
    )
    return f"{own} while it {true}" if own != true else f"{own} too {'far' if abs(turns) > abs(turned) else 'little'}"
