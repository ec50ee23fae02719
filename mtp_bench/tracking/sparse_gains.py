"""Gains of the allowed pairs of tracks and detections only, from compiled code.

Beside overlap and distance: Mahalanobis distance, and likelihood ratios as multi-hypothesis trackers use.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..errors import ShapeError, UnknownNameError
from ..types import Floats, Ints
from .kernels.affinity_kernels import CENTER_DISTANCE, GIOU_3D, IOU_3D, LIKELIHOOD_RATIO, MAHALANOBIS, sparse_pairs
from .kernels.motion_kernels import MEASUREMENT_VARIANCE
from .parameters import ClassParameters, LikelihoodTerms

_KINDS: dict[str, int] = {
    "center_distance": CENTER_DISTANCE,
    "iou_3d": IOU_3D,
    "giou_3d": GIOU_3D,
    "mahalanobis": MAHALANOBIS,
    "likelihood_ratio": LIKELIHOOD_RATIO,
}


@dataclass(frozen=True, eq=False)
class PairRules:
    """The rules of all classes as arrays, for `kernels.affinity_kernels.sparse_pairs`."""

    kind: Ints  # [C]
    gate: Floats  # [C] largest distance for "likelihood_ratio", in standard deviations
    offset: Floats  # [C] LikelihoodTerms.pair
    miss: Floats  # [C] LikelihoodTerms.miss; 0 for other affinities


def pair_rules(
    affinity: Sequence[str], gate: Sequence[float], terms: Sequence[LikelihoodTerms | None] | None = None
) -> PairRules:
    """Rules of C classes; ``terms`` only for "likelihood_ratio", None takes the defaults.

    Raises UnknownNameError for an affinity that does not exist.
    """
    for name in affinity:
        if name not in _KINDS:
            raise UnknownNameError("affinity", name, _KINDS)
    ratio = [name == "likelihood_ratio" for name in affinity]
    given = [term or LikelihoodTerms() for term in terms or [None] * len(ratio)]
    return PairRules(
        np.array([_KINDS[name] for name in affinity], dtype=np.int64),
        np.array(gate, dtype=np.float64),
        np.array([term.pair if used else 0.0 for used, term in zip(ratio, given, strict=True)]),
        np.array([term.miss if used else 0.0 for used, term in zip(ratio, given, strict=True)]),
    )


@lru_cache(maxsize=64)
def rules_of(parameters: tuple[ClassParameters, ...]) -> PairRules:
    """Rules of all classes of a task."""
    return pair_rules(
        [rule.affinity for rule in parameters],
        [rule.gate for rule in parameters],
        [rule.likelihood for rule in parameters],
    )


def innovation_variance(covariance: Floats) -> Floats:
    """Variance [N] along x, y and z of a detection around a predicted track of ``covariance`` [N, 2, 2]."""
    return np.asarray(covariance[:, 0, 0] + MEASUREMENT_VARIANCE)


def sparse_gains(
    tracks: Floats,
    track_class: Ints,
    detections: Floats,
    detection_class: Ints,
    parameters: tuple[ClassParameters, ...] | PairRules,
    variance: Floats | None = None,
) -> tuple[Ints, Ints, Floats]:
    """Allowed pairs of track boxes [N, 7] with detected boxes [D, 7]: ``indptr`` [N + 1], ``column`` and ``gain`` [E].

    The pairs of track i are ``indptr[i]:indptr[i + 1]``, by ascending column. ``variance`` [N], that of
    `innovation_variance`, is needed for "mahalanobis" (gate - distance in standard deviations) and "likelihood_ratio".
    Two boxes without any volume between them, whose GIoU is 0 / 0, may or may not match. Raises ShapeError where the
    variance is missing.
    """
    rules = parameters if isinstance(parameters, PairRules) else rules_of(parameters)
    if variance is None:
        if (rules.kind >= MAHALANOBIS).any():
            raise ShapeError("no variance of the tracks: 'mahalanobis' and 'likelihood_ratio' need it, shape [N]")
        variance = _NONE
    return sparse_pairs(
        _boxes(tracks),
        _classes(track_class),
        np.require(variance, np.float64, ["C", "W"]),
        _boxes(detections),
        _classes(detection_class),
        rules.kind,
        rules.gate,
        rules.offset,
    )


_NONE = np.zeros(0)


def _boxes(box: Floats) -> Floats:
    """Boxes as compiled code takes them: a view of longer rows will do, but writable."""
    return np.require(box, np.float64, "W")


def _classes(class_id: Ints) -> Ints:
    return np.require(class_id, np.int64, ["C", "W"])
