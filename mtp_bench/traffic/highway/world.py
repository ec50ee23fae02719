"""Worlds of simulated traffic and their recording, the ``[source]`` table, and settings.

A world is right-handed with z up, while highway-env's y points down. A change of a
setting changes the worlds: then `GENERATOR` gets its next number.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from ...cards import SourceSection, Traits
from ...core import Floats, Lane, Section, Truth, rule, starts_of_sorted, wrap_angle

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


@dataclass(frozen=True)
class GymTraffic:
    """Everything that a simulation of a gym environment depends on."""

    id: str
    # names of those that register the id or hold the policy; empty: highway-env's own,
    # or those of the running program
    modules: tuple[str, ...]
    code: tuple[str, ...]  # sha256 of their files
    config: dict[str, Any]
    policy: str
    seconds: float

    @property
    def scenario(self) -> str:
        """The id without its module and namespace: begins names of folders, scenes."""
        return self.id.rpartition(":")[2].rpartition("/")[2]


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
    def _require_disjoint(self) -> Self:
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
    def _require_fitting_scenario(cls, number: int, info: ValidationInfo) -> int:
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


_EGO_HEIGHT_M = 1.7
_LARGEST_ANGLE = 3.141592  # rad, largest one below pi with six decimals
# columns of a row: x y z yaw l w h, velocity x y, class, number; then its frame
CLASS_COLUMN = 9
NUMBER_COLUMN = 10
FRAME_COLUMN = 11
# of the first nine columns, from y down to y up
_MIRROR = np.array([1.0, -1.0, 1.0, -1.0, 1.0, 1.0, 1.0, 1.0, -1.0])


class Recording:
    """Boxes, velocities, classes and numbers of road users at ``rate`` Hz."""

    def __init__(self, rate: float) -> None:
        self.frames: list[Floats] = []  # [N, 11] in highway-env's frame
        self._rate = rate

    def add(
        self,
        box: Floats,
        velocity: Floats,
        class_id: Sequence[int],
        number: Sequence[int],
    ) -> None:
        """Append a frame of N road users, in highway-env's frame.

        ``box`` [N, 7], ``velocity`` [N, 2] m/s, ``class_id`` and ``number`` [N].
        """
        self.frames.append(np.column_stack([box, velocity, class_id, number]))

    def identity(self, row: int) -> tuple[int, int]:
        """Return class and number of a road user of the last frame."""
        class_id, number = (
            self.frames[-1][row, CLASS_COLUMN:FRAME_COLUMN].astype(np.int64).tolist()
        )
        return class_id, number

    def rows(self, frame_slice: slice = slice(None)) -> Floats:
        """Return right-handed rows [R, 12] of some frames, by frame and number."""
        frames = self.frames[frame_slice]
        row_counts = [len(frame) for frame in frames]
        frame = np.repeat(np.arange(len(frames)), row_counts)
        all_rows = np.concatenate([np.empty((0, 11)), *frames])
        rows = np.column_stack([all_rows, frame.astype(float)])
        rows = rows[np.lexsort((rows[:, NUMBER_COLUMN], frame))]
        rows[:, :9] *= _MIRROR
        yaw_rad = wrap_angle(rows[:, 3])
        rows[:, 3] = yaw_rad.clip(-_LARGEST_ANGLE, _LARGEST_ANGLE)
        rows[:, :9] = rows[:, :9].round(6) + 0.0  # no negative zeros
        return rows

    def seen_from(
        self,
        number: int,
        lanes: tuple[Lane, ...],
        frame_slice: slice = slice(None),
        renumbered: bool = True,
    ) -> World:
        """Return the world of some frames seen by vehicle ``number``.

        That vehicle is not in the truth. ``renumbered``: objects are numbered from 0,
        else they keep their numbers.
        """
        rows = self.rows(frame_slice)
        carries = rows[:, NUMBER_COLUMN] == number
        ego = rows[carries, :4]
        ego[:, 2] = _EGO_HEIGHT_M
        return self._world(rows[~carries], ego, lanes, renumbered)

    def seen_beside(
        self, sensor: tuple[float, float, float], lanes: tuple[Lane, ...]
    ) -> World:
        """Return the world seen by a fixed sensor.

        ``sensor``: x, y, z in highway-env's frame.
        """
        x, y, z = sensor
        ego = np.tile([x, -y, z, 0.0], (len(self.frames), 1))
        return self._world(self.rows(), ego, lanes)

    def _world(
        self,
        rows: Floats,
        ego: Floats,
        lanes: tuple[Lane, ...],
        renumbered: bool = True,
    ) -> World:
        class_id, object_id, frame = rows[:, CLASS_COLUMN:].astype(np.int64).T.copy()
        if renumbered:
            object_id = np.unique(object_id, return_inverse=True)[1]
        neutral = np.zeros(len(rows), dtype=np.bool_)
        truth = Truth(
            starts_of_sorted(frame, len(ego)),
            rows[:, :7].copy(),
            rows[:, 7:9].copy(),
            class_id,
            object_id,
            eligible=~neutral,
            neutral=neutral,
        )
        return World(np.arange(len(ego)) / self._rate, ego, truth, lanes)


def course_velocity(vehicles: Sequence[Any]) -> Floats:
    """Return velocities [N, 2] of the centres of vehicles.

    Their course is the heading plus the slip angle of the last step.
    """
    motion = [(v.heading, v.speed, v.action["steering"]) for v in vehicles]
    heading, speed, steering = np.array(motion, dtype=np.float64).reshape(-1, 3).T
    course = heading + np.arctan(0.5 * np.tan(steering))  # bicycle model
    return (np.array([np.cos(course), np.sin(course)]) * speed).T
