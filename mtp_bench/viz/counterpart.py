"""The event of another run of the same scene at the place of an event."""

from dataclasses import replace

import numpy as np

from .incident import MOMENT, Incident
from .replay import Replay


def counterpart(run: Replay, at: Incident) -> Incident:
    """The incident of ``run`` at the place of ``at``, an incident of another run of the same scene.

    It is the event of the object in that frame, or the false forecast nearest to that place, within the forecast gate;
    without either, an incident of kind MOMENT.
    """
    if at.object_id >= 0:
        own = [i for i in run.events if (i.object_id, i.frame) == (at.object_id, at.frame)]
        return own[0] if own else replace(run.moment(at.row), name="no event")
    rows = run.rollout.objects.rows(at.frame)
    row = rows.start + np.flatnonzero(run.forecast_false[rows] & (run.rollout.object_class[rows] == at.class_id))
    far = np.hypot(*(run.rollout.object_box[row, :2] - np.array(at.position[:2])).T)
    if not (far <= run.card.per_class(run.card.task.forecast_gate)[at.class_id]).any():
        return replace(at, kind=MOMENT, name="no event", row=-1, new_id=-1, confidence=None)
    best = int(row[np.argmin(far)])
    track = int(run.answers.object_track_id[best])
    lasting = [i for i in run.incidents if i.kind == "spurious" and i.frame <= at.frame <= i.until]
    incident = next(i for i in lasting if i.row == best or i.new_id == track >= 0)
    x, y, z = run.rollout.object_box[best, :3].tolist()
    return replace(incident, frame=at.frame, row=best, position=(x, y, z))
