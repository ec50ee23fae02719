"""Tracks shared by hypotheses, and the objects that they agree are there."""

from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

from .arrays import Bools, Floats, Ints

UNBORN = -2  # in `Tracks.past_detection`: the track was not there yet
_NOT_BY_TRACK = ("member", "log_weight", "parent", "affinity")
_ROUNDING = 1e-9  # the weights of all hypotheses sum to 1 only up to rounding


class Affinity(NamedTuple):
    """Gains of a tracker's association: for each allowed pair of a predicted old track and a detection."""

    before: Ints  # [N] the old track that each track continues, -1 for a new one
    start: Ints  # [M + 1] where the pairs of each of M old tracks begin
    detection: Ints  # [E] row of the observation
    gain: Floats  # [E] above 0, the larger the better


@dataclass(frozen=True, eq=False)
class Tracks:
    """State of a tracker after a frame: distinct tracks (leaves) and the hypotheses that share them."""

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
    parent: Ints | None = (
        # [H] hypothesis of the frame before, by its row there, that it descends from
        None
    )
    last_score: Floats | None = None  # [N] of the last detection that the track took
    hits: Ints | None = None  # [N] detections that the track took
    age: Ints | None = None  # [N] frames since its first detection, this one included
    past_detection: Ints | None = (
        # [N, P] detection taken, its row in that frame's observation; -1: none, UNBORN
        None
    )
    covariance: Floats | None = (
        # [N, 2, 2] of position (m) and velocity (m/frame), per axis, as the filter says
        None
    )
    affinity: Affinity | None = None

    def select(self, rows: Ints) -> "Tracks":
        """The tracks ``rows``, in this order; the hypotheses hold what is left of theirs."""
        aligned = [f.name for f in fields(self) if f.name not in _NOT_BY_TRACK]
        parts = {
            name: value[rows]
            for name in aligned
            if (value := getattr(self, name)) is not None
        }
        pairs = (
            None
            if self.affinity is None
            else self.affinity._replace(before=self.affinity.before[rows])
        )
        return replace(self, **parts, member=self.member[:, rows], affinity=pairs)

    @classmethod
    def of_one_hypothesis(
        cls, track_id: Ints, box: Floats, class_id: Ints, **fields: Any
    ) -> "Tracks":
        """Tracks of these identities [N], boxes [N, 7] and classes [N], all in one hypothesis.

        ``fields``: further ones; without them the tracks have no past, and took no
        detection.
        """
        n = len(box)
        bare: dict[str, Any] = {
            "score": np.ones(n),
            "detection": np.full(n, -1),
            "past": box[:, None],
        }
        bare |= {"past_valid": np.zeros((n, 1), dtype=bool), **fields}
        return cls(
            track_id,
            box,
            class_id,
            member=np.ones((1, n), dtype=bool),
            log_weight=np.zeros(1),
            **bare,
        )


@dataclass(frozen=True, eq=False)
class Objects:
    """Objects of this frame according to all hypotheses together, likeliest first."""

    box: Floats  # [O, 7] in the heaviest hypothesis that holds the object
    class_id: Ints  # [O]
    score: Floats  # [O] of the track in that hypothesis
    # [O, H] the track that stands for the object in each hypothesis, -1 where it holds
    # none
    leaf: Ints
    log_mass: Floats  # [O] total weight of the hypotheses that hold the object


def group(tracks: Tracks, most: int, min_mass: float = 0.0) -> Objects:
    """The at most ``most`` objects held by hypotheses of a total weight of at least ``min_mass``.

    Tracks of different hypotheses are one object if they took the same detection. A
    track that took none stands, in its hypothesis, for the object whose detection its
    identity took elsewhere (in the heaviest hypothesis that knows one), unless another
    track took that detection there: then it is an object of its own, as in a single
    hypothesis.
    """
    leaf = np.concatenate([_by_detection(tracks), _by_identity(tracks)])
    _move_coasting(tracks, leaf)
    held = leaf >= 0
    # As logarithms: an object of very unlikely hypotheses must not come to a mass of 0.
    log_mass = np.logaddexp.reduce(np.where(held, tracks.log_weight, -np.inf), axis=1)
    order = np.argsort(-log_mass, kind="stable")
    enough = np.exp(log_mass[order]) >= min_mass - _ROUNDING
    order = order[enough & held[order].any(axis=1)][:most]
    first = leaf[order, held[order].argmax(axis=1)]
    return Objects(
        tracks.box[first],
        tracks.class_id[first],
        tracks.score[first],
        leaf[order],
        log_mass[order],
    )


def _by_detection(tracks: Tracks) -> Ints:
    """The track [D, H] that took each detection in each hypothesis, -1 for none."""
    table = np.full(
        (int(tracks.detection.max(initial=-1)) + 1, len(tracks.member)),
        -1,
        dtype=np.int64,
    )
    hypothesis, track = np.nonzero(tracks.member & (tracks.detection >= 0))
    table[tracks.detection[track], hypothesis] = track
    return table


def _by_identity(tracks: Tracks) -> Ints:
    """The track [I, H] without a detection of each distinct identity in each hypothesis, -1 for none."""
    coasting = np.flatnonzero(tracks.detection < 0)
    identities, row = np.unique(tracks.track_id[coasting], return_inverse=True)
    table = np.full((len(identities), len(tracks.member)), -1, dtype=np.int64)
    hypothesis, place = np.nonzero(tracks.member[:, coasting])
    table[row[place], hypothesis] = coasting[place]
    return table


def _move_coasting(tracks: Tracks, leaf: Ints) -> None:
    """Let tracks without a detection stand for the object that their identity is elsewhere, where that is free."""
    detections = int(tracks.detection.max(initial=-1)) + 1
    taken = np.flatnonzero(tracks.detection >= 0)
    rank = tracks.member.argmax(axis=0)[
        taken
    ]  # the heaviest hypothesis that holds the track
    last = taken[
        np.argsort(rank, kind="stable")[::-1]
    ]  # of an identity the heaviest stays
    home = dict(
        zip(
            tracks.track_id[last].tolist(), tracks.detection[last].tolist(), strict=True
        )
    )
    identity = tracks.track_id[leaf[detections:].max(axis=1)].tolist()
    for row, target in zip(leaf[detections:], map(home.get, identity), strict=True):
        if target is not None:
            free = (row >= 0) & (leaf[target] < 0)
            leaf[target, free] = row[free]
            row[free] = -1
