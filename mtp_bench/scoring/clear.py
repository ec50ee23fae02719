"""CLEAR MOT, IDF1 and HOTA: the field's tracking numbers, for reference (protocol, "Events")."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import ShapeError
from .events import clear_identity, find_events
from .frames import Frame, Frames, read_frames
from .matching import match, match_sticky
from .pairs import Pairs, near_pairs

Mode = Literal["frame", "sticky"]


def tracking_counts(frames: Iterable[Frame], gate: float = 2.0, mode: Mode = "frame") -> dict[str, int | float | None]:
    """``TP FP FN IDS FRAG MOTA MOTP ids lost reacquired`` of tracks against truth, by BEV centre distance.

    ``frames`` iterates (scene, t, true ids [M], true xy [M, 2], track ids [N], track xy [N, 2]) in metres; ids are
    integers or strings; lists or arrays, which may be empty; scenes may be interleaved. ``gate`` is inclusive. All
    numbers come from the matching of ``mode``: "frame" has no memory, "sticky" keeps the pairs of the previous frame.
    ``IDS`` and ``FRAG`` are CLEAR's, ``ids``, ``lost`` and ``reacquired`` the protocol's events; MOTP is the mean
    distance of matched pairs, metres. MOTA is None without truth, MOTP without a match. Raises ShapeError for a
    negative gate, an unknown mode, a position that is not finite or an id twice in a frame.
    """
    given, pairs = _candidates(frames, gate)
    truth, tracks = given.truth, given.tracks
    if mode == "frame":
        matched = match(pairs, len(truth))
    elif mode == "sticky":
        matched = match_sticky(pairs, len(truth), truth.history.previous(), tracks.history.previous())
    else:
        raise ShapeError(f"mode is {mode!r}, expected 'frame' or 'sticky'")
    events = find_events(truth.history, matched, tracks.history, tracks.identity)
    switches, fragments = clear_identity(truth.history, matched, tracks.identity)
    row = np.flatnonzero(matched >= 0)
    tp = len(row)
    fn, fp = len(truth) - tp, len(tracks) - tp
    gap = truth.xy[row] - tracks.xy[matched[row]]
    return {
        "TP": tp,
        "FP": fp,
        "FN": fn,
        "IDS": len(switches),
        "FRAG": len(fragments),
        "MOTA": 1.0 - (fn + fp + len(switches)) / len(truth) if len(truth) else None,
        "MOTP": float(np.hypot(gap[:, 0], gap[:, 1]).mean()) if tp else None,
        "ids": len(events.ids),
        "lost": len(events.lost),
        "reacquired": len(events.reacquired),
    }


def identity_scores(frames: Iterable[Frame], gate: float = 2.0) -> dict[str, float | None]:
    """``IDF1 HOTA DetA AssA`` of tracks against truth; None where there is neither truth nor track.

    IDF1 (Ristani et al. 2016) pairs whole identities by the frames they share inside the gate. HOTA (Luiten et al.
    2021) is the mean over 19 thresholds of a similarity 1 - d / (2 gate), so that 0.5 lies at the gate; scenes are
    pooled. ``frames`` and errors as in `tracking_counts`.
    """
    given, _ = _candidates(frames, gate)
    truth, tracks = given.truth, given.tracks
    if len(truth) + len(tracks) == 0:
        return {"IDF1": None, "HOTA": None, "DetA": None, "AssA": None}
    # similarity is above 0 nearer than twice the gate
    near = near_pairs(truth.frame, truth.xy, tracks.frame, tracks.xy, 2.0 * gate)
    pairs = Pairs(*near)
    similarity: NDArray[np.float64] = 1.0 - near[2] / (2.0 * gate) if gate > 0 else (near[2] == 0).astype(np.float64)
    return {"IDF1": _idf1(given, pairs.keep(pairs.cost <= gate)), **_hota(given, pairs, similarity)}


def _candidates(frames: Iterable[Frame], gate: float) -> tuple[Frames, Pairs]:
    if not (np.isfinite(gate) and gate >= 0):
        raise ShapeError(f"gate is {gate}, expected a distance of 0 m or more")
    given = read_frames(frames)
    truth, tracks = given.truth, given.tracks
    return given, Pairs(*near_pairs(truth.frame, truth.xy, tracks.frame, tracks.xy, gate))


def _shared(given: Frames, pairs: Pairs, weight: NDArray[np.float64]) -> tuple[Pairs, NDArray[np.intp]]:
    """Summed weight of each pair of identities (as a negative cost), and the pair of identities of each pair."""
    objects, row = np.unique(given.truth.identity[pairs.row], return_inverse=True)
    names, column = np.unique(given.tracks.identity[pairs.column], return_inverse=True)
    code, which = np.unique(row * len(names) + column, return_inverse=True)
    total = np.bincount(which, weights=weight, minlength=len(code)).astype(np.float64)
    return Pairs(objects[code // max(1, len(names))], names[code % max(1, len(names))], total), which


def _idf1(given: Frames, pairs: Pairs) -> float:
    """2 IDTP / (true boxes + track boxes) with the assignment of identities that shares most frames."""
    shared, _ = _shared(given, pairs, np.ones(len(pairs)))
    return 2.0 * _most(shared) / (len(given.truth) + len(given.tracks))


def _most(shared: Pairs) -> float:
    """Greatest total of a one-to-one choice of pairs of identities."""
    from scipy.optimize import linear_sum_assignment

    if len(shared) == 0:
        return 0.0
    rows, i = np.unique(shared.row, return_inverse=True)
    columns, j = np.unique(shared.column, return_inverse=True)
    dense = np.zeros((len(rows), len(columns)))
    dense[i, j] = shared.cost
    return float(dense[linear_sum_assignment(dense, maximize=True)].sum())


def _hota(given: Frames, pairs: Pairs, similarity: NDArray[np.float64]) -> dict[str, float | None]:
    from scipy.optimize import linear_sum_assignment

    truth, tracks = given.truth, given.tracks
    life_row = np.unique(truth.identity, return_inverse=True, return_counts=True)
    life_column = np.unique(tracks.identity, return_inverse=True, return_counts=True)
    of_row, of_column = life_row[2][life_row[1]], life_column[2][life_column[1]]
    # how well two identities go together over all frames: matching prefers such pairs
    total_row = np.bincount(pairs.row, weights=similarity, minlength=len(truth))
    total_column = np.bincount(pairs.column, weights=similarity, minlength=len(tracks))
    joint = similarity / (total_row[pairs.row] + total_column[pairs.column] - similarity)
    shared, which = _shared(given, pairs, joint)
    alignment = shared.cost[which] / (of_row[pairs.row] + of_column[pairs.column] - shared.cost[which])
    chosen = np.zeros(len(pairs), dtype=bool)
    frame = truth.frame[pairs.row]
    for part in np.split(np.arange(len(pairs)), np.flatnonzero(np.diff(frame)) + 1):
        rows, i = np.unique(pairs.row[part], return_inverse=True)
        columns, j = np.unique(pairs.column[part], return_inverse=True)
        score, index = np.zeros((len(rows), len(columns))), np.full((len(rows), len(columns)), -1)
        score[i, j], index[i, j] = (alignment * similarity)[part], part
        picked = index[linear_sum_assignment(score, maximize=True)]
        chosen[picked[picked >= 0]] = True
    values = [
        _hota_at(
            chosen & (similarity >= alpha - np.finfo(float).eps),
            which,
            of_row[pairs.row],
            of_column[pairs.column],
            given,
        )
        for alpha in np.arange(1, 20) * 0.05
    ]
    hota, deta, assa = np.mean(values, axis=0)
    return {"HOTA": float(hota), "DetA": float(deta), "AssA": float(assa)}


def _hota_at(
    hit: NDArray[np.bool_],
    which: NDArray[np.intp],
    of_row: NDArray[np.intp],
    of_column: NDArray[np.intp],
    given: Frames,
) -> tuple[float, float, float]:
    """HOTA, DetA and AssA at one threshold."""
    tp = int(hit.sum())
    detection = tp / (len(given.truth) + len(given.tracks) - tp)
    if tp == 0:
        return 0.0, detection, 0.0
    together = np.bincount(which, weights=hit, minlength=1)[which[hit]]
    association = float((together / (of_row[hit] + of_column[hit] - together)).mean())
    return float(np.sqrt(detection * association)), detection, association
