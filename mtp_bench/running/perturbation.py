"""Random changes of detections in the runs whose events weigh targets (envs/reference/README.md).

Run r removes and moves detections at random, by errors as large as the detector's; most runs remove low scores too.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..core import Bools, Floats, Ints, Scene, joined
from ..scoring import evaluated, match_objects
from .playing import derived_seed

RUNS = 48
QUANTILES = (
    0.1,
    0.25,
)  # of the scores of matched detections: the score thresholds of two thirds of the runs
DROPPED = 0.05  # share of the detections
LOG_SIZE = 0.05
MOST_YAW = 0.1  # rad
ASSIGNMENTS = ("hungarian", "greedy")
_MEDIAN_OF_RAYLEIGH = 1.177  # of the length of a planar error, per sigma
_MEDIAN_OF_NORMAL = 0.674  # of the size of an error, per sigma
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
        """Noise and score thresholds of ``classes`` classes from the matched detections of all scenes.

        A class without matched detections has the values of all classes together.
        """
        found = joined(parts)
        own = [found.class_id == c for c in range(classes)]
        return cls(
            sigma_xy=_rounded(
                _quantiles(found.distance, own, 0.5) / _MEDIAN_OF_RAYLEIGH
            ),
            sigma_yaw=_rounded(
                np.minimum(
                    MOST_YAW, _quantiles(found.turn, own, 0.5) / _MEDIAN_OF_NORMAL
                )
            ),
            cuts=tuple(
                _rounded(_quantiles(found.score, own, share)) for share in QUANTILES
            ),
        )

    def parameters(
        self, classes: Sequence[str], seeds: Sequence[int]
    ) -> dict[str, Any]:
        """All parameters of the runs, as the file of weights stores them."""
        return {
            "seeds": f"{min(seeds)} to {max(seeds)}",
            "assignment": list(ASSIGNMENTS),
            "dropped": DROPPED,
            "sigma_log_size": LOG_SIZE,
            "sigma_xy": dict(zip(classes, self.sigma_xy, strict=True)),
            "sigma_yaw": dict(zip(classes, self.sigma_yaw, strict=True)),
            "quantiles": [None, *QUANTILES],
            "cuts": [
                None,
                *(dict(zip(classes, cut, strict=True)) for cut in self.cuts),
            ],
        }

    def perturbed(self, scene: Scene, run: int) -> Scene:
        """``scene`` with the detections of run ``run``."""
        rng = np.random.default_rng(derived_seed(run, scene.name, "perturbation"))
        seen = scene.detections
        kind = (run // len(ASSIGNMENTS)) % (len(self.cuts) + 1)
        kept = rng.random(len(seen.box)) >= DROPPED
        if kind > 0:
            kept &= seen.score >= np.asarray(self.cuts[kind - 1])[seen.class_id]
        noise = rng.standard_normal((len(seen.box), 6))
        box = np.array(seen.box, dtype=np.float64)
        box[:, :2] += noise[:, :2] * np.asarray(self.sigma_xy)[seen.class_id, None]
        box[:, 3] += noise[:, 2] * np.asarray(self.sigma_yaw)[seen.class_id]
        box[:, 4:7] *= np.exp(LOG_SIZE * noise[:, 3:])
        return replace(scene, detections=replace(seen, box=box).select(kept))


def matched_detections(scene: Scene, card: Card) -> MatchedDetections:
    """The detections of ``scene`` inside the forecast gate of an evaluated object, matched one to one."""
    truth, seen = evaluated(scene).truth, scene.detections
    matched = match_objects(
        truth, seen.frame_of_rows, seen.box, seen.class_id, card
    ).object_of_truth
    row = np.flatnonzero((matched >= 0) & ~truth.neutral)
    box, true_box = seen.box[matched[row]], truth.box[row]
    turn = box[:, 3] - true_box[:, 3]
    return MatchedDetections(
        class_id=seen.class_id[matched[row]],
        score=seen.score[matched[row]],
        distance=np.hypot(*(box[:, :2] - true_box[:, :2]).T),
        turn=np.abs(np.arctan2(np.sin(turn), np.cos(turn))),
    )


def assignment_of(run: int) -> str:
    """The assignment of detections to tracks in run ``run``."""
    return ASSIGNMENTS[run % len(ASSIGNMENTS)]


def _quantiles(
    values: Floats, of_class: Sequence[Bools], share: float
) -> NDArray[np.float64]:
    """Quantile of ``values`` [n] per class [C]; of all values for a class without any, 0 without values."""
    overall = float(np.quantile(values, share)) if len(values) else 0.0
    return np.array(
        [
            float(np.quantile(values[own], share)) if own.any() else overall
            for own in of_class
        ]
    )


def _rounded(values: NDArray[np.float64]) -> tuple[float, ...]:
    return tuple(round(float(value), _DIGITS) for value in values)
