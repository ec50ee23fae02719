"""What happens on a simulated road: the record between the traffic and the detector."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ...types import Floats, Lane, Truth

ScenarioName = Literal["intersection", "roundabout", "merge", "highway"]
SensorName = Literal["ego", "roadside"]

CLASSES = ("car", "truck", "bus", "motorcycle", "pedestrian")  # class_id of a world is an index into these
RATE = 10.0  # Hz of the simulation


@dataclass(frozen=True)
class Traffic:
    """What kind of traffic to simulate."""

    scenario: ScenarioName
    sensor: SensorName  # "ego": on a vehicle of the traffic; "roadside": at a fixed place beside the road
    seconds: float  # recorded time, after the warm-up
    vehicles: int  # aimed at on the road at any time, the ego among them
    pedestrians: int  # aimed at on the map at any time
    parked: int = 0  # parked cars along the kerbs


@dataclass(frozen=True, eq=False)
class World:
    """A recorded piece of crash-free traffic at `RATE`; right-handed frame, z up, the road at z = 0.

    The truth holds everybody but the ego, all over the map; ``class_id`` is an index into `CLASSES`.
    """

    time: Floats  # [F] s, from 0
    ego: Floats  # [F, 4] x y z yaw of the sensor
    truth: Truth
    lanes: tuple[Lane, ...]
    rejected: tuple[str, ...] = ()  # why earlier attempts were thrown away, one word each: "crash", "no_ego", ...
    visible: Floats = field(default_factory=lambda: np.zeros(0))  # [R] share of each box in line of sight of the ego
