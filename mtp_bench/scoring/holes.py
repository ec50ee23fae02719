"""Holes in time, which no target, event or identity crosses (docs/definitions, "Targets").

Each side of a hole is scored like a scene of its own: objects and tracks have another identity there.
"""

from dataclasses import replace

import numpy as np

from ..cards import Card
from ..types import Ints, Rollout, Scene, Truth, pieces_of

HOLES, LOST_TARGETS = "holes in time", "targets across holes in time"  # counts beside the skipped rows of a scene


def pieces(scene: Scene, card: Card) -> Ints:
    """Piece of time [F] of each frame of ``scene``: 0 up to the first hole."""
    return pieces_of(scene.time, 1.0 / card.task.rate)


def separated(identity: Ints, piece: Ints) -> Ints:
    """Identities [R] that differ from one ``piece`` [R] to another; those of piece 0 stay as they are."""
    ids = np.asarray(identity, dtype=np.int64)
    return np.asarray(ids + piece * (ids.max(initial=0) - ids.min(initial=0) + 1))


def separated_truth(scene: Scene, card: Card) -> Truth:
    """The truth of ``scene``, whose objects have another identity after a hole."""
    truth = scene.truth
    return replace(truth, object_id=separated(truth.object_id, pieces(scene, card)[truth.frame_of_rows]))


def separated_tracks(rollout: Rollout, scene: Scene, card: Card) -> Rollout:
    """``rollout`` of ``scene``, whose tracks have another identity after a hole."""
    piece = pieces(scene, card)[rollout.tracks.frame_of_rows]
    return replace(rollout, track_id=separated(rollout.track_id, piece))
