"""An event or a moment in at most three short sentences: what happened, the evidence, and what it costs.

The terminal, pictures, videos and recordings show the same sentences.
"""

from collections.abc import Iterator

import numpy as np

from ..geometry import wrap_angle
from ..scoring.parts import BELOW, parts_text
from ..types import Floats
from . import evidence
from .focus import Focus, ObjectForecast
from .replay import MOMENT
from .terminal.output import counted

WORDS = 25  # of a sentence; of the last one without the parts
STILL = 1.0  # m, within the horizon: an object that moves less stands still
SHORT, LONG = 0.75, 1.33  # shares of a distance between which it is the same
ASIDE, BACK = np.deg2rad(25.0), np.deg2rad(120.0)
HIDDEN = 0.5  # share of an object in line of sight below which it is worth telling


def sentence(focus: Focus) -> str:
    """The sentences, with the name of the event before them."""
    at = focus.at
    if at.object_id < 0:
        texts = list(_false_forecast(focus))
    else:
        happened = {"ids": _switched, "lost": _lost, "reacquired": _found, MOMENT: _followed}[at.kind](focus)
        texts = [f"{_when(focus)} {focus.named} {happened}", _fitting(_evidence(focus)), _error(focus)]
    return f"{at.name}: " + ". ".join(
        text if text is texts[0] else text[0].upper() + text[1:] for text in texts if text
    )


def _when(focus: Focus) -> str:
    at = focus.at
    span = f" (bad {focus.seconds(at.first):.1f} to {_time(focus, at.until)})" if 0 <= at.first < at.until else ""
    return f"at {_time(focus, at.frame)}{span}"


def _time(focus: Focus, t: int) -> str:
    return f"{focus.seconds(t):.1f} s"


def _fitting(clauses: Iterator[str]) -> str:
    """The first clauses, as many as a sentence may have words."""
    text = ""
    for clause in clauses:
        longer = f"{text}; {clause}" if text else clause
        text = longer if len(longer.split()) <= WORDS else text
    return text


# ---- what happened


def _switched(focus: Focus) -> str:
    at, other = focus.at, _swapped(focus)
    if other >= 0:
        return f"swaps tracks with {_named(focus, other)}: it had track {at.old_id} and has track {at.new_id}"
    return f"changes from track {at.old_id} to {_taker(focus, at.new_id, at.frame)}"


def _swapped(focus: Focus) -> int:
    """True box of the object whose track it has and that has its old one, -1 without one."""
    at, objects = focus.at, focus.replay.scene.truth.object_id
    other, before = focus.other(at.old_id, at.frame), focus.followed(at.new_id, at.frame)[:1]
    swapped = at.kind == "ids" and other >= 0 and (before >= 0).any() and objects[before[0]] == objects[other]
    return other if swapped else -1


def _lost(focus: Focus) -> str:
    again = focus.regained
    text = f"loses track {focus.at.old_id}"
    if again < 0:
        return f"{text} for good"
    track, event = focus.follower(again), _event(focus, focus.at.object_id, again)
    text += f" for {focus.seconds(again) - focus.seconds(focus.at.frame):.1f} s"
    if track == focus.at.old_id:
        return f"{text} until it has it again{event}"
    return f"{text}, then {_taker(focus, track, again, short=True)} takes it{event}"


def _found(focus: Focus) -> str:
    at, before = focus.at, focus.followers(focus.at.frame, 0)[1:]
    away = int(np.argmax(before >= 0))
    lost = at.frame - away
    by = f"its old track {at.new_id}" if at.new_id == at.old_id else _taker(focus, at.new_id, at.frame)
    seconds = focus.seconds(at.frame) - focus.seconds(lost)
    return f"is found again after {seconds:.1f} s{_event(focus, at.object_id, lost)} by {by}"


def _followed(focus: Focus) -> str:
    tracks, again = focus.followers(focus.at.frame, 0), focus.regained
    same = (tracks >= 0) == (tracks[0] >= 0) if tracks[0] < 0 else tracks == tracks[0]
    frames = int(np.argmin(np.append(same, False)))  # with this track, or without one
    since, always = focus.at.frame - frames + 1, frames == len(tracks)
    if tracks[0] >= 0:
        taker = _taker(focus, int(tracks[0]), since)
        return (
            f"has track {tracks[0]} from its first frame on" if always else f"has {taker} since {_time(focus, since)}"
        )
    text = "has had no track so far" if always else f"has no track since {_time(focus, since)}"
    return (
        f"{text}, then track {focus.follower(again)} from {_time(focus, again)} on"
        if again >= 0
        else f"{text} and gets none"
    )


def _taker(focus: Focus, track: int, t: int, short: bool = False) -> str:
    """A track that has the object from frame ``t`` on, and what it had before."""
    followed = focus.followed(track, t)
    objects = np.flatnonzero(followed >= 0)
    if not len(followed) or short:
        return f"the new track {track}" if not len(followed) else f"track {track}"
    if not len(objects):
        return f"track {track} ({counted(len(followed), 'frame')} old, of no object before)"
    row = int(followed[objects[0]])
    if focus.replay.scene.truth.object_id[row] == focus.at.object_id:
        return f"its earlier track {track}"
    when = f"{focus.seconds(t - 1) - focus.seconds(t - 1 - objects[0]):.1f} s before" if objects[0] else "then"
    return f"track {track}, of {focus.name_of(row)} until {when}"


def _named(focus: Focus, row: int) -> str:
    """Name of the object of a true box, with the event that it has in that frame."""
    return focus.name_of(row) + _event(focus, int(focus.replay.scene.truth.object_id[row]), focus.at.frame)


def _event(focus: Focus, object_id: int, t: int) -> str:
    """Name of the event of an object in frame ``t``, in brackets after a blank; empty without one."""
    names = [event.name for event in focus.replay.events if (event.object_id, event.frame) == (object_id, t)]
    return f" ({names[0]})" if names else ""


# ---- the evidence


def _evidence(focus: Focus) -> Iterator[str]:
    at, t = focus.at, focus.at.frame
    followed, table, confused = focus.follower(t) >= 0, focus.replay.scene.detections, evidence.confusing(focus, t)
    near = focus.detections(t)
    own = near[table.class_id[near] == at.class_id][:1]
    far = float(np.hypot(*(table.box[own[0], :2] - focus.place(t)))) if len(own) else np.inf
    missed = far > evidence.reach(focus)
    if confused >= 0 and (missed or not followed):
        article = "the" if missed else "one"
        yield f"{article} detection there says {evidence.says(focus, confused)}{_ghost(focus, confused)}"
    if at.kind == "lost" or (at.kind == "ids" and _swapped(focus) < 0):
        yield _fate(focus)
    elif at.new_id >= 0 and (took := _took(focus, at.new_id)):
        yield f"track {at.new_id} {took}"
    elif at.new_id >= 0 and _away(focus, at.new_id) > evidence.reach(focus) / 2:
        yield f"track {at.new_id} is {_away(focus, at.new_id):.1f} m away"
    if missed and confused < 0 and not len(own):
        yield f"no {focus.noun} is detected within {focus.near:g} m"
    elif missed and len(own):
        yield f"the nearest detection is {far:.1f} m away"
    elif len(own) and not followed:
        yield f"it is detected {far:.1f} m away, score {evidence.score(focus, int(own[0]))}"
    seen, ego = evidence.visible(focus, t), evidence.distance(focus, t)
    hidden = seen is not None and seen < HIDDEN
    if ego is not None and (missed or hidden or not followed):
        yield f"it is {ego:.0f} m from the ego" + (f", {seen:.0%} visible" if hidden else "")


def _fate(focus: Focus) -> str:
    """Fate of the track that had the object before."""
    t, old = focus.at.frame, focus.at.old_id
    row, other, rule = int(focus.track_rows(old)[t]), focus.other(old, t), evidence.gate(focus)
    if row < 0:
        return f"track {old} ends"
    if other >= 0:
        text = f"track {old} goes to {_named(focus, other)}"
    elif rule.iou:
        text = f"track {old} has an IoU of {evidence.overlap(focus, old, t):.2f} with it, below {rule.threshold:g}"
    else:
        new = focus.at.new_id
        text = f"track {old} is {_away(focus, old):.1f} m away" + (
            f", track {new} {_away(focus, new):.1f} m" if new >= 0 else ""
        )
    took = _took(focus, old)
    return f"{text} and {took}" if took else text


def _away(focus: Focus, track: int) -> float:
    """Distance of a track that is output from the object, m."""
    box = focus.replay.rollout.track_box[focus.track_rows(track)[focus.at.frame], :2]
    return float(np.hypot(*(box - focus.place(focus.at.frame))))


def _took(focus: Focus, track: int) -> str:
    """The detection that a track took, where it is far from the expected place; empty where it is near."""
    t, place = focus.at.frame, evidence.expected(focus, track, focus.at.frame)
    row = evidence.taken(focus, track, t)
    if place is None or row < 0:
        return "" if place is None else "takes no detection"
    far = float(np.hypot(*(focus.replay.scene.detections.box[row, :2] - place)))
    return f"takes a detection {far:.1f} m from where its forecast put it" if far > evidence.reach(focus) else ""


def _ghost(focus: Focus, detection: int) -> str:
    """Name of the run of false forecasts of a detection of another class, in brackets; empty without one."""
    run, t = focus.replay, focus.at.frame
    for at in run.incidents:
        if (
            at.kind == "spurious"
            and at.frame <= t <= at.until
            and at.class_id == run.scene.detections.class_id[detection]
        ):
            row = int(focus.track_rows(at.new_id)[t])
            if row >= 0 and np.hypot(*(run.rollout.track_box[row, :2] - focus.place(t))) <= evidence.reach(focus):
                return f" ({at.name})"
    return ""


# ---- what it costs


def _error(focus: Focus) -> str:
    """The forecast of that frame, its error and the parts of it."""
    at = focus.at
    if at.parts is None or at.error is None:
        return "no error is counted, as it is not a target then"
    parts, forecast = parts_text(at.parts), focus.forecast(at.frame)
    cost = f"which costs {at.error:.1f} m" + (f": {parts}" if at.error >= 0.05 else "")
    if forecast is None:
        return f"it has no forecast, {cost}"
    if at.minADE is None:
        far = float(np.hypot(*(forecast.start - focus.place(at.frame))))
        return f"the forecast of its track begins {far:.1f} m away and does not count, {cost}"
    samples = len(forecast.path)
    which = f"the nearest of {samples} samples" if samples > 1 else "its forecast"
    if at.confidence is not None and at.parts.get(BELOW, 0.0) > at.blame:
        which += f" (confidence {evidence.share(at.confidence)})"
    return f"{which} {went(focus, forecast)}, {cost}"


def went(focus: Focus, forecast: ObjectForecast) -> str:
    """The nearest sample beside what the object does."""
    t = forecast.frame
    future, past = focus.future(t), focus.path(t, t - round(focus.replay.card.task.rate))
    path = forecast.nearest_path[: len(future)]
    true, way = future[-1] - future[0], path[-1] - path[0]
    far, length, steps = float(np.hypot(*true)), float(np.hypot(*way)), len(future) - 1
    start = (past[0] - past[-1]) * steps / (len(past) - 1) if len(past) > 1 else true  # at the speed of now
    fast = float(np.hypot(*start))
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
        "goes straight" if abs(a) < ASIDE / 2 else "turns left" if a > 0 else "turns right" for a in (turns, turned)
    )
    return f"{own} while it {true}" if own != true else f"{own} too {'far' if abs(turns) > abs(turned) else 'little'}"


# ---- false forecasts


def _false_forecast(focus: Focus) -> Iterator[str]:
    at = focus.at
    if at.kind != "spurious":
        yield f"{_when(focus)} there is no false forecast of a {focus.noun}"
        return
    owner = f"track {at.new_id}" if at.new_id >= 0 else "a forecast without a track"
    confidence = "" if at.confidence is None else f", confidence up to {evidence.share(at.confidence)}"
    when = f"from {_time(focus, at.frame)} to {_time(focus, at.until)}" if at.frame < at.until else _when(focus)
    yield f"{when} {owner} forecasts a {focus.noun}{confidence}"
    yield _fitting(_surplus(focus))


def _surplus(focus: Focus) -> Iterator[str]:
    """Reasons why a forecast is false: an object of another class, a second forecast of one object, or no object."""
    at, truth, t = focus.at, focus.replay.scene.truth, focus.at.frame
    other, rows = evidence.mistaken(focus, t), truth.rows(t)
    same = rows.start + np.flatnonzero(truth.class_id[rows] == at.class_id)
    far = np.hypot(*(truth.box[same, :2] - np.array(at.position[:2])).T)
    if other >= 0:
        away = float(np.hypot(*(truth.box[other, :2] - np.array(at.position[:2]))))
        yield f"the true {_named(focus, other)} is {away:.1f} m away, forecast as {focus.noun}"
    if (far <= focus.gate).any():
        nearest = int(same[np.argmin(far)])
        yield f"it is a second forecast of {focus.name_of(nearest)}, {far.min():.1f} m away"
    elif other < 0:
        text = f"the nearest is {far.min():.1f} m away" if len(far) else "the scene has none"
        yield f"no true {focus.noun} is within {focus.gate:g} m: {text}"
    row = evidence.taken(focus, at.new_id, t)
    if at.new_id >= 0:
        yield "it takes no detection" if row < 0 else f"its detection scores {evidence.score(focus, row)}"
