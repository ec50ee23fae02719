"""Tracking counts of what an agent outputs, by the ids of its tracks as given.

They are of the tracks of its best hypothesis of every frame. IDF1 (Ristani et al. 2016)
pairs whole identities by the frames that they share inside the gate. HOTA (Luiten et
al. 2021) is the mean over 19 thresholds of a similarity, which is .5 at a gate of
distance, or the overlap itself.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..core import Bools, Floats, Ints, Rollout, Scene, Truth
from .events import clear_identity, history, object_history
from .forecasts import match_neutral_last, offer_neutral
from .lineage import Hypotheses
from .matching import columns_to_rows, match_best, match_sticky
from .pairs import Pairs, Rows, box_pairs
from .targets import unlabelled

THRESHOLDS = np.arange(1, 20) * 0.05
_EPSILON = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class IdentityCounts:
    """Counts per class [C], by the class of the true box."""

    shared: Floats  # [C] IDTP: boxes of identities that are paired
    hits: Floats  # [C, 19] true boxes with a track, per threshold
    # [C, 19] summed over the hits: how much of both identities the pair makes up
    association: Floats


class _IdentityPairs(NamedTuple):
    """The pairs of an object and a track to which pairs of boxes belong."""

    number: Rows  # [E] number of the pair of identities
    object_id: Rows  # [P] of each pair of identities
    track_id: Rows  # [P]
    boxes: Floats  # [P] boxes of both


@dataclass(frozen=True, eq=False)
class StreamCounts:
    """Counts per class [C + 1].

    The last entry holds track boxes without a stated class.
    """

    truth: Ints
    tp: Ints
    fp: Ints  # a box matched to a neutral one is neither right nor wrong
    fn: Ints
    ids: Ints  # CLEAR-IDS
    frag: Ints  # CLEAR-FRAG
    # summed over matched pairs: m, or 1 - IoU, as the event gate measures
    cost: NDArray[np.float64]
    false_positives: int  # unmatched boxes in frame mode
    false_tracks: int  # ids matched in no frame of their life, in frame mode
    identity: IdentityCounts


def stream_counts(
    scene: Scene, rollout: Rollout, lineage: Hypotheses, card: Card
) -> StreamCounts:
    """Return counts of the best hypothesis of every annotated frame of a scene.

    CLEAR counts are of the sticky mode, false output of the frame mode.
    """
    truth = scene.truth
    frame = rollout.tracks.frame_of_rows
    of_best = lineage.member[np.arange(len(frame)), lineage.best[frame]]
    chosen = np.flatnonzero(of_best & np.isin(frame, scene.annotated_frames))
    chosen_id = rollout.track_id[chosen]
    chosen_class = rollout.track_class[chosen]
    similar, similarity, inside = _similar_pairs(truth, rollout, chosen, card)
    pairs = similar.keep(inside)
    evaluated_pairs = pairs.keep(~truth.neutral[pairs.row])
    place = scene.annotated_place
    objects = object_history(truth, place)
    tracks = history(place[frame[chosen]], chosen_id)
    matched = match_sticky(
        evaluated_pairs, len(truth.box), objects.previous(), tracks.previous()
    )
    switches, fragments = clear_identity(objects, matched, chosen_id)
    row = np.flatnonzero(matched >= 0)
    cost = np.zeros(len(truth.box))
    hit = matched[evaluated_pairs.row] == evaluated_pairs.column
    cost[evaluated_pairs.row[hit]] = evaluated_pairs.cost[hit]
    counts = ~unlabelled(scene, frame[chosen], rollout.track_box[chosen, :2])
    false = offer_neutral(matched, pairs, truth.neutral, len(chosen)).unmatched
    false &= counts
    false_in_frame = match_neutral_last(pairs, truth.neutral, len(chosen)).unmatched
    false_in_frame &= counts
    ids, track_number = np.unique(chosen_id, return_inverse=True)
    matched_frames = np.bincount(
        track_number, weights=~false_in_frame, minlength=len(ids)
    )
    # identity counts leave out neutral objects, and tracks that are matched to them
    at_neutral = ~false & (columns_to_rows(matched, len(chosen)) < 0)
    object_number = np.unique(truth.object_id, return_inverse=True)[1]
    object_number = np.where(truth.neutral, -1, object_number)
    track_number = np.where(at_neutral, -1, track_number)
    counted = (object_number[similar.row] >= 0) & (track_number[similar.column] >= 0)
    classes = len(card.task.classes) + 1

    def per_class(rows: Rows) -> NDArray[np.intp]:
        return np.bincount(truth.class_id[rows], minlength=classes)

    evaluated_count = per_class(np.flatnonzero(~truth.neutral))
    false_class = np.where(chosen_class < 0, classes - 1, chosen_class)[false]
    class_cost = np.bincount(truth.class_id[row], weights=cost[row], minlength=classes)
    return StreamCounts(
        truth=evaluated_count,
        tp=per_class(row),
        fp=np.bincount(false_class, minlength=classes),
        fn=evaluated_count - per_class(row),
        ids=per_class(switches),
        frag=per_class(fragments),
        cost=class_cost.astype(np.float64),
        false_positives=int(false_in_frame.sum()),
        false_tracks=int((matched_frames == 0).sum()),
        identity=identity_counts(
            similar.keep(counted),
            similarity[counted],
            inside[counted],
            object_number,
            track_number,
            truth.class_id,
            classes,
        ),
    )


def _similar_pairs(
    truth: Truth, rollout: Rollout, chosen: Rows, card: Card
) -> tuple[Pairs, Floats, Bools]:
    """Return pairs of true boxes and the ``chosen`` tracks of similarity above 0.

    The other results are the similarity of each pair, and whether it is in the gate.
    """
    gate = card.task.event_gate
    threshold = np.array(card.per_class(gate.threshold))
    by_overlap = gate.measure == "iou_3d"
    # pairs of similarity above 0: any overlap, or distances up to twice the gate
    reach = np.full(len(threshold), 1e-9) if by_overlap else 2.0 * threshold
    pairs = box_pairs(
        truth.frame_of_rows,
        truth.box,
        truth.class_id,
        rollout.tracks.frame_of_rows[chosen],
        rollout.track_box[chosen],
        rollout.track_class[chosen],
        gate.measure,
        tuple(reach.tolist()),
    )
    pair_threshold = threshold[truth.class_id[pairs.row]]
    if by_overlap:
        overlap = 1.0 - pairs.cost
        return pairs, overlap, overlap >= pair_threshold
    similarity = 1.0 - pairs.cost / (2.0 * pair_threshold)
    inside = pairs.cost <= pair_threshold
    positive = similarity > 0
    return pairs.keep(positive), similarity[positive], inside[positive]


def identity_counts(
    pairs: Pairs,
    similarity: Floats,
    inside: Bools,
    objects: Rows,
    tracks: Rows,
    class_id: Ints,
    classes: int,
) -> IdentityCounts:
    """Return the counts of one scene.

    ``pairs`` [E] of true boxes and track boxes of one frame, their ``similarity`` [E]
    above 0, and which of them are ``inside`` [E] the gate. ``objects`` [R] and
    ``tracks`` [columns]: numbers from 0 on that name the identity of each box, -1 for
    boxes that do not count, which are in no pair. ``class_id`` [R] of the true boxes,
    below ``classes``.
    """
    object_boxes = np.bincount(objects[objects >= 0], minlength=1)
    track_boxes = np.bincount(tracks[tracks >= 0], minlength=1)
    code = objects[pairs.row] * len(track_boxes) + tracks[pairs.column]
    codes, index = np.unique(code, return_inverse=True)
    object_id, track_id = np.divmod(codes, len(track_boxes))
    boxes = (object_boxes[object_id] + track_boxes[track_id]).astype(np.float64)
    identities = _IdentityPairs(index, object_id, track_id, boxes)
    object_class = np.zeros(len(object_boxes), dtype=np.intp)
    object_class[objects[pairs.row]] = class_id[pairs.row]
    # [C, P]
    is_class = object_class[object_id] == np.arange(classes)[:, None]
    is_class = is_class.astype(np.float64)
    frames = np.bincount(index[inside], minlength=len(codes)).astype(np.float64)
    shared_pairs = Pairs(object_id, track_id, -frames).keep(frames > 0)
    partner = match_best(shared_pairs, len(object_boxes))
    paired = partner[object_id] == track_id
    hits = _hits(pairs, similarity, identities, len(objects), len(tracks))
    return IdentityCounts(
        shared=is_class @ (frames * paired),
        hits=is_class @ hits,
        association=is_class @ (hits**2 / (boxes[:, None] - hits)),
    )


def _hits(
    pairs: Pairs,
    similarity: Floats,
    identities: _IdentityPairs,
    rows: int,
    columns: int,
) -> Floats:
    """Return the hits [P, 19] of every pair of identities, per threshold."""
    count = len(identities.boxes)
    row_sum = np.bincount(pairs.row, weights=similarity, minlength=rows)
    column_sum = np.bincount(pairs.column, weights=similarity, minlength=columns)
    # how well two identities go together over all frames: the boxes of such are matched
    # first
    joint = similarity / (row_sum[pairs.row] + column_sum[pairs.column] - similarity)
    total = np.bincount(identities.number, weights=joint, minlength=count)
    score = (total / (identities.boxes - total))[identities.number] * similarity
    matched = match_best(Pairs(pairs.row, pairs.column, -score), rows)
    hit = matched[pairs.row] == pairs.column
    # number of thresholds that each hit reaches
    level = np.searchsorted(THRESHOLDS - _EPSILON, similarity[hit], side="right")
    levels = len(THRESHOLDS) + 1
    table = np.bincount(
        identities.number[hit] * levels + level, minlength=count * levels
    ).reshape(-1, levels)
    # a hit of level l counts at the first l thresholds: summed from the right, without
    # level 0
    return np.asarray(table[:, :0:-1].cumsum(axis=1)[:, ::-1], dtype=np.float64)


def idf1(shared: float, truth: float, tracks: float) -> float | None:
    """Return IDF1 from counts of boxes.

    None without any.
    """
    return 2.0 * shared / (truth + tracks) if truth + tracks else None


def hota(
    hits: Floats, association: Floats, truth: float, tracks: float
) -> float | None:
    """Return HOTA from counts per threshold [19] and the numbers of boxes.

    None without any box.
    """
    if not truth + tracks:
        return None
    detection_accuracy = hits / (truth + tracks - hits)
    # association accuracy is the mean over hits
    return float(
        np.sqrt(detection_accuracy * association / np.maximum(hits, 1.0)).mean()
    )
