"""Rows of a report.

Their fields are the keys of its JSON and declare the columns of its tables. None stands
for undefined, never NaN. `Report.to_json` writes them. Every field has a sentence, of
its column or of its `Field`: the page of JSON keys is made of them.
"""

from typing import Annotated, Any, Literal

from pydantic import Field, model_serializer

from ..core import Column, Section
from .definitions import Subset

Count = Annotated[int, Field(ge=0)]
# 95 %; JSON has a list of two
Interval = Annotated[tuple[float, float], Field(strict=False)]
Point = Annotated[tuple[float, float], Field(strict=False)]
Probability = Annotated[float, Field(ge=0, le=1)]
Budget = Literal["equal", "free"]

Metres = Annotated[float | None, Column(unit="m", better="lower")]
Share = Annotated[float | None, Column(unit="share", better="higher")]
ErrorPart = Annotated[float | None, Column(unit="m", better="lower", optional=True)]
Difference = Annotated[float | None, Column(unit="m", better="lower", format="+.3f")]
IntervalColumn = Annotated[
    Interval | None, Column(interval=True, help="95 % interval of the number before.")
]
Score = Annotated[float | None, Column(better="higher")]
Milliseconds = Annotated[
    float | None,
    Column("ms per frame", "ms", "lower", ".1f", help="Mean time of `act`."),
]
_SUBSET = Column(
    help="Subset of the targets: all, those that turn, or weighted by how often an "
    "event happens there."
)
_SEEDS = "Runs with different random draws, of which numbers are means."
_TARGETS = Annotated[Count, Column(help="Targets with a weight above 0.")]
_SCENES = Annotated[Count, Column(help="Scenes that have these targets.")]
PValue = Annotated[
    float | None, Column(format=".3f", help="p of the sign-flip test over units.")
]


def described(meaning: str) -> Any:
    """Declare a field that no table shows, with the ``meaning`` of its key."""
    return Field(description=meaning)


class AgentSetting(Section):
    """An agent in one setting."""

    agent: Annotated[
        str,
        Column(
            help="Name of the submission, with the parameters that are not its default "
            "ones."
        ),
    ]
    hypotheses: Annotated[Count, Column("H", help="Hypotheses of the tracker.")]
    samples: Annotated[Count, Column("K", help="Samples per object.")]
    budget: Annotated[
        Budget, Column("samples allowed", help="equal: k of the task; free: more.")
    ]


class Row(AgentSetting):
    """Numbers of one subset of the targets.

    A further metric is a field here, optional and None by default, and its value in
    `report`.
    """

    subset: Annotated[Subset, _SUBSET]
    minADE: Annotated[
        Metres, Column(help="Mean distance of the best sample, over covered targets.")
    ]
    minFDE: Annotated[
        Metres, Column(help="Final distance of the best sample, over covered targets.")
    ]
    error: Annotated[
        float | None,
        Column("bADE", "m", "lower", help="Budgeted ADE, which decides the place."),
    ]
    interval: IntervalColumn
    localisation: Annotated[
        ErrorPart, Column("with forecast", help="Part of bADE: covered targets.")
    ] = None
    missed: Annotated[
        ErrorPart, Column("without forecast", help="Part of bADE: other targets.")
    ] = None
    error_by_score: Annotated[
        ErrorPart,
        Column(help="bADE with the score of the nearest detection as the confidence."),
    ] = None
    cost_ground_truth: Annotated[
        ErrorPart,
        Column("predictor", help="Part of bADE: error on ground-truth tracks."),
    ] = None
    cost_localisation: Annotated[
        ErrorPart, Column("localisation", help="Part of bADE: present position.")
    ] = None
    cost_history: Annotated[
        ErrorPart, Column("history", help="Part of bADE: past positions are measured.")
    ] = None
    cost_association: Annotated[
        ErrorPart,
        Column("association", help="Part of bADE: beyond perfect association."),
    ] = None
    cost_rest: Annotated[
        ErrorPart,
        Column("rest", help="Part of bADE: forecasts that no reference splits."),
    ] = None
    cost_below_threshold: Annotated[
        ErrorPart, Column("below threshold", help="Part of bADE: left out by budgets.")
    ] = None
    cost_no_forecast: Annotated[
        ErrorPart, Column("no forecast", help="Part of bADE: only detected.")
    ] = None
    cost_other_class: Annotated[
        ErrorPart,
        Column("other class", help="Part of bADE: detected as another class."),
    ] = None
    cost_off_place: Annotated[
        ErrorPart, Column("off place", help="Part of bADE: detected within two gates.")
    ] = None
    cost_undetected_new: Annotated[
        ErrorPart, Column("never detected so far", help="Part of bADE.")
    ] = None
    cost_undetected_seen: Annotated[
        ErrorPart, Column("not detected now", help="Part of bADE: detected earlier.")
    ] = None
    plain_error: Annotated[
        ErrorPart, Column(help="Error with every forecast kept.")
    ] = None
    fixed_error: Annotated[
        ErrorPart, Column(help="Per target, forecasts of confidence 0.5 or more.")
    ] = None
    energy_score: Annotated[
        ErrorPart, Column(help="Energy score, over covered targets.")
    ] = None
    coverage: Annotated[
        Share, Column(help="Share of the targets that have a forecast.")
    ]
    difference_to_stp: Annotated[
        Difference, Column(help="bADE less that of stp on the same targets.")
    ]
    difference_interval: IntervalColumn
    p: PValue
    gap_closed: Annotated[
        Share,
        Column(
            help="Share closed of the gap from stp to prediction on ground-truth "
            "tracks."
        ),
    ]
    gap_interval: IntervalColumn
    gap_closed_same_predictor: Annotated[
        Share, Column(help="The same gap with the agent's own predictor.")
    ]
    gap_same_predictor_interval: IntervalColumn
    association_gap_closed: Annotated[
        Share,
        Column(
            help="Share closed of the gap from the same samples to perfect association."
        ),
    ] = None
    association_gap_interval: IntervalColumn = None
    gap_blank_because: Annotated[
        str | None, Column(help="Reason of a missing gap_closed.")
    ] = None
    association_gap_blank_because: Annotated[
        str | None, Column(help="The same of association_gap_closed.")
    ] = None
    place: Annotated[
        int | None,
        Column(better="lower", help="Position by bADE. Missing: shown, not ranked."),
    ] = None
    rank_range: Annotated[
        tuple[int, int] | None,
        Column(
            "ranks",
            help="1 + the number of agents that are significantly better, to n - the "
            "number worse.",
        ),
        Field(strict=False),
    ] = None
    unranked_because: Annotated[str | None, Column(help="Reason of a missing rank.")]
    targets: _TARGETS
    effective_targets: Annotated[
        float, Column(format=".1f", help="Effective number of targets (Kish).")
    ]
    # in a run of the reference tracker; of "paper_" subsets those of plain STP
    events: Annotated[
        float | None,
        Column(
            format=".1f", help="Expected number of events of the reference tracker."
        ),
    ]
    objects: Annotated[Count, Column(help="Objects that have these targets.")]
    effective_objects: Annotated[
        float, Column(format=".1f", help="Effective number of objects (Kish).")
    ]
    scenes: _SCENES
    effective_units: Annotated[
        float, Column(format=".1f", help="Effective number of blocks of at most 20 s.")
    ]
    seeds: Annotated[Count, Column(help=_SEEDS)]
    ms_per_frame: Milliseconds


class PairedRow(AgentSetting):
    """Differences of an agent to a control on one subset."""

    other: Annotated[str, Column("less", help="The control that is subtracted.")]
    subset: Annotated[Subset, _SUBSET]
    error: Annotated[Difference, Column("bADE", help="bADE less that of the control.")]
    interval: IntervalColumn
    p: PValue
    minADE: Annotated[
        Difference,
        Column(help="minADE less that of the control, over targets that both cover."),
    ]
    minADE_interval: IntervalColumn
    targets: _TARGETS
    shared: Annotated[Count, Column(help="Targets that both cover.")]
    scenes: _SCENES


class Errors(Section):
    """Errors over some of the targets."""

    minADE: float | None = described(
        "Mean distance of the best sample, over covered targets, metres."
    )
    minFDE: float | None = described(
        "Final distance of the best sample, over covered targets, metres."
    )
    error: float | None = described("bADE at the budgets of all targets, metres.")
    plain_error: float | None = described("Error with every forecast kept, metres.")
    coverage: float | None = described("Share of the targets that have a forecast.")
    targets: Count = described("Targets.")
    objects: Count = described("Objects that have these targets.")
    scenes: Count = described("Scenes that have these targets.")


class Bin(Section):
    """Errors over the targets of one distance, class or motion."""

    by: Literal["distance", "class", "motion"] = described(
        "What the bins divide the targets by."
    )
    bin: str = described("Metres to the ego, a class, or moving and static.")
    errors: Errors
    EPA: float | None = Field(
        default=None, description="End-to-end prediction accuracy, of classes alone."
    )

    @model_serializer
    def _flat(self) -> dict[str, Any]:
        row = {"by": self.by, "bin": self.bin, **self.errors.model_dump()}
        if self.by == "class":
            row["EPA"] = self.EPA
        return row


class Clear(Section):
    """Tracking numbers, None for an agent that states no tracks.

    Also None where a false positive cannot be known: the truth is not complete.
    """

    TP: Count | None = described("Matched tracks (true positives), summed over frames.")
    FP: Count | None = described(
        "Tracks of no object (false positives), summed over frames."
    )
    FN: Count | None = described(
        "Objects without a track (false negatives), summed over frames."
    )
    IDS: Annotated[
        Count | None,
        Column("IDS", better="lower", group="CLEAR", help="Identity switches."),
    ]
    FRAG: Annotated[
        Count | None,
        Column("FRAG", better="lower", group="CLEAR", help="Fragmentations."),
    ]
    MOTA: Annotated[Score, Column(help="Multi-object tracking accuracy.")]
    MOTP: float | None = described(
        "Mean IoU or mean distance in metres of the matches, as the gate measures."
    )
    IDF1: Annotated[Score, Column(help="F1 of the identities.")]
    HOTA: Annotated[Score, Column(help="Higher order tracking accuracy.")]


class Tracking(Section):
    """Tracking numbers of the first seed."""

    all: Clear = described(
        "Numbers over all classes; those of each class stand beside."
    )
    classes: dict[str, Clear]
    false_positives: Count | None = described(
        "Tracks of no object, summed over frames."
    )
    false_tracks: Count | None = described(
        "Tracks that are matched in no frame of their life."
    )

    @model_serializer
    def _flat(self) -> dict[str, Any]:
        classes = {name: clear.model_dump() for name, clear in self.classes.items()}
        return {
            "all": self.all.model_dump(),
            **classes,
            "false_positives": self.false_positives,
            "false_tracks": self.false_tracks,
        }


class Reliability(Section):
    """Forecasts in a range of confidence, and how many match a true object."""

    confidence: Probability = described("Mean confidence.")
    matched: Probability = described("Share that is of a true object.")
    forecasts: Count = described("Number of forecasts.")


class Details(AgentSetting):
    """Further numbers of an agent over all targets."""

    seeds: Count = described(_SEEDS)
    nothing_predicted: float | None = described(
        "Error if nothing is predicted, metres."
    )
    miss_rate: Annotated[
        float | None,
        Column("MR", "", "lower", help="Miss rate; uncovered targets are missed."),
    ]
    PI_ADE: Annotated[
        float | None,
        Column(
            "PI-ADE", better="lower", help="Error, metres, near the ego weighing more."
        ),
    ]
    EPA: Annotated[Score, Column(help="End-to-end prediction accuracy.")]
    AP_f: Annotated[Score, Column("AP_f", help="Forecasting average precision.")]
    brier: Annotated[
        float | None,
        Column(
            "Brier", "", "lower", help="Brier score of the confidences in live frames."
        ),
    ]
    reliability: list[Reliability] = described("Calibration by range of confidence.")
    forecasts_per_frame: Annotated[
        float, Column("forecasts", format=".1f", help="Forecasts per live frame.")
    ]
    false_per_frame: Annotated[
        float | None,
        Column("false", "", "lower", ".1f", help="False ones per live frame."),
    ]
    curve: list[Point] = described(
        "False forecasts per target (forecasts per live frame where those cannot be "
        "known), and the error in metres."
    )
    k_curve: dict[str, float | None] = described(
        "Expected minADE of k samples by k, metres."
    )
    bins: list[Bin] = described("Errors by distance, class and motion.")
    own: dict[str, Errors | None] = described(
        "Errors where the agent itself has an event: shown, never ranked. Each is null "
        "for an agent without tracks."
    )
    own_events: dict[str, int | None] = described(
        "Number of the agent's own events, by kind; each is null for an agent without "
        "tracks."
    )
    guessed_parents: float | None = described(
        "Share of frames in which the lineage of own events had to be guessed."
    )
    tracking: Tracking = described(
        "Tracking numbers of the first seed; each is null for an agent without tracks."
    )
    invalid: dict[str, int] = described(
        "Rejected rows of the agent's actions, by table."
    )
    dropped_detections: Count = described(
        "Detections beyond the range or the number of the task, not shown to the agent."
    )


class OfficialRow(Section):
    """A number of an official program."""

    agent: Annotated[str, Column(help="Name of the agent.")]
    number: Annotated[str, Column(help="Program and number, with its unit.")]
    targets: Annotated[Count, Column(help="True objects that it counts.")]
    value: Annotated[float | None, Column(help="The number.")]
