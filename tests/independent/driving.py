"""The numbers of a stored drive, from its file alone, as docs/definitions/driving.md says it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

Array = NDArray[Any]
CLASSES = ("car", "truck", "bus", "motorcycle", "pedestrian")


@dataclass(frozen=True)
class Numbers:
    """The numbers of one drive."""

    way: float
    seconds: float
    goal: bool
    hits: set[tuple[str, int]]  # class and number of those that the collision may be named after
    at_fault: bool
    near_misses: int
    phantom_brakes: int
    comfortable: bool

    def score(self, reference: float) -> float:
        """The drive score of the scene; ``reference``: distance with ground-truth tracks, m."""
        if self.at_fault:
            return 0.0
        progress = 1.0 if reference < 5.0 else min(1.0, self.way / reference)
        return (5 * progress + 5 * (self.near_misses == 0) + 2 * self.comfortable) / 12


@dataclass(frozen=True)
class RoadUser:
    """A road user in one state."""

    number: int
    class_id: int
    box: Array  # x, y, z, yaw, length, width, height
    velocity: Array


def numbers_of(file: Path) -> Numbers:
    """The numbers of the drive that is stored in ``file``."""
    with np.load(file) as stored:
        arrays = dict(stored)
    s, a = arrays["drive_station"], arrays["drive_acceleration"]
    steps = len(a)
    v = 10.0 * np.diff(s)
    ego = [ego_box(arrays, state) for state in range(steps + 1)]
    others = [road_users(arrays, state) for state in range(steps + 1)]
    last_speed = v[-1] + a[-1] / 10.0
    met = [other for other in others[-1] if meet(ego[-1], other.box)]
    guilty = [other for other in met if last_speed > 0.05 and not from_behind(ego[-1], other.box)]
    near = [v[k] > 0.05 and any(nearly_met(ego[k], v[k], other) for other in others[k]) for k in range(steps)]
    brakes = [a[k] < -3.0 and is_free(arrays, ego[k], s[k], others[k]) for k in range(steps)]
    return Numbers(
        way=s[-1] - s[0],
        seconds=steps / 10,
        goal=bool(s[-1] >= arrays["drive_route"][-1, 0] - 1.0),
        hits={(CLASSES[other.class_id], other.number) for other in guilty or met},
        at_fault=bool(guilty),
        near_misses=runs(near),
        phantom_brakes=runs(brakes),
        comfortable=is_comfortable(a, v, np.array([box[3] for box in ego])[:-1]),
    )


def on_way(arrays: dict[str, Array], s: float) -> Array:
    """x, y and heading of the way at ``s``."""
    route = arrays["drive_route"]
    return np.array([np.interp(s, route[:, 0], column) for column in route.T[1:]])


def ego_box(arrays: dict[str, Array], state: int) -> Array:
    """The ego's box."""
    x, y, heading = on_way(arrays, arrays["drive_station"][state])
    length, width = arrays["drive_size"]
    return np.array([x, y, 0.0, heading, length, width, 0.0])


def road_users(arrays: dict[str, Array], state: int) -> list[RoadUser]:
    """All road users in a state."""
    start = arrays["world_start"]
    if state >= len(start) - 1:
        rows = arrays["world_ending"][arrays["world_ending"][:, 0] == state]
        return [RoadUser(int(row[1]), int(row[2]), row[3:10], row[10:12]) for row in rows]
    columns = (arrays[f"world_{name}"] for name in ("object_id", "class_id", "box", "velocity"))
    part = slice(start[state], start[state + 1])
    return [RoadUser(*row) for row in zip(*(column[part] for column in columns), strict=True)]


def corners(box: Array) -> Array:
    """The four corners [4, 2] of a box."""
    along = np.array([np.cos(box[3]), np.sin(box[3])]) * box[4] / 2
    across = np.array([-np.sin(box[3]), np.cos(box[3])]) * box[5] / 2
    return np.array([box[:2] + offset for offset in (along + across, along - across, -along - across, -along + across)])


def meet(a: Array, b: Array) -> bool:
    """True if two boxes have a point in common: no side of either one separates all of their corners."""
    for yaw in (a[3], a[3] + np.pi / 2, b[3], b[3] + np.pi / 2):
        axis = np.array([np.cos(yaw), np.sin(yaw)])
        first, second = corners(a) @ axis, corners(b) @ axis
        if first.max() < second.min() or second.max() < first.min():
            return False
    return True


def ahead_of(ego: Array, box: Array) -> float:
    """Place of the centre of ``box`` along the ego's heading, from its centre."""
    return float((box[:2] - ego[:2]) @ [np.cos(ego[3]), np.sin(ego[3])])


def from_behind(ego: Array, box: Array) -> bool:
    """True if ``box`` hits the ego from behind."""
    d, phi = ahead_of(ego, box), box[3] - ego[3]
    reach = (box[4] * abs(np.cos(phi)) + box[5] * abs(np.sin(phi))) / 2
    return bool(d < 0 and d + reach < ego[4] / 2 and np.cos(phi) > 0.5)


def nearly_met(ego: Array, speed: float, other: RoadUser) -> bool:
    """True if the moving ego would meet the road user at one of the three moments."""
    if ahead_of(ego, other.box) <= 0 or np.hypot(*(other.box[:2] - ego[:2])) >= 40.0:
        return False
    for seconds in (0.3, 0.6, 0.95):
        mine, theirs = ego.copy(), other.box.copy()
        mine[:2] += seconds * speed * np.array([np.cos(ego[3]), np.sin(ego[3])])
        theirs[:2] += seconds * other.velocity
        if meet(mine, theirs):
            return True
    return False


def is_free(arrays: dict[str, Array], ego: Array, s: float, others: list[RoadUser]) -> bool:
    """True if no road user is on the way ahead of the ego."""
    offsets = np.arange(ego[4] / 2, ego[4] / 2 + 30, 1)
    points = np.array([on_way(arrays, s + offset)[:2] for offset in offsets])
    for other in others:
        near = np.hypot(*(other.box[:2] - ego[:2])) < 40.0
        reach = ego[5] / 2 + min(other.box[4], other.box[5]) / 2 + 1.0
        if near and (np.hypot(*(points - other.box[:2]).T) < reach).any():
            return False
    return True


def is_comfortable(a: Array, v: Array, heading: Array) -> bool:
    """True if acceleration, along and across, and jerk keep within their bounds."""
    before, after = np.append(heading[0], heading[:-1]), np.append(heading[1:], heading[-1])
    steps = np.full(len(a), 2.0)
    steps[[0, -1]] = 1.0
    across = v * 10.0 * (after - before) / steps
    jerk = savgol_filter(a, window_length=15, polyorder=2, deriv=1, delta=0.1) if len(a) >= 15 else np.zeros(1)
    along = ((a >= -4.05) & (a <= 2.40)).all()
    return bool(along and (np.abs(across) <= 4.89).all() and (np.abs(jerk) <= 4.13).all())


def runs(states: list[bool]) -> int:
    """Number of runs of True."""
    return sum(now and not before for before, now in zip([False, *states], states, strict=False))
