"""Conflicts of routes through a junction, computed once per map, in metres from the start of a route."""

from dataclasses import dataclass

import numpy as np

from ...core import Bools, Floats, Ints
from .driving import swept_sides
from .lanes import LaneGeometry, Route, RouteTable
from .networks import Crossing, RoadMap

_STEP = 0.5  # m between samples
_FREE = 0.15  # m, free space on each side
_MERGED = 0.4  # m; closer paths count as one
_MERGE_LENGTH = 4.0  # m; crossing paths share less than this
_LIGHT, _HEAVY = (
    (5.4, 2.0, 3.2),
    (12.0, 2.55, 6.6),
)  # m, length, width, wheelbase that a path is kept free for
_BEFORE_LINE = 1.0  # m from the front of a waiting vehicle to the conflict


@dataclass(frozen=True)
class ConflictZone:
    """A stretch of a route that must not be used together with a stretch of another route."""

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
    end: float  # of the last conflict
    cruise: float  # m/s, lowest limit between them
    stretches: tuple[CrossingStretch, ...]
    zones: dict[int, tuple[ConflictZone, ...]]  # by the other route


@dataclass(frozen=True, eq=False)
class _Path:
    s: Floats  # [n] m from the start of the route
    xy: Floats  # [n, 2]
    half: Floats  # [n] m to keep free on each side


def find_passages(road_map: RoadMap, routes: RouteTable) -> tuple[Passage, ...]:
    """The passage of every route of a regulated map."""
    paths = [
        _sample(route, r, routes, road_map.geometry)
        for r, route in enumerate(road_map.routes)
    ]
    zones: list[dict[int, tuple[ConflictZone, ...]]] = [{} for _ in paths]
    arms = [road_map.geometry.index[route.roads[0][0]][0] for route in road_map.routes]
    for p, path in enumerate(paths):
        for q in range(p + 1, len(paths)):
            shared = () if arms[p] == arms[q] else _zones(path, paths[q])
            if shared:
                zones[p][q] = shared
                zones[q][p] = tuple(zone.mirrored for zone in shared)
    return tuple(
        _passage(road_map, r, paths[r], zones[r], routes) for r in range(len(paths))
    )


def _sample(
    route: Route, number: int, routes: RouteTable, geometry: LaneGeometry
) -> _Path:
    length, width, wheelbase = _HEAVY if route.heavy else _LIGHT
    s, xy, half = [], [], []
    for lane, *_ in route.roads:
        station = np.arange(0.0, geometry.length[lane], _STEP)
        s.append(routes.start[number, lane] + station)
        xy.append(
            np.array(
                [geometry.lanes[lane].position(float(value), 0.0) for value in station]
            )
        )
        radius = geometry.radius[lane : lane + 1]
        outer, inner = swept_sides(
            np.array(length), np.array(width), np.array(wheelbase), radius
        )
        half.append(np.full(len(station), max(outer[0], inner[0]) + _FREE))
    return _Path(np.concatenate(s), np.concatenate(xy), np.concatenate(half))


def _near(a: _Path, b: _Path) -> _Path:
    """The part of path a, in one piece, outside of which it is not close to b."""
    reach = a.half.max() + b.half.max()
    near = np.flatnonzero(
        ((a.xy > b.xy.min(axis=0) - reach) & (a.xy < b.xy.max(axis=0) + reach)).all(
            axis=1
        )
    )
    part = slice(near[0], near[-1] + 1) if len(near) else slice(1)
    return _Path(a.s[part], a.xy[part], a.half[part])


def _zones(a: _Path, b: _Path) -> tuple[ConflictZone, ...]:
    a = _near(a, b)
    b = _near(b, a)
    dx = a.xy[:, 0, None] - b.xy[:, 0]
    dy = a.xy[:, 1, None] - b.xy[:, 1]
    distance = np.sqrt(
        dx * dx + dy * dy
    )  # a norm along a short axis takes several times as long
    close = distance < a.half[:, None] + b.half
    return tuple(
        _zone(a, b, distance, close, run) for run in _runs(np.any(close, axis=1))
    )


def _runs(flags: Bools) -> list[Ints]:
    """Indices of each run of True."""
    index = np.flatnonzero(flags)
    return np.split(index, np.flatnonzero(np.diff(index) > 1) + 1) if len(index) else []


def _zone(
    a: _Path, b: _Path, distance: Floats, close: Bools, run: Ints
) -> ConflictZone:
    merged = np.argwhere(distance[run] < _MERGED)
    if len(np.unique(merged[:, 0])) * _STEP >= _MERGE_LENGTH:
        i, j = run[merged[0, 0]], merged[0, 1]
        first = np.flatnonzero(close[run[0]])
        start = max(
            float(b.s[j]) - (float(a.s[i]) - float(a.s[run[0]])), float(b.s[first[0]])
        )
        return ConflictZone(
            float(a.s[run[0]]), float(a.s[i]), start, float(b.s[j]), True
        )
    other = np.flatnonzero(close[run].any(axis=0))
    return ConflictZone(
        float(a.s[run[0]]),
        float(a.s[run[-1]]),
        float(b.s[other[0]]),
        float(b.s[other[-1]]),
        False,
    )


def _passage(
    road_map: RoadMap,
    r: int,
    path: _Path,
    zones: dict[int, tuple[ConflictZone, ...]],
    routes: RouteTable,
) -> Passage:
    every = [zone for shared in zones.values() for zone in shared]
    found = [
        part
        for c, crossing in enumerate(road_map.crossings)
        for part in _stretches(c, crossing, path)
    ]
    stretches = tuple(sorted(found, key=lambda stretch: stretch.start))
    line = (
        min([zone.start for zone in every] + [stretch.start for stretch in stretches])
        - _BEFORE_LINE
    )
    end = max([zone.end for zone in every] + [stretch.end for stretch in stretches])
    lanes, length = (
        [road[0] for road in road_map.routes[r].roads],
        road_map.geometry.length,
    )
    inside = [
        k
        for k in lanes
        if routes.start[r, k] + length[k] > line and routes.start[r, k] < end
    ]
    return Passage(
        lanes[0],
        line,
        end,
        float(road_map.geometry.limit[inside].min()),
        stretches,
        zones,
    )


def _stretches(number: int, crossing: Crossing, path: _Path) -> list[CrossingStretch]:
    along, across = (
        np.array(crossing.direction),
        np.array([-crossing.direction[1], crossing.direction[0]]),
    )
    offset = path.xy - np.array(crossing.origin)
    t, u, s = offset @ along, offset @ across, path.s
    on = (t > 0) & (t < crossing.span) & (np.abs(u) <= crossing.width / 2)
    return [
        CrossingStretch(
            number, float(s[run[0]]), float(s[run[-1]]), float(t[run].mean())
        )
        for run in _runs(on)
    ]
