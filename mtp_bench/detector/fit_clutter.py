"""False positives, fitted: their rate, how it varies, how long they stay, and how they look."""

from __future__ import annotations

import numpy as np

from .profile import FalsePositives
from .samples import ClutterSamples

_FEW = 20  # boxes from which the variation of the rate and the survival are taken
_LONGEST = 0.95  # survival from frame to frame that is believed


def fit_clutter(clutter: ClutterSamples) -> FalsePositives | None:
    """False positives per frame without the duplicates of true boxes; None where there are none."""
    own = ~clutter.duplicate
    if not own.any():
        return None
    frames, boxes = len(clutter.count), int(own.sum())
    judged = own & clutter.judged
    enough = judged.sum() >= _FEW
    dispersion = max(float(clutter.count.var() / clutter.count.mean()), 1.0) if enough else 1.0
    survive = min(float(np.mean(clutter.followed[judged])), _LONGEST) if enough else 0.0
    size = clutter.size[own].mean(axis=0)
    return FalsePositives(
        rate=round(boxes / frames, 4),
        dispersion=round(dispersion, 4),
        survive=round(survive, 4),
        score=round(float(clutter.score[own].mean()), 4),
        score_deviation=round(float(clutter.score[own].std()), 4),
        size=(round(float(size[0]), 4), round(float(size[1]), 4), round(float(size[2]), 4)),
    )
