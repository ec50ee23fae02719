"""The schema of a record, and in what two contents of it differ."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal, NamedTuple, get_args

from pydantic import Field

from ..scoring.rows import Count, Interval, Row
from ..scoring.statistics import ratio
from ..scoring.subsets import Subset
from ..strict import Section

Status = Literal["finished", "partial", "crashed", "rejected"]
Level = Literal["scored", "re-scored", "re-run", "hidden seeds"]
LEVELS: tuple[Level, ...] = get_args(Level)  # from the weakest on, each includes those before it
TOLERANCE = 1e-9  # of a number that is scored again, absolute and relative
_FileName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]  # it becomes part of a path
_Hex = Annotated[str, Field(pattern=r"^[0-9a-f]*$")]


class SubmissionPart(Section):
    """What was run."""

    name: _FileName
    authors: list[str]
    description: str
    digest: _Hex  # over all files of the folder
    parameters: dict[str, Any]
    ends: Literal["controls", "own"] | None  # of its gap: stp and truth_past have its predictor, or it states others


class EnvPart(Section):
    """What it was run on."""

    id: _FileName
    card_digest: _Hex
    split: str
    data_manifest: _Hex  # over all that the scorer read
    scenes: Count
    scenes_of_split: Count
    observe: Literal["detections", "truth"]
    truth_complete: bool  # False: false forecasts are not known, all forecasts count against the budgets
    keywords: dict[str, Any]  # settings of the env beyond the card


class ScorerPart(Section):
    """What scored it."""

    definitions: str
    source_digest: _Hex


class ReferencePart(Section):
    """The event weights."""

    name: str  # the baseline whose events they are
    hash: _Hex
    origin: str
    frozen: bool  # those that ship for the env; False: made from the scenes of this record


class HardwarePart(Section):
    """Where it was run."""

    cpu: str
    cores: Count
    memory_gib: float
    gpu: str | None


class LatencyPart(Section):
    """Time per answer; the first of each scene, in which code is loaded and compiled, is left out."""

    p50_ms: float | None
    p95_ms: float | None
    max_ms: float | None
    limit_ms: float  # later answers are misses


class MissedPart(Section):
    """Frames, over all scenes and seeds, that are missing for another reason than silence; and scenes cut short."""

    late: Count
    malformed: Count
    crashed_scenes: Count  # of scenes x seeds
    reasons: dict[str, str]  # "scene|seed" -> why it was cut short


class IsolationPart(Section):
    """What held the agent in every run, the weakest of them; as `gateway.Isolation`."""

    mechanism: Literal["bubblewrap", "namespaces", "none"]
    filtered: bool
    memory: Literal["cgroup", "watch"]
    cuda: bool

    @property
    def holds(self) -> bool:
        """Whether it was kept from truth, network and other processes."""
        return self.mechanism != "none" and self.filtered


class ScenePart(Section):
    """What ranks, summed over the targets of each unit of one scene: enough to rank records without their rollouts."""

    scene: str
    weight: dict[Subset, list[float]]  # [units of the scene] of the targets
    error: dict[Subset, list[float]]  # [units] m, weighted, at the budgets of the whole record, mean over seeds

    @property
    def targets(self) -> int:
        """Their number."""
        return round(sum(self.weight["all"]))

    @property
    def mean_error(self) -> float | None:
        """Over all targets, m; None without any."""
        return ratio(sum(self.error["all"]), sum(self.weight["all"]))


class HiddenPart(Section):
    """Error on scenes of secret seeds, over all of them: the name of a scene tells its seed."""

    commitment: _Hex  # sha256 of the secret
    weights: _Hex  # hash of their event weights, which are made once per seal
    scenes: Count
    targets: Count
    error: float | None
    interval: Interval | None


class Record(Section):
    """One submission on one env.

    The rows have no ranks: those depend on the records beside it. ``gap_closed`` is null in them for the same reason,
    and so is ``gap_closed_same_predictor``, unless the ends were run with the submission.
    """

    format: Literal[2] = 2
    submission: SubmissionPart
    division: Literal["closed", "open"]
    training_data: list[str]  # as declared
    env: EnvPart
    scorer: ScorerPart
    reference: ReferencePart
    seeds: list[int]
    status: Status
    status_reason: str
    verification: Level = "scored"
    hidden: HiddenPart | None = None
    versions: dict[str, str]
    hardware: HardwarePart
    latency: LatencyPart
    peak_memory_mib: float
    missed: MissedPart
    isolation: IsolationPart
    hypotheses: Count
    samples: Count
    rows: list[Row]  # one per subset
    silence: float | None  # m, what an agent that says nothing scores
    details: dict[str, Any]  # as `Details` of the scorer are written
    per_scene: list[ScenePart]
    seals: dict[str, str]  # "scene|seed" -> hash chain over the answers as they came
    rollout_digests: dict[str, str]  # "scene|seed"
    made: str  # ISO date, UTC
    digest: _Hex = ""

    @property
    def row(self) -> Row:
        """The row of the subset "all"."""
        return self.row_of("all")

    def row_of(self, subset: Subset) -> Row:
        """The row of one subset."""
        return next(row for row in self.rows if row.subset == subset)

    def unit_weight(self, subset: Subset) -> list[float]:
        """Weight of the targets of each unit, over all scenes."""
        return [value for scene in self.per_scene for value in scene.weight[subset]]

    def unit_error(self, subset: Subset) -> list[float]:
        """What ranks, times the weight, summed over the targets of each unit, m."""
        return [value for scene in self.per_scene for value in scene.error[subset]]


class Difference(NamedTuple):
    """Something that a record says and that was found to be otherwise."""

    what: str
    recorded: Any
    found: Any


def unequal(where: str, recorded: Any, found: Any) -> Iterator[Difference]:
    """The leaves in which two contents of JSON differ, numbers by more than TOLERANCE."""
    if isinstance(recorded, dict) and isinstance(found, dict):
        for name in dict.fromkeys([*recorded, *found]):
            path = f"{where}.{name}" if where else name
            yield from unequal(path, recorded.get(name), found.get(name))
    elif isinstance(recorded, list) and isinstance(found, list) and len(recorded) == len(found):
        for index, (one, other) in enumerate(zip(recorded, found, strict=True)):
            yield from unequal(f"{where}[{index}]", one, other)
    elif not _same(recorded, found):
        yield Difference(where, recorded, found)


def _same(recorded: Any, found: Any) -> bool:
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in (recorded, found))
    if numbers:
        return math.isclose(recorded, found, rel_tol=TOLERANCE, abs_tol=TOLERANCE)
    return type(recorded) is type(found) and bool(recorded == found)
