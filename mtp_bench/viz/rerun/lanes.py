"""Identity lanes: which track follows each true object, as plain data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...types import Ints
from ..replay import Replay


@dataclass(frozen=True)
class Lane:
    """Which track follows a true object: states from their first frame on, None where the object is not there."""

    object_id: int
    frame: tuple[int, ...]
    track: tuple[int | None, ...]  # -1: none


def lanes(replay: Replay) -> list[Lane]:
    """Identity lanes of the evaluated objects, by their ids: the best hypothesis of every frame."""
    truth = replay.scene.truth
    frame = truth.frame_of_rows
    track = np.append(replay.rollout.track_id, -1)[replay.truth_track]
    evaluated = ~truth.neutral
    found = []
    for object_id in np.unique(truth.object_id[evaluated]).tolist():
        rows = np.flatnonzero(evaluated & (truth.object_id == object_id))
        states = _changes(frame[rows], track[rows], replay.frames)
        found.append(Lane(object_id, tuple(states), tuple(states.values())))
    return found


def _changes(frame: Ints, track: Ints, frames: int) -> dict[int, int | None]:
    """State of one object from each frame on at which it changes; None from the frame after it was seen."""
    states: dict[int, int | None] = {}
    current: int | None = None
    for t, following, i in zip(frame.tolist(), [*frame[1:].tolist(), frames], track.tolist(), strict=True):
        if i != current:
            states[t] = current = i
        if following > t + 1:
            states[t + 1] = current = None
    return states
