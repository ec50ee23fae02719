"""Lane coordinates of many positions at once, in front of the exact scalar lanes of highway-env.

NumPy rounds arrays and scalars differently in the last bits (fused products, vector sines). So nothing here is ever a
result: arrays only decide what is clear by more than `CLEAR`, and the lanes themselves are asked about the rest.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from highway_env.road.lane import CircularLane, SineLane, StraightLane
from highway_env.road.road import RoadNetwork

from ...types import Bools, Floats

LaneIndex: TypeAlias = tuple[str, str, int]
Graph: TypeAlias = dict[str, dict[str, list[Any]]]

CLEAR = 1e-8  # m, rad: far above rounding (1e-11 at 10 km), far below what traffic notices
MARGIN = 1.0  # m beside a lane where `Road.neighbour_vehicles` still counts a vehicle as on it
_SEAM = np.pi - 1e-9  # rad from the start of an arc, where the coordinate along it jumps by a full circle
_KINDS = (StraightLane, SineLane, CircularLane)  # exact types; others are asked one position at a time


class LaneTable:
    """The lanes of a road graph as arrays, one row per lane: straight, sine, circular, others.

    The table goes with the lanes that the graph has when it is made; `fits` says whether it still has them.
    """

    def __init__(self, graph: Graph) -> None:
        listed = [
            ((start, end, i), lane)
            for start, to in graph.items()
            for end, side in to.items()
            for i, lane in enumerate(side)
        ]
        kinds = [_KINDS.index(type(lane)) if type(lane) in _KINDS else len(_KINDS) for _, lane in listed]
        self.order: list[int] = sorted(range(len(listed)), key=kinds.__getitem__)  # row -> place in the graph
        self.indices: list[LaneIndex] = [listed[i][0] for i in self.order]
        self.lanes: list[Any] = [listed[i][1] for i in self.order]
        self.rows: dict[Any, int] = {lane: row for row, lane in enumerate(self.lanes)}
        self.places = frozenset(self.indices)
        self._graph = graph
        self._listed = [lane for _, lane in listed]
        self._links: dict[tuple[LaneIndex, bool], list[tuple[int, float]]] = {}
        ends = np.cumsum([kinds.count(kind) for kind in range(len(_KINDS) + 1)]).tolist()
        self._linear, self._sines = slice(0, ends[1]), slice(ends[0], ends[1])
        self._circles, self._others = slice(ends[1], ends[2]), range(ends[2], ends[3])

    def fits(self, graph: Graph) -> bool:
        """Whether it is the table's graph and has the very lanes of the table, in the same order."""
        return (
            graph is self._graph
            and [lane for to in graph.values() for side in to.values() for lane in side] == self._listed
        )

    def _column(self, rows: slice, name: str) -> Floats:  # [L, 1]
        return np.array([[getattr(lane, name)] for lane in self.lanes[rows]], dtype=np.float64).reshape(-1, 1)

    @cached_property
    def _origin(self) -> Floats:  # [2, L, 1] m; zero for other kinds
        found = np.zeros((2, len(self.lanes), 1))
        for row, lane in enumerate(self.lanes[: self._circles.stop]):
            found[:, row, 0] = lane.center if row >= self._circles.start else lane.start
        return found

    @cached_property
    def _along(self) -> Floats:  # [2, L, 1] unit vectors of the straight and sine lanes
        return np.array([lane.direction for lane in self.lanes[self._linear]]).reshape(-1, 2).T[:, :, None]

    @cached_property
    def _sine(self) -> Floats:  # [3, L, 1]
        return np.array([self._column(self._sines, name) for name in ("amplitude", "pulsation", "phase")])

    @cached_property
    def _circle(self) -> Floats:  # [3, L, 1]
        return np.array([self._column(self._circles, name) for name in ("radius", "start_phase", "direction")])

    @cached_property
    def _heading(self) -> Floats:  # [L, 1] rad
        return self._column(self._linear, "heading")

    @cached_property
    def _length(self) -> Floats:  # [L, 1] m
        return self._column(slice(None), "length")

    @cached_property
    def _half_width(self) -> Floats:  # [L, 1] m; zero for other kinds, which may change along the lane
        found = np.zeros((len(self.lanes), 1))
        found[: self._circles.stop] = self._column(slice(0, self._circles.stop), "width") / 2
        return found

    @cached_property
    def _overhang(self) -> Floats:  # [L, 1] m
        return self._column(slice(None), "VEHICLE_LENGTH")

    def coordinates(self, xy: Floats) -> tuple[Floats, Floats]:
        """Longitudinal and lateral coordinates [L, N] m of the positions xy [N, 2] m on every lane, within `CLEAR`."""
        s, r = np.empty((2, len(self.lanes), len(xy)))
        dx, dy = xy.T[:, None, :] - self._origin
        linear, sines, circles = self._linear, self._sines, self._circles
        (ux, uy), dxl, dyl = self._along, dx[linear], dy[linear]
        s[linear] = dxl * ux + dyl * uy
        r[linear] = dyl * ux - dxl * uy
        amplitude, pulsation, phase = self._sine
        r[sines] -= amplitude * np.sin(pulsation * s[sines] + phase)
        radius, start, way = self._circle
        turn = (np.arctan2(dy[circles], dx[circles]) - start + np.pi) % (2 * np.pi) - np.pi
        s[circles] = way * radius * turn
        r[circles] = way * (radius - np.hypot(dx[circles], dy[circles]))
        for k, i in np.argwhere(np.abs(turn) > _SEAM):
            row = circles.start + int(k)
            s[row, i], r[row, i] = self.lanes[row].local_coordinates(xy[i])
        for row in self._others:
            for i, position in enumerate(xy):
                s[row, i], r[row, i] = self.lanes[row].local_coordinates(position)
        return s, r

    def headings(self, s: Floats) -> Floats:
        """Headings [L, N] rad, not wrapped, of the lanes at the longitudinal coordinates s [L, N] m."""
        found = np.empty_like(s)
        found[self._linear] = self._heading
        amplitude, pulsation, phase = self._sine
        found[self._sines] += np.arctan(amplitude * pulsation * np.cos(pulsation * s[self._sines] + phase))
        radius, start, way = self._circle
        found[self._circles] = way * (s[self._circles] / radius + np.pi / 2) + start
        for row in self._others:
            found[row] = [self.lanes[row].heading_at(value) for value in s[row].tolist()]
        return found

    def closest(self, xy: Floats, headings: Floats | None) -> list[LaneIndex]:
        """Index of the closest lane to each of xy [N, 2] m, as `RoadNetwork.get_closest_lane_index` finds it.

        headings [N] rad, if given, count in the distance. Lanes that are as close as the closest, within `CLEAR`, are
        asked themselves, and the first of them in the graph wins.
        """
        s, r = self.coordinates(xy)
        cost = np.abs(r) + np.maximum(s - self._length, 0) + np.maximum(-s, 0)
        if headings is not None:
            cost += np.abs((headings - self.headings(s) + np.pi) % (2 * np.pi) - np.pi)
        tied = cost <= cost.min(axis=0) + CLEAR
        rows = cost.argmin(axis=0).tolist()
        for i in np.flatnonzero(tied.sum(axis=0) > 1).tolist():
            heading = None if headings is None else headings[i]
            candidates = sorted(np.flatnonzero(tied[:, i]).tolist(), key=self.order.__getitem__)
            rows[i] = min(candidates, key=lambda row: self.lanes[row].distance_with_heading(xy[i], heading))
        return [self.indices[row] for row in rows]

    def on_lane(self, s: Floats, r: Floats, xy: Floats) -> tuple[Bools, Bools]:
        """Which positions are on which lanes [L, N] with a margin of `MARGIN`, and which lanes [L] cannot tell."""
        beyond = np.maximum(-self._overhang - s, s - self._length - self._overhang)
        outside = np.maximum(np.abs(r) - self._half_width - MARGIN, beyond)
        for row in self._others:
            outside[row] = [-1.0 if self.lanes[row].on_lane(position, margin=MARGIN) else 1.0 for position in xy]
        unsure = np.any(np.abs(outside) < CLEAR, axis=1)
        return outside <= 0, unsure

    def links(self, index: LaneIndex, connected: bool) -> list[tuple[int, float]]:
        """Rows of the lanes where `Road.neighbour_vehicles` looks for neighbours, with their offsets m along the lane.

        The lane itself comes first; if ``connected``, the lanes that follow it and those before it come next.
        """
        key = (index, connected)
        if key not in self._links:
            start, end, i = index
            lane = self._graph[start][end][i]
            after = [side[i if i < len(side) else 0] for side in self._graph.get(end, {}).values() if side]
            before = [to[start][i if i < len(to[start]) else 0] for to in self._graph.values() if to.get(start)]
            found = [(self.rows[lane], 0.0)]
            if connected:
                found += [(self.rows[other], lane.length) for other in after]
                found += [(self.rows[other], -other.length) for other in before]
            self._links[key] = found
        return self._links[key]


class FastNetwork(RoadNetwork):  # type: ignore[misc]
    """A road network that looks for the closest lane on all lanes at once."""

    def __init__(self) -> None:
        super().__init__()
        self._table: LaneTable | None = None

    @classmethod
    def of(cls, network: Any) -> FastNetwork:
        """A fast network with the lanes of another one, in the same order; the other one is left as it is."""
        fast = cls()
        fast.graph = {start: {end: list(side) for end, side in to.items()} for start, to in network.graph.items()}
        return fast

    def table(self) -> LaneTable:
        """The lanes as arrays; made anew if the graph has got other lanes, however that happened."""
        if self._table is None or not self._table.fits(self.graph):
            self._table = LaneTable(self.graph)
        return self._table

    def get_closest_lane_index(self, position: Floats, heading: float | None = None) -> LaneIndex:
        """The index of the lane closest to a position [2] m, and to a heading if given."""
        headings = None if heading is None else np.array([heading], dtype=np.float64)
        return self.table().closest(np.array([position], dtype=np.float64), headings)[0]
