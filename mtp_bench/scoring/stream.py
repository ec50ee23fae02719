"""CLEAR counts of what an agent outputs: the tracks of its best hypothesis of every frame, by their ids as given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..types import Ints, Rollout, Truth
from .events import clear_identity, history, object_history
from .forecasts import match_neutral_last, offer_neutral
from .lineage import Hypotheses, event_pairs
from .matching import match_sticky
from .pairs import Rows, of_columns


@dataclass(frozen=True, eq=False)
class StreamCounts:
    """Counts per class [C + 1]; the last entry holds track boxes without a stated class."""

    truth: Ints
    tp: Ints
    fp: Ints  # a box matched to a neutral one is neither right nor wrong
    fn: Ints
    ids: Ints  # CLEAR-IDS
    frag: Ints  # CLEAR-FRAG
    cost: NDArray[np.float64]  # summed over matched pairs: m, or 1 - IoU, as the event gate measures
    false_positives: int  # unmatched boxes in frame mode
    false_tracks: int  # ids matched in no frame of their life, in frame mode


def stream_counts(truth: Truth, rollout: Rollout, lineage: Hypotheses, card: Card) -> StreamCounts:
    """CLEAR counts (sticky mode) and false output (frame mode) of the best hypothesis of every frame."""
    frame = rollout.tracks.frame_of_rows
    chosen = np.flatnonzero(lineage.member[np.arange(len(frame)), lineage.best[frame]])
    pairs = of_columns(event_pairs(truth, rollout, card), chosen, len(frame))
    own = pairs.keep(~truth.neutral[pairs.row])
    objects = object_history(truth)
    tracks = history(frame[chosen], rollout.track_id[chosen])
    matched = match_sticky(own, len(truth.box), objects.previous(), tracks.previous())
    switched, begun = clear_identity(objects, matched, rollout.track_id[chosen])
    row = np.flatnonzero(matched >= 0)
    cost = np.zeros(len(truth.box))
    hit = matched[own.row] == own.column
    cost[own.row[hit]] = own.cost[hit]
    wrong = offer_neutral(matched, pairs, truth.neutral, len(chosen)).unmatched
    in_frame = match_neutral_last(pairs, truth.neutral, len(chosen)).unmatched
    ids, number = np.unique(rollout.track_id[chosen], return_inverse=True)
    count = len(card.task.classes) + 1

    def per_class(rows: Rows) -> NDArray[np.intp]:
        return np.bincount(truth.class_id[rows], minlength=count)

    evaluated = np.flatnonzero(~truth.neutral)
    track_class = rollout.track_class[chosen]
    return StreamCounts(
        truth=per_class(evaluated),
        tp=per_class(row),
        fp=np.bincount(np.where(track_class < 0, count - 1, track_class)[wrong], minlength=count),
        fn=per_class(evaluated) - per_class(row),
        ids=per_class(switched),
        frag=per_class(begun),
        cost=np.bincount(truth.class_id[row], weights=cost[row], minlength=count).astype(np.float64),
        false_positives=int(in_frame.sum()),
        false_tracks=int((np.bincount(number, weights=~in_frame, minlength=len(ids)) == 0).sum()),
    )
