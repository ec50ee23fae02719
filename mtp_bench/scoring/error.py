"""The plain error of targets, and the error of decisions at a fixed operating point (protocol, "Numbers per target").

What ranks is the error at false-forecast budgets, see `budgets`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..cards import Card
from ..types import Floats, Ints, Scene
from .cuts import Cuts
from .definitions import FALSE_FORECAST_SHARE, FREE_FORECASTS, SURE
from .forecasts import Forecasts, candidates, cuts, grow
from .neutral import evaluated
from .targets import Targets, live_frames

if TYPE_CHECKING:
    from .score import SceneScore


def capped_error(min_ade: Floats, miss_error: Floats) -> Floats:
    """Error [n] of targets, metres: ``min_ade`` [n] (inf where there is no forecast), at most ``miss_error`` [n]."""
    return np.minimum(min_ade, miss_error)


def fixed_error(cut: Cuts, malformed: Ints, miss_error: Floats, truth_complete: bool) -> float:
    """Error of the decisions to forecast what is likelier there than not, summed over targets, m: c-GOSPA.

    A target costs min(minADE, c), and c without a forecast of confidence 0.5 or more. A false forecast of such a
    confidence costs c / 2. Where false ones cannot be known, those beyond the 40 surest of a frame cost it.

    ``cut``: the forecasts of live frames. ``malformed`` [F, C + 1]: objects of live frames that were taken out of the
    answers; they count as false forecasts, those without a class as of the largest c. ``miss_error`` [C]: c.
    """
    error = float(cut.at(SURE)[0].sum())
    share = FALSE_FORECAST_SHARE * np.append(miss_error, miss_error.max())
    broken = malformed @ share
    if truth_complete:
        return error + cut.false_costs(SURE, share) + float(broken.sum())
    said = np.flatnonzero(cut.confidence >= SURE)
    frame = cut.frame[said]
    order = np.argsort(frame, kind="stable")  # the surest of each frame first
    place = np.arange(len(order)) - np.searchsorted(frame[order], frame[order])
    beyond = said[order[place >= FREE_FORECASTS]]
    spared = np.maximum(0, FREE_FORECASTS - np.bincount(frame, minlength=len(malformed)))
    many = malformed.sum(axis=1)
    part = np.divide(np.maximum(0, many - spared), many, out=np.zeros(len(many)), where=many > 0)
    return error + float(share[cut.class_id[beyond]].sum()) + float((part * broken).sum())


def frame_error(scene: Scene, targets: Targets, card: Card, t: int, forecasts: Forecasts, malformed: Ints) -> float:
    """The share of frame ``t`` in `fixed_error`, metres: over all frames the shares add up to it.

    ``targets``: of the ``scene`` under ``card``; ``forecasts`` and ``malformed`` [C + 1]: what was said of frame ``t``.
    """
    live = live_frames(scene, card)
    if not live[t]:
        return 0.0
    here = targets.only(t)
    here = replace(here, row=here.row - scene.truth.start[t])
    found = candidates(evaluated(replace(scene, truth=scene.truth.only(t))), here, forecasts, live, card)
    miss_error = np.asarray(card.per_class(card.task.miss_error))
    grown = grow(found, forecasts.confidence)
    cut = cuts(found, grown, forecasts.confidence, miss_error[here.class_id])
    broken = np.zeros((scene.frames, len(malformed)), dtype=np.int64)
    broken[t] = malformed
    return fixed_error(cut, broken, miss_error, scene.truth_complete)


def mean_plain_error(scores: Sequence[SceneScore]) -> float | None:
    """Error over all targets of some scenes with every forecast kept, metres; None without a target."""
    targets = sum(len(score) for score in scores)
    return sum(float(score.capped.sum()) for score in scores) / targets if targets else None
