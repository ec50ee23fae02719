"""Where the error is: by cause, by time since an event, by age of the track, by distance, class, motion, confidence."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...running.settings import Setting
from ...scoring.causes import CAUSES
from ...scoring.definitions import DISTANCE_BINS, PLANNING_SIGMA
from ...scoring.subsets import Subset
from ...types import Bools, Floats
from ..findings import Findings
from ..plan import Subject
from ..table import Count, Metres, Number, Share, Table, Text
from .costs import shown
from .paper import settings_told, subset_name

# as shown; the key "lost" is also the name of an event, which is another thing
CAUSE_NAMES = {cause: cause.replace("_", " ") for cause in CAUSES} | {"lost": "not forecast"}
CAUSE_SUBSETS: tuple[Subset, ...] = ("all", "ids", "reacquired")


@dataclass(frozen=True)
class CauseRow:
    """The number that ranks as a sum."""

    targets_of: Text
    agent: Text
    H: Count
    error: Metres
    undetected: Metres
    withheld: Metres
    lost: Metres
    true_past: Metres
    localisation: Metres
    switched: Metres
    rest: Metres
    targets: Count
    objects: Count


def cause_table(found: Findings) -> Table:
    """Where the error that ranks comes from."""
    rows: list[CauseRow] = []
    for subset in CAUSE_SUBSETS:
        for subject, setting in settings_told(found):
            if setting.budget == "equal":
                row = _cause_row(found, subject, setting, subset)
                rows += [row] if row is not None and row not in rows else []
    return Table(
        "causes",
        "Where the remaining error comes from",
        "Parts that add up to the error that ranks. A target without a forecast counts for the first cause that "
        "applies: undetected (no detection inside the gate), withheld (a forecast below the cut of the budget), not "
        "forecast (detected, and nothing was said). The error of one with a forecast is that from true pasts, plus "
        "localisation (what moving the forecast to the true present place takes away), plus the rest, which is called "
        "switched where the reference tracker ever switches the identity. Parts have signs.",
        rows,
    )


def _cause_row(found: Findings, subject: Subject, setting: Setting, subset: Subset) -> CauseRow | None:
    table = found.table(setting)
    weight = table.weight[subset]
    if not weight.sum():
        return None
    parts = found.causes(subject, setting, subset) @ weight / weight.sum()
    row = found.row(setting, subset)
    named = dict(zip(CAUSES, parts.tolist(), strict=True))
    return CauseRow(
        subset_name(subset), row.agent, row.hypotheses, row.error, **named, targets=row.targets, objects=row.objects
    )


@dataclass(frozen=True)
class BinRow:
    """A part of the targets."""

    by: Text
    bin: Text
    agent: Text
    H: Count
    plain_error: Metres
    low: Metres
    high: Metres
    minADE: Metres  # noqa: N815
    minADE_low: Metres  # noqa: N815
    minADE_high: Metres  # noqa: N815
    coverage: Share
    targets: Count
    objects: Count


def _bin_rows(found: Findings, setting: Setting, by: str, bins: Mapping[str, Floats | Bools]) -> Iterator[BinRow]:
    """A row for the targets of each of the ``bins``, which are weights [n] by name, in which there is any."""
    table = found.table(setting)
    for name, weight in bins.items():
        mean = found.mean(table, table.capped, weight)
        if mean.targets:
            ade = found.covered_mean(table, table.min_ade, weight)
            covered = float((table.covered * weight).sum() / len(table.setting.seeds) / np.sum(weight))
            yield BinRow(by, name, setting.label, table.setting.hypotheses, *mean[:3], *ade[:3], covered, *mean[3:])


def since_table(found: Findings) -> Table:
    """How long an event hurts."""
    steps = 2 * found.bench.card.task.past
    rows: list[BinRow] = []
    for kind in ("ids", "lost", "reacquired"):
        since = found.since(kind)
        bins = {str(step): since == step for step in range(steps + 1)}
        bins |= {f"over {steps}": since > steps, "never so far": since < 0}
        for setting in shown(found):
            rows += _bin_rows(found, setting, kind, bins)
    return Table(
        "since",
        "How long an event hurts",
        f"Errors by the frames since the object last had an event of {found.subject.single.label}, first seed: the "
        "same targets for every agent. The figure has minADE, over targets with a forecast; the plain error of the "
        "table counts a missing forecast as the miss error.",
        rows,
    )


def age_table(found: Findings) -> Table:
    """The error over the age of the track."""
    past = found.bench.card.task.past
    edges = sorted({0, 1, 2, 3, past, 2 * past, 4 * past, 8 * past})
    near = found.of(found.subject.single).around[0]
    age = np.concatenate([scene.age for scene in near])
    bins = {"no track": age < 0}
    for low, high in pairwise(edges):
        bins[str(low) if high == low + 1 else f"{low} to {high - 1}"] = (age >= low) & (age < high)
    bins[f"{edges[-1]} or more"] = age >= edges[-1]
    rows = [row for each in shown(found) for row in _bin_rows(found, each, "age of the track, frames", bins)]
    return Table(
        "age",
        "The error over the age of the track",
        f"The plain error by the frames since the track of {found.subject.single.label} that holds the object was "
        "first said: the same targets for every agent.",
        rows,
    )


def bin_table(found: Findings) -> Table:
    """The error by distance, class and motion."""
    rows: list[BinRow] = []
    for setting in shown(found):
        table = found.table(setting)
        bins: dict[str, dict[str, Floats | Bools]] = {"motion": {"moving": table.moving, "static": ~table.moving}}
        bins["class"] = {name: table.class_id == c for c, name in enumerate(found.bench.card.task.classes)}
        if found.bench.card.has_ego:
            bins["distance"] = _distance_masks(table.distance)
            bins["planning"] = {"weighted": np.exp(-(table.approach**2) / (2.0 * PLANNING_SIGMA**2))}
        for by, of in bins.items():
            rows += _bin_rows(found, setting, by, of)
    return Table(
        "bins",
        "The error by distance, class and motion",
        "The plain error of targets at some distance to the ego, of a class, moving (above 0.5 m/s over the future) or "
        "static; and weighted for planning: by exp(-d² / 2σ²), d the closest future approach to the ego, σ = 3 m "
        "(PI-ADE), which is what the paper leaves to future work.",
        rows,
    )


def _distance_masks(distance: Floats) -> dict[str, Floats | Bools]:
    return {
        f"{low:g}-{high:g} m" if np.isfinite(high) else f"beyond {low:g} m": (distance >= low) & (distance < high)
        for low, high in pairwise(DISTANCE_BINS)
    }


@dataclass(frozen=True)
class CalibrationRow:
    """Forecasts of one range of confidence."""

    agent: Text
    H: Count
    confidence: Number
    of_a_true_object: Share
    forecasts: Count
    brier: Number


def calibration_table(found: Findings) -> Table:
    """Whether confidences are probabilities."""
    rows = []
    for setting in shown(found):
        if setting.ideal:
            continue
        detail = found.details(setting)
        rows += [
            CalibrationRow(detail.agent, detail.hypotheses, r.confidence, r.matched, r.forecasts, detail.brier)
            for r in detail.reliability
        ]
    return Table(
        "calibration",
        "Whether confidences are probabilities",
        "Forecasts by their confidence, and the share of them that is of a true object. On the diagonal a confidence "
        "is a probability. The Brier score is that of all forecasts in live frames.",
        rows,
    )
