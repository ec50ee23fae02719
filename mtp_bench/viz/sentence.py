"""An event in one sentence: time, object, tracks, and the forecast with its error.

The terminal, pictures, videos and recordings show the same sentence.
"""

from __future__ import annotations

import numpy as np

from ..geometry import wrap_angle
from ..types import Floats
from .case import Case, ObjectForecast
from .replay import NO_EVENT
from .terminal.output import counted

STILL = 1.0  # m, within the horizon: an object that moves less stands still
SHORT, LONG = 0.75, 1.33  # shares of the true distance between which the speed is right
ASIDE, BACK = np.deg2rad(25.0), np.deg2rad(120.0)


def sentence(case: Case) -> str:
    """The sentence, with the name of the event before it."""
    at = case.at
    if at.object_id < 0:
        return f"{at.name}: {(_spurious if at.kind == 'spurious' else _nothing_there)(case)}"
    happened = {"ids": _switched, "lost": _lost, "reacquired": _found, NO_EVENT: _followed}[at.kind](case)
    return f"{at.name}: {happened}; {_worth(case)}"


def _object(case: Case) -> str:
    return f"at {case.seconds(case.at.frame):.1f} s {case.noun} {case.at.object_id}"


def _switched(case: Case) -> str:
    at = case.at
    return f"{_object(case)} changes from track {at.old_id} to {_taker(case)}{_left(case)}"


def _taker(case: Case) -> str:
    """Origin of the track that has the object now."""
    at = case.at
    before = case.age(at.new_id, at.frame)
    if before == 0:
        return f"the new track {at.new_id}"
    found = case.last_followed(at.new_id, at.frame)
    if found is None:
        return f"track {at.new_id} ({counted(before, 'frame')} old, of no object before)"
    ago, row = found
    did = (
        f"followed {case.name_of(row)} before"
        if ago == 1
        else f"followed {case.name_of(row)} until {ago} frames before"
    )
    return f"track {at.new_id}, which {did}"


def _left(case: Case) -> str:
    """Fate of the track that had the object before."""
    at = case.at
    row, other = case.track_row(at.old_id, at.frame), case.followed(at.old_id, at.frame)
    if row < 0:
        return f", and track {at.old_id} ends"
    if other >= 0:
        return f", and track {at.old_id} goes to {case.name_of(other)}"
    return f", while track {at.old_id} stays {_away(case, row):.1f} m away"


def _lost(case: Case) -> str:
    at = case.at
    row, other = case.track_row(at.old_id, at.frame), case.followed(at.old_id, at.frame)
    if other >= 0:
        why = f"which goes to {case.name_of(other)}"
    elif row >= 0:
        why = f"whose box is {_away(case, row):.1f} m away"
    else:
        why = "which ends"
    return f"{_object(case)} loses track {at.old_id}, {why}, and {_seen(case)}"


def _seen(case: Case) -> str:
    """The nearest detection of its class."""
    found = case.detections(case.at.frame)
    found = found[case.replay.scene.detections.class_id[found] == case.at.class_id]
    if not len(found):
        return f"no {case.noun} is detected within {case.near:g} m"
    box = case.replay.scene.detections.box[found[0]]
    return f"the nearest detection is {float(np.hypot(*(box[:2] - case.place(case.at.frame)))):.1f} m away"


def _found(case: Case) -> str:
    at, away = case.at, 0
    while at.frame - away > 0 and case.follower(at.frame - away - 1) < 0:
        away += 1
    by = f"its old track {at.new_id}" if at.new_id == at.old_id else _taker(case)
    return f"{_object(case)} is found again after {counted(away, 'frame')} by {by}"


def _spurious(case: Case) -> str:
    at = case.at
    owner = f"track {at.new_id}" if at.new_id >= 0 else "a forecast without a track"
    when = f"from {case.seconds(at.frame):.1f} s to {case.seconds(at.until):.1f} s"
    sure = "" if at.confidence is None else f"; confidence up to {at.confidence:.2f}"
    return f"{when} {owner} forecasts a {case.noun} {_surplus(case)}{sure}"


def _surplus(case: Case) -> str:
    """Reason why a forecast is false: the object within its gate has another one, or there is no object."""
    at, truth, card = case.at, case.replay.scene.truth, case.replay.card
    rows = truth.rows(at.frame)
    same = rows.start + np.flatnonzero(truth.class_id[rows] == at.class_id)
    if not len(same):
        return "far from true ones: the scene has none"
    far = np.hypot(*(truth.box[same, :2] - np.array(at.position[:2])).T)
    nearest = int(np.argmin(far))
    if far[nearest] <= card.per_class(card.task.forecast_gate)[at.class_id]:
        return f"a second time: {case.name_of(int(same[nearest]))}, {far[nearest]:.1f} m away, has its forecast"
    return f"far from true ones: the nearest is {far[nearest]:.1f} m away"


def _nothing_there(case: Case) -> str:
    return f"at {case.seconds(case.at.frame):.1f} s there is no false forecast of a {case.noun}"


def _followed(case: Case) -> str:
    at = case.at
    if at.new_id < 0:
        return f"{_object(case)} is followed by no track"
    stays = at.frame > 0 and case.follower(at.frame - 1) == at.new_id
    return f"{_object(case)} {'stays with' if stays else 'is followed by'} track {at.new_id}"


def _worth(case: Case) -> str:
    """The forecast of that frame, and its error."""
    at = case.at
    if at.error is None:
        return "no error is counted, as it is not a target then"
    forecast = case.forecast(at.frame)
    before = "" if at.error_before is None else f" (the frame before: {at.error_before:.1f} m)"
    if at.minADE is None or forecast is None:
        return f"it has no forecast, which costs {at.error:.1f} m{before}"
    samples = len(forecast.path)
    which = f"the nearest of {samples} samples" if samples > 1 else "its forecast"
    return f"{which} {went(forecast, case.future(at.frame))}, which costs {at.error:.1f} m{before}"


def went(forecast: ObjectForecast, future: Floats) -> str:
    """The nearest sample compared with the true ``future`` [n, 2], which begins with the present place."""
    path = forecast.nearest_path[: len(future)]
    true, said = future[-1] - future[0], path[-1] - path[0]
    far, way = float(np.hypot(*true)), float(np.hypot(*said))
    turn = float(wrap_angle(np.arctan2(said[1], said[0]) - np.arctan2(true[1], true[0])))
    end = f"ends {float(np.hypot(*(path[-1] - future[-1]))):.1f} m from the true place"
    if far < STILL:
        return (
            "stands still like the object" if way < STILL else "moves off though the object stands,"
        ) + f" and {end}"
    if way < max(STILL, 0.2 * far):
        return f"stands still and {end}"
    if abs(turn) > BACK:
        return f"goes back and {end}"
    if abs(turn) > ASIDE:
        return f"turns off to the {'left' if turn > 0 else 'right'} and {end}"
    if way < SHORT * far:
        return f"falls short and {end}"
    return f"{'goes too far' if way > LONG * far else 'goes the right way'} and {end}"


def _away(case: Case, row: int) -> float:
    """Metres from a track to the object."""
    return float(np.hypot(*(case.replay.rollout.track_box[row, :2] - case.place(case.at.frame))))
