"""An event in one sentence: time, object, tracks, and the forecast with its error.

The terminal, pictures, videos and recordings show the same sentence.
"""

import numpy as np

from ..geometry import wrap_angle
from ..types import Floats
from .focus import Focus, ObjectForecast
from .replay import MOMENT
from .terminal.output import counted

STILL = 1.0  # m, within the horizon: an object that moves less stands still
SHORT, LONG = 0.75, 1.33  # shares of the true distance between which the speed is right
ASIDE, BACK = np.deg2rad(25.0), np.deg2rad(120.0)


def sentence(focus: Focus) -> str:
    """The sentence, with the name of the event before it."""
    at, when = focus.at, f"at {focus.seconds(focus.at.frame):.1f} s"
    if at.object_id < 0:
        missing = f"{when} there is no false forecast of a {focus.noun}"
        return f"{at.name}: {_spurious(focus) if at.kind == 'spurious' else missing}"
    happened = {"ids": _switched, "lost": _lost, "reacquired": _found, MOMENT: _kept}[at.kind](focus)
    return f"{at.name}: {when} {focus.named} {happened}; {_error(focus)}"


def _switched(focus: Focus) -> str:
    left = {
        "other": "and track {} goes to {}", "away": "while track {} stays {} away", "ends": "and track {} ends",
    }  # fmt: skip
    fate, detail = _old_track(focus)
    return f"changes from track {focus.at.old_id} to {_taker(focus)}, {left[fate].format(focus.at.old_id, detail)}"


def _lost(focus: Focus) -> str:
    left = {"other": "which goes to {}", "away": "whose box is {} away", "ends": "which ends"}
    fate, detail = _old_track(focus)
    table, t = focus.replay.scene.detections, focus.at.frame
    rows = focus.detections(t)
    boxes = table.box[rows[table.class_id[rows] == focus.at.class_id]]
    detected = f"no {focus.noun} is detected within {focus.near:g} m"
    if len(boxes):
        detected = f"the nearest detection is {np.hypot(*(boxes[0, :2] - focus.place(t))):.1f} m away"
    return f"loses track {focus.at.old_id}, {left[fate].format(detail)}, and {detected}"


def _found(focus: Focus) -> str:
    at, away = focus.at, 0
    while at.frame - away > 0 and focus.follower(at.frame - away - 1) < 0:
        away += 1
    by = f"its old track {at.new_id}" if at.new_id == at.old_id else _taker(focus)
    return f"is found again after {counted(away, 'frame')} by {by}"


def _kept(focus: Focus) -> str:
    at = focus.at
    if at.new_id < 0:
        return "is followed by no track"
    stays = at.frame > 0 and focus.follower(at.frame - 1) == at.new_id
    return f"{'stays with' if stays else 'is followed by'} track {at.new_id}"


def _taker(focus: Focus) -> str:
    """Origin of the track that has the object now."""
    track = focus.at.new_id
    followed = focus.followed(track, focus.at.frame)
    objects = np.flatnonzero(followed >= 0)
    if not len(followed):
        return f"the new track {track}"
    if not len(objects):
        return f"track {track} ({counted(len(followed), 'frame')} old, of no object before)"
    when = f"until {objects[0] + 1} frames before" if objects[0] else "before"
    return f"track {track}, which followed {focus.name_of(int(followed[objects[0]]))} {when}"


def _old_track(focus: Focus) -> tuple[str, str]:
    """Fate of the track that had the object before: "other" and its object, "away" and how far, or "ends"."""
    t, old = focus.at.frame, focus.at.old_id
    row, other = focus.track_rows(old)[t], focus.other(old, t)
    if other >= 0:
        return "other", focus.name_of(other)
    if row < 0:
        return "ends", ""
    return "away", f"{np.hypot(*(focus.replay.rollout.track_box[row, :2] - focus.place(t))):.1f} m"


def _spurious(focus: Focus) -> str:
    at = focus.at
    owner = f"track {at.new_id}" if at.new_id >= 0 else "a forecast without a track"
    when = f"from {focus.seconds(at.frame):.1f} s to {focus.seconds(at.until):.1f} s"
    confidence = "" if at.confidence is None else f"; confidence up to {at.confidence:.2f}"
    return f"{when} {owner} forecasts a {focus.noun} {_surplus(focus)}{confidence}"


def _surplus(focus: Focus) -> str:
    """Reason why a forecast is false: the object within its gate has another one, or there is no object."""
    at, truth = focus.at, focus.replay.scene.truth
    rows = truth.rows(at.frame)
    same = rows.start + np.flatnonzero(truth.class_id[rows] == at.class_id)
    if not len(same):
        return "far from true ones: the scene has none"
    far = np.hypot(*(truth.box[same, :2] - np.array(at.position[:2])).T)
    nearest = int(np.argmin(far))
    if far[nearest] <= focus.gate:
        return f"a second time: {focus.name_of(int(same[nearest]))}, {far[nearest]:.1f} m away, has its forecast"
    return f"far from true ones: the nearest is {far[nearest]:.1f} m away"


def _error(focus: Focus) -> str:
    """The forecast of that frame, and its error."""
    at = focus.at
    if at.error is None:
        return "no error is counted, as it is not a target then"
    forecast = focus.forecast(at.frame)
    before = "" if at.error_before is None else f" (the frame before: {at.error_before:.1f} m)"
    if at.minADE is None or forecast is None:
        return f"it has no forecast, which costs {at.error:.1f} m{before}"
    samples = len(forecast.path)
    which = f"the nearest of {samples} samples" if samples > 1 else "its forecast"
    return f"{which} {went(forecast, focus.future(at.frame))}, which costs {at.error:.1f} m{before}"


def went(forecast: ObjectForecast, future: Floats) -> str:
    """The nearest sample compared with the true ``future`` [n, 2], which begins with the present place."""
    path = forecast.nearest_path[: len(future)]
    true, predicted = future[-1] - future[0], path[-1] - path[0]
    far, way = float(np.hypot(*true)), float(np.hypot(*predicted))
    turn = float(wrap_angle(np.arctan2(predicted[1], predicted[0]) - np.arctan2(true[1], true[0])))
    cases = (
        (far < STILL and way < STILL, "stands still like the object"),
        (far < STILL, "moves off though the object stands,"),
        (way < max(STILL, 0.2 * far), "stands still"),
        (abs(turn) > BACK, "goes back"),
        (turn > ASIDE, "turns off to the left"),
        (turn < -ASIDE, "turns off to the right"),
        (way < SHORT * far, "falls short"),
        (way > LONG * far, "goes too far"),
        (True, "goes the right way"),
    )
    went = next(text for applies, text in cases if applies)
    return f"{went} and ends {np.hypot(*(path[-1] - future[-1])):.1f} m from the true place"
