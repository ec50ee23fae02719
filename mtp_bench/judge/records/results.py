"""Results of one agent as facts: error sums per unit, and numbers that no sums give.

All that follows from these facts is a property.
"""

import math
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from ...core import RecordError, Section
from ...scoring import (
    SUBSETS,
    DrivingRow,
    Row,
    Subset,
    UnitSums,
    bootstrap_interval,
    effective_number,
    fault_interval,
    ratio,
    score_interval,
)
from .fields import MAX_LIST, Name, NotNegative, Share
from .targets import MAX_SCENES, MAX_UNITS, NO_TARGETS, UnitTargets

_DERIVED = {
    "error", "interval", "localisation", "cost_rest", "effective_units", "seeds",
    "targets", "effective_targets", "events", "objects", "effective_objects", "scenes",
    "difference_to_stp", "difference_interval", "p", "gap_closed", "gap_interval",
    "gap_closed_same_predictor", "gap_same_predictor_interval", "ms_per_frame",
    "association_gap_closed", "association_gap_interval", "gap_blank_because",
    "association_gap_blank_because", "place", "rank_range", "unranked_because",
    "agent", "hypotheses", "samples", "budget", "subset",
}  # fmt: skip
# fields of a `Row` that records store; a further metric is one of them
FACTS = {*Row.model_fields} - _DERIVED


def _require_facts(numbers: dict[str, float]) -> dict[str, float]:
    for name in numbers:
        if name not in FACTS:
            raise ValueError(f"{name!r} is not a fact that records store")
    return numbers


_UnitErrors = Annotated[list[NotNegative], Field(max_length=MAX_UNITS)]
_Numbers = Annotated[dict[Name, NotNegative], AfterValidator(_require_facts)]
_Scores = Annotated[list[Share], Field(min_length=1, max_length=MAX_LIST)]


class DrivesPart(Section):
    """Drives in a closed loop.

    The score and its interval follow from ``scores``.
    """

    # [S][seeds] of each scene and seed, in the order of the scenes
    scores: Annotated[list[_Scores], Field(min_length=1, max_length=MAX_SCENES)]
    # per 100 scenes
    collisions: NotNegative  # at fault
    any_collision: NotNegative
    near_misses: NotNegative
    phantom_brakes: NotNegative
    progress: Share
    goal_seconds: NotNegative | None
    comfort: Share

    @property
    def scene_scores(self) -> list[float]:
        """Score of each scene [S], mean over seeds."""
        return [math.fsum(scores) / len(scores) for scores in self.scores]


class Results(Section):
    """Errors of one agent by subset and unit, and numbers that they do not give.

    In a closed loop the only target of a scene is its drive. Its error is 1 - drive
    score; no event has a target.
    """

    # [U] m, weighted, at the budgets of all scenes, mean over seeds
    error: dict[Subset, _UnitErrors]
    # fields of a `Row` that do not follow from the sums of units
    numbers: dict[Subset, _Numbers]
    drives: DrivesPart | None = None  # of a closed loop alone
    targets: UnitTargets = NO_TARGETS

    @property
    def subsets(self) -> tuple[Subset, ...]:
        """Subsets with results: older records do not have "turning"."""
        return ("all",) if self.drives is not None else tuple(self.error)

    def unit_weight(self, subset: Subset) -> list[float]:
        """Return the weight of the targets of each unit [U]."""
        return self.targets.on(subset).weight

    def unit_error(self, subset: Subset) -> list[float]:
        """Return the weighted bADE per unit [U], metres."""
        if self.drives is not None and subset == "all":
            return [1.0 - score for score in self.drives.scene_scores]
        return self.error.get(subset) or [0.0] * self.targets.units

    def sums_on(self, subset: Subset, samples: int) -> UnitSums:
        """Return the sums over the units.

        ``samples`` are per object.
        """
        return UnitSums(
            samples=samples,
            weight=np.array(self.unit_weight(subset)),
            error=np.array(self.unit_error(subset)),
            effective_objects=self.targets.on(subset).effective_objects,
        )

    def row_of(self, subset: Subset) -> Row:
        """Return the row of one subset, with None in fields that are not stored."""
        targets = self.targets.on(subset)
        errors = self.unit_error(subset)
        error = ratio(math.fsum(errors), math.fsum(targets.weight))
        numbers = self.numbers.get(subset, {})
        missed = numbers.get("missed")
        content = dict.fromkeys(Row.model_fields) | {
            **numbers,
            **targets.model_dump(exclude={"weight"}),
            "subset": subset,
            "error": error,
            "interval": bootstrap_interval(errors, targets.weight),
            "effective_units": effective_number(targets.weight),
        }
        if error is not None and missed is not None:
            content["localisation"] = max(error - missed, 0.0)
            # the stored costs by cause explain "missed": the rest of the error is this
            if "cost_no_forecast" in numbers:
                content["cost_rest"] = content["localisation"]
        return Row.model_construct(**content)

    @property
    def rows(self) -> list[Row]:
        """Rows of all subsets with results."""
        return [self.row_of(subset) for subset in self.subsets]

    @property
    def row(self) -> Row:
        """Row of the subset "all"."""
        return self.row_of("all")

    @property
    def driving(self) -> DrivingRow | None:
        """Row of a closed loop, without differences to other records."""
        if self.drives is None:
            return None
        scores = self.drives.scene_scores
        return DrivingRow.model_construct(
            **dict.fromkeys(DrivingRow.model_fields)
            | self.drives.model_dump(exclude={"scores"})
            | {
                "drive_score": math.fsum(scores) / len(scores),
                "interval": score_interval(scores),
                "collisions_interval": fault_interval(
                    self.drives.collisions, len(scores)
                ),
                "scenes": len(scores),
            }
        )


def require_units(results: Results, where: str) -> None:
    """Raise RecordError unless there is one sum of errors per unit of the targets."""
    units = results.targets.units
    counts = {f"error.{name}": len(errors) for name, errors in results.error.items()}
    if results.drives is not None:
        counts = {"drives.scores": len(results.drives.scores)}
    elif missing := [subset for subset in SUBSETS if subset not in results.error]:
        raise RecordError(f"{where}: error has no sums of {', '.join(missing)}")
    for name, count in counts.items():
        if count != units:
            raise RecordError(f"{where}: {name} has {count} units, its targets {units}")
