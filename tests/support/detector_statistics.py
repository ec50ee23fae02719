"""Recall of a detector and the dependence of its errors over time, per class, real or simulated."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from mtp_bench.core import Bools, Floats, Ints, Scene
from mtp_bench.detector.visibility import Sensor
from mtp_bench.training.detector_fit.objects import robust_deviation
from mtp_bench.training.detector_fit.samples import RADIAL, TANGENTIAL, ObjectSamples, collect_samples


@dataclass(frozen=True)
class ClassStatistics:
    """Figures of one class; NaN where there is no case."""

    boxes: int  # true boxes inside the sensor's coverage, neutral ones left out
    recall: float
    undetected_odds_ratio: float  # odds of being undetected after an undetected frame over those after a hit
    gaps: int  # runs of undetected frames between two hits of an object
    gap_length: float  # mean, frames
    radial_scale: float | None  # m, robust standard deviation of the error along the line of sight
    tangential_scale: float | None  # m, the same across it
    radial_autocorrelation: float  # of the errors' normal scores in consecutive frames
    tangential_autocorrelation: float
    false_positives: float  # per frame
    score_true: float  # mean score of detections that belong to a true box


def detector_statistics(
    scenes: Iterable[Scene], classes: Sequence[str], sensor: Sensor, floor: Mapping[str, float] | None = None
) -> dict[str, ClassStatistics]:
    """Statistics per class of the detections of ``scenes`` inside the coverage of ``sensor``.

    ``floor`` is the operating point per class: detections with a lower score do not count.
    """
    result = {}
    for name, (objects, false) in collect_samples(scenes, classes, sensor, floor).items():
        length = _gap_lengths(objects)
        result[name] = ClassStatistics(
            boxes=len(objects.hit), recall=_mean(objects.hit), undetected_odds_ratio=_undetected_odds_ratio(objects),
            gaps=len(length), gap_length=_mean(length),
            radial_scale=robust_deviation(objects.error[objects.hit, RADIAL]),
            tangential_scale=robust_deviation(objects.error[objects.hit, TANGENTIAL]),
            radial_autocorrelation=_autocorrelation(objects, RADIAL),
            tangential_autocorrelation=_autocorrelation(objects, TANGENTIAL), false_positives=_mean(false.count),
            score_true=_mean(objects.score[objects.hit]),
        )  # fmt: skip
    return result


def _gap_lengths(objects: ObjectSamples) -> Ints:
    """Frames of the gaps between two hits of an object; a frame without the true box ends a gap unseen."""
    begins = np.ones(len(objects.hit), dtype=bool)
    begins[objects.pairs()[1]] = False
    stretch = np.cumsum(begins)  # of consecutive frames; the rows of a stretch follow each other
    hit = np.flatnonzero(objects.hit)
    step, same = np.diff(hit), stretch[hit[1:]] == stretch[hit[:-1]]
    return np.asarray(step[same & (step > 1)] - 1)


def _undetected_odds_ratio(objects: ObjectSamples) -> float:
    """Odds ratio; half a case is added to each of the four counts, so that it is finite."""
    earlier, later = objects.pairs()
    count = np.full((2, 2), 0.5)
    np.add.at(count, (~objects.hit[earlier] * 1, ~objects.hit[later] * 1), 1)
    return float(count[1, 1] * count[0, 0] / (count[1, 0] * count[0, 1]))


def _autocorrelation(objects: ObjectSamples, column: int) -> float:
    """Lag-1 autocorrelation of the errors' normal scores: ranks first, so that heavy tails do not count."""
    earlier, later = objects.hit_pairs()
    _, place, count = np.unique(objects.error[objects.hit, column], return_inverse=True, return_counts=True)
    if len(earlier) < 3 or len(count) < 3:
        return np.nan
    middle = np.cumsum(count) - count / 2  # equal errors share the rank in their middle
    score = np.full(len(objects.hit), np.nan)
    score[objects.hit] = ndtri(middle / count.sum())[place]
    return float(np.corrcoef(score[earlier], score[later])[0, 1])


def _mean(value: Floats | Ints | Bools) -> float:
    return float(np.mean(value)) if len(value) else np.nan
