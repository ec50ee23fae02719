"""Recording of a simulation, frame by frame, as a world.

A world is right-handed with z up, while highway-env's y points down.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...core import Floats, Lane, Truth, starts_of_sorted, wrap_angle
from .world import World

_EGO_HEIGHT_M = 1.7
_LARGEST_ANGLE = 3.141592  # rad, of six decimals
# columns of a row: x y z yaw l w h, velocity x y, class, number; then its frame
_NUMBER = 10
# factors of the first nine columns, from y down to y up
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
        class_id, number = self.frames[-1][row, 9:11].astype(np.int64).tolist()
        return class_id, number

    def rows(self, frame_slice: slice = slice(None)) -> Floats:
        """Return right-handed rows [R, 12] of some frames, by frame and number."""
        frames = self.frames[frame_slice]
        row_counts = [len(frame) for frame in frames]
        frame = np.repeat(np.arange(len(frames)), row_counts)
        rows = np.column_stack([np.concatenate([np.empty((0, 11)), *frames]), frame])
        rows = rows[np.lexsort((rows[:, _NUMBER], frame))]
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
        carries = rows[:, _NUMBER] == number
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
        class_id, object_id, frame = rows[:, 9:].astype(np.int64).T.copy()
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

    They are along heading and slip angle of the last step.
    """
    motion = [(v.heading, v.speed, v.action["steering"]) for v in vehicles]
    heading, speed, steering = np.array(motion, dtype=np.float64).reshape(-1, 3).T
    course = heading + np.arctan(0.5 * np.tan(steering))
    return (np.array([np.cos(course), np.sin(course)]) * speed).T
