"""Gains of the allowed pairs of tracks and detections only, from compiled code."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import UnknownNameError
from ..types import Floats, Ints
from .kernels.affinity_kernels import CENTER_DISTANCE, GIOU_3D, IOU_3D, sparse_pairs
from .parameters import ClassParameters

_KINDS: dict[str, int] = {"center_distance": CENTER_DISTANCE, "iou_3d": IOU_3D, "giou_3d": GIOU_3D}


@dataclass(frozen=True, eq=False)
class PairRules:
    """The rules of all classes as arrays, for `kernels.affinity_kernels.sparse_pairs`."""

    kind: Ints  # [C]
    gate: Floats  # [C]


def rules_of(parameters: Sequence[ClassParameters]) -> PairRules:
    """The rules of C classes; raises UnknownNameError for an affinity that does not exist."""
    for rule in parameters:
        if rule.affinity not in _KINDS:
            raise UnknownNameError("affinity", rule.affinity, _KINDS)
    kinds = np.array([_KINDS[rule.affinity] for rule in parameters], dtype=np.int64)
    return PairRules(kinds, np.array([rule.gate for rule in parameters], dtype=np.float64))


def sparse_gains(
    tracks: Floats, track_class: Ints, detections: Floats, detection_class: Ints, rules: PairRules
) -> tuple[Ints, Ints, Floats]:
    """Allowed pairs of track boxes [N, 7] with detected boxes [D, 7]: ``indptr`` [N + 1], ``column`` and ``gain`` [E].

    The pairs of track i are ``indptr[i]:indptr[i + 1]``, by ascending column; the classes [N] and [D] of both must be
    the same. Two boxes without any volume between them, whose GIoU is 0 / 0, may or may not match.
    """
    return sparse_pairs(
        np.require(tracks, np.float64, "W"),  # a view of longer rows will do, but writable
        np.require(track_class, np.int64, ["C", "W"]),
        np.require(detections, np.float64, "W"),
        np.require(detection_class, np.int64, ["C", "W"]),
        rules.kind,
        rules.gate,
    )
