"""Records that flow from source to score, and the legend of dimensions.

``F`` frames · ``D`` detections of a frame · ``M`` true objects of a frame · ``N`` tracks of a frame (leaves: distinct
track states) · ``O`` forecast objects of a frame · ``H`` hypotheses · ``K`` samples · ``T`` future frames · ``P`` past
frames, the current one included · ``C`` classes · ``R`` rows over all frames of a scene.

Metres, seconds, radians; right-handed frames with z up; a box is ``x y z yaw l w h`` with its centre at x y z.
Rows over all frames are sorted by frame; the rows of frame t are ``start[t]:start[t + 1]``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.integer[Any]]
Bools = NDArray[np.bool_]
NO_ROWS: Ints = np.zeros(0, dtype=np.int64)  # row numbers where there is no row
Observation = dict[
    str, NDArray[Any]
]  # arrays of a frame, by the names of the observation space
Action = dict[str, NDArray[Any]]  # by the names of the action space
RecordT = TypeVar("RecordT", bound=Any)


@dataclass(frozen=True, eq=False, repr=False)
class Ragged:
    """Rows of all frames one after the other, sorted by frame; frame t has the rows ``start[t]:start[t + 1]``.

    A table whose columns are aligned with these rows is a subclass.
    """

    start: Ints  # [F + 1]

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}: {int(self.start[-1])} rows in {self.frames} frames"
        )

    @property
    def frames(self) -> int:
        """Number of frames F."""
        return len(self.start) - 1

    @property
    def counts(self) -> Ints:
        """Number of rows of each frame [F]."""
        return self.start[1:] - self.start[:-1]

    @property
    def frame_of_rows(self) -> Ints:
        """The frame of each row [R]."""
        return np.repeat(np.arange(self.frames), self.counts)

    def rows(self, t: int) -> slice:
        """Rows of frame ``t``."""
        return slice(int(self.start[t]), int(self.start[t + 1]))

    def only(self, t: int) -> Self:
        """The table with the rows of frame ``t`` alone; the other frames are empty."""
        rows = self.rows(t)
        start = np.where(np.arange(len(self.start)) > t, rows.stop - rows.start, 0)
        columns = {
            column.name: getattr(self, column.name)[rows]
            for column in fields(self)
            if column.name != "start"
        }
        return replace(self, start=start, **columns)

    def select(self, kept: Bools) -> Self:
        """The table of the rows in the mask ``kept`` [R]; every column but ``start`` must have a value per row."""
        columns = {
            column.name: getattr(self, column.name)[kept]
            for column in fields(self)
            if column.name != "start"
        }
        return replace(self, start=starts_of(kept)[self.start], **columns)


SCORES = "scores"  # a `Task.presence`: the score of an object's last detection is its confidence
ABSENT_BELOW = (
    -1e30
)  # log-weights below, such as -inf, mean an absent sample or hypothesis
ID_LIMIT = 2**31 - 1  # largest number of an object or a track
LONGEST_SHORT_NAME = 16  # characters
CENTIMETRES = 100.0  # per metre: forecasts are recorded in whole centimetres


def to_centimetres(metres: Floats) -> Ints:
    """Forecasts as they are recorded: whole centimetres, int16."""
    return np.asarray(np.rint(metres * CENTIMETRES).astype(np.int16))


def to_metres(centimetres: Ints) -> Floats:
    """Recorded forecasts in metres."""
    return centimetres / CENTIMETRES


def starts_of(count: Sequence[int] | Ints | Bools) -> Ints:
    """First row of each frame [F + 1], from the number of rows per frame ``count`` [F]."""
    return np.concatenate([[0], np.cumsum(count)]).astype(np.int64)


def select(record: RecordT, rows: Ints | Bools) -> RecordT:
    """The ``rows`` of a record, a dataclass of arrays of one length."""
    return cast(
        RecordT,
        type(record)(**{c.name: getattr(record, c.name)[rows] for c in fields(record)}),
    )


def joined(records: Sequence[RecordT]) -> RecordT:
    """One record of several of the same class, at least one: their arrays end to end."""
    columns = {
        c.name: np.concatenate([getattr(record, c.name) for record in records])
        for c in fields(records[0])
    }
    return cast(RecordT, type(records[0])(**columns))


def starts_of_sorted(frame: Ints, frames: int) -> Ints:
    """First row of each frame [F + 1], from the sorted frames of all rows ``frame`` [R]."""
    return np.searchsorted(frame, np.arange(frames + 1))


LONGEST_STEP = (
    1.5  # frame periods of the task; a longer step between two frames is a hole in time
)
_ROUNDING = 1e-6  # s, of steps


def pieces_of(time: Floats, period: float) -> Ints:
    """Piece of time [F] that each frame lies in: a hole ends a piece, and no past, future or velocity crosses it.

    ``time`` [F] s; ``period``: nominal time between two frames, s.
    """
    return np.cumsum(
        np.diff(time, prepend=time[:1]) > LONGEST_STEP * period + _ROUNDING, dtype=int
    )


@dataclass(frozen=True, eq=False, repr=False)
class Truth(Ragged):
    """True boxes of a scene, in its frame of reference."""

    box: Floats  # [R, 7]
    velocity: Floats  # [R, 2] m/s, NaN where unknown
    class_id: Ints  # [R] index into the task's classes
    object_id: Ints  # [R] unique per object within the scene
    eligible: Bools  # [R] may be a prediction target; it needs P past and T future frames (`Scene.listed_targets`)
    neutral: Bools  # [R] of a class similar to an evaluated one (KITTI: a van for "car"): matches with it do not count


@dataclass(frozen=True, eq=False, repr=False)
class Detections(Ragged):
    """Detected boxes of a scene, in its frame of reference."""

    box: Floats  # [R, 7]
    velocity: Floats  # [R, 2] m/s, NaN where unknown
    class_id: Ints  # [R]
    score: Floats  # [R] as the detector gives it (a logit may be negative)


@dataclass(frozen=True, eq=False, repr=False)
class StoredTracks(Detections):
    """Boxes of a foreign tracker with their identities; it may have seen the future."""

    object_id: Ints  # [R] identity within the scene, from 0; one of them has one class, and one box in a frame


HARD_BRAKING = -3.0  # m/s2


@dataclass(frozen=True, eq=False)
class Drive:
    """Record of the ego of a closed loop in one scene; N steps of the simulation, F decisions of the planner."""

    way: float  # m driven
    seconds: float
    goal: bool  # the end of the way was reached
    collision: str  # class of the road user that the ego met; empty: none
    at_fault: bool  # the ego moved, and was not hit from behind
    near_misses: int  # times that a collision was less than .95 s away
    phantom_brakes: int  # times that the ego braked by more than 3 m/s2 with nobody on its way within 30 m
    comfortable: bool  # within nuPlan's bounds
    acceleration: Floats  # [N] m/s2
    risk: Floats  # [F] severity-weighted contact score in [0, 1] of the profile that was driven, by the forecasts
    cause: Ints  # [F] forecast object, a row of the frame, that most keeps the ego from driving freely; -1: none does
    plan: Floats  # [F, T + 1, 2] m, places along the profile of each decision, from that of the decision on
    hit: int  # number of the road user that the ego met; -1: none
    size: Floats  # [2] m, length and width of the ego
    station: Floats  # [N + 1] m along the way in each state
    route: Floats  # [n, 4] points of the way: m along it, x, y, heading in rad without jumps
    # the recording until the last decision, packed, and "ending", the road users after it: see `record.rows_from`
    world: Mapping[str, NDArray[Any]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Lane:
    """A lane of the road map: polylines along the direction of travel."""

    center: Floats  # [n, 2]
    left: Floats  # [n, 2] left border
    right: Floats  # [n, 2] right border
    following: tuple[
        int, ...
    ] = ()  # lanes that continue it, as indices of ``Scene.lanes``
    junction: bool = False  # inside a junction: drawn without borders


@dataclass(frozen=True, eq=False)
class ImageField:
    """Area that a labelled camera image covers: a forecast outside of it is neither right nor wrong."""

    projection: (
        Floats  # [F, 3, 4] from the scene's frame of reference, homogeneous, to pixels
    )
    height: Floats  # [F] m, z of the camera
    heading: Floats  # [F] rad, yaw of the platform
    size: tuple[int, int]  # pixels, width and height
    region: Floats  # [R, 4] pixels, left top right bottom: "don't care" regions of the labels
    region_start: Ints  # [F + 1] regions of each frame
    box_size: Floats  # [C, 3] m, l w h that stand for an object of each class


@dataclass(frozen=True, eq=False, repr=False)
class Scene:
    """One log: the same record for every source."""

    name: str
    time: Floats  # [F] s, increasing
    ego: Floats  # [F, 4] x y z yaw of the sensor platform
    truth: Truth
    detections: Detections
    truth_complete: bool = True  # False: objects outside the truth exist, so an unmatched forecast is not false
    listed_targets: bool = False  # True: ``truth.eligible`` is an official list, whose targets need no P past frames
    detector: str = ""  # origin of the detections, as text; empty: the scene has none
    simulated: bool = False  # True: the detections are simulated
    visible: Floats | None = (
        None  # [R] share of each true box in line of sight, 0 to 1; None: unknown
    )
    skipped: dict[str, int] = field(
        default_factory=dict
    )  # rows dropped while reading, by reason
    recording: str = ""  # that the scene is cut from: objects keep their ids in all its scenes; empty: none
    image: ImageField | None = None  # area that the labels cover; None: all around
    world: Floats | None = (
        None  # [F, 4] x y z yaw of each frame's origin, if every frame has its own
    )
    tracks: StoredTracks | None = (
        None  # of a foreign tracker, for agents that observe them
    )
    lanes: tuple[
        Lane, ...
    ] = ()  # the road map; observations show it where the card says so
    # names in the files by number, only where they differ; texts alone show them, and no digest counts them
    object_names: Mapping[int, str] = field(
        default_factory=dict, compare=False
    )  # of true objects, all different
    track_names: Mapping[int, str] = field(default_factory=dict, compare=False)
    # of ``tracks``: an agent with ``observe="tracks"`` that keeps the ids it is shown answers these numbers as track_id

    def __repr__(self) -> str:
        boxes = f"{len(self.truth.box)} boxes of {len(np.unique(self.truth.object_id))} true objects"
        detections = f"{len(self.detections.box)} detections ({self.detector or 'of an unknown detector'})"
        return f"Scene {self.name!r}: {self.frames} frames\n{boxes}, {detections}"

    @property
    def frames(self) -> int:
        """Number of frames F."""
        return len(self.time)

    def name_of(self, object_id: int) -> str:
        """Id of a true object in the files of the scene: a word, a token or the number itself."""
        return self.object_names.get(object_id, str(object_id))

    def short_name(self, object_id: int) -> str:
        """Id of a true object in at most 16 characters; "#" and its number where others have the same beginning."""
        name = self.name_of(object_id)
        if len(name) <= LONGEST_SHORT_NAME:
            return name
        for begin in (name[:8], name[:LONGEST_SHORT_NAME]):
            if (
                sum(other.startswith(begin) for other in self.object_names.values())
                == 1
            ):
                return begin
        return f"#{object_id}"


@dataclass(frozen=True)
class Task:
    """The rules of the env, which an agent receives before an episode; independent of the scene."""

    env_id: str
    classes: tuple[str, ...]
    dt: float  # s, nominal frame period
    past: int  # P frames of history, the current one included
    future: int  # T frames to forecast
    k: int  # samples per object that are ranked
    samples: int  # K samples that fit per object; more than k only in unranked runs
    detections: int  # D
    tracks: int  # N
    objects: int  # O
    hypotheses: int  # H
    detector: str  # e.g. "pointrcnn": agents choose their parameters by it
    # "truth": true boxes with true ids come as detections; "tracks": stored tracks do; "associated": detections have
    # the ids of the true objects that they are matched to
    observe: str = "detections"
    ego_motion: bool = (
        True  # False: every frame is given in its own ego frame, the world moves
    )
    velocity: bool = False  # detections carry a measured velocity
    seed: int = (
        0  # for the agent's own random draws; a hash of the run's seed and the scene
    )
    lanes: int = 0  # L pieces of lanes in the observation; 0: it shows none
    lane_points: int = 0  # Q points of a piece
    motion_noise: str = ""  # e.g. "KITTI": where objects move like here; agents choose their motion model by it
    weights_of: str = ""  # the env whose network weights serve here too; empty: none
    tracker: Mapping[str, Mapping[str, Any]] = field(
        default_factory=dict
    )  # by class; empty: those of the detector
    presence: str = ""  # SCORES, or the file of a presence model; empty: agents choose it by the detector

    def after_hole(self, observation: Observation) -> bool:
        """True if the frame follows a hole in time: no track history should cross it (docs/definitions, "Targets")."""
        return (
            float(observation.get("dt", self.dt)) > LONGEST_STEP * self.dt + _ROUNDING
        )


@dataclass(frozen=True, eq=False, repr=False)
class Rollout:
    """All actions of an agent on one scene, checked and quantised, in the scene's frame of reference.

    Invalid rows are left out; ``invalid`` counts them.
    """

    scene: str
    track_start: Ints  # [F + 1]
    track_id: Ints  # [R]
    track_box: Floats  # [R, 7]
    track_class: Ints  # [R]; -1: not stated, fits every class
    member: Bools  # [R, H] the hypotheses that hold this track
    hypothesis_log_weight: (
        Floats  # [F, H] normalised; -inf: no such hypothesis in this frame
    )
    hypothesis_parent: Ints  # [F, H] hypothesis of the frame before that it descends from; -1: not stated
    object_start: Ints  # [F + 1]
    object_box: Floats  # [R, 7]
    object_class: Ints  # [R]
    object_confidence: Floats  # [R] 0 to 1, that the object exists
    forecast: Ints  # [R, K, T, 2] int16, centimetres from the object's centre
    forecast_log_weight: Floats  # [R, K] normalised; -inf: no such sample
    invalid: Ints  # [F, 3] rows rejected: tracks, hypotheses, objects
    malformed: Ints  # [F, C + 1] false forecasts that rejected objects count as, by class; the last of unknown class
    dropped: Ints  # [F] detections that did not fit into the observation
    seconds: Floats  # [F] time the agent took; not part of the digest
    drive: Drive | None = None  # of a closed loop

    def __repr__(self) -> str:
        boxes = f"{len(self.track_id)} boxes of tracks, {len(self.object_class)} forecast objects"
        return f"Rollout of scene {self.scene!r}: {self.frames} frames, {self.member.shape[1]} hypotheses\n{boxes}"

    @property
    def frames(self) -> int:
        """Number of frames F."""
        return len(self.track_start) - 1

    @property
    def tracks(self) -> Ragged:
        """Rows of tracks by frame."""
        return Ragged(self.track_start)

    @property
    def objects(self) -> Ragged:
        """Rows of forecast objects by frame."""
        return Ragged(self.object_start)
