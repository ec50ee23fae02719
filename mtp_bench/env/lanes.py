"""Lanes of an observation: the road map of a scene in pieces of equal size.

An observation shows those next to the sensor, the nearest first.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..agent import pad_rows
from ..cards import LaneSection
from ..core import (
    Bools,
    DataError,
    Floats,
    Ints,
    Lane,
    Observation,
    Scene,
    even_points,
    rotate,
    starts_of,
)

SUCCESSORS = 4  # of a piece that an observation has room for
_ROUNDING = 1e-6  # of the number of steps along a lane


@dataclass(frozen=True, eq=False)
class LaneFeed:
    """All A pieces of the lanes of a scene.

    A frame shows some of them.
    It is made once, at ``reset``; a frame then costs one distance for each point.
    """

    point: Floats  # [A, Q, 2] m, float32, in the frame of the observations
    valid: Bools  # [A, Q] a point is there
    following: Ints  # [A, SUCCESSORS] pieces that continue a piece; -1: none
    # [A, Q, 2] m, the points in the frame of the scene: no motion of the episode
    # changes the order
    scene_point: Floats
    sensor: Floats  # [F, 2] m, of the sensor in the frame of the scene
    size: LaneSection

    def observe(self, t: int) -> Observation:
        """Return fresh arrays of the pieces in reach at frame ``t``, nearest first."""
        distance = np.linalg.norm(self.scene_point - self.sensor[t], axis=2)
        nearest = np.where(self.valid, distance, np.inf).min(axis=1)
        shown = np.argsort(nearest, kind="stable")[: self.size.pieces]
        shown = shown[nearest[shown] <= self.size.reach]
        row = np.full(len(self.point) + 1, -1)  # successor -1 (none) reads the last one
        row[shown] = np.arange(len(shown))
        successors = row[self.following[shown]]
        pieces = self.size.pieces
        return {
            "lane_point": pad_rows(self.point[shown], pieces, np.float32),
            "lane_valid": pad_rows(self.valid[shown], pieces, np.int8),
            "lane_next": pad_rows(successors, pieces, np.int16, -1),
        }


def make_lane_feed(
    scene: Scene, yaw: float, shift: Floats, size: LaneSection
) -> LaneFeed:
    """Cut the lanes of ``scene`` into pieces for observations.

    The frame of the observations has the scene's places turned by ``yaw``, then moved
    by ``shift``. Raises DataError for a lane that has fewer than two points, or none
    where it should have one, or whose successors do not exist.
    """
    lines = [
        _resample(lane, size.step, f"scene {scene.name!r}, lane {i}")
        for i, lane in enumerate(scene.lanes)
    ]
    steps = size.points - 1  # of a piece: neighbours share their end point
    pieces = [-(-(len(line) - 1) // steps) for line in lines]  # rounded up
    first_piece = starts_of(pieces)
    point, valid = _cut(lines, size.points)
    following = _successors(scene, first_piece)
    passed = valid & _within_reach(point, scene.ego[:, :2], size.reach)
    kept_piece = passed.any(axis=1)
    # number of each piece among those kept; successor -1 (none) reads the last one
    number = np.append(np.where(kept_piece, np.cumsum(kept_piece) - 1, -1), -1)
    local = (rotate(point.reshape(-1, 2), yaw) + shift).reshape(point.shape)
    local = np.where(valid[..., None], local, 0.0).astype(np.float32)
    return LaneFeed(
        point=local[kept_piece],
        valid=valid[kept_piece],
        following=number[following[kept_piece]],
        scene_point=point[kept_piece],
        sensor=scene.ego[:, :2],
        size=size,
    )


def _cut(lines: Sequence[Floats], points: int) -> tuple[Floats, Bools]:
    """Cut lines into pieces: points [A, Q, 2] m, and a mask [A, Q] of valid ones."""
    cuts = [
        line[start : start + points]
        for line in lines
        for start in range(0, len(line) - 1, points - 1)
    ]
    counts = np.array([len(cut) for cut in cuts], dtype=np.int64)
    valid = np.arange(points) < counts[:, None]
    point = np.zeros((len(cuts), points, 2))
    point[valid] = np.concatenate([np.zeros((0, 2)), *cuts])
    return point, valid


def _successors(scene: Scene, first_piece: Ints) -> Ints:
    """Return the pieces that continue each piece [A, SUCCESSORS], -1 for none.

    ``first_piece``: of each lane, and the number of pieces.
    """
    pieces = int(first_piece[-1])
    following = np.full((pieces, SUCCESSORS), -1)
    following[:, 0] = np.arange(1, pieces + 1)  # within a lane
    for lane, last_piece in zip(scene.lanes, first_piece[1:] - 1, strict=True):
        lanes = np.array(lane.following, dtype=np.int64)
        if ((lanes < 0) | (lanes >= len(scene.lanes))).any():
            raise DataError(
                f"scene {scene.name!r}: a lane is followed by {lane.following}, "
                f"expected lanes from 0 to {len(scene.lanes) - 1}"
            )
        successors = first_piece[lanes][:SUCCESSORS]
        following[last_piece] = pad_rows(successors, SUCCESSORS, np.int64, -1)
    return following


def _within_reach(point: Floats, sensor: Floats, reach_m: float) -> Bools:
    """Mask the points [A, Q] in the rectangle around the way of the sensor [F, 2]."""
    low = sensor.min(axis=0) - reach_m
    high = sensor.max(axis=0) + reach_m
    return np.asarray(((point >= low) & (point <= high)).all(axis=2))


def _resample(lane: Lane, step_m: float, where: str) -> Floats:
    """Return equidistant points [n, 2] of the middle line, with both ends.

    ``step_m``: largest distance between two; ``where``: names the lane in an error.
    """
    center = np.asarray(lane.center, dtype=np.float64)
    is_line = center.ndim == 2 and center.shape[1] == 2 and len(center) >= 2
    if not is_line or not np.isfinite(center).all():
        raise DataError(
            f"{where}: center has shape {center.shape}, "
            "expected 2 or more points [n, 2] of finite metres"
        )
    length_m = np.cumsum(np.linalg.norm(np.diff(center, axis=0), axis=1))[-1]
    steps = max(1, int(np.ceil(length_m / step_m - _ROUNDING)))
    return even_points(center, steps + 1)
