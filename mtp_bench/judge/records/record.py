"""The schema of a record, and of the results on hidden scenes of its signed level."""

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from ...agent import SubmissionName
from ...core import Section
from ...running import MAX_SEED
from ..gateway.limits import Isolation, Limits
from .fields import (
    MAX_LIST,
    Count,
    Date,
    FileName,
    Json,
    Level,
    Name,
    NotNegative,
    OptionalSha256,
    Sha256,
    Share,
    Text,
    Url,
)
from .results import Results
from .targets import UnitTargets

Status = Literal["finished", "partial", "crashed", "rejected"]
Observed = Literal["detections", "truth", "associated"]
REJECTED = "rejected: "  # before the reason of a run that broke the rules

_CurvePoint = Annotated[tuple[NotNegative, NotNegative], Field(strict=False)]


class SubmissionPart(Section):
    """The submission: name, digest, parameters."""

    name: SubmissionName
    authors: Annotated[list[Name], Field(max_length=MAX_LIST)]
    description: Text
    source: Url  # address of its code
    commit: Annotated[str, Field(pattern=r"^([0-9a-f]{7,64})?$")]
    paper: Url
    license: Name
    # over all files that ran: those of the folder, and these weights
    digest: Sha256
    # weights outside the folder, trained where it ran: file -> its sha256
    networks: dict[Name, Sha256]
    parameters: dict[Text, Json]
    # number that a parameter declares; None: the answers state it
    hypotheses: Count | None = None
    # reference pair: STP and ground-truth tracks, or others
    gap_references: Literal["controls", "own"] | None


class EnvPart(Section):
    """The environment, its split and its data."""

    id: FileName
    card_digest: Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]
    split: Name
    data_manifest: Sha256  # over all data that the scorer read
    scenes_of_split: Count
    observe: Observed
    # False: false forecasts are not known, all forecasts count against the budgets
    truth_complete: bool
    keywords: dict[Text, Json]  # settings of the env beyond the card


class ScorerPart(Section):
    """The scorer: version of the definitions, digest."""

    definitions: Name
    # digest of the version of the definitions and of the golden results, see
    # `scorer_digest`
    source_digest: Sha256


class ReferencePart(Section):
    """The event weights."""

    name: Name  # baseline whose events they count
    hash: Sha256
    origin: Text
    frozen: bool  # they ship for the env; False: made from the scenes of this record


class HardwarePart(Section):
    """The machine."""

    cpu: Text
    cores: Count
    memory_gib: NotNegative


class LatencyPart(Section):
    """Time per answer.

    The first answer of each scene is left out: in it code is loaded and compiled.
    """

    p50_ms: NotNegative | None
    p95_ms: NotNegative | None
    max_ms: NotNegative | None


class MeasuredPart(Section):
    """Measurements that an equal run does not repeat, with a digest of their own."""

    hardware: HardwarePart
    latency: LatencyPart
    ms_per_frame: NotNegative | None  # mean
    peak_memory_mib: NotNegative
    made: Date  # UTC
    digest: OptionalSha256 = ""  # empty until the record is stored


class MissedPart(Section):
    """Malformed answers and unfinished scenes, over all scenes and seeds."""

    malformed: Count
    reasons: dict[Text, Text]  # "scene|seed" -> why the scene was not finished

    @property
    def crashed_scenes(self) -> int:
        """Number of unfinished runs of a scene."""
        return len(self.reasons)


class HashesPart(Section):
    """Digests that another run must repeat, over all scenes and seeds."""

    seals: Sha256  # digest of the hash chains over the answers
    rollouts: Sha256  # digest of the digests of the rollouts


class ConversionPart(Section):
    """An earlier form of a record, from which this one was converted without a run."""

    digest: Sha256  # digest of the record in that form
    level: Level
    date: Date | None = None  # day of the level; None for "scored"
    signer: Name = ""


class Record(Results):
    """Results of one submission on one env.

    An equal run gives an equal record, but for `measured`. A record does not know its
    level: `attestation` reads it from the same file, and checks its signature.
    """

    format: Literal[3] = 3
    submission: SubmissionPart
    training_data: Annotated[list[Text], Field(max_length=MAX_LIST)]  # as declared
    env: EnvPart
    scorer: ScorerPart
    reference: ReferencePart
    seeds: Annotated[
        list[Annotated[int, Field(ge=0, le=MAX_SEED)]], Field(max_length=MAX_LIST)
    ]
    versions: Annotated[dict[Name, Name], Field(max_length=MAX_LIST)]
    limits: Limits
    missed: MissedPart
    isolation: Isolation
    hypotheses: Count
    samples: Count
    # the targets are in the file only where the leaderboard does not have them
    targets_sha256: Sha256
    brier: Share | None = None
    # mean stated confidence less the share of true forecasts
    overconfidence: Annotated[float, Field(ge=-1, le=1)] | None = None
    # false forecasts per target (forecasts per frame where those are not known), m
    curve: Annotated[list[_CurvePoint], Field(max_length=MAX_LIST)] = Field([])
    hashes: HashesPart
    measured: MeasuredPart
    # digest of all that was decided before the runs, see `parts`
    plan: OptionalSha256 = ""
    converted_from: ConversionPart | None = None
    digest: OptionalSha256 = ""  # empty until the record is stored
    level: Annotated[None, BeforeValidator(lambda _: None)] = Field(None, exclude=True)

    @property
    def scenes(self) -> list[str]:
        """Names of the scenes, in their order."""
        return self.targets.scenes

    @property
    def runs(self) -> int:
        """Number of scenes x seeds."""
        return len(self.scenes) * len(self.seeds)

    @property
    def status(self) -> Status:
        """Status, which follows from the scenes that were run and finished."""
        return self._status_and_reason[0]

    @property
    def status_reason(self) -> str:
        """Reason of the status.

        It is empty if the record is finished.
        """
        return self._status_and_reason[1]

    @property
    def unfinished(self) -> str:
        """Reason why some scenes were not finished.

        It is empty if all were.
        """
        if self.status != "finished":
            return f"{self.status}: {self.status_reason}"
        crashed = self.missed.crashed_scenes
        if not crashed:
            return ""
        return f"{crashed} of {self.runs} scenes and seeds were not finished"

    @property
    def _status_and_reason(self) -> tuple[Status, str]:
        reasons = self.missed.reasons
        for key, reason in reasons.items():
            if reason.startswith(REJECTED):
                return "rejected", f"{key}: {reason.removeprefix(REJECTED)}"
        if self.runs and len(reasons) == self.runs:
            return "crashed", f"no scene was finished: {next(iter(reasons.values()))}"
        if len(self.scenes) < self.env.scenes_of_split:
            return "partial", f"{len(self.scenes)} of {self.env.scenes_of_split} scenes"
        return "finished", ""


class HiddenPart(Results):
    """Results on scenes of secret seeds, without the names of the scenes."""

    commitment: Sha256  # of the secret
    weights: Sha256  # hash of their event weights, made once per seal
    scenes: Count
    # in an order of units that the salt of the seal draws; it must be stated
    targets: UnitTargets  # pyright: ignore[reportGeneralTypeIssues]


def key_of(scene: str, seed: int) -> str:
    """Return the key of one run, as in ``missed.reasons``."""
    return f"{scene}|{seed}"
