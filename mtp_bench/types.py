"""Records that flow from source to score, and the legend of dimensions.

``F`` frames · ``D`` detections of a frame · ``M`` true objects of a frame · ``N`` tracks of a frame (leaves: distinct
track states) · ``O`` forecast objects of a frame · ``H`` hypotheses · ``K`` samples · ``T`` future frames · ``P`` past
frames, the current one included · ``C`` classes · ``R`` rows over all frames of a scene.

Metres, seconds, radians; right-handed frames with z up; a box is ``x y z yaw l w h`` with its centre at x y z.
Rows over all frames are sorted by frame; the rows of frame t are ``start[t]:start[t + 1]``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.integer[Any]]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Truth:
    """True boxes of a scene, in its frame of reference."""

    start: Ints  # [F + 1]
    box: Floats  # [R, 7]
    velocity: Floats  # [R, 2] m/s, NaN where unknown
    class_id: Ints  # [R] index into the task's classes
    object_id: Ints  # [R] unique per object within the scene
    eligible: Bools  # [R] may be a prediction target; it needs P past and T future frames (`Scene.listed_targets`)
    neutral: Bools  # [R] beside the evaluated classes (KITTI: a van for "car"): matching it is neither right nor wrong

    def rows(self, t: int) -> slice:
        """Rows of frame ``t``."""
        return slice(int(self.start[t]), int(self.start[t + 1]))


@dataclass(frozen=True, eq=False)
class Detections:
    """Detected boxes of a scene, in its frame of reference."""

    start: Ints  # [F + 1]
    box: Floats  # [R, 7]
    velocity: Floats  # [R, 2] m/s, NaN where unknown
    class_id: Ints  # [R]
    score: Floats  # [R] as the detector gives it (a logit may be negative)

    def rows(self, t: int) -> slice:
        """Rows of frame ``t``."""
        return slice(int(self.start[t]), int(self.start[t + 1]))


@dataclass(frozen=True, eq=False)
class Lane:
    """A lane of the road map: polylines along the direction of travel."""

    center: Floats  # [n, 2]
    left: Floats  # [n, 2] left border
    right: Floats  # [n, 2] right border
    following: tuple[int, ...] = ()  # lanes that continue it, by their place in ``Scene.lanes``


@dataclass(frozen=True, eq=False)
class Scene:
    """One log: the same record for every source."""

    name: str
    time: Floats  # [F] s, increasing
    ego: Floats  # [F, 4] x y z yaw of the sensor platform
    truth: Truth
    detections: Detections
    truth_complete: bool = True  # False: objects outside the truth exist, so an unmatched forecast is not spurious
    listed_targets: bool = False  # True: ``truth.eligible`` is an official list, whose targets need no P past frames
    detector: str = ""  # what made the detections, in words; simulated ones say so; empty: there are none
    simulated: bool = False  # True: the detections are simulated
    visible: Floats | None = None  # [R] share of each true box in line of sight, 0 to 1; None where it is not known
    skipped: dict[str, int] = field(default_factory=dict)  # rows dropped while reading, by reason
    lanes: tuple[Lane, ...] = ()  # the road map, for drawing and training; empty where there is none

    @property
    def frames(self) -> int:
        """Number of frames F."""
        return len(self.time)


@dataclass(frozen=True)
class Task:
    """What an agent is told before an episode: the rules of the env, nothing of the scene."""

    env_id: str
    classes: tuple[str, ...]
    dt: float  # s, nominal frame period
    past: int  # P frames of history, the current one included
    future: int  # T frames to forecast
    k: int  # samples per object that are ranked
    samples: int  # K samples that fit per object; more than k only in unranked, k-free runs
    detections: int  # D
    tracks: int  # N
    objects: int  # O
    hypotheses: int  # H
    detector: str  # e.g. "pointrcnn": agents choose their parameters by it
    observe: str = "detections"  # "truth": true boxes with true ids come as detections
    ego_motion: bool = True  # False: every frame is given in its own ego frame, the world moves
    velocity: bool = False  # detections carry a measured velocity
    seed: int = 0  # for the agent's own random draws


@dataclass(frozen=True, eq=False)
class Rollout:
    """Everything an agent said on one scene, checked and quantised, in the scene's frame of reference.

    A row that broke the contract is not in it; ``invalid`` counts such rows.
    """

    scene: str
    track_start: Ints  # [F + 1]
    track_id: Ints  # [R]
    track_box: Floats  # [R, 7]
    track_class: Ints  # [R]; -1: not stated, fits every class
    member: Bools  # [R, H] the hypotheses that hold this track
    hypothesis_log_weight: Floats  # [F, H] normalised; -inf: no such hypothesis in this frame
    object_start: Ints  # [F + 1]
    object_box: Floats  # [R, 7]
    object_class: Ints  # [R]
    forecast: Ints  # [R, K, T, 2] int16, centimetres from the object's centre
    forecast_log_weight: Floats  # [R, K] normalised; -inf: no such sample
    invalid: Ints  # [F, 3] rows rejected: tracks, hypotheses, objects
    dropped: Ints  # [F] detections that did not fit into the observation
    seconds: Floats  # [F] time the agent took; not part of the digest

    @property
    def frames(self) -> int:
        """Number of frames F."""
        return len(self.track_start) - 1

    def track_rows(self, t: int) -> slice:
        """Rows of the tracks of frame ``t``."""
        return slice(int(self.track_start[t]), int(self.track_start[t + 1]))

    def object_rows(self, t: int) -> slice:
        """Rows of the forecast objects of frame ``t``."""
        return slice(int(self.object_start[t]), int(self.object_start[t + 1]))
