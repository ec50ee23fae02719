"""Identity events of true objects, and holes in time, which no event, target or identity crosses (docs/definitions).

Each side of a hole is scored like a scene of its own: objects and tracks have another identity there.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..cards import Card
from ..core import Bools, Ints, Rollout, Scene, ShapeError, Truth, pieces_of
from .matching import Matched
from .pairs import Rows

HOLES, LOST_TARGETS = (
    "holes in time",
    "targets across holes in time",
)  # counts beside the skipped rows of a scene


@dataclass(frozen=True, eq=False)
class Events:
    """Rows of the truth where something happens to the identity of an object, ascending."""

    ids: Rows
    lost: Rows
    wrong: Rows  # those lost whose old id is output outside the gate; that of the others is not output
    reacquired: Rows


@dataclass(frozen=True, eq=False)
class History:
    """Rows of a table sorted by identity, then frame, and whether each continues the identity of the row before."""

    order: Rows  # [R]
    identity: Ints  # [R] in that order
    frame: Ints  # [R] in that order
    follows: Bools  # [R] the row before is the same identity, at any earlier frame
    consecutive: Bools  # [R] ... in the frame just before

    def previous(self) -> Rows:
        """Row [R] of the same identity in the frame just before, -1 without one; in the order of the table."""
        earlier = np.full(len(self.order), -1, dtype=np.intp)
        place = np.flatnonzero(self.consecutive)
        earlier[self.order[place]] = self.order[place - 1]
        return earlier


def history(frame: Ints, identity: Ints) -> History:
    """History of a table [R] that is sorted by frame; an identity occurs once per frame, else ShapeError."""
    order = np.argsort(identity, kind="stable")
    who, when = identity[order], frame[order]
    follows, consecutive = (
        np.zeros(len(order), dtype=bool),
        np.zeros(len(order), dtype=bool),
    )
    follows[1:] = who[1:] == who[:-1]
    step = when[1:] - when[:-1]
    consecutive[1:] = follows[1:] & (step == 1)
    twice = np.flatnonzero(follows[1:] & (step == 0))
    if len(twice):
        i = int(twice[0])
        raise ShapeError(
            f"identity {who[i]} occurs twice in frame {when[i]}, expected once per frame"
        )
    return History(order, who, when, follows, consecutive)


def object_history(truth: Truth) -> History:
    """History of the true boxes [R]; a neutral box counts as absent, as an object of its own."""
    identity = np.asarray(truth.object_id, dtype=np.int64)
    alone = identity.max(initial=0) + 1 + np.arange(len(identity))
    return history(truth.frame_of_rows, np.where(truth.neutral, alone, identity))


def find_events(
    objects: History, matched: Matched, tracks: History, track_id: Ints
) -> Events:
    """Events of one stream of tracks.

    ``objects`` and ``tracks`` are the histories of the true boxes [R] and the tracks; ``matched`` [R] the row of the
    track of each true box, -1 none; ``track_id`` the ids by row. No event is found across frames without the object.
    """
    column = matched[objects.order]
    held = column >= 0
    before = np.roll(column, 1)
    ids = np.append(np.asarray(track_id, dtype=np.int64), -1)  # row -1: no track
    follows_match = objects.consecutive & (before >= 0)
    lost = np.flatnonzero(follows_match & ~held)
    went_on = np.zeros(
        len(tracks.order), dtype=bool
    )  # tracks that are output in the next frame too
    went_on[tracks.order[np.flatnonzero(tracks.consecutive) - 1]] = True
    return Events(
        ids=np.sort(objects.order[follows_match & held & (ids[before] != ids[column])]),
        lost=np.sort(objects.order[lost]),
        wrong=np.sort(objects.order[lost[went_on[before[lost]]]]),
        reacquired=np.sort(objects.order[_matched_again(objects.consecutive, held)]),
    )


def clear_identity(
    objects: History, matched: Matched, track_id: Ints
) -> tuple[Rows, Rows]:
    """Rows of CLEAR-IDS (the id differs from the last matched one) and of CLEAR-FRAG (matched again after a gap)."""
    column = matched[objects.order]
    place = np.flatnonzero(column >= 0)
    same = objects.identity[place[1:]] == objects.identity[place[:-1]]
    switched = place[1:][
        same & (track_id[column[place[1:]]] != track_id[column[place[:-1]]])
    ]
    return objects.order[switched], objects.order[
        np.flatnonzero(_matched_again(objects.follows, column >= 0))
    ]


def _matched_again(follows: Bools, held: Bools) -> Bools:
    """Return True for rows that are matched (``held``) after a gap that followed a match in the same run.

    ``follows`` [R] as in `counted_in_run`.
    """
    before = counted_in_run(follows, held) > held
    return np.asarray(held & follows & ~np.roll(held, 1) & before)


def counted_in_run(follows: Bools, flags: Bools) -> Ints:
    """Return the number of ``flags`` [R] in each row's run of rows, up to the row itself.

    ``follows`` [R]: the row continues the run of the row before.
    """
    count = np.cumsum(flags)
    return np.asarray(
        count - np.maximum.accumulate(np.where(follows, 0, count - flags))
    )


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
    return replace(
        truth,
        object_id=separated(truth.object_id, pieces(scene, card)[truth.frame_of_rows]),
    )


def separated_tracks(rollout: Rollout, scene: Scene, card: Card) -> Rollout:
    """``rollout`` of ``scene``, whose tracks have another identity after a hole."""
    piece = pieces(scene, card)[rollout.tracks.frame_of_rows]
    return replace(rollout, track_id=separated(rollout.track_id, piece))
