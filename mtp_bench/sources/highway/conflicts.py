"""Where the ways through a junction come too close: computed once per map, in metres from the start of a route."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...types import Bools, Floats, Ints
from .following import sweep
from .lane_geometry import LaneGeometry
from .networks import Crossing, RoadMap
from .routes import Route, RouteTable

_STEP = 0.5  # m between samples
_FREE = 0.15  # m, free space on each side
_MET = 0.4  # m, two ways that are this close have become one
_TOGETHER = 4.0  # m, crossings share less than this
_LIGHT, _HEAVY = (5.4, 2.0, 3.2), (12.0, 2.55, 6.6)  # length, width, wheelbase that a way is kept free for
_BEFORE_LINE = 1.0  # m from the front of a waiting vehicle to what it waits for


@dataclass(frozen=True)
class Zone:
    """A stretch of a route that must not be used together with a stretch of another one."""

    start: float
    end: float
    other_start: float
    other_end: float
    merging: bool  # both go on together from the end

    @property
    def mirrored(self) -> Zone:
        """The same, as the other route has it."""
        return Zone(self.other_start, self.other_end, self.start, self.end, self.merging)


@dataclass(frozen=True)
class Stripe:
    """A stretch of a route on a pedestrian crossing."""

    crossing: int
    start: float
    end: float
    across: float  # m along the crossing's axis, of the middle of the route


@dataclass(frozen=True)
class Passage:
    """What matters about a route's way through the junction."""

    entry: int  # the lane at its start
    line: float  # where to wait
    end: float  # the last conflict
    cruise: float  # m/s, lowest limit between them
    stripes: tuple[Stripe, ...]
    zones: dict[int, tuple[Zone, ...]]  # by the other route


@dataclass(frozen=True, eq=False)
class _Way:
    s: Floats  # [n] m from the start of the route
    xy: Floats  # [n, 2]
    half: Floats  # [n] m to keep free on each side


def passages(town: RoadMap, routes: RouteTable) -> tuple[Passage, ...]:
    """The passage of every route of a regulated map."""
    ways = [_sample(route, r, routes, town.geometry) for r, route in enumerate(town.routes)]
    zones: list[dict[int, tuple[Zone, ...]]] = [{} for _ in ways]
    arms = [town.geometry.index[route.roads[0][0]][0] for route in town.routes]
    for p, way in enumerate(ways):
        for q in range(p + 1, len(ways)):
            found = () if arms[p] == arms[q] else _zones(way, ways[q])
            if found:
                zones[p][q] = found
                zones[q][p] = tuple(zone.mirrored for zone in found)
    return tuple(_passage(town, r, ways[r], zones[r], routes) for r in range(len(ways)))


def _sample(route: Route, number: int, routes: RouteTable, geometry: LaneGeometry) -> _Way:
    length, width, wheelbase = _HEAVY if route.heavy else _LIGHT
    s, xy, half = [], [], []
    for road in route.roads:
        lane = road[0]
        at = np.arange(0.0, geometry.length[lane], _STEP)
        s.append(routes.start[number, lane] + at)
        xy.append(np.array([geometry.lanes[lane].position(float(a), 0.0) for a in at]))
        outer, inner = sweep(np.array(length), np.array(width), np.array(wheelbase), geometry.radius[lane : lane + 1])
        half.append(np.full(len(at), max(outer[0], inner[0]) + _FREE))
    return _Way(np.concatenate(s), np.concatenate(xy), np.concatenate(half))


def _zones(a: _Way, b: _Way) -> tuple[Zone, ...]:
    dx: Floats = a.xy[:, 0, None] - b.xy[:, 0]
    dy: Floats = a.xy[:, 1, None] - b.xy[:, 1]
    distance: Floats = np.sqrt(dx * dx + dy * dy)  # a norm along a short axis takes several times as long
    close: Bools = distance < a.half[:, None] + b.half
    return tuple(_zone(a, b, distance, close, run) for run in _runs(np.any(close, axis=1)))


def _runs(flags: Bools) -> list[Ints]:
    where = np.flatnonzero(flags)
    return np.split(where, np.flatnonzero(np.diff(where) > 1) + 1) if len(where) else []


def _zone(a: _Way, b: _Way, distance: Floats, close: Bools, run: Ints) -> Zone:
    met = np.argwhere(distance[run] < _MET)
    if len(np.unique(met[:, 0])) * _STEP >= _TOGETHER:
        i, j = run[met[0, 0]], met[0, 1]
        first = np.flatnonzero(close[run[0]])
        start = max(float(b.s[j]) - (float(a.s[i]) - float(a.s[run[0]])), float(b.s[first[0]]))
        return Zone(float(a.s[run[0]]), float(a.s[i]), start, float(b.s[j]), True)
    other = np.flatnonzero(close[run].any(axis=0))
    return Zone(float(a.s[run[0]]), float(a.s[run[-1]]), float(b.s[other[0]]), float(b.s[other[-1]]), False)


def _passage(town: RoadMap, r: int, way: _Way, zones: dict[int, tuple[Zone, ...]], routes: RouteTable) -> Passage:
    every = [zone for found in zones.values() for zone in found]
    stripes = tuple(stripe for c, crossing in enumerate(town.crossings) for stripe in _stripes(c, crossing, way))
    stripes = tuple(sorted(stripes, key=lambda stripe: stripe.start))
    line = min([zone.start for zone in every] + [stripe.start for stripe in stripes]) - _BEFORE_LINE
    end = max([zone.end for zone in every] + [stripe.end for stripe in stripes])
    lanes = [road[0] for road in town.routes[r].roads]
    inside = [k for k in lanes if routes.start[r, k] + town.geometry.length[k] > line and routes.start[r, k] < end]
    return Passage(lanes[0], line, end, float(town.geometry.limit[inside].min()), stripes, zones)


def _stripes(number: int, crossing: Crossing, way: _Way) -> list[Stripe]:
    along, across = np.array(crossing.direction), np.array([-crossing.direction[1], crossing.direction[0]])
    offset = way.xy - np.array(crossing.origin)
    t, u = offset @ along, offset @ across
    on = (t > 0) & (t < crossing.span) & (np.abs(u) <= crossing.width / 2)
    return [Stripe(number, float(way.s[r[0]]), float(way.s[r[-1]]), float(t[r].mean())) for r in _runs(on)]
