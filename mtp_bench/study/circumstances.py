"""Circumstances of targets: the age of the track that holds them, and the time since the last event of their object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..scoring.events import object_history
from ..scoring.holes import separated_tracks, separated_truth
from ..scoring.lineage import hypotheses, in_all, lineage_events, match_hypotheses
from ..scoring.neutral import evaluated
from ..scoring.targets import find_targets
from ..types import Bools, Ints, Rollout, Scene, Truth

KINDS = ("ids", "lost", "reacquired", "frag")  # the last: lost or reacquired


@dataclass(frozen=True, eq=False)
class Circumstances:
    """Circumstances of one rollout of one scene; targets [n] in the order of `find_targets`."""

    age: Ints  # [n] frames since the track that holds it first appeared; -1: not held in the best hypothesis
    since: dict[str, Ints]  # [n] by KINDS: frames since the last event of the object, 0 for now; -1: none so far
    own: dict[str, int]  # by KINDS: events along the lineage of the best hypothesis, on targets or not
    shared: dict[str, int]  # by KINDS: events that every hypothesis has
    objects: int  # evaluated true objects
    frames: int


def circumstances(scene: Scene, rollout: Rollout, card: Card) -> Circumstances:
    """Circumstances of the targets of ``scene``; the rollout is one that `score_scene` takes."""
    scene = evaluated(scene)
    truth, targets = separated_truth(scene, card), find_targets(scene, card)
    lineage = hypotheses(rollout, card)
    matched = match_hypotheses(truth, rollout, lineage.member, card)
    events = lineage_events(truth, rollout, lineage, matched)
    best = lineage.best[truth.frame_of_rows]
    own = {kind: getattr(events.of(best), kind)[:, 0] for kind in KINDS}
    track = np.take_along_axis(matched, best[:, None], axis=1)[:, 0]
    return Circumstances(
        age=_ages(separated_tracks(rollout, scene, card), track)[targets.row],
        since={kind: _since(truth, rows)[targets.row] for kind, rows in own.items()},
        own={kind: int(rows.sum()) for kind, rows in own.items()},
        shared={kind: int(in_all(truth, lineage, events, kind).sum()) for kind in KINDS},
        objects=len(np.unique(scene.truth.object_id[~truth.neutral])),
        frames=scene.frames,
    )


def _ages(rollout: Rollout, track: Ints) -> NDArray[np.int64]:
    """Frames [R] since the id of each ``track`` first appeared; -1 without a track."""
    frame = rollout.tracks.frame_of_rows
    _, first, number = np.unique(rollout.track_id, return_index=True, return_inverse=True)
    age = np.append(frame - frame[first][number], -1)  # row -1: no track
    return np.asarray(age[track], dtype=np.int64)


def _since(truth: Truth, happened: Bools) -> NDArray[np.int64]:
    """Frames since the last row of the same object that ``happened`` [R], 0 for the row itself; -1 without any."""
    past = object_history(truth)
    own, place = happened[past.order], np.arange(len(past.order))
    last = np.maximum.accumulate(np.where(own, place, -1)) if len(place) else place
    begin = np.maximum.accumulate(np.where(past.follows, 0, place)) if len(place) else place
    since = np.full(len(place), -1, dtype=np.int64)
    known = last >= begin
    since[past.order[known]] = past.frame[known] - past.frame[last[known]]
    return since
