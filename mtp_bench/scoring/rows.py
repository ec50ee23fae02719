"""Rows of a report. Their fields are the keys of its JSON and declare the columns of its tables.

None stands for undefined, never NaN. `Report.to_json` writes them.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_serializer

from ..strict import Section
from ..tables import Column
from .definitions import Subset

Count = Annotated[int, Field(ge=0)]
Interval = Annotated[tuple[float, float], Field(strict=False)]  # 95 %; JSON has a list of two
Point = Annotated[tuple[float, float], Field(strict=False)]
Budget = Literal["equal", "free"]


Metres = Annotated[float | None, Column(unit="m", better="lower")]
Share = Annotated[float | None, Column(unit="share", better="higher")]
ErrorPart = Annotated[float | None, Column(unit="m", better="lower", optional=True)]
Difference = Annotated[float | None, Column(unit="m", better="lower", format="+.3f")]
Cost = Annotated[float | None, Column(unit="m", better="lower", optional=True)]
IntervalColumn = Annotated[Interval | None, Column(interval=True, help="95 % interval.")]
Score = Annotated[float | None, Column(better="higher")]
PValue = Annotated[float | None, Column(format=".3f", help="Sign-flip test over units.")]


class AgentSetting(Section):
    """An agent in one setting."""

    agent: Annotated[str, Column()]
    hypotheses: Annotated[Count, Column("H", help="Hypotheses of the tracker.")]
    samples: Annotated[Count, Column("K", help="Samples per object.")]
    budget: Annotated[Budget, Column("samples allowed", help="equal: k of the task; free: more.")]


class Row(AgentSetting):
    """Numbers of one subset of the targets.

    A further metric is a field here, optional and None by default, and its value in `report`.
    """

    subset: Annotated[Subset, Column()]
    minADE: Annotated[Metres, Column(help="Over covered targets.")]  # noqa: N815  (a fixed name of the files)
    minFDE: Annotated[Metres, Column(help="Over covered targets.")]  # noqa: N815
    error: Annotated[float | None, Column("bADE", "m", "lower", help="Budgeted ADE, which decides the place.")]
    interval: IntervalColumn
    localisation: Annotated[ErrorPart, Column("with forecast", help="Part of bADE from such targets.")] = None
    missed: Annotated[ErrorPart, Column("without forecast", help="Part of bADE from such targets.")] = None
    error_by_score: Annotated[
        ErrorPart, Column(help="bADE with the score of the nearest detection as the confidence.")
    ] = None
    cost_ground_truth: Annotated[Cost, Column("predictor", help="On ground-truth tracks.")] = None
    cost_localisation: Annotated[Cost, Column("localisation", help="Of the present place.")] = None
    cost_history: Annotated[Cost, Column("history", help="Measured places in place of true ones.")] = None
    cost_association: Annotated[Cost, Column("association", help="Beyond perfect association.")] = None
    cost_rest: Annotated[Cost, Column("rest", help="Of forecasts that no reference splits.")] = None
    cost_below_threshold: Annotated[Cost, Column("below threshold", help="Forecasts of too low confidence.")] = None
    cost_no_forecast: Annotated[Cost, Column("no forecast", help="Detected, but without a forecast.")] = None
    cost_other_class: Annotated[Cost, Column("other class", help="Detected as another class.")] = None
    cost_off_place: Annotated[Cost, Column("off place", help="Detected within two gates.")] = None
    cost_undetected_new: Annotated[Cost, Column("never detected so far")] = None
    cost_undetected_seen: Annotated[Cost, Column("not detected now", help="Detected earlier.")] = None
    plain_error: Annotated[ErrorPart, Column(help="Error with every forecast kept.")] = None
    fixed_error: Annotated[ErrorPart, Column(help="Per target, forecasts of confidence 0.5 or more.")] = None
    energy_score: ErrorPart = None
    coverage: Annotated[Share, Column(help="Targets that have a forecast.")]
    difference_to_stp: Annotated[Difference, Column(help="Difference of bADE.")]
    difference_interval: IntervalColumn
    p: PValue
    gap_closed: Annotated[Share, Column(help="Between stp and prediction on ground-truth tracks.")]
    gap_interval: IntervalColumn
    gap_closed_same_predictor: Annotated[Share, Column(help="Between a reference pair with the agent's predictor.")]
    gap_same_predictor_interval: IntervalColumn
    association_gap_closed: Annotated[
        Share, Column(help="Between equal samples, without and with perfect association.")
    ] = None
    association_gap_interval: IntervalColumn = None
    gap_blank_because: Annotated[str | None, Column(help="Reason of a missing gap_closed.")] = None
    association_gap_blank_because: Annotated[str | None, Column(help="Reason of a missing association gap.")] = None
    place: Annotated[int | None, Column(better="lower", help="By bADE. Missing: shown, not ranked.")] = None
    rank_range: Annotated[
        tuple[int, int] | None,
        Column("ranks", help="1 + the number of agents that are significantly better, to n - the number worse."),
        Field(strict=False),
    ] = None
    unranked_because: Annotated[str | None, Column()]
    targets: Annotated[Count, Column()]
    effective_targets: Annotated[float, Column(format=".1f", help="Effective sample size (Kish).")]
    # expected number in a run of the reference tracker; of "paper_" subsets those of plain STP
    events: Annotated[float | None, Column(format=".1f", help="Expected number of events.")]
    objects: Annotated[Count, Column()]
    effective_objects: Annotated[float, Column(format=".1f", help="Effective sample size (Kish).")]
    scenes: Annotated[Count, Column()]
    effective_units: Annotated[float, Column(format=".1f", help="Effective number of blocks of at most 20 s.")]
    seeds: Annotated[Count, Column()]
    ms_per_frame: Annotated[float | None, Column("ms per frame", "ms", "lower", ".1f")]


class PairedRow(AgentSetting):
    """Differences of an agent to a control on one subset."""

    other: Annotated[str, Column("less", help="The control.")]
    subset: Annotated[Subset, Column()]
    error: Annotated[Difference, Column("bADE")]
    interval: IntervalColumn
    p: PValue
    minADE: Annotated[Difference, Column(help="Over targets that both cover.")]  # noqa: N815
    minADE_interval: IntervalColumn  # noqa: N815
    targets: Annotated[Count, Column()]
    shared: Annotated[Count, Column(help="Targets that both cover.")]
    scenes: Annotated[Count, Column()]


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
    IDS: Annotated[Count, Column("IDS", better="lower", group="CLEAR")]
    FRAG: Annotated[Count, Column("FRAG", better="lower", group="CLEAR")]
    MOTA: Score
    MOTP: float | None  # mean IoU or mean distance in metres, as the event gate measures
    IDF1: Score
    HOTA: Score


class Tracking(Section):
    """Tracking numbers of the first seed."""

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


class Details(AgentSetting):
    """Further numbers of an agent over all targets."""

    seeds: Count
    silence: float | None  # m, error if nothing is predicted
    miss_rate: Annotated[float | None, Column("MR", "", "lower", help="Over all targets; uncovered ones are missed.")]
    PI_ADE: Annotated[float | None, Column("PI-ADE", better="lower")]
    EPA: Score
    AP_f: Annotated[Score, Column("AP_f")]
    brier: Annotated[float | None, Column("Brier", "", "lower", help="Of the confidences in live frames.")]
    reliability: list[Reliability]
    forecasts_per_frame: Annotated[float, Column("forecasts", format=".1f", help="Per live frame.")]
    false_per_frame: Annotated[float | None, Column("false", "", "lower", ".1f", help="Per live frame.")]
    curve: list[Point]  # false forecasts per target (forecasts per live frame where those cannot be known), error in m
    k_curve: dict[str, float | None]  # k -> expected minADE of k samples
    bins: list[Bin]
    own: dict[str, Errors]  # where the agent itself has an event: shown, never ranked
    own_events: dict[str, int]
    guessed_parents: float | None  # share of frames in which the lineage of own events had to be guessed
    tracking: Tracking
    invalid: dict[str, int]  # rows rejected: tracks, hypotheses, objects
    dropped_detections: Count
