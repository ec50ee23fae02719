"""Conflicts of routes through a junction, in metres from the start of a route.

They are computed once per map.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from ...core import Bools, Floats, Ints, true_runs
from .driving import swept_sides
from .lanes import Crossing, LaneGeometry, RoadMap, Route, RouteTable, lane_points

_SAMPLE_STEP_M = 0.5
_SIDE_MARGIN_M = 0.15  # free space on each side
_MERGED_M = 0.4  # closer paths count as one
_MIN_MERGE_LENGTH_M = 4.0  # crossing paths share less than this
# length, width, wheelbase that a path is kept free for, m
_LIGHT_SIZE_M = np.array([5.4, 2.0, 3.2])
_HEAVY_SIZE_M = np.array([12.0, 2.55, 6.6])
_LINE_GAP_M = 1.0  # from the front of a waiting vehicle to the conflict


@dataclass(frozen=True)
class ConflictZone:
    """A stretch of a route that conflicts with a stretch of another route.

    Both must not be used together.
    """

    start: float
    end: float
    other_start: float
    other_end: float
    merging: bool  # both routes continue together from the end

    @property
    def mirrored(self) -> "ConflictZone":
        """The same zone from the side of the other route."""
        return ConflictZone(
            self.other_start, self.other_end, self.start, self.end, self.merging
        )


@dataclass(frozen=True)
class CrossingStretch:
    """A stretch of a route on a pedestrian crossing."""

    crossing: int
    start: float
    end: float
    across: float  # m along the crossing's axis, of the middle of the route


@dataclass(frozen=True)
class Passage:
    """A route's way through the junction."""

    entry: int  # the lane at its start
    line: float  # place to wait at
    end: float  # station where the last conflict ends
    cruise: float  # m/s, lowest limit between them
    stretches: tuple[CrossingStretch, ...]
    zones: dict[int, tuple[ConflictZone, ...]]  # zones by number of the other route


@dataclass(frozen=True, eq=False)
class _Path:
    """Points of a route, and the room that a vehicle needs there."""

    s: Floats  # [n] m from the start of the route
    xy: Floats  # [n, 2]
    half: Floats  # [n] m to keep free on each side


def find_passages(road_map: RoadMap, routes: RouteTable) -> tuple[Passage, ...]:
    """Return the passage of every route of a regulated map."""
    geometry = road_map.geometry
    paths = [
        _sample(route, routes.start[r], geometry)
        for r, route in enumerate(road_map.routes)
    ]
    zones: list[dict[int, tuple[ConflictZone, ...]]] = [{} for _ in paths]
    arms = [geometry.index[route.roads[0][0]][0] for route in road_map.routes]
    for first_index, path in enumerate(paths):
        for second_index in range(first_index + 1, len(paths)):
            if arms[first_index] == arms[second_index]:
                continue  # vehicles from one arm follow each other
            shared_zones = _zones(path, paths[second_index])
            if shared_zones:
                zones[first_index][second_index] = shared_zones
                zones[second_index][first_index] = tuple(
                    zone.mirrored for zone in shared_zones
                )
    return tuple(
        _passage(road_map, r, paths[r], zones[r], routes) for r in range(len(paths))
    )


def _sample(route: Route, lane_start: Floats, geometry: LaneGeometry) -> _Path:
    """Return the path along the first lane of each road of a route.

    ``lane_start`` [L]: m from the start of the route to each lane.
    """
    size = _HEAVY_SIZE_M if route.heavy else _LIGHT_SIZE_M
    length, width, wheelbase = size[:, None]
    stations = []
    points = []
    half_widths = []
    for lane, *_ in route.roads:
        along_m = np.arange(0.0, geometry.length[lane], _SAMPLE_STEP_M)
        outer, inner = swept_sides(length, width, wheelbase, geometry.radius[[lane]])
        half_width = max(outer[0], inner[0]) + _SIDE_MARGIN_M
        stations.append(lane_start[lane] + along_m)
        points.append(lane_points(geometry.lanes[lane], along_m))
        half_widths.append(np.full(len(along_m), half_width))
    return _Path(
        np.concatenate(stations), np.concatenate(points), np.concatenate(half_widths)
    )


def _zones(a: _Path, b: _Path) -> tuple[ConflictZone, ...]:
    """Return the conflict zones of path a with path b."""
    distance = cdist(a.xy, b.xy)
    close_pairs = distance < a.half[:, None] + b.half
    return tuple(
        _zone(a, b, distance, close_pairs, np.arange(start, end))
        for start, end in true_runs(np.any(close_pairs, axis=1))
    )


def _zone(
    a: _Path, b: _Path, distance: Floats, close_pairs: Bools, index_run: Ints
) -> ConflictZone:
    """Return the zone of a run of points of path a that are close to path b.

    Paths that become one share only the stretch before they join: behind it vehicles
    follow each other.
    """
    start_m = float(a.s[index_run[0]])
    merged, merged_other = np.nonzero(distance[index_run] < _MERGED_M)
    if len(np.unique(merged)) * _SAMPLE_STEP_M >= _MIN_MERGE_LENGTH_M:
        end_m = float(a.s[index_run[merged[0]]])
        other_end = float(b.s[merged_other[0]])
        first_other = float(b.s[np.flatnonzero(close_pairs[index_run[0]])[0]])
        # the stretch of b is as long, but has close points only
        other_start = max(other_end - (end_m - start_m), first_other)
        return ConflictZone(start_m, end_m, other_start, other_end, merging=True)
    shared_stations = b.s[close_pairs[index_run].any(axis=0)]
    return ConflictZone(
        start_m,
        float(a.s[index_run[-1]]),
        float(shared_stations[0]),
        float(shared_stations[-1]),
        merging=False,
    )


def _passage(
    road_map: RoadMap,
    r: int,
    path: _Path,
    zones: dict[int, tuple[ConflictZone, ...]],
    routes: RouteTable,
) -> Passage:
    """Return the passage of route r, from the line to the end of all conflicts."""
    stretches: list[CrossingStretch] = []
    for c, crossing in enumerate(road_map.crossings):
        stretches += _stretches(c, crossing, path)
    stretches.sort(key=lambda stretch: stretch.start)
    parts: list[ConflictZone | CrossingStretch] = [*stretches]
    for shared_zones in zones.values():
        parts += shared_zones
    line_m = min(part.start for part in parts) - _LINE_GAP_M
    end_m = max(part.end for part in parts)
    lanes = np.array([road[0] for road in road_map.routes[r].roads])
    lane_start = routes.start[r, lanes]
    lane_end = lane_start + road_map.geometry.length[lanes]
    inside = lanes[(lane_end > line_m) & (lane_start < end_m)]
    cruise = float(road_map.geometry.limit[inside].min())
    return Passage(int(lanes[0]), line_m, end_m, cruise, tuple(stretches), zones)


def _stretches(number: int, crossing: Crossing, path: _Path) -> list[CrossingStretch]:
    """Return the stretches of a path on a crossing."""
    x, y = crossing.direction
    offset = path.xy - np.array(crossing.origin)
    along_m = offset @ np.array([x, y])
    across_m = offset @ np.array([-y, x])
    inside = (along_m > 0) & (along_m < crossing.span)
    inside &= np.abs(across_m) <= crossing.width / 2
    return [
        CrossingStretch(
            number,
            float(path.s[start]),
            float(path.s[end - 1]),
            float(along_m[start:end].mean()),
        )
        for start, end in true_runs(inside)
    ]
