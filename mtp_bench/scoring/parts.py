"""Parts of bADE per target, which add up to it.

A target without a forecast costs the miss error c, which counts as one part: the cause
why it has no forecast.

The error of a target with a forecast is split by two reference runs, both with the
agent's own predictor. One associates the same detections perfectly, the other has the
ground-truth tracks.

Errors are averaged over budgets and seeds before the split. This changes no part, as
all are linear in the errors (docs/definitions, "Parts of the error").
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..core import Floats, Ints
from .bade import at_budgets
from .statistics import ratio
from .table import AgentScores, AgentTable, ReferenceErrors, over_seeds
from .targets import AbsentCause

# key of `Row` without "cost_" -> printed name; the first four are of references
PART_NAMES = {
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
# names of parts; the last takes the blame of targets that doubts about the data touch
PARTS = (*PART_NAMES.values(), "data")
LEAST_SHOWN = 0.05  # m, of a part in a text
# part of the stack -> parts of the error that it causes
STAGE_PARTS = {
    "detector": (
        "localisation",
        "history",
        "other class",
        "off place",
        "never detected so far",
        "not detected now",
    ),
    "tracker": ("association", "no forecast"),
    "predictor": ("predictor",),
    "forecast": ("rest",),  # of tracker or predictor
    "confidence": ("below threshold",),
    "data": ("data",),
}
# in tables of all parts of a `Row`
STAGE_NAMES = {stage: stage for stage in STAGE_PARTS if stage != "data"}
STAGE_NAMES["forecast"] = "not split"
BELOW_THRESHOLD = PART_NAMES["below_threshold"]
_COLUMN = {name: column for column, name in enumerate(PART_NAMES)}


class SceneParts(NamedTuple):
    """Parts of the targets of a scene, and what is usual in its run."""

    part: Floats  # [n, len(PART_NAMES)] m
    usual: float  # m, mean of `blame` over the targets of all scenes
    distance: Floats  # [n] m to the ego: shows whether the truth is that of the run
    unsplit: str = ""  # why the error of forecasts is its rest; empty: it is split
    thresholds: Floats | None = None  # [b], see `thresholds_of`; None: not known


def plain_parts(error: Floats, absent_cause: Ints) -> Floats:
    """Return parts [n, len(PART_NAMES)] of the plain error, without references.

    ``error`` [n]: m; ``absent_cause`` [n]: of `AbsentCause`; -1 for a target with a
    forecast, whose error is its rest.
    """
    causes = [cause.name.lower() for cause in AbsentCause]
    columns = np.array([_COLUMN[name] for name in (*causes, "rest")])
    part = np.zeros((len(error), len(PART_NAMES)))
    # -1 takes the last column, "rest"
    part[np.arange(len(error)), columns[absent_cause]] = error
    return part


def blame(part: Floats) -> Floats:
    """Return the sum [...] of parts [..., n] but below threshold, m.

    That part depends on all other forecasts.
    """
    return np.asarray(part.sum(axis=-1) - part[..., _COLUMN["below_threshold"]])


def named_parts(part: Floats) -> dict[str, float]:
    """Return the parts [len(PARTS)] by name, m, without those of 0.

    The largest first, below threshold last.
    """
    parts = {
        name: float(value) for name, value in zip(PARTS, part, strict=False) if value
    }
    names = sorted(parts, key=lambda name: (name == BELOW_THRESHOLD, -parts[name]))
    return {name: parts[name] for name in names}


def parts_text(parts: Mapping[str, float], most: int = len(PART_NAMES)) -> str:
    """Return the parts as text: "other class 5.0 m, predictor 3.1".

    Parts that round to 0 are left out. If all round to 0, the first is printed with two
    decimals. The sum of names beyond the first ``most`` is called "others".
    """
    shown = _shown(parts)
    if parts and not shown:
        name, value = next(iter(parts.items()))
        return f"{name} {value:.2f} m"
    names = [name for name in shown if name != BELOW_THRESHOLD]
    remainder = sum(shown[name] for name in names[most:])
    named = {name: shown[name] for name in names[:most]}
    named = _shown(
        {**named, "others": remainder, BELOW_THRESHOLD: shown.get(BELOW_THRESHOLD, 0.0)}
    )
    if not named:
        return "nothing"
    first, *texts = [f"{name} {value:.1f}" for name, value in named.items()]
    return ", ".join([f"{first} m", *texts])


def _shown(parts: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in parts.items() if abs(value) >= LEAST_SHOWN}


def by_fault(parts: Mapping[str, float]) -> dict[str, float]:
    """Return the sums of `named_parts` by part of the stack, m, the largest first."""
    sums = {}
    for stage, names in STAGE_PARTS.items():
        sums[stage] = sum(parts.get(name, 0.0) for name in names)
    stages = sorted(sums, key=lambda stage: -sums[stage])
    return {stage: sums[stage] for stage in stages}


def reference_errors(
    associated: AgentScores | None, tracks: AgentScores | None, samples: int
) -> ReferenceErrors | None:
    """Return the errors of the references that split an agent's error.

    None if one is missing, or does not have the agent's number of ``samples``.
    """
    if associated is None or tracks is None:
        return None
    if associated.samples != samples or tracks.samples != samples:
        return None
    return ReferenceErrors(
        _covered_mean(associated, "capped"),
        _covered_mean(associated, "centred"),
        _covered_mean(tracks, "capped"),
    )


def _covered_mean(scores: AgentScores, name: str) -> Floats:
    """Return the mean [n] of array ``name`` over seeds that cover a target."""
    seed_count = over_seeds(scores, "covered")
    mean: Floats = np.full(len(seed_count), np.nan)
    np.divide(over_seeds(scores, name), seed_count, out=mean, where=seed_count > 0)
    return mean


def error_parts(table: AgentTable, subset: str) -> dict[str, Floats]:
    """Return the parts [n] of bADE on a subset, m, by the keys of `PART_NAMES`.

    Unknown parts are left out. Without references, which `AgentTable.split` holds, the
    whole error of a forecast is its "rest"; so it is for a target of which one of them
    has no forecast.
    """
    bade = table.bade(subset)
    absent = bade.missed - bade.below_threshold
    unsplit = bade.error - bade.missed
    parts: dict[str, Floats] = {}
    if table.split is not None:
        split = np.isfinite(sum(table.split))  # False if one is NaN
        associated, centred, ground_truth = np.where(split, table.split, 0.0)
        # share of budgets and seeds with a forecast: the others cost c
        covered = 1.0 - bade.missed / table.miss_error
        parts = {
            "ground_truth": covered * ground_truth,
            "localisation": covered * (associated - centred),
            "history": covered * (centred - ground_truth),
            "association": unsplit - covered * associated,
        }
        parts = {name: np.where(split, part, 0.0) for name, part in parts.items()}
        unsplit = np.where(split, 0.0, unsplit)
    parts |= {"rest": unsplit, "below_threshold": bade.below_threshold}
    for cause in AbsentCause:
        parts[cause.name.lower()] = np.where(table.absent_cause == cause, absent, 0.0)
    return parts


def thresholds_of(table: AgentTable) -> Floats:
    """Return the least confidence [b] that each budget of all targets keeps.

    They are those of the first seed; inf if a budget keeps no forecast. A budget mostly
    ends between two cuts, and its threshold is interpolated between theirs.
    """
    run = table.setting.seeds[0]
    budgets = table.budgets
    live_frames = None if budgets.false_known else sum(score.live for score in run)

    def threshold(scene: int, min_confidence: float) -> Floats:
        # all scenes have the same threshold, and the first one alone reports it
        return np.full((1, int(scene == 0)), min_confidence)

    cuts = [score.cuts for score in run]
    return at_budgets(cuts, budgets.all, threshold, live_frames)[:, 0, 0]


def mean_costs(table: AgentTable, subset: str) -> dict[str, Any]:
    """Return fields ``cost_*`` of a `Row`: means over the targets of a subset, m.

    Fields of unknown parts are missing.
    """
    weight = table.weight[subset]
    total = float(weight.sum())
    parts = error_parts(table, subset)
    return {
        f"cost_{name}": ratio(float((part * weight).sum()), total)
        for name, part in parts.items()
    }
