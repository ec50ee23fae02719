"""Causes of an event as a table: stage at fault, reason, evidence in columns, cost."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..core import wrap_angle
from ..scoring import BELOW_THRESHOLD, FIXED_CONFIDENCE, LEAST_SHOWN
from .doubted import doubt_numbers
from .evidence import (
    appeared,
    borrowed,
    distance_to,
    last_detected,
    object_detection,
    of_other_class,
    owner_of,
    taken_detection,
    trail,
)
from .focus import Focus, nearest_box
from .incident import MOMENT, Incident
from .part_ranking import DETECTION_REASONS, ranked_parts
from .plan import collision_evidence

Values = dict[str, Any]

_FORECAST = (
    "the nearest of {samples} samples goes {way_m:.0f} m at {turn_deg:.0f}° to the "
    "heading and ends {end_error_m:.1f} m off; the object goes {true_way_m:.0f} m at "
    "{true_turn_deg:.0f}°"
)
_COUNTS = (
    "detected in {detected_frames} and forecast in {forecast_frames} of the {frames} "
    "frames before"
)
_NEAREST = "nearest sample {forecast_error_m:.1f} m off where they meet"
TEMPLATES = {  # reason -> evidence; keys of the values have their units
    # parts of the error of a target, by the names of `PART_NAMES`
    "predictor": _FORECAST,
    "rest": _FORECAST,
    "localisation": "the forecast begins {offset_m:.1f} m from the object",
    "history": "its track is {track_age_s:.1f} s old and moves at {speed_mps:.1f} m/s, "
    "the object at {true_speed_mps:.1f} m/s",
    "association": "its forecast is that of {track}, which followed {followed} before "
    "and takes {detection}",
    "no forecast": "detected {detection_m:.1f} m away with score {score:.2f}, but "
    "without a forecast",
    "nothing forecast": "{agent} forecasts nothing in this scene",
    "borrowed detections": "the detections there are of other objects: {owner}",
    "other class": "the detection there says {detected_class}, score {score:.2f}",
    "off place": "the nearest {noun} detection is {detection_m:.1f} m away, the gate "
    "is {gate_m:g} m",
    "never detected so far": "not detected since it appeared at {since_s:.1f} s",
    "not detected now": "last detected at {last_s:.1f} s",
    "below threshold": "its confidence {confidence:.3f} is left out at "
    "{budgets_without} of {budgets} budgets, the largest of which needs "
    "{least_confidence:.3f}",
    "data": "{doubt}",
    "filled budgets": "other forecasts fill {budgets_without} of {budgets} budgets "
    "before its confidence of {confidence:.3f}",
    # false forecasts
    "mistaken class": "the true {owner}, {distance_m:.1f} m away, is forecast as a "
    "{noun}",
    "second forecast": "{owner}, {distance_m:.1f} m away, has another forecast",
    "false detection": "its detection has score {score:.2f} and no object",
    "no detection": "its track goes on without a detection",
    # collisions
    "not detected before": _COUNTS,
    "not forecast before": _COUNTS,
    "switched before": _COUNTS + "; changed its track at {switch_s:.1f} s; " + _NEAREST,
    "unsure before": _COUNTS + "; mean confidence {confidence:.2f}",
    "forecast off": _COUNTS + "; " + _NEAREST,
    "plan": _COUNTS,
}
HAPPENED = {  # kind of incident -> text
    "ids": "{object} changes from {old_track} to {new_track}",
    "lost": "{object} loses {old_track} {duration}",
    "reacquired": "{object} is found again by {new_track}, before {old_track}",
    "spurious": "a {noun} is forecast by {new_track} until {until_s:.1f} s, "
    "confidence up to {confidence:.2f}",
    "collision": "the ego hits {object}, {fault}, planned risk {risk:.0%}",
    MOMENT: "{object} is followed by {new_track}",
    "no event": "no false forecast of a {noun}",
}


class Cause(NamedTuple):
    """One row of the table."""

    # detector, tracker, predictor, confidence, planner, or forecast: tracker or
    # predictor, where the error is not split
    stage: str
    reason: str  # key of `TEMPLATES`
    values: Values  # columns of this reason; empty where nothing can be measured
    cost_m: float | None = None  # share of the error; None: the event has no error

    @property
    def title(self) -> str:
        """Stage and reason: "tracker: association"."""
        if self.stage == self.reason:
            return self.stage
        return f"{self.stage}: {self.reason}"


def cause_text(cause: Cause) -> str:
    """Return the evidence of a cause in words, empty if not measured."""
    return TEMPLATES[cause.reason].format(**cause.values) if cause.values else ""


def cause_line(cause: Cause) -> str:
    """Return title, cost in metres and evidence of a cause."""
    cost = "" if cause.cost_m is None else f", {cause.cost_m:.1f} m"
    evidence = cause_text(cause)
    return f"{cause.title}{cost}: {evidence}" if evidence else f"{cause.title}{cost}"


def causes_of(focus: Focus) -> list[Cause]:
    """Return the causes of an event, the gravest first.

    The list is empty for an object that is not a target then, or has no error.
    """
    at = focus.at
    if at.kind == "collision":
        evidence = collision_evidence(focus)
        return [Cause(*evidence.cause, evidence._asdict())]
    if at.kind == "spurious":
        return [_false_forecast(focus)]
    if not at.parts:
        return []
    is_borrowed = bool(borrowed(focus.replay)[at.row])
    causes: list[Cause] = []
    is_sure = at.confidence is not None and at.confidence >= FIXED_CONFIDENCE
    for stage, part_name, cost_m in ranked_parts(at.parts, is_borrowed):
        if causes and cost_m < LEAST_SHOWN:  # the gravest is shown however small
            continue
        reason = part_name
        if is_borrowed and part_name in DETECTION_REASONS:
            reason = "borrowed detections"
        elif is_sure and part_name == BELOW_THRESHOLD:
            reason = "filled budgets"
        elif not len(focus.replay.rollout.object_box):
            reason = "nothing forecast"
        causes.append(Cause(stage, reason, _MEASURES[reason](focus), cost_m))
    return causes


def headline(focus: Focus) -> str:
    """Return stage and reason of the gravest cause: "detector: other class"."""
    causes = causes_of(focus)
    if causes:
        return causes[0].title
    if focus.at.object_id < 0:  # another run has a false forecast there
        return "no false forecast"
    return "not a target" if focus.at.parts is None else "no error"


def happened(focus: Focus) -> str:
    """Return name, time and event of a moment in one sentence."""
    at = focus.at
    name = at.name
    event = at  # or the event of the object in the frame of a moment
    for other in focus.replay.events:
        is_same = (other.object_id, other.frame) == (at.object_id, at.frame)
        if at.kind == MOMENT and is_same:
            event = other
            name = f"{at.name}, {other.name}"
    values = _event_values(focus, event)
    time = f"at {values['at_s']:.1f} s"
    if 0 <= at.first < at.until:
        time += f" (bad {focus.seconds(at.first):.1f} to {focus.seconds(at.until):.1f})"
    is_absent = at.kind == MOMENT and at.object_id < 0
    template = HAPPENED["no event" if is_absent else event.kind]
    return f"{name}: {time} {template.format(**values)}"


def sentence(focus: Focus) -> str:
    """Return the event, and its gravest cause with evidence and cost."""
    return ". ".join([happened(focus), *map(cause_line, causes_of(focus)[:1])])


def _event_values(focus: Focus, event: Incident) -> Values:
    """Return the values that the texts of `HAPPENED` name."""
    old_track, new_track = (
        "no track" if track_id < 0 else focus.track_name(track_id)
        for track_id in (event.old_id, event.new_id)
    )
    duration = "for good"
    if focus.regained >= 0:
        time_s = focus.seconds(focus.regained) - focus.seconds(event.frame)
        duration = f"for {time_s:.1f} s"
    values = {
        "object": focus.named,
        "noun": focus.noun,
        "old_track": old_track,
        "new_track": new_track,
        "duration": duration,
        "at_s": focus.seconds(event.frame),
        "until_s": focus.seconds(event.until),
        "confidence": event.confidence or 0.0,
    }
    drive = focus.replay.rollout.drive
    if drive is not None and event.kind == "collision":
        values["at_s"] = drive.seconds  # the frame is before it
        values["fault"] = "at fault" if drive.at_fault else "not at fault"
        values["risk"] = drive.risk[-1]
    return values


def _forecast(focus: Focus) -> Values:
    """Measure the ways of the nearest sample and of the object."""
    forecast = focus.forecast(focus.at.frame)
    future = focus.future(focus.at.frame)
    if forecast is None or not len(future):
        return {}
    path = forecast.nearest_path[: len(future)]
    heading = focus.replay.scene.truth.box[focus.at.row, 3]
    values: Values = {
        "samples": len(forecast.samples),
        "end_error_m": float(np.hypot(*(path[-1] - future[-1]))),
    }
    for prefix, places in (("", path), ("true_", future)):
        way = places[-1] - places[0]
        turn = wrap_angle(np.arctan2(way[1], way[0]) - heading)
        values[f"{prefix}way_m"] = float(np.hypot(*way))
        values[f"{prefix}turn_deg"] = round(float(np.degrees(turn))) + 0.0  # not -0
    return values


def _localisation(focus: Focus) -> Values:
    forecast = focus.forecast(focus.at.frame)
    return {} if forecast is None else {"offset_m": distance_to(focus, forecast.start)}


def _history(focus: Focus) -> Values:
    """Measure speeds of track and object over the last second."""
    t = focus.at.frame
    forecast = focus.forecast(t)
    if forecast is None or forecast.track_id < 0:
        return {}
    rate_hz = focus.replay.card.task.rate
    second_frames = round(rate_hz)
    age_frames = len(trail(focus, forecast.track_id, t, t + 1)) - 1
    values: Values = {"track_age_s": age_frames / rate_hz}
    places = {
        "speed_mps": trail(focus, forecast.track_id, t, second_frames + 1),
        "true_speed_mps": focus.path(t, t - second_frames),
    }
    for name, path in places.items():
        steps = max(1, len(path) - 1)
        values[name] = float(np.hypot(*(path[-1] - path[0]))) * rate_hz / steps
    return values


def _association(focus: Focus) -> Values:
    """Name the track of the forecast, its last object and its detection."""
    t = focus.at.frame
    forecast = focus.forecast(t)
    if forecast is None or forecast.track_id < 0:
        return {}
    detection_row = taken_detection(focus, forecast.track_id, t)
    if detection_row < 0:
        detection = "no detection"
    elif focus.replay.detected[detection_row] == focus.at.object_id:
        detection = "its detection"
    elif owner := focus.name_of(owner_of(focus, detection_row, t)):
        detection = f"the detection of {owner}"
    else:
        detection = "a detection of no object"
    track_rows = focus.until_gap(focus.track_rows(forecast.track_id), t - 1, 0)
    truth_rows = focus.truth_of_track[track_rows]  # the newest first
    truth_rows = truth_rows[truth_rows >= 0]
    followed = "no object"
    if len(truth_rows):
        row = int(truth_rows[0])
        is_object = focus.replay.scene.truth.object_id[row] == focus.at.object_id
        followed = "it" if is_object else focus.name_of(row)
    return {
        "track": focus.track_name(forecast.track_id),
        "followed": followed,
        "detection": detection,
    }


def _detection(focus: Focus) -> Values:
    """Measure the detection of the object, or the nearest of its class."""
    row = object_detection(focus, focus.at.frame)
    if row < 0:
        return {}
    detections = focus.replay.scene.detections
    return {
        "noun": focus.noun,
        "detection_m": distance_to(focus, detections.box[row]),
        "score": float(detections.score[row]),
        "gate_m": focus.gate_m,
        "owner": focus.name_of(owner_of(focus, row, focus.at.frame)) or "no object",
    }


def _other_class(focus: Focus) -> Values:
    detections = focus.replay.scene.detections
    row = of_other_class(focus, focus.at.frame, detections)
    if row < 0:
        return {}
    return {
        "detected_class": focus.replay.class_noun(detections.class_id[row]),
        "score": float(detections.score[row]),
    }


def _never_detected(focus: Focus) -> Values:
    return {"since_s": focus.seconds(appeared(focus, focus.at.frame))}


def _not_detected(focus: Focus) -> Values:
    frame = last_detected(focus, focus.at.frame)
    return {"last_s": focus.seconds(frame)} if frame >= 0 else {}


def _below_threshold(focus: Focus) -> Values:
    """Count the budgets that leave out the forecast."""
    thresholds = focus.replay.thresholds
    confidence = focus.at.confidence
    if thresholds is None or confidence is None:
        return {}
    above = thresholds[thresholds > confidence]
    return {
        "confidence": confidence,
        "budgets_without": len(above),
        "budgets": len(thresholds),
        "least_confidence": float(above.min(initial=1.0)),
    }


def _data(focus: Focus) -> Values:
    """Quote the doubt that touches the object."""
    replay = focus.replay
    truth = replay.scene.truth
    numbers = doubt_numbers(
        replay.doubts, replay.card, truth.frame_of_rows, truth.object_id
    )
    return {"doubt": replay.doubts[numbers[focus.at.row]].line}


_MEASURES: dict[str, Callable[[Focus], Values]] = {
    "predictor": _forecast,
    "rest": _forecast,
    "localisation": _localisation,
    "history": _history,
    "association": _association,
    "no forecast": _detection,
    "nothing forecast": lambda focus: {"agent": focus.replay.agent},
    "borrowed detections": _detection,
    "other class": _other_class,
    "off place": _detection,
    "never detected so far": _never_detected,
    "not detected now": _not_detected,
    "below threshold": _below_threshold,
    "filled budgets": _below_threshold,
    "data": _data,
}


def _false_forecast(focus: Focus) -> Cause:
    """Return the cause of a false forecast, the first that applies."""
    t = focus.at.frame
    truth = focus.replay.scene.truth
    mistaken_row = of_other_class(focus, t, truth)
    rows = truth.rows(t)
    same_class = truth.class_id[rows] == focus.at.class_id
    second_row = nearest_box(truth.box, rows, same_class, focus.place(t), focus.gate_m)
    for stage, reason, row in (
        ("detector", "mistaken class", mistaken_row),
        ("tracker", "second forecast", second_row),
    ):
        if row >= 0:
            values = {
                "noun": focus.noun,
                "owner": focus.name_of(row),
                "distance_m": distance_to(focus, truth.box[row]),
            }
            return Cause(stage, reason, values)
    detection_row = taken_detection(focus, focus.at.new_id, t)
    if detection_row < 0:
        return Cause("tracker", "no detection", {"track_id": focus.at.new_id})
    score = float(focus.replay.scene.detections.score[detection_row])
    return Cause("detector", "false detection", {"score": score})
