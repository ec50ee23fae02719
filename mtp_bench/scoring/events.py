"""Identity events of true objects, and holes in time.

No event, target or identity crosses a hole (docs/definitions, "Events"). Each side of a
hole is scored like a scene of its own: objects and tracks have another identity there.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..cards import Card
from ..core import Bools, Ints, Rollout, Scene, ShapeError, Truth, pieces_of
from .matching import Matched
from .pairs import Rows

# counts beside the skipped rows of a scene
HOLES = "holes in time"
LOST_TARGETS = "targets across holes in time"


@dataclass(frozen=True, eq=False)
class History:
    """Rows of a table sorted by identity, then frame."""

    order: Rows  # [R]
    identity: Ints  # [R] in that order
    frame: Ints  # [R] in that order
    follows: Bools  # [R] the row before is the same identity, at any earlier frame
    consecutive: Bools  # [R] ... in the frame just before

    def previous(self) -> Rows:
        """Return the row [R] of the same identity in the frame just before.

        -1 without one; in the order of the table.
        """
        previous_row = np.full(len(self.order), -1, dtype=np.intp)
        place = np.flatnonzero(self.consecutive)
        previous_row[self.order[place]] = self.order[place - 1]
        return previous_row


def history(frame: Ints, identity: Ints) -> History:
    """Return the history of a table [R] that is sorted by frame.

    An identity occurs once per frame, else ShapeError.
    """
    order = np.argsort(identity, kind="stable")
    sorted_identity = identity[order]
    sorted_frame = frame[order]
    step = np.diff(sorted_frame)
    follows = np.zeros(len(order), dtype=bool)
    follows[1:] = sorted_identity[1:] == sorted_identity[:-1]
    consecutive = np.zeros(len(order), dtype=bool)
    consecutive[1:] = follows[1:] & (step == 1)
    twice = np.flatnonzero(follows[1:] & (step == 0))
    if len(twice):
        raise ShapeError(
            f"identity {sorted_identity[twice[0]]} occurs twice in frame "
            f"{sorted_frame[twice[0]]}, expected once per frame"
        )
    return History(order, sorted_identity, sorted_frame, follows, consecutive)


def object_history(truth: Truth, place: Ints) -> History:
    """Return the history of the true boxes [R] over annotated frames.

    A neutral box counts as absent, as an object of its own. ``place`` [F]: see
    `Scene.annotated_place`.
    """
    object_id = np.asarray(truth.object_id, dtype=np.int64)
    unused_id = object_id.max(initial=0) + 1 + np.arange(len(object_id))
    identity = np.where(truth.neutral, unused_id, object_id)
    return history(place[truth.frame_of_rows], identity)


def clear_identity(
    objects: History, matched: Matched, track_id: Ints
) -> tuple[Rows, Rows]:
    """Return the rows of CLEAR-IDS and of CLEAR-FRAG.

    IDS: the id of the track differs from that of the last match. FRAG: the object is
    matched again after a gap.
    """
    track_row = matched[objects.order]
    place = np.flatnonzero(track_row >= 0)
    matched_identity = objects.identity[place]
    matched_id = track_id[track_row[place]]
    same_object = matched_identity[1:] == matched_identity[:-1]
    switched = place[1:][same_object & (matched_id[1:] != matched_id[:-1])]
    fragmented = _matched_again(objects.follows, track_row >= 0)
    return objects.order[switched], objects.order[fragmented]


def _matched_again(follows: Bools, is_matched: Bools) -> Bools:
    """Return True for rows that are matched after a gap that followed a match.

    Match, gap and row are in the same run. ``follows`` [R]: see `counted_in_run`.
    """
    # the count includes the row itself
    matched_before = counted_in_run(follows, is_matched) > is_matched
    after_gap = follows & ~np.roll(is_matched, 1)
    return np.asarray(is_matched & after_gap & matched_before)


def counted_in_run(follows: Bools, flags: Bools) -> Ints:
    """Count the True ``flags`` [R] from the start of a run to each row.

    A run is a series of rows; ``follows`` [R] is True for a row that continues the run
    of the row before.
    """
    count = np.cumsum(flags)
    # counts rise, so the maximum so far is that of the run's first row
    count_before_run = np.where(follows, 0, count - flags)
    return np.asarray(count - np.maximum.accumulate(count_before_run))


def pieces(scene: Scene, card: Card) -> Ints:
    """Return the piece of time [F] of each frame: 0 up to the first hole.

    A gap between annotated frames of 1.5 times their usual step also is a hole.
    """
    gaps = pieces_of(scene.annotated_frames.astype(float), scene.annotated_step)
    gaps_before = gaps[np.maximum(scene.annotated_place, 0)]
    return pieces_of(scene.time, 1.0 / card.task.rate) + gaps_before


def separated(identity: Ints, piece: Ints) -> Ints:
    """Return other identities [R] for the rows of each ``piece`` [R] of time.

    So an object counts as a new one after a hole in time. Rows of piece 0 keep their
    identities.
    """
    ids = np.asarray(identity, dtype=np.int64)
    return np.asarray(ids + piece * (ids.max(initial=0) - ids.min(initial=0) + 1))


def separated_truth(scene: Scene, card: Card) -> Truth:
    """Return the truth of a scene, with other identities after a hole."""
    truth = scene.truth
    piece = pieces(scene, card)[truth.frame_of_rows]
    return replace(truth, object_id=separated(truth.object_id, piece))


def separated_tracks(rollout: Rollout, scene: Scene, card: Card) -> Rollout:
    """Return the rollout of a scene, with other track identities after a hole."""
    piece = pieces(scene, card)[rollout.tracks.frame_of_rows]
    return replace(rollout, track_id=separated(rollout.track_id, piece))
