"""An event or a moment in at most three short sentences, everywhere the same: what happened, evidence and cost."""

import re
from collections.abc import Iterator, Mapping

import numpy as np

from ..geometry import iou_3d
from ..scoring.parts import BELOW, LEAST_SHOWN, PARTS, parts_text
from . import evidence
from .focus import Focus
from .replay import MOMENT
from .terminal.output import counted

WORDS = 25  # of a sentence; of the last one without the parts
HIDDEN = 0.75  # share of an object in line of sight below which texts state it


def sentence(focus: Focus) -> str:
    """The sentences, with the name of the event before them; those of a moment with an event are of the event."""
    at, run = focus.at, focus.replay
    own = [event for event in run.events if (event.object_id, event.frame) == (at.object_id, at.frame)]
    if at.kind == MOMENT and own:
        return f"{at.name}, {sentence(Focus(run, own[0]))}"
    if at.object_id < 0:
        texts = _false_forecast(focus)
    else:
        happened = {"ids": _switched, "lost": _lost, "reacquired": _found, MOMENT: _followed}[at.kind](focus)
        texts = [f"{_when(focus)} {focus.named} {happened}", _fitting(_evidence(focus)), _error(focus)]
    texts[1:] = [text[0].upper() + text[1:] for text in texts[1:] if text]
    return _with_ids_in_file(f"{at.name}: {'. '.join(texts)}", run.scene.track_names)


def _with_ids_in_file(text: str, names: Mapping[int, str]) -> str:
    """``text``, whose first mention of each stored track has its id in the file behind it; ``names``: by number."""
    for number in dict.fromkeys(re.findall(r"\btrack (\d+)\b", text)):
        if int(number) in names:
            before, track, after = re.split(rf"(\btrack {number}\b)", text, maxsplit=1)
            text = f"{before}{track} ({names[int(number)]} in its file){after}"
    return text


def _when(focus: Focus) -> str:
    at = focus.at
    span = f" (bad {focus.seconds(at.first):.1f} to {_time(focus, at.until)})" if 0 <= at.first < at.until else ""
    return f"at {_time(focus, at.frame)}{span}"


def _time(focus: Focus, t: int, since: int = 0) -> str:
    return f"{focus.seconds(t) - focus.seconds(since):.1f} s"


def _fitting(clauses: Iterator[str]) -> str:
    """The first clauses, as many as a sentence may have words."""
    text = ""
    for clause in clauses:
        longer = f"{text}; {clause}" if text else clause
        text = longer if len(longer.split()) <= WORDS else text
    return text


def _switched(focus: Focus) -> str:
    return f"changes from track {focus.at.old_id} to {_taker(focus, focus.at.new_id, focus.at.frame)}"


def _lost(focus: Focus) -> str:
    at, again = focus.at, focus.regained
    if again < 0:
        return f"loses track {at.old_id} for good"
    track = focus.follower(again)
    then = "until it has it again" if track == at.old_id else f"then {_taker(focus, track, again)} takes it"
    return f"loses track {at.old_id} for {_time(focus, again, at.frame)}, {then}{_event(focus, at.object_id, again)}"


def _found(focus: Focus) -> str:
    at = focus.at
    lost = at.frame - int(np.argmax(focus.followers(at.frame, 0)[1:] >= 0))
    by = f"its old track {at.new_id}" if at.new_id == at.old_id else _taker(focus, at.new_id, at.frame)
    return f"is found again after {_time(focus, at.frame, lost)}{_event(focus, at.object_id, lost)} by {by}"


def _followed(focus: Focus) -> str:
    tracks, again = focus.followers(focus.at.frame, 0), focus.regained
    frames = int(np.argmin(np.append(tracks == tracks[0], False)))  # with this track, or without one
    since, always = focus.at.frame - frames + 1, frames == len(tracks)
    if tracks[0] >= 0 and always:
        return f"is followed by track {tracks[0]} from its first frame on"
    if tracks[0] >= 0:
        return f"is followed since {_time(focus, since)} by {_taker(focus, int(tracks[0]), since)}"
    text = "has had no track so far" if always else f"has no track since {_time(focus, since)}"
    then = "and gets none" if again < 0 else f"then track {focus.follower(again)} from {_time(focus, again)} on"
    return f"{text}, {then}"


def _taker(focus: Focus, track: int, t: int) -> str:
    """A track that has the object from frame ``t`` on, and what it had before."""
    followed = focus.followed(track, t)
    objects = np.flatnonzero(followed >= 0)
    if not len(followed):
        return f"the new track {track}"
    if not len(objects):
        return f"track {track} ({counted(len(followed), 'frame')} old, of no object before)"
    row, frames = int(followed[objects[0]]), int(objects[0])
    if focus.replay.scene.truth.object_id[row] == focus.at.object_id:
        return f"its earlier track {track}"
    until = f"{_time(focus, t, t - frames)} before" if frames else "then"
    return f"track {track} (of {focus.name_of(row)} until {until})"


def _named(focus: Focus, row: int) -> str:
    """Name of the object of a true box, with its event."""
    return focus.name_of(row) + _event(focus, int(focus.replay.scene.truth.object_id[row]), focus.at.frame)


def _event(focus: Focus, object_id: int, t: int) -> str:
    """Name of the event of an object in frame ``t``, or of its loss during a run of false forecasts, in brackets."""
    last = focus.at.until if focus.at.kind == "spurious" else t
    own = (each for each in focus.replay.events if each.object_id == object_id and t <= each.frame <= last)
    return next((f" ({each.name})" for each in own if focus.at.object_id >= 0 or each.kind == "lost"), "")


def _evidence(focus: Focus) -> Iterator[str]:
    at, t, seen = focus.at, focus.at.frame, focus.replay.scene.detections
    followed, confused, own = at.new_id >= 0, evidence.confusing(focus, t), evidence.detection(focus, t)
    far = evidence.away(focus, seen.box[own]) if own >= 0 else np.inf
    missed = far > evidence.reach(focus)
    if confused >= 0 and (missed or not followed):
        whose = focus.name_of(evidence.owner_of(focus, confused, t))
        whose = f" (of {whose})" if whose else evidence.ghost(focus, confused)
        yield f"{'the' if missed else 'one'} detection there says {evidence.says(focus, confused)}{whose}"
    if at.kind in ("ids", "lost"):
        yield _fate(focus)
    elif followed and (took := _took(focus, at.new_id)):
        yield f"track {at.new_id} {took}"
    elif followed and (away := _metres(focus, at.new_id, evidence.reach(focus) / 2)):
        yield f"track {at.new_id} is {away} away"
    yield from _others(focus)
    nearest, taken = f"the nearest {focus.noun} detection", evidence.taken(focus, at.old_id, t)
    if own < 0 and confused < 0 and (taken < 0 or focus.replay.detected[taken] >= 0):
        yield f"no {focus.noun} is detected within {focus.near:g} m"
    elif own >= 0 and (missed or not followed):
        metres, whose = evidence.metres(focus, far), focus.name_of(evidence.owner_of(focus, own, t))
        there = f"it is detected {metres} away, score {evidence.share(seen.score[own])}"
        other = f"{nearest}, {metres} away, is that of {whose}" if whose else f"{nearest} is {metres} away"
        yield there if focus.replay.detected[own] == at.object_id else other
    first, last = evidence.detected_until(focus, t)
    if last < t:
        yield f"last detected at {_time(focus, last)}" if last >= 0 else f"there since {_time(focus, first)}"
    start, end = (at.first, at.until) if at.first >= 0 else (t, max(t, focus.regained - 1))
    visible, ego = evidence.visible(focus, start, end), evidence.distance(focus, t)
    hidden = visible is not None and visible < HIDDEN
    if ego is not None and (missed or hidden or not followed):
        yield f"it is {ego:.0f} m from the ego"
    if hidden:
        yield f"{visible:.0%} visible" + (" on average" if end > start else "")


def _others(focus: Focus) -> Iterator[str]:
    """The track of another object whose forecast counts for this one, and the nearest one that is at it."""
    t, had = focus.at.frame, (focus.at.old_id, focus.at.new_id)
    counted, rival = focus.counted(int(focus.rows[t])), focus.rival(t)
    if focus.forecast(t) is not None and -1 < counted != focus.at.new_id:
        other = -1 if counted in had else focus.other(counted, t)
        follows = f", which follows {focus.name_of(other)}," if other >= 0 else ""
        yield f"the forecast of track {counted}{follows} counts for it"
    if rival not in (-1, counted, *had):
        yield f"track {rival}, {_metres(focus, rival)} away, follows {focus.name_of(focus.other(rival, t))}"


def _fate(focus: Focus) -> str:
    """Fate of the track that had the object before."""
    t, old, new, rule = focus.at.frame, focus.at.old_id, focus.at.new_id, evidence.gate(focus)
    if (row := focus.track_rows(old)[t]) < 0:
        return f"track {old} ends"
    took, other = _took(focus, old), focus.other(old, t)
    if other >= 0 and f"of {focus.name_of(other)}" in took:
        return f"track {old} {took}"
    took += " and " if took else ""
    if other >= 0:
        return f"track {old} {took}goes to {_named(focus, other)}"
    if (kind := int(focus.replay.rollout.track_class[row])) not in (-1, focus.at.class_id):
        return f"track {old} {took}has class {focus.replay.card.task.classes[kind].replace('_', ' ')} now"
    if rule.iou:
        overlap = iou_3d(focus.replay.scene.truth.box[focus.rows[t]], focus.replay.rollout.track_box[row])
        below = f", below {rule.threshold:g}" if new < 0 else ""
        return f"track {old} {took}has an IoU of {np.floor(100 * overlap) / 100:.2f} with it{below}"
    beside = f", track {new} {_metres(focus, new)}" if new >= 0 else ""
    return f"track {old} {took}is {_metres(focus, old)} away{beside}"


def _metres(focus: Focus, track: int, least: float = 0.0) -> str:
    """Distance of a track that is output from the object; empty below ``least`` m."""
    far = evidence.away(focus, focus.replay.rollout.track_box[focus.track_rows(track)[focus.at.frame]])
    return evidence.metres(focus, far) if far >= least else ""


def _took(focus: Focus, track: int) -> str:
    """The detection that a track took, where it is of another object or far from the expected place; else empty."""
    t, place = focus.at.frame, evidence.expected(focus, track, focus.at.frame)
    if (row := evidence.taken(focus, track, t)) < 0:
        return "" if place is None else "takes no detection"
    box, other = focus.replay.scene.detections.box[row], evidence.owner_of(focus, row, t)
    far = 0.0 if place is None else float(np.hypot(*(box[:2] - place)))
    off = f"{far:.1f} m from where its forecast put it" if far > evidence.reach(focus) else ""
    if other >= 0:
        return f"takes the detection of {_named(focus, other)}" + (off and f", {off}")
    if off and focus.replay.detected[row] < 0:
        return f"takes a detection of no object, {evidence.metres(focus, evidence.away(focus, box))} beside it,"
    return off and f"takes a detection {off}"


def _error(focus: Focus) -> str:
    """The forecast of that frame, its error and the parts of it."""
    at = focus.at
    if at.parts is None or at.error is None:
        return "no error is counted, as it is not a target then"
    parts, forecast = parts_text(at.parts), focus.forecast(at.frame)
    if at.parts.get(PARTS["ground_truth"], 0.0) >= at.blame + LEAST_SHOWN:
        parts += " (better than on ground-truth tracks)"
    cost = f"which costs {at.error:.1f} m" + (f": {parts}" if parts != "nothing" else "")
    if forecast is None:
        return f"it has no forecast, {cost}"
    if at.minADE is None:
        far = evidence.metres(focus, evidence.away(focus, forecast.start))
        return f"the forecast of its track begins {far} away and does not count, {cost}"
    samples, below = len(forecast.path), at.parts.get(BELOW, 0.0) > at.blame
    which = f"the nearest of {samples} samples" if samples > 1 else "its forecast"
    which += f" (confidence {evidence.share(at.confidence)})" if below and at.confidence is not None else ""
    return f"{which} {evidence.went(focus, forecast)}, {cost}"


def _false_forecast(focus: Focus) -> list[str]:
    at = focus.at
    if at.kind != "spurious":
        return [f"{_when(focus)} there is no false forecast of a {focus.noun}"]
    owner = f"track {at.new_id}" if at.new_id >= 0 else "a forecast without a track"
    when = f"from {_time(focus, at.frame)} to {_time(focus, at.until)}" if at.frame < at.until else _when(focus)
    confidence = f"confidence up to {evidence.share(at.confidence or 0.0)}"
    return [f"{when} {owner} forecasts a {focus.noun}, {confidence}", _fitting(_surplus(focus))]


def _surplus(focus: Focus) -> Iterator[str]:
    """Reasons why a forecast is false: an object of another class, a second forecast of one object, or no object."""
    at, truth, t, doubled = focus.at, focus.replay.scene.truth, focus.at.frame, focus.doubled
    far = [evidence.metres(focus, evidence.away(focus, box)) for box in truth.box[truth.rows(t)]]
    if (other := evidence.confusing(focus, t, true=True)) >= 0:
        yield f"the true {_named(focus, other)} is {far[other - truth.start[t]]} away, forecast as {focus.noun}"
    if doubled >= 0:
        yield f"it is a second forecast of {focus.name_of(doubled)}, {far[doubled - truth.start[t]]} away"
        if (counted := focus.counted(doubled)) not in (-1, at.new_id):
            yield f"that of track {counted} counts"
    elif other < 0:
        same = (far[i] for i in np.flatnonzero(truth.class_id[truth.rows(t)] == at.class_id))
        nearest = min(same, key=lambda text: float(text[:-2]), default="")
        yield f"the nearest true {focus.noun} is {nearest} away" if nearest else f"there is no true {focus.noun} then"
    if (row := evidence.taken(focus, at.new_id, t)) >= 0:
        whose = f" (of {name})" if (name := focus.name_of(evidence.owner_of(focus, row, t))) else ""
        score = evidence.share(focus.replay.scene.detections.score[row])
        yield f"the detection of track {at.new_id}{whose} scores {score}"
    elif at.new_id >= 0:
        yield f"track {at.new_id} takes no detection"
