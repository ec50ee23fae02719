"""Random changes of detections in the runs whose events weigh targets.

See envs/reference/README.md. Run r removes and moves detections at random, by errors as
large as the detector's; most runs remove low scores too.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..cards import Card
from ..core import Bools, Floats, Ints, Scene, joined
from ..scoring import evaluated, match_objects
from .playing import derived_seed

RUNS = 48
# Of the scores of matched detections: the score thresholds of two thirds of the runs.
QUANTILES = (0.1, 0.25)
DROPPED = 0.05  # share of the detections
SIGMA_LOG_SIZE = 0.05
MAX_SIGMA_YAW_RAD = 0.1
ASSIGNMENTS = ("hungarian", "greedy")
_RAYLEIGH_MEDIAN = 1.177  # of the length of a planar error, per sigma
_NORMAL_MEDIAN = 0.674  # of the size of an error, per sigma
_DIGITS = 6  # of stored numbers; the runs use the rounded ones


@dataclass(frozen=True, eq=False)
class MatchedDetections:
    """Detections [n] matched to a true object, and their errors."""

    class_id: Ints
    score: Floats
    distance: Floats  # m, of the centres
    turn: Floats  # rad, size of the difference in yaw


@dataclass(frozen=True)
class Perturbation:
    """Size of the noise and score thresholds, per class [C]."""

    sigma_xy: tuple[float, ...]  # m
    sigma_yaw: tuple[float, ...]  # rad
    cuts: tuple[tuple[float, ...], ...]  # [quantiles, C] least score

    @classmethod
    def fit(cls, parts: Sequence[MatchedDetections], classes: int) -> "Perturbation":
        """Fit noise and thresholds of ``classes`` classes to matched detections.

        ``parts``: one per scene. A class without matched detections has the values of
        all classes together.
        """
        matched = joined(parts)
        of_class = [matched.class_id == class_id for class_id in range(classes)]
        distance = _quantiles(matched.distance, of_class, 0.5)
        turn = _quantiles(matched.turn, of_class, 0.5)
        cuts = [_quantiles(matched.score, of_class, share) for share in QUANTILES]
        return cls(
            sigma_xy=_rounded(distance / _RAYLEIGH_MEDIAN),
            sigma_yaw=_rounded(np.minimum(MAX_SIGMA_YAW_RAD, turn / _NORMAL_MEDIAN)),
            cuts=tuple(_rounded(cut) for cut in cuts),
        )

    def parameters(
        self, classes: Sequence[str], seeds: Sequence[int]
    ) -> dict[str, Any]:
        """Return all parameters of the runs, as the file of weights stores them."""
        class_cuts = [dict(zip(classes, cut, strict=True)) for cut in self.cuts]
        return {
            "seeds": f"{min(seeds)} to {max(seeds)}",
            "assignment": list(ASSIGNMENTS),
            "dropped": DROPPED,
            "sigma_log_size": SIGMA_LOG_SIZE,
            "sigma_xy": dict(zip(classes, self.sigma_xy, strict=True)),
            "sigma_yaw": dict(zip(classes, self.sigma_yaw, strict=True)),
            "quantiles": [None, *QUANTILES],
            "cuts": [None, *class_cuts],
        }

    def perturbed(self, scene: Scene, run: int) -> Scene:
        """Return ``scene`` with the detections of run ``run``."""
        rng = np.random.default_rng(derived_seed(run, scene.name, "perturbation"))
        detections = scene.detections
        class_id = detections.class_id
        row_mask = rng.random(len(class_id)) >= DROPPED
        # as many runs in a row as assignments have one threshold; 0: without one
        cut_number = (run // len(ASSIGNMENTS)) % (len(self.cuts) + 1)
        if cut_number > 0:
            min_score = np.asarray(self.cuts[cut_number - 1])
            row_mask &= detections.score >= min_score[class_id]
        # of x, y, yaw, length, width and height
        noise = rng.standard_normal((len(class_id), 6))
        box = np.array(detections.box, dtype=np.float64)
        box[:, :2] += noise[:, :2] * np.asarray(self.sigma_xy)[class_id, None]
        box[:, 3] += noise[:, 2] * np.asarray(self.sigma_yaw)[class_id]
        box[:, 4:7] *= np.exp(SIGMA_LOG_SIZE * noise[:, 3:])
        return replace(scene, detections=replace(detections, box=box).select(row_mask))


def matched_detections(scene: Scene, card: Card) -> MatchedDetections:
    """Return the detections matched one to one to evaluated objects.

    A matched detection is inside the forecast gate of its object.
    """
    truth = evaluated(scene).truth
    detections = scene.detections
    object_row = match_objects(
        truth, detections.frame_of_rows, detections.box, detections.class_id, card
    ).object_of_truth
    true_row = np.flatnonzero((object_row >= 0) & ~truth.neutral)
    detection_row = object_row[true_row]
    box_error = detections.box[detection_row] - truth.box[true_row]
    return MatchedDetections(
        class_id=detections.class_id[detection_row],
        score=detections.score[detection_row],
        distance=np.hypot(box_error[:, 0], box_error[:, 1]),
        turn=np.abs(np.arctan2(np.sin(box_error[:, 3]), np.cos(box_error[:, 3]))),
    )


def assignment_of(run: int) -> str:
    """Return the assignment of detections to tracks in run ``run``."""
    return ASSIGNMENTS[run % len(ASSIGNMENTS)]


def _quantiles(values: Floats, of_class: Sequence[Bools], share: float) -> Floats:
    """Return the quantile ``share`` of ``values`` [n] per class [C].

    A class without values gets the quantile of all values, or 0 without any.
    ``of_class`` [C]: mask [n] of the values of each class.
    """
    overall = float(np.quantile(values, share)) if len(values) else 0.0
    quantiles = np.full(len(of_class), overall)
    for class_id, rows in enumerate(of_class):
        if rows.any():
            quantiles[class_id] = np.quantile(values[rows], share)
    return quantiles


def _rounded(values: Floats) -> tuple[float, ...]:
    return tuple(round(float(value), _DIGITS) for value in values)
