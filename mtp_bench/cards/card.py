"""Content of an environment card: source, detector, task, sizes, and its digest.

``envs/README.md`` explains the keys.
"""

import hashlib
import json
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    Field,
    SerializeAsAny,
    ValidationInfo,
    field_validator,
)

from ..core import CardError, MtpBenchError, Section, nearest, rule
from ..detector import Profile, Variant, load_profile, with_variant
from .source import DataSection, DetectionsSection, SourceSection

# a single number in the TOML stands for every class
PerClass = dict[str, Annotated[float, Field(gt=0, le=1e4)]]
# hints for agents, and the place on the leaderboard
_NOT_SCORED = ("motion_noise", "weights_of", "board", "tracker", "data")


class EventGate(Section):
    """Rule by which a track can match a true box for identity events.

    See docs/definitions, "Events".
    """

    measure: Literal["iou_3d", "center_distance"]
    threshold: PerClass  # inclusive: IoU at least, or metres at most

    @field_validator("threshold")
    @classmethod
    def _require_share(cls, threshold: PerClass, info: ValidationInfo) -> PerClass:
        is_overlap = info.data.get("measure") == "iou_3d"
        if is_overlap and max(threshold.values(), default=0) > 1:
            raise ValueError("expected an IoU of at most 1")
        return threshold


class TaskSection(Section):
    """Rules of prediction and scoring: rate, horizon, samples, classes, gates and miss error."""

    rate: Annotated[float, Field(gt=0, le=1000)]  # Hz, nominal
    past: Annotated[int, Field(ge=2, le=1000)]  # P
    future: Annotated[int, Field(ge=1, le=1000)]  # T
    samples: Annotated[int, Field(ge=1, le=1000)]  # k
    classes: Annotated[  # TOML has lists only
        tuple[str, ...],
        Field(min_length=1, strict=False),
        rule(lambda names: len(set(names)) == len(names), "expected each class once"),
    ]
    event_gate: EventGate
    forecast_gate: PerClass  # m, BEV centre distance
    miss_error: PerClass  # m, c: the error of a target without a forecast
    # n: only every n-th frame, from the first one on, is annotated, unless a scene
    # itself states its annotated frames; None: all are
    annotated_every: Annotated[int, Field(ge=1)] | None = None

    @field_validator("event_gate", "forecast_gate", "miss_error", mode="before")
    @classmethod
    def _spread(cls, value: Any, info: ValidationInfo) -> Any:
        """Write a single number as a table with every class."""
        classes = info.data.get("classes", ())
        # true and false are instances of int, too
        if type(value) in (int, float):
            return dict.fromkeys(classes, value)
        if isinstance(value, dict) and type(value.get("threshold")) in (int, float):
            return {**value, "threshold": dict.fromkeys(classes, value["threshold"])}
        return value

    @field_validator("event_gate", "forecast_gate", "miss_error")
    @classmethod
    def _require_each_class(cls, value: Any, info: ValidationInfo) -> Any:
        table = value.threshold if isinstance(value, EventGate) else value
        classes = info.data.get("classes", tuple(table))
        for name in (*table, *classes):
            if name not in classes:
                raise ValueError(f"unknown class {name!r}{nearest(name, classes)}")
            if name not in table:
                raise ValueError(f"no value for class {name!r}")
        return value


class SizeSection(Section):
    """Padded sizes of the spaces.

    Constants of the env id.
    """

    detections: Annotated[int, Field(ge=1)]  # D
    tracks: Annotated[int, Field(ge=1)]  # N
    objects: Annotated[int, Field(ge=1)]  # O
    hypotheses: Annotated[int, Field(ge=1)]  # H


class LaneSection(Section):
    """Sizes of the lanes in observations."""

    pieces: Annotated[int, Field(ge=1, le=10_000)] = 96  # L
    points: Annotated[int, Field(ge=2, le=1000)] = 20  # Q
    step: Annotated[float, Field(gt=0, le=100)] = 2.0  # m between two points, at most
    reach: Annotated[float, Field(gt=0, le=100)] = (
        60.0  # m from the sensor; maps end about 100 m from its whole way
    )


class PlannerSection(Section):
    """Weights of the planner that drives the ego, fitted on training seeds.

    See `mtp_bench.traffic.planner`.
    """

    caution: Annotated[float, Field(ge=0)] = (
        30.0  # m/s of progress that a certain contact now costs
    )
    patience: Annotated[float, Field(gt=0)] = (
        2.0  # s, by which a later contact counts less
    )
    comfort: Annotated[float, Field(ge=0)] = (
        0.4  # m/s of progress per m/s2 of braking beyond 2
    )
    smoothness: Annotated[float, Field(ge=0)] = 0.05  # m/s of progress per m/s2
    margin: Annotated[float, Field(gt=0)] = 0.3  # m, of error of a forecast place
    creep: Annotated[float, Field(ge=0)] = 0.65  # widths of a box per second
    headway: Annotated[float, Field(ge=0)] = 0.6  # s, to those who drive ahead
    pace: Annotated[float, Field(gt=0, le=1)] = (
        1.0  # share of the speed limits that is driven at most
    )


class DriveSection(Section):
    """The forecasts of the agent drive the ego of simulated traffic."""

    planner: PlannerSection = PlannerSection()


_COMPARE = "`mtp-bench compare` sets agents side by side by how they drive"


def _switch(value: Any) -> Any:
    """Read true as an empty section, with all defaults, and false as None."""
    if not isinstance(value, bool):
        return value
    return {} if value else None


_SWITCH = BeforeValidator(_switch)
_SHIPPED = rule(  # a path would be relative to which folder?
    lambda profile: not profile.endswith(".toml"),
    "expected the name of a shipped profile; a file's content belongs into [detector.noise]",
)
_CORNERS = rule(
    lambda area: area[0] < area[2] and area[1] < area[3],
    "expected least x and y, then largest x and y",
)


class DetectorSection(Section):
    """A simulated detector in place of stored detections.

    The card either names a shipped ``profile`` or states its ``noise``.
    """

    profile: Annotated[str, _SHIPPED] | None = None
    noise: Profile | None = None
    variant: Variant = "as_fitted"
    reach: Annotated[float, Field(gt=0)] = 80.0  # m
    field_of_view: Annotated[float, Field(gt=0, le=360)] = (
        90.0  # degrees, centred on the ego's heading
    )
    area: (
        Annotated[tuple[float, float, float, float], Field(strict=False), _CORNERS]
        | None
    ) = None
    # m: least x and y, largest x and y of false positives; without it they are anywhere
    # within reach
    seed: Annotated[int, Field(ge=0)] = 0  # of the noise

    @property
    def resolved(self) -> Profile:
        """Noise profile in its variant.

        Raises CardError unless exactly one of ``profile`` and ``noise`` is given,
        UnknownNameError for an unknown name.
        """
        if (self.profile is None) == (self.noise is None):
            raise CardError(
                "[detector] has both or none of 'profile' and 'noise', "
                "expected exactly one of them"
            )
        return with_variant(self.noise or load_profile(str(self.profile)), self.variant)


class PerturbSection(Section):
    """Errors of a detector in multiples of its own; the defaults are as recorded.

    docs/environment/robustness.md describes each knob.
    """

    # detections with less are left out; if scores are no probabilities, this share
    score: Annotated[float, Field(ge=0, lt=1)] = 0.0
    misses: Annotated[float, Field(ge=0, le=16)] = 1.0
    false: Annotated[float, Field(ge=0, le=16)] = 1.0
    noise: Annotated[float, Field(ge=0, le=16)] = 1.0
    delay: Annotated[float, Field(ge=0, le=100)] = 0.0  # frames
    seed: Annotated[int, Field(ge=0)] = 0  # of what is drawn

    def __str__(self) -> str:
        changed = self.model_dump(exclude_defaults=True)
        return ", ".join(f"{knob} {level:g}" for knob, level in changed.items())


class TrackerSection(Section):
    """Parameters of a tracker for one class (`mtp_bench.tracking.ClassParameters`)."""

    assignment: Literal["hungarian", "greedy"]
    affinity: Literal["giou_3d", "iou_3d", "center_distance"]
    gate: float  # smallest affinity that may match; of distances the largest, m
    min_hits: Annotated[int, Field(ge=1)]
    max_age: Annotated[int, Field(ge=1)]


class Card(Section):
    """One environment id. Functions of `mtp_bench.cards.changes` return changed copies."""

    id: str
    summary: str
    # baseline whose runs make the event weights; None: the single-hypothesis control
    reference: str | None = None
    motion_noise: str | None = None  # where objects move like here
    weights_of: str | None = None  # id of the env whose network weights serve here too
    # place among the envs of the leaderboard; those without one come last
    board: int | None = None
    tracker: dict[str, TrackerSection] = Field(
        default_factory=dict
    )  # by class; empty: those of the detector
    # file of a presence model for baselines, or "scores"; None: the detector's model
    presence: str | None = None
    # observations show the road; ``true``: in the default sizes
    lanes: Annotated[LaneSection | None, _SWITCH] = None
    drive: Annotated[DriveSection | None, _SWITCH] = None  # closed loop
    data: DataSection | None = None
    source: SerializeAsAny[SourceSection]
    detector: DetectorSection | None = None
    perturb: PerturbSection | None = None  # of stored and simulated detections alike
    task: TaskSection
    size: SizeSection

    @property
    def digest(self) -> str:
        """First 16 hex digits of the sha256 of the card's content.

        It covers the noise of a simulated detector.
        """
        content = self.model_dump(
            mode="json", exclude_none=True, exclude=set(_NOT_SCORED)
        )
        if self.detector is not None:
            noise = self.detector.resolved
            content["detector"]["noise"] = noise.model_dump(
                mode="json", exclude_none=True
            )
        text = json.dumps(content, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def detector_name(self) -> str:
        """Name of the stored detector, or of the simulated one's profile.

        Agents choose their parameters by it.
        """
        if self.detector is None:
            return self.source.traits.stored_detector
        return self.detector.resolved.name

    @property
    def simulated(self) -> bool:
        """True if there is a scene for any seed."""
        return self.source.traits.simulated

    @property
    def is_trusted(self) -> bool:
        """True if the doctor does not examine the recordings."""
        is_off = self.data is not None and self.data.doctor == "off"
        return self.simulated or is_off

    @property
    def has_ego(self) -> bool:
        """True if a vehicle carries the sensors.

        Else the ego pose is a fixed place, so distances to it say little.
        """
        return self.source.traits.has_ego

    @property
    def velocity(self) -> bool:
        """True if detections carry a measured velocity."""
        traits = self.source.traits
        some_stored = traits.mixed_detections and traits.stored_detector
        if self.detector is None or some_stored:
            return traits.measured_velocity
        noise = self.detector.resolved
        return all(noise.noise(name).velocity is not None for name in self.task.classes)

    def require_same_scenes(self, why: str, instead: str = "") -> None:
        """Raise CardError for a closed loop.

        Each agent drives in a world of its own. ``why``: what a loop does not have.
        ``instead``: what to do; empty: compare how agents drive.
        """
        if self.drive is not None:
            advice = instead or _COMPARE
            raise CardError(f"{self.id} is a closed loop, {why}: {advice}")

    def stored(self) -> dict[str, Any]:
        """Return the card as JSON that `parse_card` reads again.

        It has the paths of its files on this machine.
        """
        # null values too: a detector that was taken away stays away
        content = self.model_dump(mode="json")
        for name in ("folder", "detections"):
            path = getattr(self.source, name, None)
            if path is not None:
                content["source"][name] = path
        return content

    def per_class(self, table: PerClass) -> tuple[float, ...]:
        """Return values of a per-class table in the order of ``task.classes``."""
        return tuple(table[name] for name in self.task.classes)


def check_consistency(card: Card, where: str) -> None:
    """Raise CardError unless the sections of a card fit each other.

    ``where`` names the card.
    """
    check_detector(card, where)
    _check_lanes(card, where)
    _check_length(card, where)
    source = card.source
    if card.drive is not None and (source.name != "highway" or not card.has_ego):
        sensor = "" if card.has_ego else " with a fixed sensor"
        raise CardError(
            f"{where}: drive is set, but nothing drives in source {source.name!r}"
            f"{sensor}, expected 'highway' with sensor = \"ego\""
        )
    # the card's digest covers the content, not the path
    if not isinstance(source, DetectionsSection):
        return
    if source.detections is not None and source.detections_sha256 is None:
        raise CardError(
            f"{where}: source.detections needs source.detections_sha256, the digest "
            "of the file; or leave it out and name the file with --detections"
        )


def _check_lanes(card: Card, where: str) -> None:
    """Raise CardError for lanes that the source of the card cannot show."""
    traits = card.source.traits
    if card.lanes is None or (traits.lanes and traits.common_frame):
        return
    reason = "without a road map"
    if traits.lanes:
        reason = "whose frames have separate axes"
    raise CardError(
        f"{where}: lanes cannot be shown for source {card.source.name!r}, {reason}; "
        "leave them out"
    )


def _check_length(card: Card, where: str) -> None:
    """Raise CardError for scenes shorter than past and future."""
    seconds = card.source.traits.scene_seconds
    if seconds is None:
        return
    rate = card.task.rate
    needed = card.task.past + card.task.future
    if seconds * rate < needed:
        raise CardError(
            f"{where}: scenes of {seconds:g} s at {rate:g} Hz have {seconds * rate:g} "
            f"frames, expected at least {needed}: task.past and task.future"
        )


def check_detector(card: Card, where: str) -> None:
    """Raise CardError unless the card has the detector that its source needs.

    The detector needs noise for every class.
    """
    traits = card.source.traits
    if card.detector is None:
        if traits.without_detections:
            raise CardError(
                f"{where}: {traits.without_detections} has no detections: "
                "a [detector] section is missing"
            )
        return
    if not traits.truth_complete:
        raise CardError(
            f"{where}: a simulated detector would see nothing but the prediction targets, "
            "the only known objects; take stored detections, or a card with "
            'truth = "all"'
        )
    try:
        noise = card.detector.resolved
        for name in card.task.classes:
            noise.noise(name)  # raises an error without noise for the class
    except MtpBenchError as error:
        raise CardError(f"{where}: {error}") from None
