"""Lanes of an observation: the road map of a scene in pieces of equal size, those next to the sensor first."""

from dataclasses import dataclass

import numpy as np

from ..agent import padded
from ..cards import LaneSection
from ..core import (
    Bools,
    DataError,
    Floats,
    Ints,
    Lane,
    Observation,
    Scene,
    rotate,
    starts_of,
)

NEXT = 4  # successors of a piece that an observation has room for


@dataclass(frozen=True, eq=False)
class LaneFeed:
    """Pieces of the lanes of a scene, A in all, from which each frame shows those in reach.

    It is made once, at ``reset``; a frame then costs one distance for each point.
    """

    point: Floats  # [A, Q, 2] m, float32, in the frame of the observations
    valid: Bools  # [A, Q] a point is there
    following: Ints  # [A, NEXT] pieces that continue a piece; -1: none
    place: Floats  # [A, Q, 2] m, the points in the frame of the scene: no motion of the episode changes the order
    sensor: Floats  # [F, 2] m, of the sensor in the frame of the scene
    size: LaneSection

    def observe(self, t: int) -> Observation:
        """Fresh arrays of frame ``t``: pieces with a point in reach, nearest first."""
        distance = np.linalg.norm(self.place - self.sensor[t], axis=2)
        nearest = np.where(self.valid, distance, np.inf).min(axis=1)
        shown = np.argsort(nearest, kind="stable")[: self.size.pieces]
        shown = shown[nearest[shown] <= self.size.reach]
        row = np.full(len(self.point) + 1, -1)  # the last one is of "none"
        row[shown] = np.arange(len(shown))
        return {
            "lane_point": padded(self.point[shown], self.size.pieces, np.float32, 0),
            "lane_valid": padded(self.valid[shown], self.size.pieces, np.int8, 0),
            "lane_next": padded(
                row[self.following[shown]], self.size.pieces, np.int16, -1
            ),
        }


def make_lane_feed(
    scene: Scene, yaw: float, shift: Floats, size: LaneSection
) -> LaneFeed:
    """The lanes of ``scene`` for observations, whose frame has its places turned by ``yaw``, then moved by ``shift``.

    Raises DataError for a lane that has fewer than two points, or none where it should have one, or whose successors
    do not exist.
    """
    lines = [
        _resampled(lane, size.step, f"scene {scene.name!r}, lane {i}")
        for i, lane in enumerate(scene.lanes)
    ]
    steps = size.points - 1  # of a piece: neighbours share their end point
    first = starts_of(
        [-(-(len(line) - 1) // steps) for line in lines]
    )  # piece of each lane
    cuts = [
        line[i : i + size.points]
        for line in lines
        for i in range(0, len(line) - 1, steps)
    ]
    valid = (
        np.arange(size.points)
        < np.array([len(cut) for cut in cuts], dtype=np.int64)[:, None]
    )
    point = np.zeros((len(cuts), size.points, 2))
    point[valid] = np.concatenate([np.zeros((0, 2)), *cuts])
    following = np.full((len(cuts), NEXT), -1)
    following[:, 0] = np.arange(1, len(cuts) + 1)
    for lane, end in zip(scene.lanes, first[1:] - 1, strict=True):
        after = np.array(lane.following, dtype=np.int64)
        if ((after < 0) | (after >= len(scene.lanes))).any():
            expected = f"expected lanes from 0 to {len(scene.lanes) - 1}"
            raise DataError(
                f"scene {scene.name!r}: a lane is followed by {lane.following}, {expected}"
            )
        following[end] = padded(first[after][:NEXT], NEXT, np.int64, -1)
    low, high = (
        scene.ego[:, :2].min(axis=0) - size.reach,
        scene.ego[:, :2].max(axis=0) + size.reach,
    )
    passed = ((point >= low) & (point <= high)).all(
        axis=2
    ) & valid  # of a map larger than the way of the sensor
    kept = passed.any(axis=1)
    number = np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1)
    local = (rotate(point.reshape(-1, 2), yaw) + shift).reshape(point.shape)
    local = np.where(valid[..., None], local, 0.0).astype(np.float32)
    return LaneFeed(
        local[kept],
        valid[kept],
        number[following[kept]],
        point[kept],
        scene.ego[:, :2],
        size,
    )


def _resampled(lane: Lane, step: float, where: str) -> Floats:
    """Points [n, 2] of the middle line at equal distances of at most ``step`` m, the ends included."""
    center = np.asarray(lane.center, dtype=np.float64)
    if (
        center.ndim != 2
        or center.shape[1] != 2
        or len(center) < 2
        or not np.isfinite(center).all()
    ):
        raise DataError(
            f"{where}: center has shape {center.shape}, expected [n, 2] finite metres of 2 or more points"
        )
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(center, axis=0), axis=1)))
    stations = np.linspace(
        0.0, along[-1], max(1, int(np.ceil(along[-1] / step - 1e-6))) + 1
    )
    return np.stack(
        [np.interp(stations, along, center[:, axis]) for axis in range(2)], axis=1
    )
