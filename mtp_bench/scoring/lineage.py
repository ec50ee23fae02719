"""Lineages of hypotheses, and the events along a lineage.

A lineage is the parent of each hypothesis in the frame before. An agent states the
parent (``hypothesis_parent``), else it is guessed as the hypothesis whose tracks moved
least.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..core import Bools, Floats, Ints, Ragged, Rollout, Truth
from .definitions import MAX_SPEED
from .matching import match
from .pairs import Pairs, Rows, box_pairs


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """Hypotheses of a rollout in every frame.

    A frame without any counts as one hypothesis without tracks, which descends from the
    best of the frame before.
    """

    alive: Bools  # [F, H]
    member: Bools  # [R, H] tracks of alive hypotheses
    best: Ints  # [F] heaviest; the lowest index among equals
    parent: Ints  # [F, H] hypothesis of the frame before; 0 in frame 0
    # [F, H] True if the parent is stated or there is no choice; else it is guessed
    stated: Bools

    @property
    def guessed(self) -> int:
        """Number of frames in which a parent was guessed among several hypotheses."""
        has_choice = self.alive[:-1].sum(axis=1) > 1
        unstated = (self.alive & ~self.stated)[1:].any(axis=1)
        return int((unstated & has_choice).sum())

    def seen_from(self, t: int) -> Ints:
        """Return the hypothesis [F] of each frame in the lineage of the best of ``t``.

        After frame ``t`` it is the best of each frame.
        """
        chosen = self.best.copy()
        for frame in range(t, 0, -1):
            chosen[frame - 1] = self.parent[frame, chosen[frame]]
        return chosen


@dataclass(frozen=True, eq=False)
class LineageEvents:
    """Events of every hypothesis along its own lineage, per true box."""

    ids: Bools  # [R, H]
    lost: Bools  # [R, H]
    wrong: Bools  # [R, H] a loss whose old id is still output
    reacquired: Bools  # [R, H]
    # [R, H] track of the last match before this frame, without a gap in the truth; -1
    # none
    old: Rows

    @property
    def frag(self) -> Bools:
        """Lost or reacquired [R, H]."""
        return self.lost | self.reacquired

    def of(self, hypothesis: Ints) -> "LineageEvents":
        """Return the events [R, 1] of one hypothesis per row."""
        index = np.asarray(hypothesis)[:, None]
        return LineageEvents(
            **{
                name: np.take_along_axis(value, index, axis=1)
                for name, value in vars(self).items()
            }
        )


def hypotheses(rollout: Rollout, card: Card) -> Hypotheses:
    """Return the hypotheses of a rollout: existence, the best one and the parents."""
    weight = np.asarray(rollout.hypothesis_log_weight, dtype=np.float64)
    if weight.shape[1] == 0:
        weight = np.full((len(weight), 1), -np.inf)
    alive = np.isfinite(weight)
    member = np.zeros((len(rollout.track_id), alive.shape[1]), dtype=bool)
    member[:, : rollout.member.shape[1]] = rollout.member
    member &= alive[rollout.tracks.frame_of_rows]
    best = np.argmax(weight, axis=1)
    is_empty = np.asarray(~alive.any(axis=1))
    alive[is_empty, 0] = True
    parent, is_stated = _stated_parents(rollout, alive)
    # an empty frame states no parent; a guess would take the hypothesis with the fewest
    # tracks, which loses the least
    empty_frame = 1 + np.flatnonzero(is_empty[1:])
    parent[empty_frame, 0] = best[empty_frame - 1]
    is_stated[empty_frame, 0] = True
    if alive.shape[1] > 1:
        gates = card.per_class(card.task.forecast_gate)
        # farthest a track may move in a frame [C + 1], m; the last entry is for tracks
        # without a class
        reach = np.array([*gates, max(gates)]) + MAX_SPEED / card.task.rate
        unstated = (alive & ~is_stated)[1:].any(axis=1)
        for t in (1 + np.flatnonzero(unstated)).tolist():
            guess = _parents(rollout, member, alive[t - 1], weight[t - 1], t, reach)
            parent[t] = np.where(is_stated[t], parent[t], guess)
    return Hypotheses(alive, member, best, parent, is_stated)


def _stated_parents(rollout: Rollout, alive: Bools) -> tuple[Rows, Bools]:
    """Return stated parents [F, H] and their mask.

    Where none is stated it is 0. A parent that did not exist counts as not stated.
    """
    parent = np.zeros(alive.shape, dtype=np.intp)
    is_stated = np.zeros(alive.shape, dtype=bool)
    stated_parent = np.asarray(rollout.hypothesis_parent)
    if stated_parent.shape == alive.shape and len(stated_parent):
        index = np.clip(stated_parent[1:], 0, None)
        existed = np.take_along_axis(alive[:-1], index, axis=1)
        is_stated[1:] = (stated_parent[1:] >= 0) & existed
        parent[is_stated] = stated_parent[is_stated]
    return parent, is_stated


def match_hypotheses(
    truth: Truth, rollout: Rollout, member: Bools, card: Card
) -> NDArray[np.intp]:
    """Match evaluated true boxes to the tracks of each hypothesis [R, H].

    Rows of tracks, -1 none; ``frame`` mode, event gate.
    """
    pairs = event_pairs(truth, rollout, card)
    pairs = pairs.keep(~truth.neutral[pairs.row])
    count = member.shape[1]
    # every hypothesis has rows and columns of its own, so all are matched at once
    pair, hypothesis = np.nonzero(member[pairs.column])
    pairs = Pairs(
        pairs.row[pair] * count + hypothesis,
        pairs.column[pair] * count + hypothesis,
        pairs.cost[pair],
    )
    matched = match(pairs, len(truth.box) * count).reshape(-1, count)
    return np.where(matched >= 0, matched // count, -1)


def event_pairs(truth: Truth, rollout: Rollout, card: Card) -> Pairs:
    """Return the pairs of true boxes and tracks inside the event gate of the card."""
    return gated_pairs(
        truth, rollout.track_start, rollout.track_box, rollout.track_class, card
    )


def gated_pairs(
    truth: Truth, start: Ints, box: Floats, class_id: Ints, card: Card
) -> Pairs:
    """Return the pairs of true boxes and other boxes inside the event gate.

    ``box`` [n, 7] and ``class_id`` [n] of the others; ``start`` [F + 1]: where the rows
    of each frame start.
    """
    gate = card.task.event_gate
    return box_pairs(
        truth.frame_of_rows,
        truth.box,
        truth.class_id,
        Ragged(start).frame_of_rows,
        box,
        class_id,
        gate.measure,
        card.per_class(gate.threshold),
    )


def lineage_events(
    truth: Truth,
    rollout: Rollout,
    lineage: Hypotheses,
    matched: NDArray[np.intp],
    annotated: Ints,
) -> LineageEvents:
    """Return the events [R, H] of all hypotheses, from one annotated frame to the next.

    ``matched`` [R, H] as `match_hypotheses` gives it; ``annotated``: see
    `Scene.annotated_frames`. An object is absent where it is neutral: it has no event
    there, and none across such frames.
    """
    shape = matched.shape
    ids = np.zeros(shape, dtype=bool)
    is_lost = ids.copy()
    wrong = ids.copy()
    reacquired = ids.copy()
    last_track = np.full(shape, -1, dtype=np.intp)
    objects, object_number = np.unique(truth.object_id, return_inverse=True)
    track_id = np.append(rollout.track_id, -1)  # row -1: no track, never compared
    # [objects, H] track row in the frame before, and of the last match since the object
    # is there
    previous = np.full((len(objects), shape[1]), -1, dtype=np.intp)
    latest = previous.copy()
    evaluated = truth.select(~truth.neutral)
    truth_row = np.flatnonzero(~truth.neutral)
    for t in range(evaluated.frames):
        parent = lineage.parent[t]
        previous = previous[:, parent]
        latest = latest[:, parent]
        if t not in annotated:
            continue
        rows = truth_row[evaluated.rows(t)]
        index = object_number[rows]
        track = matched[rows]
        previous_track = previous[index]
        old_track = latest[index]
        is_matched = track >= 0
        was_matched = previous_track >= 0
        other_id = track_id[previous_track] != track_id[track]
        last_track[rows] = old_track
        ids[rows] = was_matched & is_matched & other_id
        is_lost[rows] = was_matched & ~is_matched
        reacquired[rows] = is_matched & (old_track >= 0) & ~was_matched
        if is_lost[rows].any():
            tracks = rollout.tracks.rows(t)
            output = rollout.track_id[tracks][:, None, None] == track_id[previous_track]
            output &= lineage.member[tracks][:, None]
            wrong[rows] = is_lost[rows] & output.any(axis=0)
        # forget objects that are absent in this frame
        previous = np.full_like(previous, -1)
        latest = previous.copy()
        previous[index] = track
        latest[index] = np.where(is_matched, track, old_track)
    # absent hypotheses have no events
    alive = lineage.alive[truth.frame_of_rows]
    return LineageEvents(ids, is_lost & alive, wrong & alive, reacquired, last_track)


def in_all(
    truth: Truth, lineage: Hypotheses, events: LineageEvents, kind: str
) -> Bools:
    """Return True [R] for true boxes that have the event in every alive hypothesis.

    ``kind``: a field of `LineageEvents`.
    """
    absent = ~lineage.alive[truth.frame_of_rows]
    return np.asarray((getattr(events, kind) | absent).all(axis=1))


def _parents(
    rollout: Rollout,
    member: Bools,
    alive: Bools,
    weight: Floats,
    t: int,
    reach: NDArray[np.float64],
) -> Rows:
    """Return the parent [H] of the hypotheses of frame ``t``, by index.

    Cost of a parent: capped BEV distance summed over the tracks that both hold (same id
    and class), plus the cap for every track that one of them lacks. Equal costs: the
    heavier, then the lower index.
    """
    present = rollout.tracks.rows(t)
    past = rollout.tracks.rows(t - 1)
    cap_now = reach[rollout.track_class[present]]
    cap_past = reach[rollout.track_class[past]]
    same_id = rollout.track_id[present][:, None] == rollout.track_id[past]
    same_class = rollout.track_class[present][:, None] == rollout.track_class[past]
    row, column = np.nonzero(same_id & same_class)
    offset = rollout.track_box[present][row, :2] - rollout.track_box[past][column, :2]
    distance = np.minimum(np.hypot(offset[:, 0], offset[:, 1]), cap_now[row])
    saved = np.zeros((len(cap_now), len(cap_past)))
    saved[row, column] = cap_now[row] + cap_past[column] - distance
    member_now = member[present].astype(np.float64)
    member_past = member[past].astype(np.float64)
    # [H now, H past], less what all share
    cost = (cap_past @ member_past)[None] - member_now.T @ saved @ member_past
    order = np.lexsort((np.arange(len(weight)), -weight))
    order = order[alive[order]]
    # sums of the same terms in another order differ by rounding: such costs are equal
    return np.asarray(order[np.argmin(np.round(cost[:, order], 6), axis=1)])
