"""The schema of a record, and of the results on hidden scenes that its signed level may add."""

from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag
from typing_extensions import TypeAliasType  # pydantic brings it

from ...agent import SubmissionName
from ...core import Section, unseen
from ...running import MOST_SEED
from ...scoring import KNOWN_SUBSETS, SUBSETS, Count, DrivingRow, Row, Subset, ratio
from ..gateway.limits import Isolation
from .canonical import Date, Sha256

Status = Literal["finished", "partial", "crashed", "rejected"]
Observed = Literal["detections", "truth", "associated"]
MOST_NAME, MOST_TEXT = (
    100,
    2000,
)  # characters of a name, and of a description or a reason
MOST_NAMES, MOST_SCENES = 50, 10_000  # in a list; of a record
_LARGEST = 1 << 53  # larger whole numbers are not the same in every reader of JSON


def _visible(text: str) -> str:
    if not (
        text.isascii() and text.isprintable()
    ):  # letters are looked at one by one only where needed
        letter = next(
            (letter for letter in text if unseen(letter) and letter not in "\n\t"), None
        )
        if letter is not None:
            raise ValueError(
                f"contains U+{ord(letter):04X}, expected no invisible and no control characters"
            )
    return text


Text = Annotated[str, Field(max_length=MOST_TEXT), AfterValidator(_visible)]
Name = Annotated[str, Field(max_length=MOST_NAME), AfterValidator(_visible)]
if TYPE_CHECKING:
    Json = Any
else:  # finite numbers, bounded whole numbers and texts, however deep; chosen by type, so that errors name one type
    _Whole = Annotated[int, Field(ge=-_LARGEST, le=_LARGEST)]
    _KINDS = {
        "NoneType": None,
        "bool": bool,
        "int": _Whole,
        "float": float,
        "str": Text,
        "list": list["Json"],
        "dict": dict[Text, "Json"],
    }
    _any_kind = reduce(
        or_, (Annotated[kind, Tag(name)] for name, kind in _KINDS.items())
    )
    Json = TypeAliasType(
        "Json", Annotated[_any_kind, Discriminator(lambda value: type(value).__name__)]
    )
_FileName = Annotated[
    str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=MOST_NAME)
]  # part of a path
_Url = Annotated[
    str,
    Field(pattern=r"^(https?://\S+)?$", max_length=MOST_TEXT),
    AfterValidator(_visible),
]
_CardDigest = Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]
_Digest = Annotated[
    str, Field(pattern=r"^([0-9a-f]{64})?$")
]  # empty until the record is stored
_Seconds = Annotated[float, Field(gt=0, le=86_400)]
_Bytes = Annotated[int, Field(gt=0, le=1 << 40)]
_NotNegative = Annotated[float, Field(ge=0)]
UnitSums = dict[
    Subset,
    Annotated[list[Annotated[float, Field(ge=0, le=1e9)]], Field(max_length=100_000)],
]


def _each_subset(rows: list[Row]) -> list[Row]:
    subsets = tuple(row.subset for row in rows)
    if subsets not in (SUBSETS, KNOWN_SUBSETS):
        raise ValueError(
            f"holds rows of {', '.join(subsets) or 'no subset'}, expected {', '.join(SUBSETS)}"
        )
    return rows


def _equally_long(sums: UnitSums) -> UnitSums:
    lengths = {*map(len, sums.values())}
    if len(lengths) != 1 or 0 in lengths or not sums.keys() >= {*SUBSETS}:
        raise ValueError(
            "expected one sum or more of every subset, equally many of each"
        )
    return sums


Rows = Annotated[list[Row], Field(max_length=MOST_NAMES), AfterValidator(_each_subset)]
_Scores = Annotated[
    list[Annotated[float, Field(ge=0, le=1)]], Field(max_length=MOST_NAMES)
]  # one per seed
_SceneSums = Annotated[UnitSums, AfterValidator(_equally_long)]


class SubmissionPart(Section):
    """The submission: name, digest, parameters."""

    name: SubmissionName
    authors: Annotated[list[Name], Field(max_length=MOST_NAMES)]
    description: Text
    source: _Url  # of its code
    commit: Annotated[str, Field(pattern=r"^([0-9a-f]{7,64})?$")]
    paper: _Url
    license: Name
    digest: Sha256  # over all files that ran: those of the folder, and these weights
    networks: dict[
        Name, Sha256
    ]  # weights outside the folder, trained on the machine where it ran: file, its sha256
    parameters: dict[Text, Json]
    hypotheses: Count | None = (
        None  # as declared by a parameter; None: the answers state them
    )
    gap_references: (
        Literal["controls", "own"] | None
    )  # reference pair: STP and ground-truth tracks, or others


class EnvPart(Section):
    """The environment, its split and its scenes."""

    id: _FileName
    card_digest: _CardDigest
    split: Name
    data_manifest: Sha256  # over all data that the scorer read
    scenes: Annotated[int, Field(ge=1, le=MOST_SCENES)]
    scenes_of_split: Annotated[Count, Field(le=_LARGEST)]
    observe: Observed
    truth_complete: bool  # False: false forecasts are not known, all forecasts count against the budgets
    keywords: dict[Text, Json]  # settings of the env beyond the card


class ScorerPart(Section):
    """The scorer: version of the definitions, digest."""

    definitions: Name
    source_digest: Sha256  # of the version of the definitions and the golden results, see `scorer_digest`


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
    memory_gib: _NotNegative
    gpu: Text | None = None  # of version 0.2


class LatencyPart(Section):
    """Time per answer, without the first of each scene, in which code is loaded and compiled."""

    p50_ms: _NotNegative | None
    p95_ms: _NotNegative | None
    max_ms: _NotNegative | None


class MeasuredPart(Section):
    """Measurements that an equal run does not repeat: they have a digest of their own."""

    hardware: HardwarePart
    latency: LatencyPart
    ms_per_frame: _NotNegative | None  # mean
    peak_memory_mib: _NotNegative
    made: Date  # UTC
    digest: _Digest = ""


class LimitsPart(Section):
    """Limits of the agent, as `gateway.Limits`."""

    start: _Seconds
    reset: _Seconds
    first_frame: _Seconds
    frame: _Seconds  # later answers are missed
    scene: _Seconds
    memory: _Bytes
    disk: _Bytes
    answer: _Bytes
    cuda: Literal[False] = False


class MissedPart(Section):
    """Frames without an accepted answer, over all scenes and seeds, and scenes that were not finished."""

    late: Literal[0] = 0  # a late answer ends its scene
    malformed: Count
    crashed_scenes: Count  # of scenes x seeds
    reasons: dict[Text, Text]  # "scene|seed" -> why the scene was not finished


class HashesPart(Section):
    """Digests that another run must repeat, over all scenes and seeds."""

    seals: Sha256  # of the hash chains over the answers
    rollouts: Sha256  # of the digests of the rollouts


class ScenePart(Section):
    """Sums of one scene over the targets of each unit: enough to rank records without their rollouts."""

    scene: Name
    weight: _SceneSums  # [units of the scene] of the targets
    error: _SceneSums  # [units] m, weighted, at the budgets of the whole record, mean over seeds

    @property
    def targets(self) -> int:
        """Number of targets."""
        return round(sum(self.weight["all"]))

    @property
    def mean_error(self) -> float | None:
        """Mean bADE over all targets, m; None without any."""
        return ratio(sum(self.error["all"]), sum(self.weight["all"]))


class DrivingPart(DrivingRow):
    """Row of an agent in a closed loop, with the score of each scene; differences need other records, and are null."""

    scores: Annotated[
        list[_Scores], Field(max_length=MOST_SCENES)
    ]  # of each scene, in the order of the sums


class Results(Section):
    """Rows of results, one per subset.

    In a closed loop the only target of a scene is its drive. Its error is 1 - drive score; no event has a target.
    """

    driving: DrivingPart | None = None  # of a closed loop alone

    if TYPE_CHECKING:
        rows: Rows

    @property
    def row(self) -> Row:
        """Row of the subset "all"."""
        return self.row_of("all")

    def row_of(self, subset: Subset) -> Row:
        """Row of one subset."""
        return next(row for row in self.rows if row.subset == subset)


class Record(Results):
    """Results of one submission on one env: an equal run gives an equal record, but for `measured`.

    The rows have no ranks, which depend on other records. ``gap_closed`` is null in them for the same reason, and so is
    ``gap_closed_same_predictor`` unless its reference agents were run with the submission; ``ms_per_frame`` is
    measured. A record does not know its level: `attestation` reads it from the same file, and checks its signature.
    """

    format: Literal[2] = 2
    submission: SubmissionPart
    division: Literal["closed"] = "closed"  # of version 0.2, as `LimitsPart.cuda`
    training_data: Annotated[list[Text], Field(max_length=MOST_NAMES)]  # as declared
    env: EnvPart
    scorer: ScorerPart
    reference: ReferencePart
    seeds: Annotated[
        list[Annotated[int, Field(ge=0, le=MOST_SEED)]], Field(max_length=MOST_NAMES)
    ]
    status: Status
    status_reason: Text
    versions: Annotated[dict[Name, Name], Field(max_length=MOST_NAMES)]
    limits: LimitsPart
    missed: MissedPart
    isolation: Isolation
    hypotheses: Count
    samples: Count
    rows: Rows
    nothing_predicted: float | None  # m, error if nothing is predicted
    details: dict[Text, Json]  # `Details` of the scorer
    per_scene: Annotated[list[ScenePart], Field(max_length=MOST_SCENES)]
    hashes: HashesPart
    measured: MeasuredPart
    plan: _Digest = ""  # of all that was decided before the runs, see `parts`
    digest: _Digest = ""
    level: Annotated[None, BeforeValidator(lambda _: None)] = Field(
        None, exclude=True
    )  # left out

    @property
    def runs(self) -> int:
        """Number of scenes x seeds."""
        return len(self.per_scene) * len(self.seeds)

    @property
    def unfinished(self) -> str:
        """Reason why some scenes were not finished; empty if all were."""
        if self.status != "finished":
            return f"{self.status}: {self.status_reason}"
        crashed = self.missed.crashed_scenes
        return (
            f"{crashed} of {self.runs} scenes and seeds were not finished"
            if crashed
            else ""
        )

    def unit_weight(self, subset: Subset) -> list[float]:
        """Weight of the targets of each unit, over all scenes."""
        return [
            value for scene in self.per_scene for value in scene.weight.get(subset, ())
        ]

    def unit_error(self, subset: Subset) -> list[float]:
        """Weighted bADE per unit [U], metres."""
        return [
            value for scene in self.per_scene for value in scene.error.get(subset, ())
        ]


class HiddenPart(Results):
    """Results on scenes of secret seeds, without their names, from which the seeds would follow."""

    commitment: Sha256  # of the secret
    weights: Sha256  # hash of their event weights, made once per seal
    scenes: Count
    rows: Rows
    nothing_predicted: float | None  # m, error if nothing is predicted there
    weight: UnitSums  # [units] of the targets, over all scenes, in an order that the salt of the seal draws
    error: UnitSums  # [units] m, weighted, at the budgets of all hidden scenes, mean over seeds

    def unit_weight(self, subset: Subset) -> list[float]:
        """Weight of the targets of each unit."""
        return self.weight.get(subset, [])

    def unit_error(self, subset: Subset) -> list[float]:
        """Weighted bADE per unit [U], metres."""
        return self.error.get(subset, [])


def key_of(scene: str, seed: int) -> str:
    """Key of one run, as in ``missed.reasons``."""
    return f"{scene}|{seed}"
