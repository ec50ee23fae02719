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
Budget = Literal["equal", "free"]


class Setting(Section):
    """An agent in one setting."""

    agent: str
    hypotheses: Count
    samples: Count  # per object


class Row(Setting):
    """Numbers of one subset of the targets."""

    budget: Budget
    subset: Subset
    minADE: float | None  # noqa: N815  (m; a fixed name of the files)
    minFDE: float | None  # noqa: N815
    missing_aware: float | None
    energy_score: float | None
    coverage: float | None
    gap_closed: float | None
    targets: Count
    events: Count | None
    objects: Count
    scenes: Count
    interval: Interval | None  # of missing_aware
    ms_per_frame: float | None


class RankRow(Setting):
    """The rank of an agent on one subset."""

    subset: Subset
    rank: int | None  # None: shown, never ranked


class PairedRow(Setting):
    """Differences of an agent to a control on one subset."""

    other: str  # the control
    subset: Subset
    missing_aware: float | None
    interval: Interval | None  # of missing_aware
    p: float | None  # sign-flip test over scenes
    minADE: float | None  # noqa: N815  (where both cover a target)
    minADE_interval: Interval | None  # noqa: N815
    targets: Count
    shared: Count  # targets that both cover
    scenes: Count
    gap_interval: Interval | None  # of the agent's gap_closed


class Parts(Section):
    """The parts that the missing-aware error of all targets adds up from, metres."""

    localisation: float | None
    missed: float | None
    false: float | None  # None: the truth is not complete


class Errors(Section):
    """Errors over some of the targets."""

    minADE: float | None  # noqa: N815
    minFDE: float | None  # noqa: N815
    missing_aware: float | None
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
    """CLEAR numbers; None where a false positive cannot be known because the truth is not complete."""

    TP: Count
    FP: Count | None
    FN: Count
    IDS: Count
    FRAG: Count
    MOTA: float | None
    MOTP: float | None  # mean IoU or mean distance in metres, as the event gate measures


class Tracking(Section):
    """CLEAR numbers of the first seed, and its false output."""

    all: Clear
    classes: dict[str, Clear]
    false_positives: Count | None
    false_tracks: Count | None  # matched in no frame of their life

    @model_serializer
    def _flat(self) -> dict[str, Any]:
        classes = {name: clear.model_dump() for name, clear in self.classes.items()}
        false = {"false_positives": self.false_positives, "spurious_tracks": self.false_tracks}
        return {"all": self.all.model_dump(), **classes, **false}


class Details(Setting):
    """What lies behind the rows of an agent, over all targets."""

    budget: Budget
    seeds: Count
    parts: Parts
    silence: float | None  # m, what an agent that says nothing scores
    miss_rate: float | None
    PI_ADE: float | None
    EPA: float | None
    AP_f: float | None
    forecasts_per_frame: float
    spurious_per_frame: float | None  # false forecasts
    k_curve: dict[str, float | None]  # k -> expected minADE of k samples
    bins: list[Bin]
    own: dict[str, Errors]  # where the agent itself has an event: shown, never ranked
    own_events: dict[str, int]
    tracking: Tracking
    invalid: dict[str, int]  # rows rejected: tracks, hypotheses, objects
    dropped_detections: Count
