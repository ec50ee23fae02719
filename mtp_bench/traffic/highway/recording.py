"""Recording of the frames of a run as a world: right-handed with z up, while highway-env's y points down."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...core import Floats, Lane, Truth, starts_of_sorted, wrap_angle
from .pedestrians import Crowd
from .vehicles import Driver
from .world import CLASSES, RATE, World

_EGO_HEIGHT = 1.7  # m
_PEOPLE_FROM, _PARKED_FROM = (
    1_000_000,
    2_000_000,
)  # numbers of people and parked cars follow those of drivers
_BEST = 3  # candidates among which the ego is drawn
_FAR, _NEAR = (
    0.6,
    60.0,
)  # least share of the longest way; m around the ego within which objects count
_LARGEST_ANGLE = 3.141592  # rad, of six decimals
_NO_EGO = (CLASSES.index("motorcycle"), CLASSES.index("pedestrian"))
_COLUMNS = 12  # x y z yaw l w h, velocity x y, class, number, frame
_MIRROR = np.array(
    [1.0, -1.0, 1.0, -1.0, 1.0, 1.0, 1.0, 1.0, -1.0]
)  # of the first nine, from y down to y up


class Recording:
    """Recorded boxes, velocities, classes and numbers, frame by frame."""

    def __init__(self, parked: Floats) -> None:
        """``parked`` ``[K, 7]``: boxes of cars that never move."""
        self._rows: list[Floats] = []
        self._parked = np.zeros((len(parked), _COLUMNS))  # of frame 0
        self._parked[:, :7], self._parked[:, 9] = parked, CLASSES.index("car")
        self._parked[:, 10] = _PARKED_FROM + np.arange(len(parked))

    def add(
        self,
        vehicles: Sequence[Driver],
        vehicle_boxes: Floats,
        crowd: Crowd,
        people: Floats,
    ) -> None:
        """Append a frame: boxes ``[N, 7]`` of vehicles and ``[M, 7]`` of people in highway-env's frame."""
        n = len(vehicles)
        rows = np.empty((n + len(people), _COLUMNS))
        rows[:n, :7], rows[n:, :7] = vehicle_boxes, people
        rows[:n, 7:9], rows[n:, 7:9] = course_velocity(vehicles), crowd.xy()[1].T
        rows[:n, 9], rows[n:, 9] = (
            [v.traits.class_id for v in vehicles],
            CLASSES.index("pedestrian"),
        )
        rows[:n, 10], rows[n:, 10] = (
            [v.number for v in vehicles],
            [_PEOPLE_FROM + p.number for p in crowd.people],
        )
        rows[:, 11] = len(self._rows)
        self._rows.append(rows)

    def identity(self, row: int) -> tuple[int, int]:
        """Class and number of a road user of the last frame, in the order vehicles, people, parked cars."""
        kind, number = (
            np.concatenate([self._rows[-1], self._parked])[row, 9:11]
            .astype(np.int64)
            .tolist()
        )
        return kind, number

    def world(
        self,
        sensor: tuple[float, float, float] | None,
        lanes: tuple[Lane, ...],
        rng: np.random.Generator,
    ) -> World | str:
        """The world; ``sensor``: x y z of a fixed one, None: on a vehicle. "no_ego" if no vehicle can carry it."""
        frames = len(self._rows)
        rows = right_handed([*self._rows, self._parked_rows(frames)])
        if sensor is None:
            number = self._ego(rows, rng)
            return (
                "no_ego"
                if number is None
                else seen_from(number, rows, frames, RATE, lanes)
            )
        ego = np.tile([sensor[0], -sensor[1], sensor[2], 0.0], (frames, 1))
        return World(np.arange(frames) / RATE, ego, _truth(rows, frames), lanes)

    def seen_from(
        self, number: int, lanes: tuple[Lane, ...], last: bool, frames: int | None
    ) -> World:
        """Frames so far, the first ``frames`` or the ``last`` one, seen by vehicle ``number``; numbers stay."""
        chosen = self._rows[:frames]
        if last:
            chosen = [self._rows[-1].copy()]
            chosen[0][:, 11] = 0
        rows = right_handed([*chosen, self._parked_rows(len(chosen))])
        return seen_from(number, rows, len(chosen), RATE, lanes, renumbered=False)

    def _parked_rows(self, frames: int) -> Floats:
        rows = np.tile(self._parked, (frames, 1))
        rows[:, 11] = np.repeat(np.arange(frames), len(self._parked))
        return rows

    def _ego(self, rows: Floats, rng: np.random.Generator) -> int | None:
        """Number of a vehicle that is present in all frames, drives far and has many objects around it."""
        drives = ~np.isin(rows[:, 9], _NO_EGO) & (rows[:, 10] < _PEOPLE_FROM)
        numbers, count = np.unique(rows[drives, 10], return_counts=True)
        paths = [
            rows[rows[:, 10] == number, :2]
            for number in numbers[count == len(self._rows)]
        ]
        if not paths:
            return None
        far = np.array([np.hypot(*np.diff(path, axis=0).T).sum() for path in paths])
        frame = rows[:, 11].astype(np.int64)
        near = np.array(
            [
                np.mean(np.hypot(*(rows[:, :2] - path[frame]).T) < _NEAR)
                for path in paths
            ]
        )
        best = np.argsort(
            -np.where(far >= _FAR * far.max(), near, near - 1.0), kind="stable"
        )[:_BEST]
        return int(
            numbers[count == len(self._rows)][int(best[int(rng.integers(len(best)))])]
        )


def right_handed(frames: Sequence[Floats]) -> Floats:
    """Rows ``[R, 12]`` of all frames (`_COLUMNS`), sorted by frame and number, from those of highway-env's frame."""
    rows = np.concatenate([np.empty((0, _COLUMNS)), *frames])
    rows = rows[np.lexsort((rows[:, 10], rows[:, 11]))]
    rows[:, :9] *= _MIRROR
    rows[:, 3] = np.minimum(
        np.maximum(wrap_angle(rows[:, 3]), -_LARGEST_ANGLE), _LARGEST_ANGLE
    )
    rows[:, :9] = rows[:, :9].round(6) + 0.0  # no negative zeros
    return rows


def seen_from(
    number: int,
    rows: Floats,
    frames: int,
    rate: float,
    lanes: tuple[Lane, ...],
    renumbered: bool = True,
) -> World:
    """The world of right-handed rows ``[R, 12]``; the vehicle ``number`` carries the sensor and is not in the truth.

    ``renumbered``: objects are numbered from 0, else they keep the numbers of their rows.
    """
    own = rows[:, 10] == number
    ego = rows[own, :4]
    ego[:, 2] = _EGO_HEIGHT
    return World(
        np.arange(frames) / rate, ego, _truth(rows[~own], frames, renumbered), lanes
    )


def course_velocity(vehicles: Sequence[Any]) -> Floats:
    """Velocities ``[N, 2]`` of the centres of vehicles, along heading and slip angle of the last step."""
    motion = [(v.heading, v.speed, v.action["steering"]) for v in vehicles]
    heading, speed, steering = np.array(motion, dtype=np.float64).reshape(-1, 3).T
    course = heading + np.arctan(0.5 * np.tan(steering))
    return (np.array([np.cos(course), np.sin(course)]) * speed).T


def _truth(rows: Floats, frames: int, renumbered: bool = True) -> Truth:
    start, class_id = (
        starts_of_sorted(rows[:, 11].astype(np.int64), frames),
        rows[:, 9].astype(np.int64),
    )
    object_id = rows[:, 10].astype(np.int64)
    if renumbered:
        object_id = np.unique(object_id, return_inverse=True)[1]
    neutral = np.zeros(len(rows), dtype=np.bool_)
    return Truth(
        start,
        rows[:, :7].copy(),
        rows[:, 7:9].copy(),
        class_id,
        object_id,
        ~neutral,
        neutral,
    )
