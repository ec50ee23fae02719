"""Tracks shared by hypotheses, and the objects that they agree are there."""

from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

from .arrays import Bools, Floats, Ints

UNBORN = -2  # in `Tracks.past_detection`: the track was not there yet
_NOT_BY_TRACK = ("member", "log_weight", "parent", "affinity")
_ROUNDING = 1e-9  # the weights of all hypotheses sum to 1 only up to rounding


class Affinity(NamedTuple):
    """Gains of a tracker's association, for allowed pairs of old track and detection."""

    before: Ints  # [N] the old track that each track continues, -1 for a new one
    start: Ints  # [M + 1] where the pairs of each of M old tracks begin
    detection: Ints  # [E] row of the observation
    gain: Floats  # [E] above 0, the larger the better


@dataclass(frozen=True, eq=False)
class Tracks:
    """State of a tracker after a frame: distinct tracks (leaves) in hypotheses."""

    # [N] identity along the lineage of a hypothesis; one hypothesis never holds it
    # twice
    track_id: Ints
    box: Floats  # [N, 7] now
    class_id: Ints  # [N]
    score: Floats  # [N] mean score of the detections that the track took
    detection: Ints  # [N] the detection of this frame that the track took, -1 for none
    # [N, P, 7] the detections that the track took, oldest first, the last row is now
    past: Floats
    past_valid: Bools  # [N, P] False: no detection taken, or not yet born
    member: Bools  # [H, N]
    log_weight: Floats  # [H] normalised, heaviest first
    # [H] hypothesis of the frame before, by its row there, that it descends from
    parent: Ints | None = None
    last_score: Floats | None = None  # [N] of the last detection that the track took
    hits: Ints | None = None  # [N] detections that the track took
    age: Ints | None = None  # [N] frames since its first detection, this one included
    # [N, P] detection taken, its row in that frame's observation; -1: none, UNBORN
    past_detection: Ints | None = None
    # [N, 2, 2] of position (m) and velocity (m/frame), per axis, as the filter says
    covariance: Floats | None = None
    affinity: Affinity | None = None

    def select(self, rows: Ints) -> "Tracks":
        """Return the tracks ``rows``, in this order.

        The hypotheses hold those of their tracks that are selected.
        """
        columns: dict[str, Any] = {"member": self.member[:, rows]}
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name not in _NOT_BY_TRACK and value is not None:
                columns[field.name] = value[rows]
        if self.affinity is not None:
            before = self.affinity.before[rows]
            columns["affinity"] = self.affinity._replace(before=before)
        return replace(self, **columns)

    @classmethod
    def of_one_hypothesis(
        cls, track_id: Ints, box: Floats, class_id: Ints, **fields: Any
    ) -> "Tracks":
        """Return tracks of these identities [N], boxes [N, 7] and classes [N].

        All are in one hypothesis. ``fields``: further ones; without them the tracks
        have no past, and took no detection.
        """
        n = len(box)
        columns: dict[str, Any] = {
            "score": np.ones(n),
            "detection": np.full(n, -1),
            "past": box[:, None],
            "past_valid": np.zeros((n, 1), dtype=bool),
            "member": np.ones((1, n), dtype=bool),
            "log_weight": np.zeros(1),
        }
        return cls(track_id, box, class_id, **(columns | fields))


@dataclass(frozen=True, eq=False)
class Objects:
    """Objects of this frame according to all hypotheses, likeliest first."""

    box: Floats  # [O, 7] in the heaviest hypothesis that holds the object
    class_id: Ints  # [O]
    score: Floats  # [O] of the track in that hypothesis
    # [O, H] the track that stands for the object in each hypothesis, -1 where it holds
    # none
    leaf: Ints
    log_mass: Floats  # [O] total weight of the hypotheses that hold the object


def group(tracks: Tracks, most: int, min_mass: float = 0.0) -> Objects:
    """Return at most ``most`` objects of weight ``min_mass`` or more.

    Tracks of different hypotheses are one object if they took the same detection. A
    track that took none stands, in its hypothesis, for the object whose detection its
    identity took elsewhere (in the heaviest hypothesis that knows one), unless another
    track took that detection there: then it is an object of its own, as in a single
    hypothesis.
    """
    leaf = np.concatenate([_by_detection(tracks), _by_identity(tracks)])
    _move_coasting(tracks, leaf)
    in_hypothesis = leaf >= 0
    # as logarithms: an object of very unlikely hypotheses must not come to a mass of 0
    log_weight = np.where(in_hypothesis, tracks.log_weight, -np.inf)
    log_mass = np.logaddexp.reduce(log_weight, axis=1)
    order = np.argsort(-log_mass, kind="stable")
    is_likely = np.exp(log_mass[order]) >= min_mass - _ROUNDING
    order = order[is_likely & in_hypothesis[order].any(axis=1)][:most]
    first = leaf[order, in_hypothesis[order].argmax(axis=1)]
    return Objects(
        tracks.box[first],
        tracks.class_id[first],
        tracks.score[first],
        leaf[order],
        log_mass[order],
    )


def _by_detection(tracks: Tracks) -> Ints:
    """Return the track [D, H] that took each detection, or -1."""
    shape = (_detection_count(tracks), len(tracks.member))
    table = np.full(shape, -1, dtype=np.int64)
    hypothesis, track = np.nonzero(tracks.member & (tracks.detection >= 0))
    table[tracks.detection[track], hypothesis] = track
    return table


def _by_identity(tracks: Tracks) -> Ints:
    """Return the track [I, H] of identities without detection, or -1.

    Rows are distinct identities, columns hypotheses.
    """
    coasting = np.flatnonzero(tracks.detection < 0)
    identities, row = np.unique(tracks.track_id[coasting], return_inverse=True)
    table = np.full((len(identities), len(tracks.member)), -1, dtype=np.int64)
    hypothesis, column = np.nonzero(tracks.member[:, coasting])
    table[row[column], hypothesis] = coasting[column]
    return table


def _detection_count(tracks: Tracks) -> int:
    """Count the detections up to the last one that a track took."""
    return int(tracks.detection.max(initial=-1)) + 1


def _move_coasting(tracks: Tracks, leaf: Ints) -> None:
    """Let tracks without detection stand for the object with their identity.

    They do so in hypotheses in which the object has no other track. ``leaf`` is changed
    in place: its first rows are of detections, the others of identities.
    """
    detection_count = _detection_count(tracks)
    with_detection = np.flatnonzero(tracks.detection >= 0)
    heaviest = tracks.member.argmax(axis=0)[with_detection]
    # of equal ids a dict keeps the last row: that of the heaviest hypothesis
    rows = with_detection[np.argsort(heaviest, kind="stable")[::-1]]
    ids = tracks.track_id[rows].tolist()
    detection_of_id = dict(zip(ids, tracks.detection[rows].tolist(), strict=True))
    coasting = leaf[detection_count:]
    coasting_ids = tracks.track_id[coasting.max(axis=1)].tolist()
    for row, track_id in zip(coasting, coasting_ids, strict=True):
        target = detection_of_id.get(track_id)
        if target is not None:
            is_free = (row >= 0) & (leaf[target] < 0)
            leaf[target, is_free] = row[is_free]
            row[is_free] = -1
