"""Rules of an env, as an agent receives them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from .arrays import Observation
from .scenes import longest_step

SCORES = "scores"  # a `Task.presence`: the last detection's score is the confidence
# log-weights below, such as -inf, mean an absent sample or hypothesis
ABSENT_BELOW = -1e30
ID_LIMIT = 2**31 - 1  # largest number of an object or a track
# in place of an object's number, where the frame is not annotated
UNKNOWN_OBJECT = -2


@dataclass(frozen=True)
class Task:
    """Rules of the env, which an agent receives before an episode of any scene."""

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
    # "truth": true boxes with true ids come as detections; "tracks": stored tracks do;
    # "associated": detections have the ids of the true objects that they match
    observe: str = "detections"
    ego_motion: bool = True  # False: every frame is in its own ego frame
    velocity: bool = False  # detections carry a measured velocity
    # seed of the agent's random draws: a hash of the run's seed and the scene
    seed: int = 0
    lanes: int = 0  # L pieces of lanes in the observation; 0: it shows none
    lane_points: int = 0  # Q points of a piece
    # e.g. "KITTI", where objects move like here; agents choose their motion model by it
    motion_noise: str = ""
    weights_of: str = ""  # the env whose network weights serve here too; empty: none
    # by class; empty: those that the detector has
    tracker: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    # SCORES, or the file of a presence model; empty: agents choose it by the detector
    presence: str = ""

    def after_hole(self, observation: Observation) -> bool:
        """Return True if the frame follows a hole in time.

        No track history should cross it (docs/definitions, "Targets").
        """
        return float(observation.get("dt", self.dt)) > longest_step(self.dt)
