"""Tracking counts of what an agent outputs: the tracks of its best hypothesis of every frame, by their ids as given.

IDF1 (Ristani et al. 2016) pairs whole identities by the frames that they share inside the gate. HOTA (Luiten et al.
2021) is the mean over 19 thresholds of a similarity, which is .5 at a gate of distance, or the overlap itself.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..core import Bools, Floats, Ints, Rollout, Truth
from .events import clear_identity, history, object_history
from .forecasts import match_neutral_last, offer_neutral
from .lineage import Hypotheses
from .matching import columns_to_rows, match_best, match_sticky
from .pairs import Pairs, Rows, box_pairs

THRESHOLDS = np.arange(1, 20) * 0.05
_EPSILON = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class IdentityCounts:
    """Counts per class [C], by the class of the true box."""

    shared: Floats  # [C] IDTP: boxes of identities that are paired
    hits: Floats  # [C, 19] true boxes with a track, per threshold
    association: Floats  # [C, 19] summed over the hits: how much of both identities the pair makes up


class _Identities(NamedTuple):
    """Which object and which track each pair is of."""

    of: Rows  # [E] number of the pair of identities
    object: Rows  # [P] of each pair of identities
    track: Rows  # [P]
    lives: Floats  # [P] boxes of both


@dataclass(frozen=True, eq=False)
class StreamCounts:
    """Counts per class [C + 1]; the last entry holds track boxes without a stated class."""

    truth: Ints
    tp: Ints
    fp: Ints  # a box matched to a neutral one is neither right nor wrong
    fn: Ints
    ids: Ints  # CLEAR-IDS
    frag: Ints  # CLEAR-FRAG
    cost: NDArray[
        np.float64
    ]  # summed over matched pairs: m, or 1 - IoU, as the event gate measures
    false_positives: int  # unmatched boxes in frame mode
    false_tracks: int  # ids matched in no frame of their life, in frame mode
    identity: IdentityCounts


def stream_counts(
    truth: Truth, rollout: Rollout, lineage: Hypotheses, card: Card
) -> StreamCounts:
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
    object_of = np.where(
        truth.neutral, -1, np.unique(truth.object_id, return_inverse=True)[1]
    )
    track_of = np.where(excused, -1, number)
    counted = (object_of[near.row] >= 0) & (track_of[near.column] >= 0)

    def per_class(rows: Rows) -> NDArray[np.intp]:
        return np.bincount(truth.class_id[rows], minlength=count)

    evaluated = np.flatnonzero(~truth.neutral)
    track_class = rollout.track_class[chosen]
    return StreamCounts(
        truth=per_class(evaluated),
        tp=per_class(row),
        fp=np.bincount(
            np.where(track_class < 0, count - 1, track_class)[wrong], minlength=count
        ),
        fn=per_class(evaluated) - per_class(row),
        ids=per_class(switched),
        frag=per_class(begun),
        cost=np.bincount(
            truth.class_id[row], weights=cost[row], minlength=count
        ).astype(np.float64),
        false_positives=int(in_frame.sum()),
        false_tracks=int(
            (np.bincount(number, weights=~in_frame, minlength=len(ids)) == 0).sum()
        ),
        identity=identity_counts(
            near.keep(counted),
            similarity[counted],
            inside[counted],
            object_of,
            track_of,
            truth.class_id,
            count,
        ),
    )


def _near_pairs(
    truth: Truth, rollout: Rollout, frame: Ints, chosen: Rows, card: Card
) -> tuple[Pairs, Floats, Bools]:
    """Pairs of true boxes and the ``chosen`` tracks, their similarity, which is above 0, and which are in the gate."""
    gate, limit = (
        card.task.event_gate,
        np.array(card.per_class(card.task.event_gate.threshold)),
    )
    overlap = gate.measure == "iou_3d"
    reach = (
        np.full(len(limit), 1e-9) if overlap else 2.0 * limit
    )  # half as similar as can be at the gate
    boxes = frame[chosen], rollout.track_box[chosen], rollout.track_class[chosen]
    at = truth.frame_of_rows, truth.box, truth.class_id
    near = box_pairs(*at, *boxes, gate.measure, tuple(reach.tolist()))
    here = limit[truth.class_id[near.row]]
    if overlap:
        return near, 1.0 - near.cost, 1.0 - near.cost >= here
    similarity = 1.0 - near.cost / (2.0 * here)
    positive = similarity > 0
    return near.keep(positive), similarity[positive], (near.cost <= here)[positive]


def identity_counts(
    pairs: Pairs,
    similarity: Floats,
    inside: Bools,
    objects: Rows,
    tracks: Rows,
    class_id: Ints,
    classes: int,
) -> IdentityCounts:
    """Counts of one scene.

    ``pairs`` [E] of true boxes and track boxes of one frame, their ``similarity`` [E] above 0, and which of them are
    ``inside`` [E] the gate. ``objects`` [R] and ``tracks`` [columns]: numbers from 0 on that name the identity of each
    box, -1 for boxes that do not count, which are in no pair. ``class_id`` [R] of the true boxes, below ``classes``.
    """
    life_of_object, life_of_track = (
        np.bincount(ids[ids >= 0], minlength=1) for ids in (objects, tracks)
    )
    code, of = np.unique(
        objects[pairs.row] * len(life_of_track) + tracks[pairs.column],
        return_inverse=True,
    )
    first, second = np.divmod(code, len(life_of_track))
    known = _Identities(
        of,
        first,
        second,
        (life_of_object[first] + life_of_track[second]).astype(np.float64),
    )
    class_of = np.zeros(len(life_of_object), dtype=np.intp)
    class_of[objects[pairs.row]] = class_id[pairs.row]
    is_class = (class_of[first] == np.arange(classes)[:, None]).astype(
        np.float64
    )  # [C, P]
    frames = np.bincount(of[inside], minlength=len(code)).astype(np.float64)
    paired = (
        match_best(Pairs(first, second, -frames).keep(frames > 0), len(life_of_object))[
            first
        ]
        == second
    )
    together = _together(pairs, similarity, known, len(objects), len(tracks))
    return IdentityCounts(
        shared=is_class @ (frames * paired),
        hits=is_class @ together,
        association=is_class @ (together**2 / (known.lives[:, None] - together)),
    )


def _together(
    pairs: Pairs, similarity: Floats, known: _Identities, rows: int, columns: int
) -> Floats:
    """Hits [P, 19] of every pair of identities, per threshold."""
    of_row = np.bincount(pairs.row, weights=similarity, minlength=rows)
    of_column = np.bincount(pairs.column, weights=similarity, minlength=columns)
    # how well two identities go together over all frames: the boxes of such are matched first
    joint = similarity / (of_row[pairs.row] + of_column[pairs.column] - similarity)
    total = np.bincount(known.of, weights=joint, minlength=len(known.lives))
    score = (total / (known.lives - total))[known.of] * similarity
    hit = (
        match_best(Pairs(pairs.row, pairs.column, -score), rows)[pairs.row]
        == pairs.column
    )
    steps = len(THRESHOLDS) + 1
    level = np.searchsorted(
        THRESHOLDS - _EPSILON, similarity[hit], side="right"
    )  # thresholds that it reaches
    table = np.bincount(
        known.of[hit] * steps + level, minlength=len(known.lives) * steps
    ).reshape(-1, steps)
    return np.asarray(table[:, :0:-1].cumsum(axis=1)[:, ::-1], dtype=np.float64)


def idf1(shared: float, truth: float, tracks: float) -> float | None:
    """IDF1 from counts of boxes; None without any."""
    return 2.0 * shared / (truth + tracks) if truth + tracks else None


def hota(
    hits: Floats, association: Floats, truth: float, tracks: float
) -> float | None:
    """HOTA from counts per threshold [19] and the numbers of boxes; None without any."""
    if not truth + tracks:
        return None
    return float(
        np.sqrt(
            hits / (truth + tracks - hits) * association / np.maximum(hits, 1.0)
        ).mean()
    )
