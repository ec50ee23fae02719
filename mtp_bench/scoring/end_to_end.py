"""EPA and AP_f: detection and forecasting in one number, to stand beside end-to-end papers (protocol, "Numbers")."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ShapeError
from .definitions import EPA_ALPHA

_RECALLS = 101  # points of the precision-recall curve
_LEAST = 0.1  # recall and precision below do not count, as in nuScenes detection


def end_to_end_accuracy(hits: float, false_forecasts: float, targets: float) -> float | None:
    """EPA (ViP3D, Gu et al. 2023): (hits - alpha x false forecasts) / targets; None without a target.

    A hit is a target with a matched forecast and a minFDE of at most 2 m. ViP3D matches within 2 m; the benchmark uses
    the forecast gate of its card, which is 2 m for vehicles.
    """
    return float((hits - EPA_ALPHA * false_forecasts) / targets) if targets > 0 else None


def forecast_average_precision(correct: ArrayLike, score: ArrayLike, targets: int) -> float | None:
    """AP_f (Peri et al. 2022; Xu et al. 2024) of forecasts with a confidence; None without a target.

    ``correct`` [n]: matched to a target now (2 m), and the best final point within 4 m; ``score`` [n]. The mean of the
    precision over 101 recalls, what lies below .1 of either cut off, as nuScenes does for detection. Equal scores are
    one point of the curve, so the order of the rows does not matter; an agent without confidences has one point.
    Raises ShapeError for arrays that do not fit or more correct forecasts than targets.
    """
    right, confidence = np.asarray(correct, dtype=bool), np.asarray(score, dtype=np.float64)
    if right.ndim != 1 or right.shape != confidence.shape:
        raise ShapeError(f"correct has shape {right.shape} and score {confidence.shape}, expected one length for both")
    if right.sum() > targets:
        raise ShapeError(f"{int(right.sum())} correct forecasts of {targets} targets, expected at most one each")
    if targets == 0:
        return None
    if len(right) == 0:
        return 0.0
    order = np.argsort(-confidence, kind="stable")
    last = np.append(np.diff(confidence[order]) != 0, True)
    hits = np.cumsum(right[order])[last]
    precision, recall = hits / np.flatnonzero(np.append(False, last)), hits / targets
    curve = np.interp(np.linspace(0.0, 1.0, _RECALLS), recall, precision, right=0.0)
    counted = curve[round(100 * _LEAST) + 1 :]
    return float(np.maximum(counted - _LEAST, 0.0).mean() / (1.0 - _LEAST))
