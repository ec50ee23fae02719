"""Parts of bADE per target, which add up to it (docs/definitions, "Parts of the error").

A target without a forecast costs c for one cause. The error of one with a forecast is split by two references with the
agent's own predictor: perfect association of the same detections, and ground-truth tracks. Every part is linear in the
error and in its share from targets without a forecast, so both are averaged over budgets and seeds before the split.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..core import Floats, Ints
from .bade import at_budgets
from .statistics import ratio
from .table import AgentScores, AgentTable, over_seeds
from .targets import AbsentCause

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
LEAST_SHOWN = 0.05  # m, of a part in a text
FAULTS = {  # part of the stack -> parts of the error that it causes; what a forecast starts from is measured
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
}
FAULT_NAMES = {
    who: "not split" if who == "forecast" else who for who in FAULTS
}  # in tables of all parts
BELOW = PARTS["below_threshold"]
# Plain errors [n] m of perfect association, of the same with the present place moved to the truth, and of ground-truth
# tracks: means over the seeds that cover a target, NaN without one
ReferenceErrors = tuple[Floats, Floats, Floats]


class SceneParts(NamedTuple):
    """Parts of the targets of a scene, and what is usual in its run."""

    part: Floats  # [n, len(PARTS)] m
    usual: float  # m, mean of `blame` over the targets of all scenes
    distance: Floats  # [n] m, of the targets to the ego: shows whether the truth is that of the run
    unsplit: str = (
        ""  # reason why the error of forecasts is its rest; empty: it is split
    )
    thresholds: Floats | None = (
        None  # [b] of the run, see `thresholds_of`; None: not known
    )


def plain_parts(error: Floats, absent_cause: Ints) -> Floats:
    """Parts [n, len(PARTS)] of the plain ``error`` [n], m, without references: one for each target.

    ``absent_cause`` [n]: of `AbsentCause`; -1 for a target with a forecast, whose error is its rest.
    """
    columns = [
        list(PARTS).index(name)
        for name in (*(cause.name.lower() for cause in AbsentCause), "rest")
    ]
    part = np.zeros((len(error), len(PARTS)))
    part[np.arange(len(error)), np.array(columns)[absent_cause]] = error
    return part


def blame(part: Floats) -> Floats:
    """Sum [...] of the ``part`` [..., len(PARTS)], m, but below threshold, which depends on all other forecasts."""
    return np.asarray(
        part.sum(axis=-1) - part[..., list(PARTS).index("below_threshold")]
    )


def named_parts(part: Floats) -> dict[str, float]:
    """Parts [len(PARTS)] by name, m, without those of 0: the largest first, below threshold last."""
    named = {
        name: float(value)
        for name, value in zip(PARTS.values(), part, strict=True)
        if value
    }
    return dict(sorted(named.items(), key=lambda each: (each[0] == BELOW, -each[1])))


def parts_text(parts: Mapping[str, float], most: int = len(PARTS)) -> str:
    """The parts as text: "other class 5.0 m, predictor 3.1"; those that round to 0 are left out.

    ``most``: of so many names; the sum of further ones is called "others". If all round to 0: the first, finer.
    """
    shown = {name: value for name, value in parts.items() if abs(value) >= LEAST_SHOWN}
    if parts and not shown:
        return "{} {:.2f} m".format(*next(iter(parts.items())))
    few = [name for name in shown if name != BELOW][:most]
    others = sum(value for name, value in shown.items() if name not in (*few, BELOW))
    kept = {name: shown[name] for name in few}
    kept |= ({"others": others} if abs(others) >= LEAST_SHOWN else {}) | {
        n: v for n, v in shown.items() if n == BELOW
    }
    texts = [f"{name} {value:.1f}" for name, value in kept.items()]
    return ", ".join([f"{texts[0]} m", *texts[1:]]) if texts else "nothing"


def by_fault(parts: Mapping[str, float]) -> dict[str, float]:
    """Sums of `named_parts` by the part of the stack, m, the largest first."""
    size = {
        who: sum(parts.get(name, 0.0) for name in names)
        for who, names in FAULTS.items()
    }
    return dict(sorted(size.items(), key=lambda each: -each[1]))


def fault_of(parts: Mapping[str, float]) -> str:
    """The part of the stack that causes most of `named_parts`, with the largest of its causes; empty without an error.

    Confidence is named only where nothing else has a part.
    """
    found = [who for who, size in by_fault(parts).items() if size >= LEAST_SHOWN]
    who = next((who for who in found if who != "confidence"), "".join(found))
    first = next((name for name in parts if who and name in FAULTS[who]), who)
    return who if first == who else f"{who}: {first}"


def reference_errors(
    associated: AgentScores | None, tracks: AgentScores | None, samples: int
) -> ReferenceErrors | None:
    """Errors of the references that split the error of an agent of so many ``samples``; None if one has others."""
    if (
        associated is None
        or tracks is None
        or {associated.samples, tracks.samples} != {samples}
    ):
        return None
    p, centred = (_covered_mean(associated, name) for name in ("capped", "centred"))
    return p, centred, _covered_mean(tracks, "capped")


def _covered_mean(scores: AgentScores, name: str) -> Floats:
    seeds = over_seeds(scores, "covered")
    mean: Floats = np.divide(
        over_seeds(scores, name),
        seeds,
        out=np.full(len(seeds), np.nan),
        where=seeds > 0,
    )
    return mean


def error_parts(
    table: AgentTable, subset: str, references: ReferenceErrors | None
) -> dict[str, Floats]:
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
        split = (
            covered * g,
            covered * (p - centred),
            covered * (centred - g),
            rest - covered * p,
        )
        parts = {
            name: np.where(known, part, 0.0)
            for name, part in zip(PARTS, split, strict=False)
        }
        rest = np.where(known, 0.0, rest)
    causes = {
        cause.name.lower(): np.where(table.absent_cause == cause, absent, 0.0)
        for cause in AbsentCause
    }
    return {**parts, "rest": rest, "below_threshold": ranked.below_threshold, **causes}


def thresholds_of(table: AgentTable) -> Floats:
    """Return the least confidence [b] that each budget of all targets keeps; inf: it keeps no forecast.

    Of the first seed. A budget keeps a part of the forecasts between two cuts, so its threshold lies between them.
    """
    run, budgets = table.setting.seeds[0], table.budgets
    live = None if budgets.false_known else sum(score.live for score in run)

    def threshold(scene: int, least: float) -> Floats:
        return np.full((1, int(scene == 0)), least)  # one number for all scenes

    return at_budgets([score.cuts for score in run], budgets.all, threshold, live)[
        :, 0, 0
    ]


def mean_costs(
    table: AgentTable, subset: str, references: ReferenceErrors | None
) -> dict[str, Any]:
    """Fields ``cost_*`` of a `Row`: means over the targets of a subset, m; of unknown parts they are missing."""
    weight, parts = table.weight[subset], error_parts(table, subset, references)
    total = float(weight.sum())
    return {
        f"cost_{name}": ratio(float((part * weight).sum()), total)
        for name, part in parts.items()
    }
