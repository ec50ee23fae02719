"""Counterpart of an event in another run of the scene: the same object in the same frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .replay import NO_EVENT, Incident, Replay, known


def counterpart(run: Replay, at: Incident) -> Incident:
    """The incident of ``run`` at the place of ``at``, an incident of another run of the same scene.

    It is the event of the object in that frame, or the false forecast near that place; without either, an incident of
    kind NO_EVENT with the track that follows the object and the error of its forecast.
    """
    if at.object_id < 0:
        return _false_forecast(run, at)
    own = [i for i in run.events if (i.object_id, i.frame) == (at.object_id, at.frame)]
    return own[0] if own else _no_event(run, at)


def _false_forecast(run: Replay, at: Incident) -> Incident:
    """The false forecast nearest to the place, within the gate of forecasts."""
    rows = run.rollout.objects.rows(at.frame)
    row = rows.start + np.flatnonzero(run.forecast_false[rows] & (run.rollout.object_class[rows] == at.class_id))
    far = np.hypot(*(run.rollout.object_box[row, :2] - np.array(at.position[:2])).T)
    if not (far <= run.card.per_class(run.card.task.forecast_gate)[at.class_id]).any():
        return replace(at, kind=NO_EVENT, name="no event", row=-1, new_id=-1, confidence=None)
    best = int(row[np.argmin(far)])
    track = int(run.answers.object_track_id[best])
    for each in run.incidents:
        spurious = each.kind == "spurious" and each.frame <= at.frame <= each.until
        if spurious and (each.row == best or each.new_id == track >= 0):
            x, y, z = (float(value) for value in run.rollout.object_box[best, :3])
            return replace(each, frame=at.frame, row=best, position=(x, y, z))
    raise AssertionError("every false forecast is in a run of them")


def _no_event(run: Replay, at: Incident) -> Incident:
    """The track that follows the object, without an event."""
    track = int(np.append(run.rollout.track_id, -1)[run.truth_track[at.row]])
    before = np.flatnonzero((run.scene.truth.object_id == at.object_id) & (run.scene.truth.frame_of_rows < at.frame))
    min_ade, error, confidence = map(known, run.worth[at.row])
    return replace(
        at,
        kind=NO_EVENT,
        name="no event",
        old_id=track,
        new_id=track,
        wrong=False,
        minADE=min_ade,
        error=error,
        error_before=known(run.worth[before[-1], 1]) if len(before) else None,
        confidence=confidence,
    )
