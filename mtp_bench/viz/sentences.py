"""An event or a moment in at most three short sentences, everywhere the same: what happened, evidence and cost."""

import re
from collections.abc import Iterator, Mapping

import numpy as np

from ..core import iou_3d
from ..scoring import BELOW, LEAST_SHOWN, PARTS, parts_text
from . import evidence
from .focus import Focus
from .incident import MOMENT
from .plan import collision_cause
from .terminal.output import counted

WORDS = 25  # of a sentence; of the last one without the parts
HIDDEN = 0.75  # share of an object in line of sight below which texts state it


def sentence(focus: Focus) -> str:
    """The sentences, with the name of the event before them; those of a moment with an event are of the event."""
    at, run = focus.at, focus.replay
    own = [
        event
        for event in run.events
        if (event.object_id, event.frame) == (at.object_id, at.frame)
    ]
    if at.kind == MOMENT and own:
        return f"{at.name}, {sentence(Focus(run, own[0]))}"
    if at.object_id < 0:
        texts = _false_forecast(focus)
    else:
        cost = collision_cause(focus) if at.kind == "collision" else _error(focus)
        texts = [
            f"{_when(focus)} {focus.named} {_HAPPENED[at.kind](focus)}",
            _fitting(_evidence(focus)),
            cost,
        ]
    texts[1:] = [text[0].upper() + text[1:] for text in texts[1:] if text]
    return _with_ids_in_file(f"{at.name}: {'. '.join(texts)}", run.scene.track_names)


def _with_ids_in_file(text: str, names: Mapping[int, str]) -> str:
    """``text``, whose first mention of each stored track has its id in the file behind it; ``names``: by number."""
    for number in {*map(int, re.findall(r"\btrack (\d+)\b", text))} & names.keys():
        before, track, after = re.split(rf"(\btrack {number}\b)", text, maxsplit=1)
        text = f"{before}{track} ({names[number]} in its file){after}"
    return text


def _when(focus: Focus) -> str:
    at = focus.at
    span = (
        f" (bad {focus.seconds(at.first):.1f} to {_time(focus, at.until)})"
        if 0 <= at.first < at.until
        else ""
    )
    return f"at {_time(focus, at.frame)}{span}"


def _time(focus: Focus, t: int, since: int = 0) -> str:
    return f"{focus.seconds(t) - focus.seconds(since):.1f} s"


def _fitting(clauses: Iterator[str]) -> str:
    """The first clauses, as many as a sentence may have words."""
    text = ""
    for clause in filter(None, clauses):
        longer = f"{text}; {clause}" if text else clause
        text = longer if len(longer.split()) <= WORDS else text
    return text


def _lost(focus: Focus) -> str:
    at, again = focus.at, focus.regained
    if again < 0:
        return f"loses track {at.old_id} for good"
    track = focus.follower(again)
    then = (
        "until it has it again"
        if track == at.old_id
        else f"then {_taker(focus, track, again)} takes it"
    )
    return f"loses track {at.old_id} for {_time(focus, again, at.frame)}, {then}{_event(focus, at.object_id, again)}"


def _switched(focus: Focus) -> str:
    at = focus.at
    by = (
        f"its old track {at.new_id}"
        if at.new_id == at.old_id
        else _taker(focus, at.new_id, at.frame)
    )
    if at.kind == "ids":
        return f"changes from track {at.old_id} to {by}"
    lost = at.frame - int(np.argmax(focus.followers(at.frame, 0)[1:] >= 0))
    return f"is found again after {_time(focus, at.frame, lost)}{_event(focus, at.object_id, lost)} by {by}"


def _hit(focus: Focus) -> str:
    drive = focus.replay.rollout.drive
    assert drive is not None, "collisions are of drives"
    fault = "at fault" if drive.at_fault else "not at fault"
    how = f"at {drive.seconds:.1f} s, {fault}, planned with a risk of {drive.risk[-1]:.0%}"
    return f"is about to collide with the ego ({how}); it {_followed(focus)}"


def _followed(focus: Focus) -> str:
    tracks, again = focus.followers(focus.at.frame, 0), focus.regained
    frames = int(
        np.argmin(np.append(tracks == tracks[0], False))
    )  # with this track, or without one
    since, always = focus.at.frame - frames + 1, frames == len(tracks)
    if (track := int(tracks[0])) >= 0:
        since_then = f"since {_time(focus, since)} by {_taker(focus, track, since)}"
        return (
            f"is followed by track {track} from its first frame on"
            if always
            else f"is followed {since_then}"
        )
    text = (
        "has had no track so far"
        if always
        else f"has no track since {_time(focus, since)}"
    )
    then = (
        "and gets none"
        if again < 0
        else f"then track {focus.follower(again)} from {_time(focus, again)} on"
    )
    return f"{text}, {then}"


_HAPPENED = {
    "ids": _switched,
    "lost": _lost,
    "reacquired": _switched,
    "collision": _hit,
    MOMENT: _followed,
}


def _taker(focus: Focus, track: int, t: int) -> str:
    """A track that has the object from frame ``t`` on, and what it had before."""
    followed = focus.truth_of_track[
        focus.until_gap(focus.track_rows(track), t, 0)[1:]
    ]  # before t, the newest first
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
    return focus.name_of(row) + _event(
        focus, int(focus.replay.scene.truth.object_id[row]), focus.at.frame
    )


def _event(focus: Focus, object_id: int, t: int) -> str:
    """Name of the event of an object in frame ``t``, or of its loss during a run of false forecasts, in brackets."""
    last = focus.at.until if focus.at.kind == "spurious" else t
    own = (
        each
        for each in focus.replay.events
        if each.object_id == object_id and t <= each.frame <= last
    )
    return next(
        (
            f" ({each.name})"
            for each in own
            if focus.at.object_id >= 0 or each.kind == "lost"
        ),
        "",
    )


def _evidence(focus: Focus) -> Iterator[str]:
    at, t, taken = (
        focus.at,
        focus.at.frame,
        evidence.taken(focus, focus.at.old_id, focus.at.frame),
    )
    confused, (own, far), fate = (
        evidence.confusing(focus, t),
        evidence.detection(focus, t),
        _fate(focus),
    )
    missed = far > evidence.reach(focus)
    looked = missed or at.new_id < 0  # at the detections
    if confused >= 0 and looked:
        whose = (
            f" (of {name})"
            if (name := _owner(focus, confused))
            else evidence.ghost(focus, confused)
        )
        yield f"{'the' if missed else 'one'} detection there says {evidence.says(focus, confused)}{whose}"
    yield fate
    yield from _others(focus)
    if looked and not (
        own < 0 <= confused or (" detection of " in fate and own in (-1, taken))
    ):
        yield _detected(focus, own, evidence.metres(focus, far))
    first, last = evidence.detected_until(focus, t)
    if last < t:
        noun = f" as a {focus.noun}" if confused >= 0 else ""
        yield (
            f"last detected{noun} at {_time(focus, last)}"
            if last >= 0
            else f"there since {_time(focus, first)}"
        )
    start, ego = at.first if at.first >= 0 else t, evidence.distance(focus, t)
    hidden = (
        visible := evidence.visible(focus, start, at.until)
    ) is not None and visible < HIDDEN
    yield (
        f"it is {ego:.0f} m from the ego"
        if ego is not None and (looked or hidden)
        else ""
    )
    yield (
        f"{visible:.0%} visible{' on average' if at.until > start else ''}"
        if hidden
        else ""
    )


def _detected(focus: Focus, row: int, far: str) -> str:
    if row < 0:
        return f"no {focus.noun} is detected within {focus.near:g} m"
    if focus.replay.detected[row] == focus.at.object_id:
        return f"it is detected {far} away, score {evidence.share(focus.replay.scene.detections.score[row])}"
    there = (
        f", {far} away, is that of {name}"
        if (name := _owner(focus, row))
        else f" is {far} away"
    )
    return f"the nearest {focus.noun} detection{there}"


def _owner(focus: Focus, detection: int) -> str:
    return focus.name_of(evidence.owner_of(focus, detection, focus.at.frame))


def _others(focus: Focus) -> Iterator[str]:
    """The track of another object whose forecast counts for this one, and the nearest one that is at it."""
    at, counted, rival = (
        focus.at,
        focus.counted(int(focus.rows[focus.at.frame])),
        focus.rival(focus.at.frame),
    )
    other, rivals = (
        focus.name_of(focus.other(each, at.frame)) for each in (counted, rival)
    )
    if counted not in (-1, at.new_id) and focus.forecast(at.frame) is not None:
        follows = f", which follows {other}," if other and counted != at.old_id else ""
        yield f"the forecast of track {counted}{follows} counts for it"
    if rival not in (-1, counted, at.old_id, at.new_id):
        yield f"track {rival}, {evidence.metres(focus, evidence.track_away(focus, rival))} away, follows {rivals}"


def _fate(focus: Focus) -> str:
    """Fate of the track that had the object before, or of the one that keeps or finds it; empty if it is usual."""
    t, old, new, rule = (
        focus.at.frame,
        focus.at.old_id,
        focus.at.new_id,
        evidence.gate(focus),
    )
    track = old if focus.at.kind in ("ids", "lost") else new
    if (row := focus.track_rows(track)[t]) < 0:
        return f"track {track} ends" if track >= 0 else ""
    took, away, other = (
        _took(focus, track),
        evidence.track_away(focus, track),
        focus.other(track, t),
    )
    far = f"is {evidence.metres(focus, away)} away"
    if track == new:
        took = took.strip(",") or (far if away > evidence.reach(focus) / 2 else "")
        return took and f"track {track} {took}"
    then, kind = (
        f"track {track} {took and f'{took} and '}",
        int(focus.replay.rollout.track_class[row]),
    )
    if other >= 0:
        goes = f"detection of {_named(focus, other)},"
        return (
            f"track {track} {took.strip(',')}"
            if goes in f"{took},"
            else f"{then}goes to {_named(focus, other)}"
        )
    if kind not in (-1, focus.at.class_id):
        return f"{then}has class {focus.replay.card.task.classes[kind].replace('_', ' ')} now"
    if rule.iou:
        overlap = iou_3d(
            focus.replay.scene.truth.box[focus.rows[t]],
            focus.replay.rollout.track_box[row],
        )
        below = f", below {rule.threshold:g}" if new < 0 else ""
        return f"{then}has an IoU of {np.floor(100 * overlap) / 100:.2f} with it{below}"
    return (
        then
        + far
        + (
            f", track {new} {evidence.metres(focus, evidence.track_away(focus, new))}"
            if new >= 0
            else ""
        )
    )


def _took(focus: Focus, track: int) -> str:
    """The detection that a track took, where it is of another object or far from the expected place; else empty."""
    t, place = focus.at.frame, evidence.expected(focus, track, focus.at.frame)
    if (row := evidence.taken(focus, track, t)) < 0:
        return "" if place is None else "takes no detection"
    box, other = (
        focus.replay.scene.detections.box[row],
        evidence.owner_of(focus, row, t),
    )
    far = 0.0 if place is None else float(np.hypot(*(box[:2] - place)))
    off = (
        f"{far:.1f} m from where its forecast put it"
        if far > evidence.reach(focus)
        else ""
    )
    whose = (
        f"the detection of {_named(focus, other)}"
        if other >= 0
        else "a detection of no object"
    )
    if other >= 0 and off:
        return f"takes {whose}, {off}"
    if other >= 0 or (off and focus.replay.detected[row] < 0):
        return f"takes {whose}, {evidence.metres(focus, evidence.away(focus, box))} beside it,"
    return off and f"takes a detection {off}"


def _error(focus: Focus) -> str:
    """The forecast of that frame, its error and the parts of it."""
    at = focus.at
    if at.parts is None or at.error is None:
        return "no error is counted, as it is not a target then"
    parts, forecast = parts_text(at.parts), focus.forecast(at.frame)
    if at.parts.get(PARTS["ground_truth"], 0.0) >= at.error + LEAST_SHOWN:
        parts += " (better than on ground-truth tracks)"
    cost = f"which costs {at.error:.1f} m" + (
        f": {parts}" if parts != "nothing" else ""
    )
    if forecast is None:
        return f"it has no forecast, {cost}"
    if at.minADE is None:
        far = evidence.metres(focus, evidence.away(focus, forecast.start))
        return f"the forecast of its track begins {far} away and does not count, {cost}"
    if at.parts.get(BELOW, 0.0) > at.blame:
        return f"its forecast {evidence.left_out(focus, at.frame)}, {cost}"
    samples = len(forecast.path)
    which = f"the nearest of {samples} samples" if samples > 1 else "its forecast"
    return f"{which} {evidence.went(focus, forecast)}, {cost}"


def _false_forecast(focus: Focus) -> list[str]:
    at = focus.at
    if at.kind != "spurious":
        return [f"{_when(focus)} there is no false forecast of a {focus.noun}"]
    owner = f"track {at.new_id}" if at.new_id >= 0 else "a forecast without a track"
    when = (
        f"from {_time(focus, at.frame)} to {_time(focus, at.until)}"
        if at.frame < at.until
        else _when(focus)
    )
    forecasts = f"forecasts a {focus.noun}, confidence up to {evidence.share(at.confidence or 0.0)}"
    return [f"{when} {owner} {forecasts}", _fitting(_surplus(focus))]


def _surplus(focus: Focus) -> Iterator[str]:
    """Reasons why a forecast is false: an object of another class, a second forecast of one object, or no object."""
    at, truth, t, doubled = (
        focus.at,
        focus.replay.scene.truth,
        focus.at.frame,
        focus.doubled,
    )
    far = [
        evidence.metres(focus, evidence.away(focus, box))
        for box in truth.box[truth.rows(t)]
    ]
    if (other := evidence.confusing(focus, t, true=True)) >= 0:
        yield f"the true {_named(focus, other)} is {far[other - truth.start[t]]} away, forecast as {focus.noun}"
    if doubled >= 0:
        yield f"it is a second forecast of {focus.name_of(doubled)}, {far[doubled - truth.start[t]]} away"
        yield (
            f"that of track {counted} is surer and counts"
            if (counted := focus.counted(doubled)) >= 0
            else ""
        )
    elif other < 0:
        same = (
            far[i] for i in np.flatnonzero(truth.class_id[truth.rows(t)] == at.class_id)
        )
        nearest = min(same, key=lambda text: float(text[:-2]), default="")
        yield (
            f"the nearest true {focus.noun} is {nearest} away"
            if nearest
            else f"there is no true {focus.noun} then"
        )
    if (row := evidence.taken(focus, at.new_id, t)) >= 0:
        score, whose = (
            evidence.share(focus.replay.scene.detections.score[row]),
            _owner(focus, row),
        )
        yield f"the detection of track {at.new_id}{whose and f' (of {whose})'} scores {score}"
    elif at.new_id >= 0:
        yield f"track {at.new_id} takes no detection"
