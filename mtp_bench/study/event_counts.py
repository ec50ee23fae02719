"""Counts of events of one rollout: with its best hypothesis, and in all hypotheses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..cards import Card
from ..scoring.holes import separated_truth
from ..scoring.lineage import hypotheses, in_all, lineage_events, match_hypotheses
from ..scoring.neutral import evaluated
from ..types import Rollout, Scene

KINDS = ("ids", "lost", "reacquired", "frag")  # the last: lost or reacquired


@dataclass(frozen=True)
class EventCounts:
    """Numbers of events of one rollout of one scene, on targets or not, by KINDS."""

    own: dict[str, int]  # along the lineage of the best hypothesis
    shared: dict[str, int]  # that every hypothesis has
    objects: int  # evaluated true objects
    frames: int


def count_events(scene: Scene, rollout: Rollout, card: Card) -> EventCounts:
    """Count the events of a rollout that `score_scene` takes."""
    scene = evaluated(scene)
    truth, lineage = separated_truth(scene, card), hypotheses(rollout, card)
    events = lineage_events(truth, rollout, lineage, match_hypotheses(truth, rollout, lineage.member, card))
    own = events.of(lineage.best[truth.frame_of_rows])
    return EventCounts(
        own={kind: int(getattr(own, kind)[:, 0].sum()) for kind in KINDS},
        shared={kind: int(in_all(truth, lineage, events, kind).sum()) for kind in KINDS},
        objects=len(np.unique(scene.truth.object_id[~truth.neutral])),
        frames=scene.frames,
    )
