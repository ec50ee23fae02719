"""Scenes: logs with their true boxes, detections, tracks and lanes.

No past, future or velocity crosses a hole in their time.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from .arrays import Bools, Floats, Ints, Ragged

_SHORT_NAME = 16  # characters at most
_PREFIX_LENGTHS = (8, _SHORT_NAME)  # of longer names


@dataclass(frozen=True, eq=False, repr=False)
class Truth(Ragged):
    """True boxes of a scene, in its frame of reference."""

    box: Floats  # [R, 7]
    velocity: Floats  # [R, 2] m/s, NaN where unknown
    class_id: Ints  # [R] index into the task's classes
    object_id: Ints  # [R] unique per object within the scene
    # [R] may be a prediction target; it needs P past and T future frames
    # (`Scene.listed_targets`)
    eligible: Bools
    # [R] of a class similar to an evaluated one (KITTI: a van for "car"): matches with
    # it do not count
    neutral: Bools


@dataclass(frozen=True, eq=False, repr=False)
class Detections(Ragged):
    """Detected boxes of a scene, in its frame of reference."""

    box: Floats  # [R, 7]
    velocity: Floats  # [R, 2] m/s, NaN where unknown
    class_id: Ints  # [R]
    score: Floats  # [R] as the detector gives it (a logit may be negative)


@dataclass(frozen=True, eq=False, repr=False)
class StoredTracks(Detections):
    """Boxes of a foreign tracker with their identities.

    It may have seen the future.
    """

    # [R] identity within the scene, from 0; it has one class, and one box in a frame
    object_id: Ints


@dataclass(frozen=True, eq=False)
class Lane:
    """A lane of the road map: polylines along the direction of travel."""

    center: Floats  # [n, 2]
    left: Floats  # [n, 2] left border
    right: Floats  # [n, 2] right border
    # lanes that continue it, as indices of ``Scene.lanes``
    following: tuple[int, ...] = ()
    junction: bool = False  # inside a junction: drawn without borders


@dataclass(frozen=True, eq=False)
class ImageField:
    """Area that a labelled camera image covers.

    A forecast outside of it is neither right nor wrong.
    """

    # [F, 3, 4] from the scene's frame of reference, homogeneous, to pixels
    projection: Floats
    height: Floats  # [F] m, z of the camera
    heading: Floats  # [F] rad, yaw of the platform
    size: tuple[int, int]  # pixels, width and height
    # [R, 4] pixels, left top right bottom: "don't care" regions of the labels
    region: Floats
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
    # False: objects outside the truth exist, so an unmatched forecast is not false
    truth_complete: bool = True
    # True: ``truth.eligible`` is an official list, whose targets need no P past frames
    listed_targets: bool = False
    detector: str = ""  # origin of the detections, as text; empty: the scene has none
    simulated: bool = False  # True: the detections are simulated
    # [R] share of each true box in line of sight, 0 to 1; None: unknown
    visible: Floats | None = None
    # rows dropped while reading, by reason
    skipped: dict[str, int] = field(default_factory=dict)
    # recording that the scene is cut from: objects keep their ids in all of its scenes;
    # empty: none
    recording: str = ""
    image: ImageField | None = None  # area that the labels cover; None: all around
    # [F, 4] x y z yaw of each frame's origin, if every frame has its own
    world: Floats | None = None
    tracks: StoredTracks | None = None  # of a foreign tracker, for agents that see them
    lanes: tuple[
        Lane, ...
    ] = ()  # the road map; observations show it where a card says so
    # [F] True: all objects of the frame are labelled, as far as the truth goes. Other
    # frames have no truth, and neither score nor count. None: all are annotated
    annotated: Bools | None = None
    # [n, 4] m, least x and y, largest x and y of rectangles without labels, in the
    # frame of reference that all frames share
    neutral_areas: Floats | None = None
    # Names of true objects in the files, by their number and only where they differ
    # from it. They are all different. Texts alone show names, and no digest has them.
    object_names: Mapping[int, str] = field(default_factory=dict, compare=False)
    # the same for ``tracks``: an agent with ``observe="tracks"`` that keeps the ids it
    # is shown answers these numbers as track_id
    track_names: Mapping[int, str] = field(default_factory=dict, compare=False)

    def __repr__(self) -> str:
        objects = len(np.unique(self.truth.object_id))
        detector = self.detector or "of an unknown detector"
        return (
            f"Scene {self.name!r}: {self.frames} frames\n"
            f"{len(self.truth.box)} boxes of {objects} true objects, "
            f"{len(self.detections.box)} detections ({detector})"
        )

    @property
    def frames(self) -> int:
        """Number of frames F."""
        return len(self.time)

    @property
    def annotated_frames(self) -> Ints:
        """Annotated frames [A], rising."""
        if self.annotated is None:
            return np.arange(self.frames)
        return np.flatnonzero(self.annotated)

    @property
    def annotated_place(self) -> Ints:
        """Place of each frame [F] among the annotated ones.

        Of another frame that of the annotated one before, -1 without one.
        """
        frames = np.arange(self.frames)
        return np.searchsorted(self.annotated_frames, frames, side="right") - 1

    @property
    def annotated_step(self) -> int:
        """Frames from one annotated frame to the next, as the median."""
        steps = np.diff(self.annotated_frames)
        return int(np.median(steps)) if len(steps) else 1

    def seconds(self, t: int) -> float:
        """Return the time of frame ``t`` since the first frame."""
        return float(self.time[t] - self.time[0])

    def name_of(self, object_id: int) -> str:
        """Return the id of a true object in the files, often a word."""
        return self.object_names.get(object_id, str(object_id))

    def short_name(self, object_id: int) -> str:
        """Return the id of a true object in at most 16 characters.

        Where others have the same beginning it is "#" and the object's number.
        """
        name = self.name_of(object_id)
        if len(name) <= _SHORT_NAME:
            return name
        all_names = self.object_names.values()
        for length in _PREFIX_LENGTHS:
            prefix = name[:length]
            if sum(text.startswith(prefix) for text in all_names) == 1:
                return prefix
        return f"#{object_id}"


_LONGEST_STEP = 1.5  # frame periods of the task between two frames without a hole
_ROUNDING_S = 1e-6


def longest_step(period: float) -> float:
    """Return the longest step without a hole, s.

    ``period``: nominal time between two frames, s.
    """
    return _LONGEST_STEP * period + _ROUNDING_S


def pieces_of(time: Floats, period: float) -> Ints:
    """Number the pieces of time [F] between holes, for each frame.

    ``time`` [F] s; ``period``: nominal time between two frames, s.
    """
    steps = np.diff(time, prepend=time[:1])
    return np.cumsum(steps > longest_step(period), dtype=int)
