"""Parts of bADE per target, which add up to it (docs/definitions, "Parts of the error").

A target without a forecast costs c for one cause. The error of one with a forecast is split by two references with the
agent's own predictor: perfect association of the same detections, and ground-truth tracks. Every part is linear in the
error and in its share from targets without a forecast, so both are averaged over budgets and seeds before the split.
"""

from __future__ import annotations

import numpy as np

from ..types import Floats
from .absence import AbsentCause
from .statistics import ratio
from .table import AgentTable

PARTS = {  # key of `Row` without "cost_" -> printed name
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
_OF_REFERENCES = tuple(PARTS)[:4]


def error_parts(
    table: AgentTable, subset: str, associated: AgentTable | None, tracks: AgentTable | None
) -> dict[str, Floats]:
    """Parts [n] of the ranking error on a subset, m, by the keys of `PARTS`; those that are unknown are left out.

    ``associated``, ``tracks``: perfect association of the same detections and ground-truth tracks, with the agent's own
    predictor and number of samples; of others, without one of them, or where one has no forecast, the error of a
    forecast is its rest.
    """
    ranked = table.ranking_error(subset)
    covered = 1.0 - ranked.missed / table.miss_error
    parts: dict[str, Floats] = {}
    rest = ranked.error - ranked.missed
    samples = table.setting.samples
    if associated and tracks and associated.setting.samples == tracks.setting.samples == samples:
        known = (associated.covered > 0) & (tracks.covered > 0)
        p, centred = (summed / np.maximum(associated.covered, 1) for summed in (associated.plain, associated.centred))
        g = tracks.plain / np.maximum(tracks.covered, 1)
        split = (covered * g, covered * (p - centred), covered * (centred - g), rest - covered * p)
        parts = dict(zip(_OF_REFERENCES, (np.where(known, part, 0.0) for part in split), strict=True))
        rest = np.where(known, 0.0, rest)
    absent = ranked.missed - ranked.below_threshold
    causes = {cause.name.lower(): np.where(table.absent_cause == cause, absent, 0.0) for cause in AbsentCause}
    return {**parts, "rest": rest, "below_threshold": ranked.below_threshold, **causes}


def mean_costs(
    table: AgentTable, subset: str, associated: AgentTable | None, tracks: AgentTable | None
) -> dict[str, float | None]:
    """Fields ``cost_*`` of a `Row`: the parts of bADE, m; None for those that are unknown, and without a target."""
    weight, parts = table.weight[subset], error_parts(table, subset, associated, tracks)
    total = float(weight.sum())
    return {f"cost_{name}": ratio(float((part * weight).sum()), total) for name, part in parts.items()}
