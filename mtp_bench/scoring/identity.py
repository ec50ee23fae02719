"""IDF1 and HOTA of a stream of tracks: counts that are summed over scenes, and the numbers of the sums.

IDF1 (Ristani et al. 2016) pairs whole identities by the frames that they share inside the gate. HOTA (Luiten et al.
2021) is the mean over 19 thresholds of a similarity, which is .5 at a gate of distance, or the overlap itself.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..types import Bools, Floats, Ints
from .matching import match_best
from .pairs import Pairs, Rows

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


def identity_counts(
    pairs: Pairs, similarity: Floats, inside: Bools, objects: Rows, tracks: Rows, class_id: Ints, classes: int
) -> IdentityCounts:
    """Counts of one scene.

    ``pairs`` [E] of true boxes and track boxes of one frame, their ``similarity`` [E] above 0, and which of them are
    ``inside`` [E] the gate. ``objects`` [R] and ``tracks`` [columns]: numbers from 0 on that name the identity of each
    box, -1 for boxes that do not count, which are in no pair. ``class_id`` [R] of the true boxes, below ``classes``.
    """
    life_of_object, life_of_track = (np.bincount(ids[ids >= 0], minlength=1) for ids in (objects, tracks))
    code, of = np.unique(objects[pairs.row] * len(life_of_track) + tracks[pairs.column], return_inverse=True)
    first, second = np.divmod(code, len(life_of_track))
    known = _Identities(of, first, second, (life_of_object[first] + life_of_track[second]).astype(np.float64))
    class_of = np.zeros(len(life_of_object), dtype=np.intp)
    class_of[objects[pairs.row]] = class_id[pairs.row]
    is_class = (class_of[first] == np.arange(classes)[:, None]).astype(np.float64)  # [C, P]
    frames = np.bincount(of[inside], minlength=len(code)).astype(np.float64)
    paired = match_best(Pairs(first, second, -frames).keep(frames > 0), len(life_of_object))[first] == second
    together = _together(pairs, similarity, known, len(objects), len(tracks))
    return IdentityCounts(
        shared=is_class @ (frames * paired),
        hits=is_class @ together,
        association=is_class @ (together**2 / (known.lives[:, None] - together)),
    )


def _together(pairs: Pairs, similarity: Floats, known: _Identities, rows: int, columns: int) -> Floats:
    """Hits [P, 19] of every pair of identities, per threshold."""
    of_row = np.bincount(pairs.row, weights=similarity, minlength=rows)
    of_column = np.bincount(pairs.column, weights=similarity, minlength=columns)
    # how well two identities go together over all frames: the boxes of such are matched first
    joint = similarity / (of_row[pairs.row] + of_column[pairs.column] - similarity)
    total = np.bincount(known.of, weights=joint, minlength=len(known.lives))
    alignment = total / (known.lives - total)
    score = alignment[known.of] * similarity
    hit = match_best(Pairs(pairs.row, pairs.column, -score), rows)[pairs.row] == pairs.column
    steps = len(THRESHOLDS) + 1
    level = np.searchsorted(THRESHOLDS - _EPSILON, similarity[hit], side="right")  # thresholds that it reaches
    table = np.bincount(known.of[hit] * steps + level, minlength=len(known.lives) * steps).reshape(-1, steps)
    return np.asarray(table[:, :0:-1].cumsum(axis=1)[:, ::-1], dtype=np.float64)


def idf1(shared: float, truth: float, tracks: float) -> float | None:
    """IDF1 from counts of boxes; None without any."""
    return 2.0 * shared / (truth + tracks) if truth + tracks else None


def hota(hits: Floats, association: Floats, truth: float, tracks: float) -> float | None:
    """HOTA from counts per threshold [19] and the numbers of boxes; None without any."""
    if not truth + tracks:
        return None
    detection = hits / (truth + tracks - hits)
    return float(np.sqrt(detection * association / np.maximum(hits, 1.0)).mean())
