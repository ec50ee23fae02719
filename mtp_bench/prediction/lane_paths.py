"""Paths along the lanes of an observation, for many objects at once."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core import Bools, Floats, Ints, Observation
from ..tracking import kernel, part
from .lane_match import (
    ARC,
    MAX_OFFSET_M,
    MIN_SEGMENT_M,
    OFFSET,
    WEIGHT,
    Lanes,
    match_pieces,
)

STEP = 2.0  # m, between the points of a path
_MAX_STARTS = 16  # pieces of lanes that an object may be on
# paths from the beginning of a piece, at most: each has the least share
_MAX_BRANCHES = 16
_MIN_SHARE = 1 / _MAX_BRANCHES - 1e-9
_MAX_DEPTH = 40  # pieces of a path
_SUCCESSORS = 4  # of a piece, at most
_CHECKS = 5  # places where two paths are compared
_MAX_GAP_M = 1.0  # between two paths that count as one


@dataclass(frozen=True, eq=False)
class LanePaths:
    """Paths of n objects, most plausible first.

    Their ``S`` points come every 2 m from the point of the lane near the object. Behind
    the last known lane a path goes straight on.
    """

    points: Floats  # [n, most, S, 2] m, frame of the observation; 0 where not valid
    valid: Bools  # [n, most]
    offset: Floats  # [n, most] m, distance of the object from the lane, left positive
    chance: Floats  # [n, most] plausibility, of sum 1 for an object that has paths


def lane_paths(
    observation: Observation,
    place: Floats,
    heading: Floats,
    most: int,
    metres: float | Floats,
) -> LanePaths:
    """Find up to ``most`` paths of objects along lanes.

    Objects are at ``place`` [n, 2], with direction of travel ``heading`` [n], rad. An
    object is on a lane by distance and direction, on several within a junction. Each is
    followed over all its successors for ``metres``, one number or one per object [n];
    paths that are the same so far are one.
    """
    count = observation["lane_valid"].astype(np.int64).sum(axis=1)
    point = np.array(observation["lane_point"], dtype=np.float64, order="C")
    follow = np.array(observation["lane_next"], dtype=np.int64, order="C")
    pose = np.empty((len(place), 4))
    pose[:, :2] = place
    pose[:, 2] = heading
    pose[:, 3] = metres
    size = int(np.ceil(np.max(metres, initial=0.0) / STEP)) + 1
    paths = np.zeros((len(place), most, size, 2))
    offset = np.zeros((len(place), most))
    chance = np.zeros((len(place), most))
    is_point = np.arange(point.shape[1]) < count[:, None]
    low = np.where(is_point[..., None], point, np.inf).min(axis=1)
    high = np.where(is_point[..., None], point, -np.inf).max(axis=1)
    bound = np.concatenate([low - MAX_OFFSET_M, high + MAX_OFFSET_M], axis=1)
    segment_length = np.linalg.norm(np.diff(point, axis=1), axis=2)
    length = (segment_length * is_point[:, 1:]).sum(axis=1)
    find_paths(point, count, follow, bound, length, pose, paths, offset, chance)
    return LanePaths(paths, chance > 0, offset, chance)


class _Traces(NamedTuple):
    """Paths from the beginning of pieces, traced once for all objects on them."""

    path_count: Ints  # [L] 0: not traced yet
    slot: Ints  # [L] row in the next two
    points: Floats  # [L, B, G, 2] of B paths from a piece
    share: Floats  # [L, B] branches share evenly


class _Candidates(NamedTuple):
    """Different paths of an object [c]: traced paths from an arc length on."""

    slot: Ints
    branch: Ints
    arc: Floats
    offset: Floats
    weight: Floats


@part
def _write_path(chain: Ints, point: Floats, count: Ints, path: Floats) -> None:
    """Write points [G, 2], 2 m apart, along the pieces ``chain``.

    Behind the last piece the path goes straight on.
    """
    g = 0
    length = 0.0
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
            segment = np.hypot(ux, uy)
            if segment < MIN_SEGMENT_M:
                continue
            cos = ux / segment
            sin = uy / segment
            length = length + segment
            while STEP * g <= length and g < len(path):
                path[g, 0] = x - (length - STEP * g) * cos
                path[g, 1] = y - (length - STEP * g) * sin
                g += 1
    for s in range(g, len(path)):
        path[s, 0] = x + (STEP * s - length) * cos
        path[s, 1] = y + (STEP * s - length) * sin


@part
def _find_successors(row: int, lanes: Lanes, successors: Ints) -> int:
    """Write the successors of a piece and count them.

    Those without a length are left out.
    """
    branches = 0
    for successor in lanes.follow[row]:
        if successor >= 0 and lanes.point_count[successor] > 1:
            successors[branches] = successor
            branches += 1
    return branches


@part
def _trace(first: int, lanes: Lanes, path: Floats, share: Floats) -> int:
    """Write the paths [B, G, 2] from a piece's beginning and count them.

    Writes ``share`` [B]: at each fork the successors share evenly.
    """
    reach = STEP * (path.shape[1] - 1)
    path_count = 0
    waiting = 1
    stack_row = np.zeros(_SUCCESSORS * _MAX_DEPTH, np.int64)
    stack_depth = np.zeros(_SUCCESSORS * _MAX_DEPTH, np.int64)
    chain = np.zeros(_MAX_DEPTH, np.int64)
    length = np.zeros(_MAX_DEPTH + 1)  # before each piece of the chain
    chain_share = np.ones(_MAX_DEPTH)
    successors = np.zeros(_SUCCESSORS, np.int64)
    stack_row[0] = first
    while waiting:
        waiting -= 1
        row = stack_row[waiting]
        depth = stack_depth[waiting]
        chain[depth] = row
        length[depth + 1] = length[depth] + lanes.length[row]
        branches = _find_successors(row, lanes, successors)
        if branches == 0 or length[depth + 1] >= reach or depth + 1 == _MAX_DEPTH:
            chosen = chain[: depth + 1]
            _write_path(chosen, lanes.point, lanes.point_count, path[path_count])
            share[path_count] = chain_share[depth]
            path_count += 1
            continue
        # far away after many branches: on along the first one alone
        if chain_share[depth] < branches * _MIN_SHARE:
            branches = 1
        chain_share[depth + 1] = chain_share[depth] / branches
        for b in range(branches):
            stack_row[waiting] = successors[b]
            stack_depth[waiting] = depth + 1
            waiting = waiting + 1
    return path_count


@part
def _coordinate(path: Floats, arc: float, axis: int) -> float:
    """Interpolate a coordinate of a path at an arc length."""
    g = min(int(arc / STEP), len(path) - 2)
    share = arc / STEP - g
    return float(path[g, axis] + share * (path[g + 1, axis] - path[g, axis]))


@part
def _stay_close(
    a: Floats, arc_a: float, b: Floats, arc_b: float, metres: float
) -> bool:
    """Return whether two paths stay close to each other for ``metres``."""
    for i in range(_CHECKS):
        ahead = metres * i / (_CHECKS - 1)
        dx = _coordinate(a, arc_a + ahead, 0) - _coordinate(b, arc_b + ahead, 0)
        dy = _coordinate(a, arc_a + ahead, 1) - _coordinate(b, arc_b + ahead, 1)
        if dx * dx + dy * dy > _MAX_GAP_M**2:
            return False
    return True


@part
def _find_equal(
    path: Floats,
    arc: float,
    metres: float,
    count: int,
    candidates: _Candidates,
    traces: _Traces,
) -> int:
    """Find the first of ``count`` candidates close to a path, -1 if none."""
    for d in range(count):
        candidate = traces.points[candidates.slot[d], candidates.branch[d]]
        if _stay_close(candidate, candidates.arc[d], path, arc, metres):
            return d
    return -1


@part
def _add_candidates(
    piece: int,
    match: Floats,
    metres: float,
    count: int,
    candidates: _Candidates,
    traces: _Traces,
) -> int:
    """Add a piece's paths to the candidates and count all.

    ``match`` [3]: of the object with the piece. A path that stays close to a candidate
    is not added. Weights add up if both branch from this piece; of lanes over each
    other the larger weight counts.
    """
    slot = traces.slot[piece]
    for b in range(traces.path_count[piece]):
        weight = match[WEIGHT] * traces.share[slot, b]
        path = traces.points[slot, b]
        equal = _find_equal(path, match[ARC], metres, count, candidates, traces)
        if equal < 0:
            candidates.slot[count] = slot
            candidates.branch[count] = b
            candidates.arc[count] = match[ARC]
            candidates.offset[count] = match[OFFSET]
            candidates.weight[count] = weight
            count += 1
        elif candidates.slot[equal] == slot:
            candidates.weight[equal] += weight
        else:
            candidates.weight[equal] = max(candidates.weight[equal], weight)
    return count


@part
def _write_candidates(
    count: int,
    candidates: _Candidates,
    traces: _Traces,
    paths: Floats,
    offset: Floats,
    chance: Floats,
) -> None:
    """Write the likeliest candidates, M at most.

    Paths are [M, S, 2], offsets and chances [M].
    """
    order = np.argsort(-candidates.weight[:count])[: len(paths)]
    total = 0.0
    for d in order:
        total += candidates.weight[d]
    for m in range(len(order)):
        d = order[m]
        offset[m] = candidates.offset[d]
        chance[m] = candidates.weight[d] / total
        path = traces.points[candidates.slot[d], candidates.branch[d]]
        for s in range(paths.shape[1]):
            arc = float(candidates.arc[d]) + STEP * s
            paths[m, s, 0] = _coordinate(path, arc, 0)
            paths[m, s, 1] = _coordinate(path, arc, 1)


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
    """Write paths, offsets and chances of objects.

    Paths are [n, most, S, 2], offsets and chances [n, most]. ``pose`` [n, 4]: x y
    heading metres. The first five are those of `Lanes`.
    """
    lanes = Lanes(point, count, follow, bound, length)
    pieces = len(count)
    trace_size = 0
    if pieces:
        trace_size = paths.shape[2] + int(length.max() / STEP) + 2
    traces = _Traces(
        np.zeros(pieces, np.int64),
        np.zeros(pieces, np.int64),
        np.empty((pieces, _MAX_BRANCHES, trace_size, 2)),
        np.empty((pieces, _MAX_BRANCHES)),
    )
    traced = 0
    row = np.empty(_MAX_STARTS, np.int64)
    match = np.empty((_MAX_STARTS, 3))
    numbers = np.empty((2, _MAX_STARTS * _MAX_BRANCHES), np.int64)
    values = np.empty((3, _MAX_STARTS * _MAX_BRANCHES))
    candidates = _Candidates(numbers[0], numbers[1], values[0], values[1], values[2])
    for n in range(len(pose)):
        start_count = match_pieces(lanes, pose[n], row, match)
        different = 0
        for start in np.argsort(-match[:start_count, WEIGHT]):
            i = int(row[start])
            if traces.path_count[i] == 0:
                slot = traced
                traces.slot[i] = slot
                traced += 1
                traces.path_count[i] = _trace(
                    i, lanes, traces.points[slot], traces.share[slot]
                )
            different = _add_candidates(
                i, match[start], pose[n, 3], different, candidates, traces
            )
        _write_candidates(different, candidates, traces, paths[n], offset[n], chance[n])
