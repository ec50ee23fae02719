"""The rows of a report: typed, checked when they are made, and written as JSON by `Report.to_json` alone.

The fields of a row are the keys of its JSON; None stands for undefined, never NaN.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_serializer

from ..strict import Section
from .subsets import Subset

Count = Annotated[int, Field(ge=0)]
Interval = Annotated[tuple[float, float], Field(strict=False)]  # 95 %; JSON has a list of two
Point = Annotated[tuple[float, float], Field(strict=False)]
Budget = Literal["equal", "free"]


class Setting(Section):
    """An agent in one setting."""

    agent: str
    hypotheses: Count
    samples: Count  # per object
    budget: Budget


class Row(Setting):
    """Numbers of one subset of the targets."""

    subset: Subset
    minADE: float | None  # noqa: N815  (m, over covered targets; a fixed name of the files)
    minFDE: float | None  # noqa: N815
    error: float | None  # m, at the false-forecast budgets: what ranks
    interval: Interval | None  # of error
    localisation: float | None  # m, the part of error from targets with a forecast
    missed: float | None  # m, the part of error from targets without one
    error_by_score: float | None  # m, error with the nearest detection's score as the confidence
    plain_error: float | None  # m, with every forecast kept
    fixed_error: float | None  # m per target, at confidence 0.5; of "all" alone
    energy_score: float | None
    coverage: float | None
    difference_to_stp: float | None  # m, of error
    difference_interval: Interval | None
    p: float | None  # sign-flip test of that difference over units
    gap_closed: float | None  # between the kinematic ends
    gap_interval: Interval | None
    gap_closed_same_predictor: float | None  # between ends with the agent's own predictor and presence
    gap_same_predictor_interval: Interval | None
    rank: int | None  # None: shown, not ranked
    unranked_because: str | None
    targets: Count
    effective_targets: float
    events: float | None  # expected number in a run of the reference tracker; of "paper_" subsets those of plain STP
    objects: Count
    effective_objects: float
    scenes: Count
    effective_units: float
    seeds: Count
    ms_per_frame: float | None


class PairedRow(Setting):
    """Differences of an agent to a control on one subset."""

    other: str  # the control
    subset: Subset
    error: float | None
    interval: Interval | None  # of error
    p: float | None  # sign-flip test over units
    minADE: float | None  # noqa: N815  (where both cover a target)
    minADE_interval: Interval | None  # noqa: N815
    targets: Count
    shared: Count  # targets that both cover
    scenes: Count


class Errors(Section):
    """Errors over some of the targets."""

    minADE: float | None  # noqa: N815
    minFDE: float | None  # noqa: N815
    error: float | None  # at the budgets of all targets
    plain_error: float | None
    coverage: float | None
    targets: Count
    objects: Count
    scenes: Count


class Bin(Section):
    """Errors over the targets of one distance, class or motion."""

    by: Literal["distance", "class", "motion"]
    bin: str
    errors: Errors
    EPA: float | None = None  # of classes alone

    @model_serializer
    def _flat(self) -> dict[str, Any]:
        row = {"by": self.by, "bin": self.bin, **self.errors.model_dump()}
        return {**row, "EPA": self.EPA} if self.by == "class" else row


class Clear(Section):
    """Tracking numbers; None where a false positive cannot be known because the truth is not complete."""

    TP: Count
    FP: Count | None
    FN: Count
    IDS: Count
    FRAG: Count
    MOTA: float | None
    MOTP: float | None  # mean IoU or mean distance in metres, as the event gate measures
    IDF1: float | None
    HOTA: float | None


class Tracking(Section):
    """Tracking numbers of the first seed, and its false output."""

    all: Clear
    classes: dict[str, Clear]
    false_positives: Count | None
    false_tracks: Count | None  # matched in no frame of their life

    @model_serializer
    def _flat(self) -> dict[str, Any]:
        classes = {name: clear.model_dump() for name, clear in self.classes.items()}
        false = {"false_positives": self.false_positives, "false_tracks": self.false_tracks}
        return {"all": self.all.model_dump(), **classes, **false}


class Reliability(Section):
    """Forecasts of one range of confidence, and how many of them were of a true object."""

    confidence: float  # mean
    matched: float  # share
    forecasts: Count


class Details(Setting):
    """What lies behind the rows of an agent, over all targets."""

    seeds: Count
    silence: float | None  # m, what an agent that says nothing scores
    miss_rate: float | None  # over all targets, uncovered ones missed
    PI_ADE: float | None
    EPA: float | None
    AP_f: float | None
    brier: float | None  # of the confidences in live frames
    reliability: list[Reliability]
    forecasts_per_frame: float  # live frames
    false_per_frame: float | None
    curve: list[Point]  # false forecasts per target (forecasts per live frame where those cannot be known), error in m
    k_curve: dict[str, float | None]  # k -> expected minADE of k samples
    bins: list[Bin]
    own: dict[str, Errors]  # where the agent itself has an event: shown, never ranked
    own_events: dict[str, int]
    guessed_parents: float | None  # share of frames in which the lineage of own events had to be guessed
    tracking: Tracking
    invalid: dict[str, int]  # rows rejected: tracks, hypotheses, objects
    dropped_detections: Count
