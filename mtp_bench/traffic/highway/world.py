"""Worlds of simulated traffic, the ``[source]`` table of their cards, and settings.

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

# class_id of a world is an index into these
CLASSES = ("car", "truck", "bus", "motorcycle", "pedestrian")
GENERATOR = 2  # version of the simulated content
# scenes of these and larger seeds belong to seals; even their names are secret
SECRET_SEEDS = 2**40
RATE = 10.0  # Hz of the simulation
WARM_UP = 10.0  # s before the recording begins

APPROACH_M = 105.0  # length of the arms of a junction
STRIP_M = 2.5  # beside the lanes of the arms, where cars park
ARM_WEIGHTS = (1.0, 0.35, 1.0, 0.35)  # frequency of vehicles from each arm


@dataclass(frozen=True)
class Traffic:
    """Kind of traffic to simulate."""

    scenario: ScenarioName
    # "ego": on a vehicle of the traffic; "roadside": at a fixed place beside the road
    sensor: SensorName
    seconds: float  # recorded time, after the warm-up
    vehicles: int  # number to keep on the road, with the ego
    pedestrians: int  # number to keep on the map
    parked: int = 0  # parked cars along the kerbs


@dataclass(frozen=True, eq=False)
class World:
    """Recorded crash-free traffic; right-handed frame, z up, the road at z = 0.

    The truth has all objects of the map but the ego; ``class_id`` is an index into
    `CLASSES`.
    """

    time: Floats  # [F] s, from 0
    ego: Floats  # [F, 4] x y z yaw of the sensor
    truth: Truth
    lanes: tuple[Lane, ...]
    # [R] share of each box in line of sight of the ego
    visible: Floats = field(default_factory=lambda: np.zeros(0))


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
    """Seeds of each split, which have no common seed.

    A range has the first seed, and the one after the last.
    """

    train: SeedRange
    val: SeedRange
    test: SeedRange

    @model_validator(mode="after")
    def _apart(self) -> Self:
        ranges = sorted((self.train, self.val, self.test))
        if any(end > first for (_, end), (first, _) in itertools.pairwise(ranges)):
            raise ValueError("expected splits without a common seed")
        return self


_SCENARIOS_WITH = {
    "pedestrians": ("intersection",),
    "parked": ("intersection", "roundabout"),
}


class HighwaySource(SourceSection):
    """Simulated traffic on highway-env roads, one scene per seed.

    It needs a ``[detector]``.
    """

    splits = ("train", "val", "test")

    generator: Annotated[int, _CURRENT] = GENERATOR  # version of the simulated content
    scenario: ScenarioName
    sensor: SensorName = "ego"  # on a moving vehicle, or at a fixed place
    seconds: Annotated[float, Field(gt=0, le=600)] = 20.0
    vehicles: Annotated[int, Field(ge=2, le=200)]  # number to keep on the road
    # number to keep; only the intersection has crossings
    pedestrians: Annotated[int, Field(ge=0, le=200)] = 0
    parked: Annotated[int, Field(ge=0, le=200)] = 0  # cars along the kerbs of junctions
    seeds: SeedRanges

    @field_validator("pedestrians", "parked")
    @classmethod
    def _fits_the_scenario(cls, number: int, info: ValidationInfo) -> int:
        scenarios = _SCENARIOS_WITH[str(info.field_name)]
        if number and info.data.get("scenario") not in scenarios:
            names = " and ".join(scenarios)
            raise ValueError(f"expected 0: only {names} have a place for them")
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
