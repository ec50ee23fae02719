"""Parts of bADE per target, which add up to it (docs/definitions, "Parts of the error").

A target without a forecast costs c for one cause. The error of one with a forecast is split by two references with the
agent's own predictor: perfect association of the same detections, and ground-truth tracks. Every part is linear in the
error and in its share from targets without a forecast, so both are averaged over budgets and seeds before the split.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats
from .absence import AbsentCause
from .statistics import ratio
from .table import AgentScores, AgentTable, over_seeds

PARTS = {  # key of `Row` without "cost_" -> printed name; the first four are of references
    "ground_truth": "predictor",
    "localisation": "localisation",
    "history": "history",
    "association": "association",
    "rest": "rest",
    "below_threshold": "below threshold",
    "no_forecast": "no forecast",
    "other_class": "other class",
    "off_place": "off place",
    "undetected_new": "never detected so far",
    "undetected_seen": "not detected now",
}
# Plain errors [n] m of perfect association, of the same with the present place moved to the truth, and of ground-truth
# tracks: means over the seeds that cover a target, NaN without one
ReferenceErrors = tuple[Floats, Floats, Floats]


def name_of(absent_cause: int) -> str:
    """Printed name of the part that the error of one target is without references; -1 for a target with a forecast."""
    return PARTS["rest" if absent_cause < 0 else AbsentCause(absent_cause).name.lower()]


def reference_errors(
    associated: AgentScores | None, tracks: AgentScores | None, samples: int
) -> ReferenceErrors | None:
    """Errors of the references that split the error of an agent of so many ``samples``; None if one has others."""
    if associated is None or tracks is None or {associated.samples, tracks.samples} != {samples}:
        return None
    p, centred = (_covered_mean(associated, name) for name in ("capped", "centred"))
    return p, centred, _covered_mean(tracks, "capped")


def _covered_mean(scores: AgentScores, name: str) -> Floats:
    seeds = over_seeds(scores, "covered")
    mean: Floats = np.divide(over_seeds(scores, name), seeds, out=np.full(len(seeds), np.nan), where=seeds > 0)
    return mean


def error_parts(table: AgentTable, subset: str, references: ReferenceErrors | None) -> dict[str, Floats]:
    """Parts [n] of bADE on a subset, m, by the keys of `PARTS`; those that are unknown are left out.

    ``references``: with the agent's own predictor and as many samples. Without them, and where one of them has no
    forecast, the error of a forecast is its rest.
    """
    ranked = table.bade(subset)
    absent, rest = ranked.missed - ranked.below_threshold, ranked.error - ranked.missed
    parts: dict[str, Floats] = {}
    if references is not None:
        known = np.isfinite(sum(references))
        p, centred, g = (np.where(known, error, 0.0) for error in references)
        covered = 1.0 - ranked.missed / table.miss_error  # share of budgets and seeds
        split = (covered * g, covered * (p - centred), covered * (centred - g), rest - covered * p)
        parts = {name: np.where(known, part, 0.0) for name, part in zip(PARTS, split, strict=False)}
        rest = np.where(known, 0.0, rest)
    causes = {cause.name.lower(): np.where(table.absent_cause == cause, absent, 0.0) for cause in AbsentCause}
    return {**parts, "rest": rest, "below_threshold": ranked.below_threshold, **causes}


def mean_costs(table: AgentTable, subset: str, references: ReferenceErrors | None) -> dict[str, Any]:
    """Fields ``cost_*`` of a `Row`: means over the targets of a subset, m; of unknown parts they are missing."""
    weight, parts = table.weight[subset], error_parts(table, subset, references)
    total = float(weight.sum())
    return {f"cost_{name}": ratio(float((part * weight).sum()), total) for name, part in parts.items()}
