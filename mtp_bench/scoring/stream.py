"""Tracking counts of what an agent outputs: the tracks of its best hypothesis of every frame, by their ids as given."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..types import Bools, Floats, Ints, Rollout, Truth
from .events import clear_identity, history, object_history
from .forecasts import match_neutral_last, offer_neutral
from .identity import IdentityCounts, identity_counts
from .lineage import Hypotheses
from .matching import columns_to_rows, match_sticky
from .pairs import Pairs, Rows, box_pairs


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
    identity: IdentityCounts


def stream_counts(truth: Truth, rollout: Rollout, lineage: Hypotheses, card: Card) -> StreamCounts:
    """CLEAR counts (sticky mode) and false output (frame mode) of the best hypothesis of every frame."""
    frame = rollout.tracks.frame_of_rows
    chosen = np.flatnonzero(lineage.member[np.arange(len(frame)), lineage.best[frame]])
    near, similarity, inside = _near_pairs(truth, rollout, frame, chosen, card)
    pairs = near.keep(inside)
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
    excused = ~wrong & (columns_to_rows(matched, len(chosen)) < 0)
    object_of = np.where(truth.neutral, -1, np.unique(truth.object_id, return_inverse=True)[1])
    track_of = np.where(excused, -1, number)
    counted = (object_of[near.row] >= 0) & (track_of[near.column] >= 0)

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
        identity=identity_counts(
            near.keep(counted), similarity[counted], inside[counted], object_of, track_of, truth.class_id, count
        ),
    )


def _near_pairs(truth: Truth, rollout: Rollout, frame: Ints, chosen: Rows, card: Card) -> tuple[Pairs, Floats, Bools]:
    """Pairs of true boxes and the ``chosen`` tracks, their similarity, which is above 0, and which are in the gate."""
    gate, limit = card.task.event_gate, np.array(card.per_class(card.task.event_gate.threshold))
    overlap = gate.measure == "iou_3d"
    reach = np.full(len(limit), 1e-9) if overlap else 2.0 * limit  # half as similar as can be at the gate
    boxes = frame[chosen], rollout.track_box[chosen], rollout.track_class[chosen]
    at = truth.frame_of_rows, truth.box, truth.class_id
    near = box_pairs(*at, *boxes, gate.measure, tuple(reach.tolist()))
    here = limit[truth.class_id[near.row]]
    if overlap:
        return near, 1.0 - near.cost, 1.0 - near.cost >= here
    similarity = 1.0 - near.cost / (2.0 * here)
    positive = similarity > 0
    return near.keep(positive), similarity[positive], (near.cost <= here)[positive]
