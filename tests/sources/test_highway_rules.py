"""The parts of the simulated traffic on their own: lanes, routes, conflicts, overlap, right of way, people."""

from __future__ import annotations

import math

import numpy as np
import pytest
from shapely.geometry import Polygon

from mtp_bench.geometry import bev_corners
from mtp_bench.sources.highway.conflicts import find_passages
from mtp_bench.sources.highway.driving import Leaders, observe
from mtp_bench.sources.highway.lanes import NO_LANE, route_table
from mtp_bench.sources.highway.networks import build_map
from mtp_bench.sources.highway.right_of_way import CrossingPedestrian, RightOfWay
from mtp_bench.sources.highway.simulate import overlapping
from mtp_bench.sources.highway.vehicles import Driver, draw_traits
from mtp_bench.sources.highway.world import ScenarioName

SCENARIOS: tuple[ScenarioName, ...] = ("intersection", "roundabout", "merge", "highway")


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_lane_coordinates_are_those_of_highway_env(scenario: ScenarioName) -> None:
    geometry = build_map(scenario, 5.0).geometry
    points = np.random.default_rng(0).uniform(-60.0, 60.0, (20, 2))
    s, d = geometry.coordinates(points)
    for k, lane in enumerate(geometry.lanes):
        expected = np.array([lane.local_coordinates(point) for point in points])
        np.testing.assert_allclose(np.stack([s[k], d[k]], axis=1), expected, atol=1e-9)
        heading = geometry.heading(np.full(20, k), s[k])
        np.testing.assert_allclose(heading, [lane.heading_at(a) for a in s[k]], atol=1e-9)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_lanes_of_a_route_join_without_a_kink(scenario: ScenarioName) -> None:
    road_map = build_map(scenario, 5.0)
    table, lanes = route_table(road_map.routes, road_map.geometry), road_map.geometry.lanes
    for r, k in np.argwhere(table.following != NO_LANE):
        before, after = lanes[k], lanes[table.following[r, k]]
        np.testing.assert_allclose(before.position(before.length, 0.0), after.position(0.0, 0.0), atol=1e-6)
        turn = before.heading_at(before.length) - after.heading_at(0.0)
        assert abs(math.remainder(turn, 2 * math.pi)) < 1e-6


def test_who_leaves_the_highway_counts_lanes_to_the_exit() -> None:
    road_map = build_map("highway", 5.0)
    table, number = route_table(road_map.routes, road_map.geometry), road_map.geometry.number
    leaving = next(r for r, route in enumerate(road_map.routes) if route.otherwise != NO_LANE)
    assert [table.changes[leaving, number["a", "b", k]] for k in range(3)] == [3, 2, 1]
    assert [table.changes[leaving, number["b", "c", k]] for k in range(4)] == [3, 2, 1, 0]
    assert table.room[leaving, number["b", "c", 0]] == pytest.approx(200.0)
    assert np.isinf(table.room[leaving, number["b", "c", 3]])


def test_overlap_against_polygons() -> None:
    rng = np.random.default_rng(1)
    box = np.zeros((40, 7))
    box[:, :2] = rng.uniform(-10.0, 10.0, (40, 2))
    box[:, 3] = rng.uniform(-4.0, 4.0, 40)
    box[:, 4:] = rng.uniform(0.4, 5.0, (40, 3))
    shapes = [Polygon(corners) for corners in bev_corners(box)]
    expected = [(i, j) for i in range(40) for j in range(i + 1, 40) if shapes[i].intersects(shapes[j])]
    assert [tuple(pair) for pair in overlapping(box).tolist()] == expected
    assert len(overlapping(box[:1])) == 0


def test_first_come_first_served() -> None:
    """Two lanes that cross: who is nearer gets the right to pass, the other one stops at its line."""
    road_map = build_map("intersection", 5.0)
    table = route_table(road_map.routes, road_map.geometry)
    every = find_passages(road_map, table)
    assert 5 in every[0].zones  # route 0: arm 0 to the left, route 5: arm 1 straight on
    profile = draw_traits(False, np.random.default_rng(0))
    vehicles = []
    for number, (route, at) in enumerate(((0, 90.0), (5, 80.0))):
        lane = road_map.routes[route].roads[0][0]
        way = road_map.geometry.lanes[lane]
        vehicle = Driver(None, way.position(at, 0.0), way.heading_at(at), 6.0, profile, number)
        vehicle.route, vehicle.lane_number = route, lane
        vehicles.append(vehicle)
    state = observe(vehicles, road_map, table, np.empty((0, 2)), np.empty((0, 2)))
    ahead = Leaders(np.full(2, np.inf), np.zeros(2))
    rules = RightOfWay(every, first_in_first_out=True)
    stop = rules.update(state, ahead, [], set(), 0.0)
    assert np.isinf(stop[0])
    assert stop[1] == pytest.approx(every[5].line - 80.0 - profile.length / 2)
    rules = RightOfWay(every, first_in_first_out=True)
    someone = CrossingPedestrian(every[0].stretches[0].crossing, every[0].stretches[0].across, 1.0, 1.2)
    assert np.isfinite(rules.update(state, ahead, [someone], set(), 0.0)[0])
    assert rules.free_to_walk(someone)
    rules = RightOfWay(every, first_in_first_out=True)
    rules.update(state, ahead, [], set(), 0.0)
    assert not rules.free_to_walk(someone)
    rules = RightOfWay(every, first_in_first_out=True)
    assert np.isfinite(rules.update(state, ahead, [], {someone.crossing}, 0.0)[0])
