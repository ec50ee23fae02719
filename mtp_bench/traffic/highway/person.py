"""A person on foot and the stages of the way over a crossing."""

from dataclasses import dataclass, field

import numpy as np

from ...core import Floats
from .right_of_way import CrossingPedestrian

ARRIVING, WAITING, CROSSING, LEAVING = range(4)
# to the waiting point: reached, or standing behind others
_REACHED_M = 0.7
_QUEUED_M = 2.0
_CORNER_M = 2.0  # to a point of the way, where people turn to the next one
# before the waiting point, from where people see if they can cross
_LOOKING_M = 3.0
_GONE_M = 1.4  # to the end of the way
# speed by which people judge if they can cross: share of the pace, and least speed
_CAREFUL_SHARE = 0.85
_MIN_CAREFUL_MPS = 0.5
_STEP_OFF_M = 0.2  # to the point where people step off the road


@dataclass(eq=False)
class Person:
    """A person on foot; points are (along, across) the crossing from its origin, m."""

    number: int
    group: int
    crossing: int  # index into those of the map
    direction: float  # +1 or -1, along the crossing
    size: tuple[float, float, float]  # m, length, width and height
    pace: float  # m/s
    patience: float  # s at the kerb
    waiting_point: Floats
    far_point: Floats  # where to step off the road
    departure: list[Floats]  # points of the way from there
    place: list[float]
    velocity: list[float]  # m/s, along and across
    heading: float  # rad
    ahead: list[Floats]  # next points of the way before the crossing, or after it
    # passed points of the way; empty for a person who cannot turn back
    passed: list[Floats] = field(default_factory=list)
    stage: int = ARRIVING
    waited: float = 0.0  # s

    @property
    def goal(self) -> Floats:
        """The present goal."""
        if self.stage == CROSSING:
            return self.far_point
        return self.waiting_point if self.stage == WAITING else self.ahead[0]

    @property
    def patient(self) -> bool:
        """False at the end of the patience."""
        return self.waited <= self.patience

    def turn_corner(self, to_next: float) -> float:
        """Turn to the next point of the way near a corner.

        ``to_next``: metres to the present point; return those to the next one.
        """
        if len(self.ahead) == 1 or to_next >= _CORNER_M:
            return to_next
        if self.passed:  # else the person cannot turn back
            self.passed.append(self.ahead[0])
        self.ahead = self.ahead[1:]
        return float(np.hypot(*(self.ahead[0] - self.place)))

    def has_left(self, to_end: float) -> bool:
        """Return True near the end of the way, in ``to_end`` m."""
        return self.stage == LEAVING and len(self.ahead) == 1 and to_end <= _GONE_M

    def turn_back(self) -> None:
        """Go back the way that is known, if there is one."""
        if self.passed and self.stage in (ARRIVING, LEAVING):
            self.ahead = self.passed[::-1]
            self.passed = []
            self.stage = LEAVING

    def advance(self, to_next: float, stands: bool, step_s: float) -> bool:
        """Move on to the next stage.

        Return True at the kerb. There a person waits, or is near enough to walk on
        without a stop.
        """
        if self.stage == ARRIVING and len(self.ahead) == 1:
            # the last point before the crossing
            if to_next < (_QUEUED_M if stands else _REACHED_M):
                self.stage = WAITING
            return to_next < _LOOKING_M
        if self.stage == WAITING:
            self.waited += step_s
            return True
        to_far = (self.far_point[0] - self.place[0]) * self.direction
        if self.stage == CROSSING and to_far < _STEP_OFF_M:
            self.stage = LEAVING
            self.ahead = self.departure
        return False

    def walk(self) -> CrossingPedestrian:
        """Return the person as a pedestrian on the crossing."""
        patient = self.stage != CROSSING and self.patient
        speed_mps = max(_CAREFUL_SHARE * self.pace, _MIN_CAREFUL_MPS)
        return CrossingPedestrian(
            self.crossing, self.place[0], self.direction, speed_mps, patient
        )
