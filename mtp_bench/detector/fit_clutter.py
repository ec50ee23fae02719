"""False positives, fitted: their rate, how it varies, how long they stay, where they are and how they look."""

from __future__ import annotations

import numpy as np

from .fit_scores import fit_false_score
from .profile import FalsePositives, ScoreNoise
from .samples import ClutterSamples

_FEW = 20  # boxes from which the variation of the rate and the survival are taken
_LONGEST = 0.95  # survival from frame to frame that is believed
_NEAREST = 2.0  # m: the sensor's own vehicle is there


def fit_clutter(clutter: ClutterSamples, limits: ScoreNoise) -> FalsePositives | None:
    """False positives per frame without the duplicates of true boxes; None where there are none.

    ``limits`` has the floor and the ceiling of the scores.
    """
    own = ~clutter.duplicate
    if not own.any():
        return None
    judged = own & clutter.judged
    enough = judged.sum() >= _FEW
    dispersion = max(float(clutter.own.var() / clutter.own.mean()), 1.0) if enough else 1.0
    survive = min(float(np.mean(clutter.followed[judged])), _LONGEST) if enough else 0.0
    size = clutter.size[own].mean(axis=0)
    distance = np.maximum(np.quantile(clutter.distance[own], np.linspace(0.0, 1.0, 11)), _NEAREST)
    score, deviation = fit_false_score(clutter.score[own], limits)
    return FalsePositives(
        rate=round(float(clutter.own.mean()), 4),
        dispersion=round(dispersion, 4),
        survive=round(survive, 4),
        score=round(score, 4),
        score_deviation=round(deviation, 4),
        size=(round(float(size[0]), 4), round(float(size[1]), 4), round(float(size[2]), 4)),
        distance=tuple(round(float(one), 2) for one in distance),
    )
