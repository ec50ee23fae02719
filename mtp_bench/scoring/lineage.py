"""Lineages of hypotheses: the parent of each hypothesis in the frame before, and the events along the lineage.

An agent states the parent (``hypothesis_parent``), else it is guessed as the hypothesis whose tracks moved least.
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

    A frame without any counts as one hypothesis without tracks, which descends from the best of the frame before.
    """

    alive: Bools  # [F, H]
    member: Bools  # [R, H] tracks of alive hypotheses
    best: Ints  # [F] heaviest; the lowest index among equals
    parent: Ints  # [F, H] hypothesis of the frame before; 0 in frame 0
    stated: Bools  # [F, H] True if the parent is stated or there is no choice; else it is guessed

    @property
    def guessed(self) -> int:
        """Number of frames in which the parent of a hypothesis was guessed among several."""
        choice = self.alive[:-1].sum(axis=1) > 1
        return int(((self.alive & ~self.stated)[1:].any(axis=1) & choice).sum())

    def seen_from(self, t: int) -> Ints:
        """The best hypothesis [F] of each frame; before frame ``t`` those that the best one of ``t`` descends from."""
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
    old: Rows  # [R, H] track of the last match before this frame, without a gap in the truth; -1 none

    @property
    def frag(self) -> Bools:
        """Lost or reacquired [R, H]."""
        return self.lost | self.reacquired

    def of(self, hypothesis: Ints) -> "LineageEvents":
        """The events [R, 1] of one hypothesis per row."""
        index = np.asarray(hypothesis)[:, None]
        kinds = (self.ids, self.lost, self.wrong, self.reacquired)
        ids, lost, wrong, reacquired = (
            np.take_along_axis(kind, index, axis=1) for kind in kinds
        )
        return LineageEvents(
            ids, lost, wrong, reacquired, np.take_along_axis(self.old, index, axis=1)
        )


def hypotheses(rollout: Rollout, card: Card) -> Hypotheses:
    """The hypotheses of a rollout: existence, the best one and the parents."""
    weight = np.asarray(rollout.hypothesis_log_weight, dtype=np.float64)
    alive = np.isfinite(weight)
    if alive.shape[1] == 0:
        alive, weight = (
            np.zeros((len(weight), 1), dtype=bool),
            np.full((len(weight), 1), -np.inf),
        )
    member = np.zeros((len(rollout.track_id), alive.shape[1]), dtype=bool)
    member[:, : rollout.member.shape[1]] = rollout.member
    member &= alive[rollout.tracks.frame_of_rows]
    best = np.argmax(weight, axis=1)
    silent = np.asarray(~alive.any(axis=1))
    alive = alive.copy()
    alive[silent, 0] = True
    parent, stated = _stated_parents(rollout, alive)
    # an empty frame states no parent; a guess would take the hypothesis with the fewest tracks, which loses the least
    later = 1 + np.flatnonzero(silent[1:])
    parent[later, 0], stated[later, 0] = best[later - 1], True
    if alive.shape[1] > 1:
        gates = card.per_class(card.task.forecast_gate)
        # farthest a track may move in a frame [C + 1], m; the last entry is for tracks without a class
        reach = np.array([*gates, max(gates)]) + MAX_SPEED / card.task.rate
        for t in (1 + np.flatnonzero((alive & ~stated)[1:].any(axis=1))).tolist():
            guess = _parents(rollout, member, alive[t - 1], weight[t - 1], t, reach)
            parent[t] = np.where(stated[t], parent[t], guess)
    return Hypotheses(alive, member, best, parent, stated)


def _stated_parents(rollout: Rollout, alive: Bools) -> tuple[Rows, Bools]:
    """Stated parents [F, H], 0 if not stated; and True for stated parents that existed."""
    parent = np.zeros(alive.shape, dtype=np.intp)
    stated = np.zeros(alive.shape, dtype=bool)
    said = np.asarray(rollout.hypothesis_parent)
    if said.shape == alive.shape and len(said):
        known = np.take_along_axis(alive[:-1], np.clip(said[1:], 0, None), axis=1)
        stated[1:] = (said[1:] >= 0) & known
        parent[stated] = said[stated]
    return parent, stated


def match_hypotheses(
    truth: Truth, rollout: Rollout, member: Bools, card: Card
) -> NDArray[np.intp]:
    """Track row of each evaluated true box in each hypothesis [R, H], -1 none; ``frame`` mode, event gate."""
    pairs = event_pairs(truth, rollout, card)
    pairs = pairs.keep(~truth.neutral[pairs.row])
    count = member.shape[1]
    pair, hypothesis = np.nonzero(member[pairs.column])
    spread = Pairs(
        pairs.row[pair] * count + hypothesis,
        pairs.column[pair] * count + hypothesis,
        pairs.cost[pair],
    )
    matched = match(spread, len(truth.box) * count).reshape(-1, count)
    return np.where(matched >= 0, matched // count, -1)


def event_pairs(truth: Truth, rollout: Rollout, card: Card) -> Pairs:
    """Pairs of true boxes and tracks inside the event gate of the card."""
    return gated_pairs(
        truth, rollout.track_start, rollout.track_box, rollout.track_class, card
    )


def gated_pairs(
    truth: Truth, start: Ints, box: Floats, class_id: Ints, card: Card
) -> Pairs:
    """Pairs of the boxes of ``truth`` and other boxes inside the event gate of ``card``.

    ``box`` [n, 7] and ``class_id`` [n] of the others; ``start`` [F + 1]: where the rows of each frame start.
    """
    gate = card.task.event_gate
    at = truth.frame_of_rows, truth.box, truth.class_id
    others = Ragged(start).frame_of_rows, box, class_id
    return box_pairs(*at, *others, gate.measure, card.per_class(gate.threshold))


def lineage_events(
    truth: Truth, rollout: Rollout, lineage: Hypotheses, matched: NDArray[np.intp]
) -> LineageEvents:
    """Events [R, H] of all hypotheses; ``matched`` [R, H] as `match_hypotheses` gives it.

    An object is absent where it is neutral: it has no event there, and none across such frames.
    """
    shape = matched.shape
    ids, lost, wrong, reacquired = (np.zeros(shape, dtype=bool) for _ in range(4))
    earlier = np.full(shape, -1, dtype=np.intp)
    objects, number = np.unique(truth.object_id, return_inverse=True)
    track_id = np.append(rollout.track_id, -1)  # row -1: no track, never compared
    before = np.full(
        (len(objects), shape[1]), -1, dtype=np.intp
    )  # track row in the frame before
    last = before.copy()  # track row of the last match since the object is there
    evaluated = truth.select(~truth.neutral)
    place = np.flatnonzero(~truth.neutral)
    for t in range(evaluated.frames):
        parent, rows = lineage.parent[t], place[evaluated.rows(t)]
        before, last = before[:, parent], last[:, parent]
        who, now = number[rows], matched[rows]
        old, held = before[who], now >= 0  # held: matched to a track
        earlier[rows] = last[who]
        ids[rows] = (old >= 0) & held & (track_id[old] != track_id[now])
        lost[rows] = (old >= 0) & ~held
        reacquired[rows] = held & (last[who] >= 0) & (old < 0)
        if lost[rows].any():
            tracks = rollout.tracks.rows(t)
            same = (
                rollout.track_id[tracks][:, None, None] == track_id[old]
            ) & lineage.member[tracks][:, None]
            wrong[rows] = lost[rows] & same.any(axis=0)
        matches = np.where(held, now, last[who])
        before, last = (
            np.full_like(before, -1),
            np.full_like(last, -1),
        )  # forget objects that are absent in this frame
        before[who], last[who] = now, matches
    alive = lineage.alive[truth.frame_of_rows]
    return LineageEvents(
        ids, lost & alive, wrong & alive, reacquired, earlier
    )  # absent hypotheses have no events


def in_all(
    truth: Truth, lineage: Hypotheses, events: LineageEvents, kind: str
) -> Bools:
    """True boxes [R] that have the event, a field of `LineageEvents`, in every hypothesis that exists."""
    return np.asarray(
        (getattr(events, kind) | ~lineage.alive[truth.frame_of_rows]).all(axis=1)
    )


def _parents(
    rollout: Rollout,
    member: Bools,
    alive: Bools,
    weight: Floats,
    t: int,
    reach: NDArray[np.float64],
) -> Rows:
    """Parent [H] of the hypotheses of frame ``t``, by index.

    Cost of a parent: capped BEV distance summed over the tracks that both hold (same id and class), plus the cap for
    every track that one of them lacks. Equal costs: the heavier, then the lower index.
    """
    now, past = rollout.tracks.rows(t), rollout.tracks.rows(t - 1)
    cap_now, cap_past = (
        reach[rollout.track_class[now]],
        reach[rollout.track_class[past]],
    )
    row, column = np.nonzero(
        (rollout.track_id[now][:, None] == rollout.track_id[past])
        & (rollout.track_class[now][:, None] == rollout.track_class[past])
    )
    gap = rollout.track_box[now][row, :2] - rollout.track_box[past][column, :2]
    moved = np.minimum(np.hypot(gap[:, 0], gap[:, 1]), cap_now[row])
    saved = np.zeros((len(cap_now), len(cap_past)))
    saved[row, column] = cap_now[row] + cap_past[column] - moved
    holds_now, holds_past = (
        member[now].astype(np.float64),
        member[past].astype(np.float64),
    )
    cost = (cap_past @ holds_past)[
        None
    ] - holds_now.T @ saved @ holds_past  # [H now, H past], less what all share
    order = np.lexsort((np.arange(len(weight)), -weight))
    order = order[alive[order]]
    # sums of the same terms in another order differ by rounding: such costs are equal
    return np.asarray(order[np.argmin(np.round(cost[:, order], 6), axis=1)])
