"""The missing-aware error of a rollout (protocol, "Numbers per target"): the one number that ranks.

A target costs min(minADE, c), and c where it has no forecast. A false forecast costs c / 2 of its class; it belongs to
no target, so the error over all targets pays for it and that of an event subset does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..types import Bools, Floats
from .definitions import FALSE_FORECAST_SHARE

if TYPE_CHECKING:
    from .score import SceneScore
    from .table import AgentTable


def capped_error(min_ade: Floats, miss_error: Floats) -> Floats:
    """Error [n] of targets, metres: ``min_ade`` [n] (inf where there is no forecast), at most ``miss_error`` [n]."""
    return np.minimum(min_ade, miss_error)


def false_forecast_error(miss_error: Floats, truth_complete: bool) -> float:
    """Error of false forecasts, metres, from the miss error c of the class of each [n].

    0 where the truth is not complete, for then nobody knows which forecasts are false.
    """
    return FALSE_FORECAST_SHARE * float(miss_error.sum()) if truth_complete else 0.0


def error_sum(score: SceneScore, targets: Bools | None = None) -> float:
    """Error of one rollout of a scene summed over its ``targets`` [n], metres; None: all, with false forecasts."""
    if targets is None:
        return float(score.capped.sum()) + score.false_error
    return float(score.capped[targets].sum())


def mean_error(scores: Sequence[SceneScore]) -> float | None:
    """Error over all targets of some scenes, metres per target; None without a target."""
    targets = sum(len(score) for score in scores)
    return sum(error_sum(score) for score in scores) / targets if targets else None


def scene_errors(table: AgentTable, subset: str) -> NDArray[np.float64]:
    """Error of each scene [S] summed over the targets of a subset, metres, mean over seeds."""
    error = table.per_scene(table.capped, table.mask[subset])
    return error + table.false_error if subset == "all" else error
