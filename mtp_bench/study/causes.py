"""Causes of the remaining error: parts of the ranking error, which add up to it.

A target without a forecast has all of its error for the first cause that applies: ``undetected`` (no detection of its
class inside the forecast gate), ``below_threshold`` (of the confidence), ``not_forecast``. That of one with a forecast
is a sum of signed parts: ``gt_tracks`` (the same predictor on ground-truth tracks), ``localisation`` (the part that
moving the forecast to the true place takes away), and the remainder: ``switched`` if the reference tracker ever
switches the identity there, else ``rest``. Parts are taken at each budget of false forecasts, and averaged like the
error.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ..scoring.ranking_error import Budgets, Cuts, at_budgets
from ..scoring.score import SceneScore
from ..types import Bools, Floats
from .circumstances import Circumstances

CAUSES = ("undetected", "below_threshold", "not_forecast", "gt_tracks", "localisation", "switched", "rest")


def causes_at(cuts: Cuts, around: Circumstances, from_truth: Floats, switched: Bools, least: float) -> Floats:
    """Parts [len(CAUSES), n] of the error of each target at the confidence threshold ``least``, m.

    ``from_truth`` [n]: m, the plain error from ground-truth tracks, at most c; ``switched`` [n]: the event weight is
    above 0.
    """
    error, missed = cuts.at(least)
    without_place = around.centred.at(least)[0]
    absent, ever = missed > 0, cuts.at(-np.inf)[1] == 0
    remains = without_place - from_truth
    parts = (
        (absent & ~around.seen, error),
        (absent & around.seen & ever, error),
        (absent & around.seen & ~ever, error),
        (~absent, from_truth),
        (~absent, error - without_place),
        (~absent & switched, remains),
        (~absent & ~switched, remains),
    )
    return np.stack([np.where(where, value, 0.0) for where, value in parts])


def causes(
    seeds: Sequence[Sequence[SceneScore]],
    around: Sequence[Sequence[Circumstances]],
    budgets: Budgets,
    from_truth: Floats,
    switched: Bools,
    subsets: bool = False,
) -> Floats:
    """Parts [len(CAUSES), n] of the ranking error per target, mean over seeds, m; they add up to it.

    ``around``: of the same scenes and seeds; ``from_truth`` and ``switched`` [n] as in `causes_at`, over all scenes;
    ``subsets``: at the budget of the event subsets, else the mean over those of "all".
    """
    first = np.cumsum([0, *(len(score) for score in seeds[0])])
    rows = [slice(low, high) for low, high in pairwise(first.tolist())]  # targets of each scene
    allowed = [budgets.subsets] if subsets else budgets.all
    runs = []
    for scores, near in zip(seeds, around, strict=True):

        def parts(scene: int, least: float, scores=scores, near=near) -> Floats:  # type: ignore[no-untyped-def]
            own = rows[scene]
            return causes_at(scores[scene].cuts, near[scene], from_truth[own], switched[own], least)

        live = None if budgets.false_known else sum(score.live for score in scores)
        runs.append(at_budgets([score.cuts for score in scores], allowed, parts, live).mean(axis=0))
    return np.asarray(np.mean(runs, axis=0), dtype=np.float64)
