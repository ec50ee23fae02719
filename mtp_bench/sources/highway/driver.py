"""Vehicles with a size and a temper of their own, on highway-env's kinematics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from highway_env.vehicle.kinematics import Vehicle

from ...types import Floats


@dataclass(frozen=True)
class Profile:
    """What a vehicle is and how it is driven."""

    class_id: int
    length: float  # m
    width: float
    height: float
    wheelbase: float
    pace: float  # desired speed as a share of the limit
    top_speed: float  # m/s
    time_gap: float  # s
    min_gap: float  # m, to a standing leader
    acceleration: float  # m/s2
    braking: float  # m/s2, comfortable
    politeness: float  # 0 selfish, 1 counts others like itself
    aside: float  # m, how far right of the middle of the lane it keeps


class Driver(Vehicle):  # type: ignore[misc]
    """A vehicle that carries out the command it was given.

    ``LENGTH`` is the wheelbase, which is what highway-env's bicycle model turns by; the box has its own size in
    ``profile``. highway-env's collision handling is off (its response would move the vehicles): overlaps are judged by
    `simulate.overlapping`. The lane is kept by number, for all vehicles at once, see `state.observe`.
    """

    position: Any  # [2] m
    heading: Any
    speed: Any

    def __init__(
        self, road: Any, position: Floats, heading: float, speed: float, profile: Profile, number: int
    ) -> None:
        nowhere: Any = None  # highway-env would search the nearest of all lanes
        super().__init__(nowhere, position, heading, speed)
        self.road = road
        self.LENGTH, self.WIDTH = profile.wheelbase, profile.width
        self.check_collisions = False
        self.impact = None
        self.profile = profile
        self.number = number  # never used twice in a world
        self.route = -1
        self.lane_number = -1
        self.command = (0.0, 0.0)
        p = profile
        self.traits = (p.length, p.width, p.wheelbase, p.pace, p.top_speed, p.time_gap, p.min_gap, p.acceleration,
                       p.braking, p.politeness, p.aside)  # fmt: skip

    def on_state_update(self) -> None:
        """Nothing: the lane is found for all vehicles at once."""

    def order(self, steering: float, acceleration: float) -> None:
        """Sets what the next `act` does: steering angle in rad, acceleration in m/s2."""
        self.command = (steering, acceleration)

    def act(self, action: Any = None) -> None:
        """Takes up the command."""
        super().act({"steering": self.command[0], "acceleration": self.command[1]})

    def snap(self) -> None:
        """Rounds the state to 1e-6, so that the last bits of a processor's arithmetic cannot grow."""
        self.position = np.round(self.position, 6) + 0.0
        self.heading = round(float(np.remainder(self.heading + np.pi, 2 * np.pi) - np.pi), 6) + 0.0
        self.speed = round(float(self.speed), 6) + 0.0
