"""Worlds of simulated traffic: what is simulated, the recorded result, and the settings of roads and traffic.

A change of a setting changes the worlds: then ``GENERATOR`` in ``section.py`` gets its next number.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ...types import Floats, Lane, Truth

ScenarioName = Literal["intersection", "roundabout", "merge", "highway"]
SensorName = Literal["ego", "roadside"]

CLASSES = ("car", "truck", "bus", "motorcycle", "pedestrian")  # class_id of a world is an index into these
RATE = 10.0  # Hz of the simulation

APPROACH = 105.0  # m, length of the arms of a junction
STRIP = 2.5  # m, beside the lanes of the arms, where cars park
ARM_WEIGHTS = (1.0, 0.35, 1.0, 0.35)  # frequency of vehicles from each arm
TURN_WEIGHTS = (0.235, 1.0, 0.57)  # frequency of left turns, straight on and right turns at the intersection
QUARTER_WEIGHTS = (0.6, 1.0, 0.4)  # frequency of one, two and three quarters around the roundabout
STREET_LIMIT = 9.0  # m/s, on the arms
BEND_LIMITS = (4.8, 3.4)  # m/s, of left and right turns
RING_RADIUS = 24.0  # m, of the roundabout
ENTRY_RADIUS = 20.0  # m, of its entries and exits
ROUNDABOUT_LIMITS = (4.4, 5.0, 5.3)  # m/s, of the entries, the ring and the exits
ASK_TIME = 4.0  # s before the line, at which drivers ask for the right of way, and some metres earlier
STRAIGHT_ON = 0.8  # share of the people on foot who come along the road that they do not cross
WARM_UP = 10.0  # s before the recording begins
FILLED = (0.95, 0.25)  # filled share of the entry lanes at the start: junctions, fast roads
LEAVING = 0.4  # share of the first vehicles at a junction that have passed it


@dataclass(frozen=True)
class Traffic:
    """Kind of traffic to simulate."""

    scenario: ScenarioName
    sensor: SensorName  # "ego": on a vehicle of the traffic; "roadside": at a fixed place beside the road
    seconds: float  # recorded time, after the warm-up
    vehicles: int  # number to keep on the road, with the ego
    pedestrians: int  # number to keep on the map
    parked: int = 0  # parked cars along the kerbs


@dataclass(frozen=True, eq=False)
class World:
    """Recorded crash-free traffic at `RATE`; right-handed frame, z up, the road at z = 0.

    The truth has all objects of the map but the ego; ``class_id`` is an index into `CLASSES`.
    """

    time: Floats  # [F] s, from 0
    ego: Floats  # [F, 4] x y z yaw of the sensor
    truth: Truth
    lanes: tuple[Lane, ...]
    rejected: tuple[str, ...] = ()  # reasons why earlier attempts were rejected: "crash", "no_ego"
    visible: Floats = field(default_factory=lambda: np.zeros(0))  # [R] share of each box in line of sight of the ego
