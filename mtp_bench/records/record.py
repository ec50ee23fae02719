"""The schema of a record and of what hidden scenes add to it, and in what two contents of them differ."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field

from .._version import __version__
from ..running.options import MOST_SEED
from ..scoring.rows import Count, Row
from ..scoring.statistics import ratio
from ..scoring.subsets import Subset
from ..strict import Section
from ..submission.manifest import NAME_PATTERN
from .canonical import Date, Sha256

Division = Literal["closed", "open"]
Mechanism = Literal["bubblewrap", "none"]
Status = Literal["finished", "partial", "crashed", "rejected"]
EARLIER, EARLIER_VERSIONS = "0.2", ("0.1.", "0.2.")  # label of what these versions of the package made
TOLERANCE = 1e-9  # of a number that is scored again, absolute and relative
MOST_NAME, MOST_TEXT = 100, 2000  # characters of a name, and of a description or a reason
MOST_NAMES, MOST_SCENES = 50, 10_000  # in a list; of a record

_FileName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=MOST_NAME)]  # part of a path
_Name = Annotated[str, Field(max_length=MOST_NAME)]
_Text = Annotated[str, Field(max_length=MOST_TEXT)]
_CardDigest = Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]
_Unmade = Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")]  # empty until the record is sealed
_Seconds = Annotated[float, Field(gt=0, le=86_400)]
_Bytes = Annotated[int, Field(gt=0, le=1 << 40)]
_NotNegative = Annotated[float, Field(ge=0)]
UnitSums = dict[Subset, Annotated[list[Annotated[float, Field(ge=0, le=1e9)]], Field(max_length=100_000)]]


class SubmissionPart(Section):
    """What was run."""

    name: Annotated[str, Field(pattern=NAME_PATTERN, max_length=MOST_NAME)]
    authors: Annotated[list[_Name], Field(max_length=MOST_NAMES)]
    description: _Text
    source: Annotated[str, Field(pattern=r"^(https?://\S+)?$", max_length=MOST_TEXT)]  # where it is published
    commit: Annotated[str, Field(pattern=r"^([0-9a-f]{7,64})?$")]
    paper: Annotated[str, Field(pattern=r"^(https?://\S+)?$", max_length=MOST_TEXT)]  # where it is described
    license: _Name
    digest: Sha256  # over all files that ran: those of the folder, and these weights
    networks: dict[_Name, Sha256]  # weights beside the folder, trained on the machine where it ran: file, its sha256
    parameters: dict[str, Any]
    ends: Literal["controls", "own"] | None  # of its gap: stp and truth_past have its predictor, or it states others


class EnvPart(Section):
    """What it was run on."""

    id: _FileName
    card_digest: _CardDigest
    split: _Name
    data_manifest: Sha256  # over all that the scorer read
    scenes: Annotated[int, Field(ge=1, le=MOST_SCENES)]
    scenes_of_split: Count
    observe: Literal["detections", "truth", "tracks"]
    truth_complete: bool  # False: false forecasts are not known, all forecasts count against the budgets
    keywords: dict[str, Any]  # settings of the env beyond the card


class ScorerPart(Section):
    """What scored it."""

    definitions: _Name
    source_digest: Sha256  # of the version of the definitions and the golden results, see `scorer_digest`


class ReferencePart(Section):
    """The event weights."""

    name: _Name  # the baseline whose events they are
    hash: Sha256
    origin: _Text
    frozen: bool  # those that ship for the env; False: made from the scenes of this record


class HardwarePart(Section):
    """Where it was run."""

    cpu: _Text
    cores: Count
    memory_gib: _NotNegative
    gpu: _Text | None


class LatencyPart(Section):
    """Time per answer; the first of each scene, in which code is loaded and compiled, is left out."""

    p50_ms: _NotNegative | None
    p95_ms: _NotNegative | None
    max_ms: _NotNegative | None


class MeasuredPart(Section):
    """What an equal run would not repeat: outside the digest of the record, with a digest of its own."""

    hardware: HardwarePart
    latency: LatencyPart
    ms_per_frame: _NotNegative | None  # mean
    peak_memory_mib: _NotNegative
    made: Date  # UTC
    digest: _Unmade = ""


class LimitsPart(Section):
    """What the agent was allowed; as `gateway.Limits`."""

    start: _Seconds
    reset: _Seconds
    first_frame: _Seconds
    frame: _Seconds  # later answers are misses
    scene: _Seconds
    memory: _Bytes
    disk: _Bytes
    answer: _Bytes
    cuda: bool = False  # it was given the graphics cards


class MissedPart(Section):
    """Frames, over all scenes and seeds, that are missing for another reason than silence; and scenes cut short."""

    late: Count
    malformed: Count
    crashed_scenes: Count  # of scenes x seeds
    reasons: dict[str, _Text]  # "scene|seed" -> why it was cut short


class IsolationPart(Section):
    """What held the agent in every run, the weakest of them; as `gateway.Isolation`."""

    mechanism: Mechanism
    memory: Literal["cgroup", "watch"]

    @property
    def sandboxed(self) -> bool:
        """Whether the agent could not reach truth, network and other processes."""
        return self.mechanism != "none"


class HashesPart(Section):
    """What another run must repeat, over all scenes and seeds."""

    seals: Sha256  # of the hash chains over the answers as they came
    rollouts: Sha256  # of the digests of the rollouts


class ScenePart(Section):
    """What ranks, summed over the targets of each unit of one scene: enough to rank records without their rollouts."""

    scene: _Name
    weight: UnitSums  # [units of the scene] of the targets
    error: UnitSums  # [units] m, weighted, at the budgets of the whole record, mean over seeds

    @property
    def targets(self) -> int:
        """Their number."""
        return round(sum(self.weight["all"]))

    @property
    def mean_error(self) -> float | None:
        """Over all targets, m; None without any."""
        return ratio(sum(self.error["all"]), sum(self.weight["all"]))


class Record(Section):
    """One submission on one env: an equal run gives an equal record, but for what is measured.

    The rows have no ranks: those depend on the records beside it. ``gap_closed`` is null in them for the same reason,
    and so is ``gap_closed_same_predictor``, unless the ends were run with the submission; ``ms_per_frame`` is measured.
    How far a record was checked stands in a signed file beside it, see `attestation`.
    """

    format: Literal[2] = 2
    submission: SubmissionPart
    division: Division
    training_data: Annotated[list[_Text], Field(max_length=MOST_NAMES)]  # as declared
    env: EnvPart
    scorer: ScorerPart
    reference: ReferencePart
    seeds: Annotated[list[Annotated[int, Field(ge=0, le=MOST_SEED)]], Field(max_length=MOST_NAMES)]
    status: Status
    status_reason: _Text
    versions: Annotated[dict[str, _Name], Field(max_length=MOST_NAMES)]
    limits: LimitsPart
    missed: MissedPart
    isolation: IsolationPart
    hypotheses: Count
    samples: Count
    rows: list[Row]  # one per subset
    silence: float | None  # m, what an agent that says nothing scores
    details: dict[str, Any]  # as `Details` of the scorer are written
    per_scene: Annotated[list[ScenePart], Field(max_length=MOST_SCENES)]
    hashes: HashesPart
    measured: MeasuredPart
    digest: _Unmade = ""

    @property
    def row(self) -> Row:
        """The row of the subset "all"."""
        return self.row_of("all")

    def row_of(self, subset: Subset) -> Row:
        """The row of one subset."""
        return next(row for row in self.rows if row.subset == subset)

    @property
    def earlier_version(self) -> str:
        """Version that made the record where its digests are not comparable with today's, "0.2"; else empty."""
        made_by = self.versions.get("mtp-bench", __version__)
        return EARLIER if made_by.startswith(EARLIER_VERSIONS) else ""

    @property
    def runs(self) -> int:
        """Number of scenes x seeds."""
        return len(self.per_scene) * len(self.seeds)

    @property
    def unfinished(self) -> str:
        """Why not every scene was lived to its end, in a few words; empty where every one was."""
        if self.status != "finished":
            return f"{self.status}: {self.status_reason}"
        cut = self.missed.crashed_scenes
        return f"{cut} of {self.runs} scenes and seeds were cut short" if cut else ""

    def unit_weight(self, subset: Subset) -> list[float]:
        """Weight of the targets of each unit, over all scenes."""
        return [value for scene in self.per_scene for value in scene.weight[subset]]

    def unit_error(self, subset: Subset) -> list[float]:
        """What ranks, times the weight, summed over the targets of each unit, m."""
        return [value for scene in self.per_scene for value in scene.error[subset]]


class HiddenPart(Section):
    """What was scored on scenes of secret seeds, without their names: a name tells the seed."""

    commitment: Sha256  # of the secret
    weights: Sha256  # hash of their event weights, which are made once per seal
    scenes: Count
    rows: list[Row]  # one per subset
    silence: float | None  # m, what an agent that says nothing scores there
    weight: UnitSums  # [units] of the targets, over all scenes, in an order that the salt of the seal draws
    error: UnitSums  # [units] m, weighted, at the budgets of all hidden scenes, mean over seeds

    @property
    def row(self) -> Row:
        """The row of the subset "all"."""
        return self.row_of("all")

    def row_of(self, subset: Subset) -> Row:
        """The row of one subset."""
        return next(row for row in self.rows if row.subset == subset)

    def unit_weight(self, subset: Subset) -> list[float]:
        """Weight of the targets of each unit."""
        return self.weight.get(subset, [])

    def unit_error(self, subset: Subset) -> list[float]:
        """What ranks, times the weight, summed over the targets of each unit, m."""
        return self.error.get(subset, [])


def key_of(scene: str, seed: int) -> str:
    """Key of one run, as in ``missed.reasons``."""
    return f"{scene}|{seed}"


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
