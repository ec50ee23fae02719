"""Worlds of simulated traffic: the table ``[source]`` of their cards, settings of roads and traffic, and the result.

A change of a setting changes the worlds: then `GENERATOR` gets its next number.
"""

import itertools
from dataclasses import dataclass, field
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from ...cards import SourceSection, Traits
from ...core import Floats, Lane, Section, Truth, rule

ScenarioName = Literal["intersection", "roundabout", "merge", "highway"]
SensorName = Literal["ego", "roadside"]

CLASSES = (
    "car",
    "truck",
    "bus",
    "motorcycle",
    "pedestrian",
)  # class_id of a world is an index into these
GENERATOR = 2  # version of the simulated content
SECRET_SEEDS = (
    2**40
)  # scenes of these and larger seeds belong to seals; even their names are secret
RATE = 10.0  # Hz of the simulation

APPROACH = 105.0  # m, length of the arms of a junction
STRIP = 2.5  # m, beside the lanes of the arms, where cars park
ARM_WEIGHTS = (1.0, 0.35, 1.0, 0.35)  # frequency of vehicles from each arm
ASK_TIME = 4.0  # s before the line, at which drivers ask for the right of way, and some metres earlier
STRAIGHT_ON = (
    0.8  # share of the people on foot who come along the road that they do not cross
)
WARM_UP = 10.0  # s before the recording begins
FILLED = (
    0.95,
    0.25,
)  # filled share of the entry lanes at the start: junctions, fast roads
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

    def simulate(self, seed: int) -> "World":
        """The world of a seed, see `simulate.simulate_world`."""
        from .simulate import simulate_world

        return simulate_world(self, seed)


@dataclass(frozen=True, eq=False)
class World:
    """Recorded crash-free traffic at `RATE`; right-handed frame, z up, the road at z = 0.

    The truth has all objects of the map but the ego; ``class_id`` is an index into `CLASSES`.
    """

    time: Floats  # [F] s, from 0
    ego: Floats  # [F, 4] x y z yaw of the sensor
    truth: Truth
    lanes: tuple[Lane, ...]
    visible: Floats = field(
        default_factory=lambda: np.zeros(0)
    )  # [R] share of each box in line of sight of the ego


_CURRENT = rule(
    lambda generator: generator == GENERATOR,
    f"this version of the library makes generator {GENERATOR}",
)
_RISING = rule(
    lambda seeds: 0 <= seeds[0] < seeds[1] <= 999_999,
    "expected 0 <= first < end <= 999999",
)
SeedRange = Annotated[tuple[int, int], Field(strict=False), _RISING]


class SeedRanges(Section):
    """Seeds of each split: the first, and the one after the last; splits have no common seed."""

    train: SeedRange
    val: SeedRange
    test: SeedRange

    @model_validator(mode="after")
    def _apart(self) -> Self:
        ranges = sorted((self.train, self.val, self.test))
        if any(end > first for (_, end), (first, _) in itertools.pairwise(ranges)):
            raise ValueError("expected splits without a common seed")
        return self


class HighwaySource(SourceSection):
    """Simulated traffic on highway-env roads, one scene per seed; needs a ``[detector]``."""

    splits = ("train", "val", "test")

    generator: Annotated[int, _CURRENT] = GENERATOR  # version of the simulated content
    scenario: ScenarioName
    sensor: SensorName = "ego"  # on a moving vehicle, or at a fixed place
    seconds: Annotated[float, Field(gt=0, le=600)] = 20.0
    vehicles: Annotated[int, Field(ge=2, le=200)]  # number to keep on the road
    pedestrians: Annotated[int, Field(ge=0, le=200)] = (
        0  # number to keep; only the intersection has crossings
    )
    parked: Annotated[int, Field(ge=0, le=200)] = 0  # cars along the kerbs of junctions
    seeds: SeedRanges

    @field_validator("pedestrians", "parked")
    @classmethod
    def _where_there_is_room(cls, number: int, info: ValidationInfo) -> int:
        places = {
            "pedestrians": ("intersection",),
            "parked": ("intersection", "roundabout"),
        }[str(info.field_name)]
        if number and info.data.get("scenario") not in places:
            raise ValueError(
                f"expected 0: only {' and '.join(places)} have a place for them"
            )
        return number

    @property
    def traits(self) -> Traits:
        """Abilities of the source."""
        return Traits(
            simulated=True,
            without_detections="simulated traffic",
            has_ego=self.sensor == "ego",
            lanes=True,
            scene_seconds=self.seconds,
        )
