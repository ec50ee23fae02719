"""Records of what an agent answered on a scene, and of how a closed loop drove."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import Bools, Floats, Ints, Ragged

_CENTIMETRES_PER_METRE = 100.0  # forecasts are recorded in whole centimetres
HARD_BRAKING = -3.0  # m/s2


def to_centimetres(metres: Floats) -> Ints:
    """Return forecasts as they are recorded: whole centimetres, int16."""
    centimetres = np.rint(metres * _CENTIMETRES_PER_METRE)
    return np.asarray(centimetres.astype(np.int16))


def to_metres(centimetres: Ints) -> Floats:
    """Return recorded forecasts in metres."""
    return centimetres / _CENTIMETRES_PER_METRE


@dataclass(frozen=True, eq=False)
class Drive:
    """Record of the ego of a closed loop in one scene.

    N steps of the simulation, F decisions of the planner.
    """

    way: float  # m driven
    seconds: float
    goal: bool  # the end of the way was reached
    collision: str  # class of the road user that the ego met; empty: none
    at_fault: bool  # the ego moved, and was not hit from behind
    near_misses: int  # times that a collision was less than .95 s away
    # times that the ego braked by more than 3 m/s2 with nobody on its way within 30 m
    phantom_brakes: int
    comfortable: bool  # within nuPlan's bounds
    acceleration: Floats  # [N] m/s2
    # [F] severity-weighted contact score in [0, 1], by the forecasts, of the driven
    # profile
    risk: Floats
    # [F] forecast object, a row of the frame, that most keeps the ego from driving
    # freely; -1: none does
    cause: Ints
    # [F, T + 1, 2] m, places along the profile of each decision, from its own place on
    plan: Floats
    hit: int  # number of the road user that the ego met; -1: none
    size: Floats  # [2] m, length and width of the ego
    station: Floats  # [N + 1] m along the way in each state
    # [n, 4] points of the way: m along it, x, y, heading in rad without jumps
    route: Floats
    # the recording until the last decision, packed, and "ending", the road users after
    # it: see `drive_record.rows_from`
    world: dict[str, NDArray[Any]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, repr=False)
class Rollout:
    """All actions of an agent on one scene, in the scene's frame of reference.

    Actions are checked and quantised. Invalid rows are left out; ``invalid`` counts
    them.
    """

    scene: str
    track_start: Ints  # [F + 1]
    track_id: Ints  # [R]
    track_box: Floats  # [R, 7]
    track_class: Ints  # [R]; -1: not stated, fits every class
    member: Bools  # [R, H] the hypotheses that hold this track
    hypothesis_log_weight: Floats  # [F, H] normalised; -inf: no such hypothesis
    # [F, H] hypothesis of the frame before that it descends from; -1: not stated
    hypothesis_parent: Ints
    object_start: Ints  # [F + 1]
    object_box: Floats  # [R, 7]
    object_class: Ints  # [R]
    object_confidence: Floats  # [R] 0 to 1, that the object exists
    forecast: Ints  # [R, K, T, 2] int16, centimetres from the object's centre
    forecast_log_weight: Floats  # [R, K] normalised; -inf: no such sample
    invalid: Ints  # [F, 3] rows rejected: tracks, hypotheses, objects
    # [F, C + 1] false forecasts that rejected objects count as, by class; the last of
    # unknown class
    malformed: Ints
    dropped: Ints  # [F] detections that did not fit into the observation
    seconds: Floats  # [F] time the agent took; not part of the digest
    drive: Drive | None = None  # how the ego drove, in a closed loop

    def __repr__(self) -> str:
        hypotheses = self.member.shape[1]
        return (
            f"Rollout of scene {self.scene!r}: {self.frames} frames, "
            f"{hypotheses} hypotheses\n{len(self.track_id)} boxes of tracks, "
            f"{len(self.object_class)} forecast objects"
        )

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
