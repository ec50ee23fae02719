"""Evidence around an event that an agent does not state; metres, frame of the scene, rows of the tables of the run."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..core import Detections, Floats, Ints, Truth, to_metres, wrap_angle
from ..scoring import SURE, Pairs, fault_of, match, pieces
from .focus import Focus, ObjectForecast
from .incident import MOMENT
from .moment_list import borrowed
from .plan import collision_cause
from .run_replay import Replay

STILL = 1.0  # m, within the horizon: an object that moves less stands still
TINY = 0.1  # m: a forecast that begins nearer begins at the object
SHORT, LONG = 0.75, 1.33  # shares of a distance between which it is the same
ASIDE, BACK = np.deg2rad(12.0), np.deg2rad(120.0)
SMOOTHED = 0.25  # share of the forecast gate that a track's box may lie beside its detection without having moved


@dataclass(frozen=True)
class Gate:
    """Rule by which the scorer lets a track follow the object: least IoU in 3D, or greatest distance of the centres."""

    iou: bool
    threshold: float  # IoU, or m

    @property
    def text(self) -> str:
        """The rule in words."""
        return (
            f"an IoU of {self.threshold:g}"
            if self.iou
            else f"within {self.threshold:g} m"
        )


def gate(focus: Focus) -> Gate:
    """Event gate of the object's class."""
    rule, card = focus.replay.card.task.event_gate, focus.replay.card
    return Gate(
        rule.measure == "iou_3d",
        float(card.per_class(rule.threshold)[focus.at.class_id]),
    )


def reach(focus: Focus) -> float:
    """Distance within which a box lies at the object, m: its forecast gate, or its event gate if that is larger."""
    rule = gate(focus)
    return focus.gate if rule.iou else max(focus.gate, rule.threshold)


def expected(focus: Focus, track_id: int, t: int) -> Floats | None:
    """Place [2] where a track was expected at frame ``t`` by its own forecast of the frame before.

    It is the first step of the heaviest sample; without a forecast the last two boxes go on at constant velocity. None
    for a track that was not there in the frame before, and after a hole in time.
    """
    run, rows = focus.replay, focus.track_rows(track_id)
    if (
        t == 0
        or min(rows[t], rows[t - 1]) < 0
        or np.diff(pieces(run.scene, run.card)[t - 1 : t + 1]) > 0
    ):
        return None
    objects = run.rollout.objects.rows(t - 1)
    own = (
        objects.start
        + np.flatnonzero(run.answers.object_track[objects] == rows[t - 1])[:1]
    )
    for row in own.tolist():
        sample = int(np.argmax(run.rollout.forecast_log_weight[row]))
        return np.asarray(
            run.rollout.object_box[row, :2]
            + to_metres(run.rollout.forecast[row, sample, 0])
        )
    way = trail(focus, track_id, t - 1, 2)
    return np.asarray(2 * way[-1] - way[0])


def trail(focus: Focus, track_id: int, t: int, frames: int) -> Floats:
    """Places [n, 2] of a track in the last ``frames`` frames until ``t``, now last; empty if it is not output."""
    rows = focus.until_gap(focus.track_rows(track_id), t, t - frames + 1)[::-1]
    return focus.replay.rollout.track_box[rows, :2].astype(np.float64)


def near_detections(focus: Focus, t: int) -> Ints:
    """Rows of the detections within ``near`` metres of the object at frame ``t``, the nearest first."""
    first, box = (
        focus.replay.scene.detections.start[t],
        focus.replay.scene.detections.box,
    )
    far = np.hypot(*(box[focus.replay.scene.detections.rows(t), :2] - focus.place(t)).T)
    return np.asarray(
        first + np.argsort(far, kind="stable")[: (far <= focus.near).sum()]
    )


def detection(focus: Focus, t: int) -> tuple[int, float]:
    """Row of the detection of the object at frame ``t``, else of the nearest of its class, or -1; its distance, m."""
    rows, seen = near_detections(focus, t), focus.replay.scene.detections
    rows = rows[seen.class_id[rows] == focus.at.class_id]
    row = min(
        rows.tolist(),
        key=lambda row: focus.replay.detected[row] != focus.at.object_id,
        default=-1,
    )
    return row, away(focus, seen.box[row]) if row >= 0 else np.inf


def detected_until(focus: Focus, t: int) -> tuple[int, int]:
    """First frame of the object since the last hole in time, and its last one until ``t`` with a detection, or -1."""
    run, piece = focus.replay, pieces(focus.replay.scene, focus.replay.card)
    there = run.scene.truth.frame_of_rows[
        run.scene.truth.object_id == focus.at.object_id
    ]
    first = int(there[piece[there] == piece[t]][0])
    seen = run.scene.detections.frame_of_rows[run.detected == focus.at.object_id]
    return first, int(np.append(-1, seen[(seen >= first) & (seen <= t)])[-1])


def taken(focus: Focus, track_id: int, t: int) -> int:
    """Row of the detection that a track took at frame ``t``, -1 for none: it coasts.

    The tracks of the hypothesis are matched with detections one-to-one. A filter moves a track from its expected place
    towards its detection and stops short of it: the detection lies about as near to the box as the box has moved.
    """
    row, run = int(focus.track_rows(track_id)[t]), focus.replay
    detection = (
        -1
        if row < 0
        else _nearest(run, t, int(focus.hypothesis[t]), focus.near).get(row, -1)
    )
    if detection < 0:
        return -1
    place, box = (
        expected(focus, track_id, t),
        run.rollout.track_box[row, :2].astype(np.float64),
    )
    moved = 0.0 if place is None else float(np.hypot(*(box - place)))
    gap = float(np.hypot(*(box - run.scene.detections.box[detection, :2])))
    return detection if gap <= SMOOTHED * focus.gate + moved else -1


@lru_cache(maxsize=64)  # lists ask for all tracks of a frame, one after the other
def _nearest(run: Replay, t: int, hypothesis: int, near: float) -> dict[int, int]:
    """The detection matched to each track of a hypothesis in frame ``t``, at most ``near`` metres away, by rows."""
    table, rollout = run.scene.detections, run.rollout
    tracks, seen = (
        np.arange(each.start[t], each.start[t + 1]) for each in (rollout.tracks, table)
    )
    tracks = tracks[run.answers.hypotheses.member[tracks, hypothesis]]
    class_id = rollout.track_class[tracks]
    gap = np.hypot(
        *np.moveaxis(
            rollout.track_box[tracks, None, :2].astype(np.float64)
            - table.box[seen, :2],
            -1,
            0,
        )
    )
    i, j = np.nonzero(
        ((class_id[:, None] == table.class_id[seen]) | (class_id[:, None] < 0))
        & (gap <= near)
    )
    matched = match(Pairs(i, j, gap[i, j]), len(tracks))
    return dict(
        zip(
            tracks[matched >= 0].tolist(),
            seen[matched[matched >= 0]].tolist(),
            strict=True,
        )
    )


def confusing(focus: Focus, t: int, true: bool = False) -> int:
    """Row of the nearest detection of another class at the object at frame ``t``, -1 without one.

    ``true``: of the nearest true object of another class, at a false forecast.
    """
    table: Truth | Detections = (
        focus.replay.scene.truth if true else focus.replay.scene.detections
    )
    rows = table.start[t] + np.flatnonzero(
        table.class_id[table.rows(t)] != focus.at.class_id
    )
    far = np.hypot(*(table.box[rows, :2] - focus.place(t)).T)
    there = true or focus.rows[t] >= 0
    return int(rows[np.argmin(far)]) if there and (far <= reach(focus)).any() else -1


def owner_of(focus: Focus, detection: int, t: int) -> int:
    """Row of the true box, other than the object, that a detection of frame ``t`` is matched to, -1 without one."""
    truth, object_id = focus.replay.scene.truth, focus.replay.detected[detection]
    same = (truth.object_id[truth.rows(t)] == object_id) & (
        object_id not in (-1, focus.at.object_id)
    )
    return int(np.append(truth.start[t] + np.flatnonzero(same), -1)[0])


def says(focus: Focus, row: int) -> str:
    """Class and score of a detection: "pedestrian .85"."""
    table, classes = focus.replay.scene.detections, focus.replay.card.task.classes
    return f"{classes[table.class_id[row]].replace('_', ' ')} {share(table.score[row])}"


def share(value: float, digits: int = 2) -> str:
    """A number of at most 1 without its zero, such as ".85"."""
    return f"{value:.{digits}f}".replace("0.", ".", int(abs(value) < 1))


def left_out(focus: Focus, t: int) -> str:
    """Return why budgets leave out the forecast of the object at frame ``t``: its confidence, and what decides.

    A forecast that is surer than not is left out because others fill the budgets, others because they are not sure.
    """
    confidence = float(focus.replay.worth[focus.rows[t], 1])
    text = f"of confidence {share(confidence, 3)} is left out at"
    if focus.replay.thresholds is None:
        return f"{text} some budgets"
    above = focus.replay.thresholds[focus.replay.thresholds > confidence]
    least = float(above.min(initial=np.inf))
    if np.isinf(least):
        why = "they keep none as sure"
    elif confidence < SURE:
        why = f"they keep {share(least, 3)} and more"
    else:
        others = (
            "false forecasts"
            if focus.replay.scene.truth_complete
            else "other forecasts"
        )
        why = f"{others} fill them down to {share(least, 3)}"
    return f"{text} {len(above)} of {len(focus.replay.thresholds)} budgets, as {why}"


def away(focus: Focus, place: Floats) -> float:
    """Distance of the ``place`` [2 or more] from the object in the event's frame, m."""
    return float(np.hypot(*(place[:2] - focus.place(focus.at.frame))))


def track_away(focus: Focus, track: int) -> float:
    """Distance of a track that is output then from the object in the event's frame, m."""
    return away(
        focus, focus.replay.rollout.track_box[focus.track_rows(track)[focus.at.frame]]
    )


def metres(focus: Focus, far: float) -> str:
    """A distance in one digit, or in two where one would hide on which side of a gate it lies."""
    gates = {f"{each:.1f}" for each in (focus.gate, reach(focus))}
    return f"{far:.2f} m" if f"{far:.1f}" in gates else f"{far:.1f} m"


def ghost(focus: Focus, detection: int) -> str:
    """Name of the run of false forecasts of a detection of another class, in brackets; empty without one."""
    run, t, class_id = (
        focus.replay,
        focus.at.frame,
        focus.replay.scene.detections.class_id[detection],
    )
    runs = (
        each
        for each in run.incidents
        if each.kind == "spurious" and each.frame <= t <= each.until
    )
    there = (
        each
        for each in runs
        if each.class_id == class_id and focus.track_rows(each.new_id)[t] >= 0
    )
    return next(
        (
            f" ({each.name})"
            for each in there
            if track_away(focus, each.new_id) <= reach(focus)
        ),
        "",
    )


def distance(focus: Focus, t: int) -> float | None:
    """Distance of the object to the ego at frame ``t``, m; None without an ego."""
    run = focus.replay
    return (
        float(np.hypot(*(focus.place(t) - run.scene.ego[t, :2])))
        if run.card.has_ego
        else None
    )


def visible(focus: Focus, t: int, last: int = -1) -> float | None:
    """Mean share of the object in line of sight at frame ``t``, or until ``last``; None where it is not stated."""
    shares, rows = focus.replay.scene.visible, focus.rows[t : max(t, last) + 1]
    return (
        None
        if shares is None or (rows < 0).all()
        else float(shares[rows[rows >= 0]].mean())
    )


def went(focus: Focus, forecast: ObjectForecast) -> str:
    """The nearest sample beside what the object does."""
    t = forecast.frame
    future, past = (
        focus.future(t),
        focus.path(t, t - round(focus.replay.card.task.rate)),
    )
    path = forecast.nearest_path[: len(future)]
    true, way = future[-1] - future[0], path[-1] - path[0]
    start = (
        (past[0] - past[-1]) * (len(future) - 1) / (len(past) - 1)
        if len(past) > 1
        else true
    )  # at its speed now
    begins, ends = path[0] - future[0], path[-1] - future[-1]
    far, length, fast, near, off = (
        float(np.hypot(*each)) for each in (true, way, start, begins, ends)
    )
    beside, left = (
        near > max(off / 2, TINY),
        float(true[0] * ends[1] - true[1] * ends[0]) / max(far, STILL),
    )
    ahead = np.arctan2(*(start if fast > STILL else true)[::-1])
    turned, turns = (
        float(wrap_angle(np.arctan2(*each[::-1]) - ahead)) for each in (true, way)
    )  # to the left above 0
    keeps, more = (
        SHORT * fast < length < LONG * fast,
        "far" if abs(turns) > abs(turned) else "little",
    )
    bent, own = (
        "goes straight"
        if abs(a) < ASIDE / 2
        else f"turns {'left' if a > 0 else 'right'}"
        for a in (turned, turns)
    )
    cases = (
        (
            far < STILL and length < STILL,
            f"stands still {'beside' if beside else 'like'} it",
        ),
        (
            far < STILL,
            "moves off while it stands" if fast < STILL else "goes on while it stops",
        ),
        (length < max(STILL, 0.2 * far), "stands still while it moves"),
        (abs(wrap_angle(turns - turned)) > BACK, "goes back"),
        (
            abs(wrap_angle(turns - turned)) > ASIDE,
            f"{own} too {more}" if own == bent else f"{own} while it {bent}",
        ),
        (
            length < SHORT * far,
            "keeps its speed while it speeds up" if keeps else "falls short",
        ),
        (
            length > LONG * far,
            "keeps its speed while it brakes" if keeps else "goes too far",
        ),
        (beside, f"begins {near:.1f} m beside it"),
        (abs(left) > far / 4, f"goes too far {'left' if left > 0 else 'right'}"),
        (True, "goes the right way"),
    )
    return (
        f"{next(text for applies, text in cases if applies)} and ends {off:.1f} m off"
    )


def _fault(focus: Focus) -> str:
    """Return the part of the stack at fault for the error of an object, and its cause."""
    at = focus.at
    if at.parts is None:
        return "not a target"
    if at.parts and borrowed(focus.replay)[at.row]:
        return "detector: only other objects are detected there"
    fault = fault_of(at.parts) or "no error"
    sure = at.confidence is not None and at.confidence >= SURE
    return (
        "budgets: filled by other forecasts"
        if sure and fault.startswith("confidence")
        else fault
    )


def verdict(focus: Focus) -> str:
    """The part of the stack at fault and its cause: "detector: other class"."""
    at, t = focus.at, focus.at.frame
    if at.kind == "collision":
        return collision_cause(focus).partition(":")[0]
    if at.object_id >= 0:
        return _fault(focus)
    if at.kind == MOMENT:
        return "no false forecast"
    if confusing(focus, t, true=True) >= 0:
        return "detector: other class"
    if focus.doubled >= 0:
        return "tracker: second forecast"
    return (
        "detector: false detection"
        if taken(focus, at.new_id, t) >= 0
        else "tracker: goes on without a detection"
    )
