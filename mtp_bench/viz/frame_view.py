"""One frame of a scene as bird's-eye pictures show it: of a scored run, or of an episode while it is played."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..cards import Card
from ..types import Bools, Floats, Ints, Scene
from .answers import Answers
from .replay import Incident, Replay

EVENT_SECONDS = 1.5  # time that an event stays in the picture
EGO_SIZE = (4.6, 1.9, 1.6)  # m, l w h of a usual car: sources do not state the size of their vehicle


@dataclass(frozen=True, eq=False)
class FrameView:
    """Content of a picture of one frame; boxes are in the frame of reference of the scene."""

    scene: Scene
    card: Card
    frame: int
    answers: Answers | None  # None before the first answer
    answered: int  # number of the frame in the answers
    replay: Replay | None = None  # None: not compared with the truth
    truth_shown: bool = True

    @property
    def truth_rows(self) -> Ints:
        """Rows [M] of the true boxes of the evaluated classes."""
        rows = self.scene.truth.rows(self.frame)
        return np.asarray(rows.start + np.flatnonzero(~self.scene.truth.neutral[rows]))

    @property
    def ego(self) -> Floats | None:
        """Pose [4] of the vehicle that carries the sensors; None without a vehicle."""
        return self.scene.ego[self.frame] if self.card.has_ego else None

    def false(self, kind: str, rows: Ints | slice, count: int) -> Bools:
        """False ones [n] of these rows of "track", "forecast" or "detection"; none if it is not known."""
        known: Bools = np.zeros(count, dtype=bool)
        return known if self.replay is None else getattr(self.replay, f"{kind}_false")[rows]

    @property
    def marked(self) -> list[tuple[Incident, Floats]]:
        """The newest event of each object lately, but for the many false forecasts, and its place [2] now."""
        if self.replay is None:
            return []
        truth, rows = self.scene.truth, self.scene.truth.rows(self.frame)
        place = dict(zip(truth.object_id[rows].tolist(), truth.box[rows, :2], strict=True))
        recent = self.replay.recent(self.frame, EVENT_SECONDS * self.card.task.rate)
        return [(event, place.get(event.object_id, np.array(event.position[:2]))) for event in recent]


def replay_view(replay: Replay, t: int) -> FrameView:
    """Frame ``t`` of a scored run."""
    return FrameView(replay.scene, replay.card, t, replay.answers, t, replay)


def ego_boxes(ego: Floats) -> Floats:
    """Boxes [F, 7] of the vehicle at the poses ``ego`` [F, 4]."""
    return np.concatenate([ego, np.broadcast_to(EGO_SIZE, (len(ego), 3))], axis=1)


def event_text(incident: Incident) -> str:
    """An event in as few words as a marker has room for."""
    match incident.kind:
        case "ids":
            return f"ids {incident.old_id} > {incident.new_id}"
        case "lost":
            return f"lost {incident.old_id}"
        case "reacquired":
            same = incident.old_id == incident.new_id
            return f"again {incident.new_id}" if same else f"again {incident.old_id} > {incident.new_id}"
        case _:
            return f"false forecast {incident.new_id}" if incident.new_id >= 0 else "false forecast"
