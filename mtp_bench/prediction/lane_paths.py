"""Paths along the lanes of an observation, and the lanes that follow them, for many objects at once."""

from dataclasses import dataclass

import numpy as np

from ..core import Bools, Floats, Ints, Observation
from ..tracking import kernel, part

STEP = 2.0  # m, between the points of a path
_ASIDE = 3.0  # m, farthest middle line of a lane that an object may be on
_TURNED = 0.9  # rad, largest angle between an object and its lane
_BEYOND = 0.5  # m, before the beginning or behind the end of a piece of a lane
_SPREAD = (
    1.0,
    0.3,
)  # m and rad, usual distance and angle between an object and its lane
_STARTS = 16  # pieces of lanes that an object may be on
_BRANCHES = (
    16  # paths from the beginning of a piece, at most: each has a share of `_LEAST`
)
_LEAST = 1 / _BRANCHES - 1e-9
_DEPTH = 40  # pieces of a path
_SAME = 1.0  # m, paths that stay as near are one


@dataclass(frozen=True, eq=False)
class LanePaths:
    """Paths of n objects, most plausible first; ``S`` points, every 2 m from the point of the lane near the object.

    Behind the last known lane a path goes straight on.
    """

    points: Floats  # [n, most, S, 2] m, frame of the observation; 0 where not valid
    valid: Bools  # [n, most]
    offset: Floats  # [n, most] m, distance of the object from the lane, left positive
    chance: Floats  # [n, most] plausibility, adding up to 1 over the paths of an object that has any


def lane_paths(
    observation: Observation,
    place: Floats,
    heading: Floats,
    most: int,
    metres: float | Floats,
) -> LanePaths:
    """Up to ``most`` paths of objects at ``place`` [n, 2] with direction of travel ``heading`` [n], rad.

    An object is on a lane by distance and direction, on several within a junction. Each is followed over all its
    successors for ``metres``, one number or one per object [n]; paths that are the same so far are one.
    """
    count = observation["lane_valid"].astype(np.int64).sum(axis=1)
    point = np.array(observation["lane_point"], dtype=np.float64, order="C")
    follow = np.array(observation["lane_next"], dtype=np.int64, order="C")
    object_pose = np.empty((len(place), 4))
    object_pose[:, :2], object_pose[:, 2], object_pose[:, 3] = place, heading, metres
    size = int(np.ceil(np.max(metres, initial=0.0) / STEP)) + 1
    paths = np.zeros((len(place), most, size, 2))
    offset = np.zeros((len(place), most))
    chance = np.zeros((len(place), most))
    there = np.arange(point.shape[1]) < count[:, None]
    low, high = (np.where(there[..., None], point, sign * np.inf) for sign in (1, -1))
    bound = np.concatenate(
        [low.min(axis=1) - _ASIDE, high.max(axis=1) + _ASIDE], axis=1
    )
    length = (np.linalg.norm(np.diff(point, axis=1), axis=2) * there[:, 1:]).sum(axis=1)
    find_paths(point, count, follow, bound, length, object_pose, paths, offset, chance)
    return LanePaths(paths, chance > 0, offset, chance)


@part
def _nearest(line: Floats, x: float, y: float) -> tuple[float, float, float, float]:
    """Arc length of the point of a line [Q, 2] nearest to x y, distance (left positive) and direction there.

    The last number is how far x y is before the beginning or behind the end of the line, along it.
    """
    least = np.inf
    arc = 0.0
    offset = 0.0
    direction = 0.0
    beyond = 0.0
    length = 0.0
    for q in range(len(line) - 1):
        ux = line[q + 1, 0] - line[q, 0]
        uy = line[q + 1, 1] - line[q, 1]
        long = np.hypot(ux, uy)
        if long < 1e-6:
            continue
        dx = x - line[q, 0]
        dy = y - line[q, 1]
        ahead = (dx * ux + dy * uy) / long
        along = min(max(ahead, 0.0), long)
        rx = dx - along * ux / long
        ry = dy - along * uy / long
        distance = np.hypot(rx, ry)
        if distance < least:
            least = distance
            arc = length + along
            direction = np.arctan2(uy, ux)
            offset = distance if ux * ry - uy * rx >= 0 else -distance
            beyond = max(
                -ahead if q == 0 else 0.0, ahead - long if q == len(line) - 2 else 0.0
            )
        length += long
    return arc, offset, direction, beyond


@part
def _write(chain: Ints, point: Floats, count: Ints, path: Floats) -> None:
    """Write points [G, 2], 2 m apart, along the pieces ``chain``, and straight on behind them."""
    g = 0
    begin = 0.0
    cos = 1.0
    sin = 0.0
    x = 0.0
    y = 0.0
    for row in chain:
        for q in range(count[row] - 1):
            x = point[row, q + 1, 0]
            y = point[row, q + 1, 1]
            ux = x - point[row, q, 0]
            uy = y - point[row, q, 1]
            long = np.hypot(ux, uy)
            if long < 1e-6:
                continue
            cos = ux / long
            sin = uy / long
            begin = begin + long
            while STEP * g <= begin and g < len(path):
                path[g, 0], path[g, 1] = (
                    x - (begin - STEP * g) * cos,
                    y - (begin - STEP * g) * sin,
                )
                g += 1
    for s in range(g, len(path)):
        path[s, 0], path[s, 1] = (
            x + (STEP * s - begin) * cos,
            y + (STEP * s - begin) * sin,
        )


@part
def _trace(
    first: int,
    point: Floats,
    count: Ints,
    length: Floats,
    follow: Ints,
    path: Floats,
    share: Floats,
) -> int:
    """Write the paths [B, G, 2] from the beginning of piece ``first`` and their shares [B]; return their number."""
    reach = STEP * (path.shape[1] - 1)
    found = 0
    waiting = 1
    stack_row = np.zeros(4 * _DEPTH, np.int64)
    stack_depth = np.zeros(4 * _DEPTH, np.int64)
    chain = np.zeros(_DEPTH, np.int64)
    end = np.zeros(_DEPTH)
    part_of = np.ones(_DEPTH)
    stack_row[0] = first
    while waiting:
        waiting -= 1
        row = stack_row[waiting]
        depth = stack_depth[waiting]
        chain[depth] = row
        end[depth] = length[row] + (end[depth - 1] if depth else 0.0)
        branches = 0
        for after in follow[row]:
            branches += after >= 0 and count[after] > 1
        if branches == 0 or end[depth] >= reach or depth + 1 == _DEPTH:
            _write(chain[: depth + 1], point, count, path[found])
            share[found] = part_of[depth]
            found += 1
            continue
        if (
            part_of[depth] < branches * _LEAST
        ):  # far away after many branches: on along the first one alone
            branches = 1
        part_of[depth + 1] = part_of[depth] / branches
        for after in follow[row]:
            if after >= 0 and count[after] > 1 and branches:
                stack_row[waiting] = after
                stack_depth[waiting] = depth + 1
                waiting = waiting + 1
                branches = branches - 1
    return found


@part
def _on_lanes(
    point: Floats, count: Ints, bound: Floats, pose: Floats, row: Ints, match: Floats
) -> int:
    """Write the pieces [16] that an object may be on and arc length, distance and weight of each [16, 3]."""
    found = 0
    for i in range(len(count)):
        x = pose[0]
        y = pose[1]
        if (
            count[i] < 2
            or x < bound[i, 0]
            or y < bound[i, 1]
            or x > bound[i, 2]
            or y > bound[i, 3]
        ):
            continue
        arc, offset, direction, beyond = _nearest(point[i, : count[i]], x, y)
        turned = abs((direction - pose[2] + np.pi) % (2 * np.pi) - np.pi)
        if abs(offset) > _ASIDE or turned > _TURNED or beyond > _BEYOND:
            continue
        weight = np.exp(
            -0.5 * ((offset / _SPREAD[0]) ** 2 + (turned / _SPREAD[1]) ** 2)
        )
        row[found], match[found, 0], match[found, 1], match[found, 2] = (
            i,
            arc,
            offset,
            weight,
        )
        found += 1
        if found == len(row):
            break
    return found


@part
def _at(path: Floats, arc: float, axis: int) -> float:
    """Coordinate of a path [G, 2] at an arc length."""
    g = min(int(arc / STEP), len(path) - 2)
    share = arc / STEP - g
    return float(path[g, axis] + share * (path[g + 1, axis] - path[g, axis]))


@part
def _same(a: Floats, arc_a: float, b: Floats, arc_b: float, metres: float) -> bool:
    """True if two paths stay close to each other for ``metres``."""
    for i in range(5):
        ahead = metres * i / 4
        dx = _at(a, arc_a + ahead, 0) - _at(b, arc_b + ahead, 0)
        dy = _at(a, arc_a + ahead, 1) - _at(b, arc_b + ahead, 1)
        if dx * dx + dy * dy > _SAME**2:
            return False
    return True


@kernel(
    "void(f8[:, :, ::1], i8[::1], i8[:, ::1], f8[:, ::1], f8[::1], "
    "f8[:, ::1], f8[:, :, :, ::1], f8[:, ::1], f8[:, ::1])"
)
def find_paths(
    point: Floats,
    count: Ints,
    follow: Ints,
    bound: Floats,
    length: Floats,
    pose: Floats,
    paths: Floats,
    offset: Floats,
    chance: Floats,
) -> None:
    """Write paths [n, most, S, 2], offsets and chances [n, most] of objects at ``pose`` [n, 4]: x y heading metres.

    ``point`` [L, Q, 2], ``count``, ``follow`` [L, 4], ``bound`` [L, 4], ``length``: pieces of lanes, successors, and
    the area that is near. The paths from the beginning of a piece are traced once, for all objects on it.
    """
    pieces = len(count)
    most = paths.shape[1]
    size = paths.shape[2]
    grid = size + int(length.max() / STEP) + 2 if pieces else 0
    traced = np.zeros(pieces, np.int64)
    slot = np.zeros(pieces, np.int64)
    table = np.empty((pieces, _BRANCHES, grid, 2))
    share = np.empty((pieces, _BRANCHES))
    used = 0
    row = np.empty(_STARTS, np.int64)
    match = np.empty((_STARTS, 3))
    kept = np.empty((_STARTS * _BRANCHES, 2), np.int64)
    arc = np.empty(_STARTS * _BRANCHES)
    aside = np.empty(_STARTS * _BRANCHES)
    weight = np.empty(_STARTS * _BRANCHES)
    for n in range(len(pose)):
        starts = _on_lanes(point, count, bound, pose[n], row, match)
        different = 0
        for place in np.argsort(-match[:starts, 2]):
            i = int(row[place])
            if traced[i] == 0:
                slot[i] = used
                used = used + 1
                traced[i] = _trace(
                    i, point, count, length, follow, table[slot[i]], share[slot[i]]
                )
            for b in range(traced[i]):
                path = table[slot[i], b]
                own = match[place, 2] * share[slot[i], b]
                before = -1
                for d in range(different):
                    if _same(
                        table[kept[d, 0], kept[d, 1]],
                        arc[d],
                        path,
                        match[place, 0],
                        pose[n, 3],
                    ):
                        before = d
                        break
                if (
                    before >= 0
                ):  # branches add up; of lanes over each other the likelier one counts
                    same_piece = kept[before, 0] == slot[i]
                    weight[before] = (
                        weight[before] + own if same_piece else max(weight[before], own)
                    )
                    continue
                kept[different, 0], kept[different, 1], arc[different] = (
                    slot[i],
                    b,
                    match[place, 0],
                )
                aside[different] = match[place, 1]
                weight[different] = own
                different += 1
        order = np.argsort(-weight[:different])[:most]
        total = 0.0
        for d in order:
            total += weight[d]
        for m in range(len(order)):
            d = order[m]
            offset[n, m] = aside[d]
            chance[n, m] = weight[d] / total
            path = table[kept[d, 0], kept[d, 1]]
            for s in range(size):
                paths[n, m, s, 0] = _at(path, float(arc[d]) + STEP * s, 0)
                paths[n, m, s, 1] = _at(path, float(arc[d]) + STEP * s, 1)
