"""The fast road has the states of highway-env's own, bit for bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from highway_env.road.lane import CircularLane, StraightLane
from highway_env.road.road import Road
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.objects import Landmark, Obstacle

from mtp_bench.sources.highway.road import FastNetwork, FastVehicle, close_pairs, snap
from tests.support.highway_scenes import ENDS, enter, network, populated, road, states


def drive(name: str, fast: bool, rounded: bool, connected: bool) -> tuple[list[Any], Any]:
    """States after each of 60 steps; one vehicle leaves on the way and two come."""
    it, rng, seen = populated(name, fast, connected=connected), np.random.default_rng(11), []
    for step in range(60):
        if step == 20:
            del it.vehicles[3]
        if step in (10, 30):
            enter(it, name, rng)
        it.act()
        it.step(0.1)
        if rounded:
            for vehicle in it.vehicles:
                snap(vehicle)
        seen.append(states(it))
    return seen, it


@pytest.mark.parametrize("rounded", [False, True], ids=["raw", "snapped"])
@pytest.mark.parametrize("name", ENDS)
def test_states_are_those_of_the_stock_road(name: str, rounded: bool) -> None:
    connected = name != "highway"
    want, _ = drive(name, False, rounded, connected)
    got, it = drive(name, True, rounded, connected)
    for step, (ours, theirs) in enumerate(zip(got, want, strict=True)):
        assert ours == theirs, f"step {step}"
    assert len(it.vehicles) == 15


@pytest.mark.parametrize(("name", "least"), [("highway", 10), ("roundabout", 10), ("merge", 5)])
def test_the_scenes_have_lane_changes(name: str, least: int) -> None:
    seen, _ = drive(name, True, False, name != "highway")
    changing = [at for _, rest in seen for at, to, *_ in rest if at != to and at[:2] == to[:2]]
    assert len(changing) >= least


def test_crashes_are_those_of_the_stock_road() -> None:
    """The last of three runs into the second, which hits an obstacle at its side."""
    found = []
    for fast in (False, True):
        it = road(network("highway"), fast)
        for s, speed in ((140, 0.0), (23, 5.0), (5, 30.0)):
            it.vehicles.append((FastVehicle if fast else IDMVehicle)(it, [s, 0.0], 0.0, speed))
        it.objects.append(Obstacle(it, [25.0, 1.5]))
        for _ in range(20):
            it.act()
            it.step(0.1)
            found.append((fast, states(it), [o.crashed for o in it.objects]))
    assert [row[1:] for row in found[:20]] == [row[1:] for row in found[20:]]
    assert [vehicle.crashed for vehicle in it.vehicles] == [False, True, True]


@pytest.mark.parametrize("fast_road", [False, True])
def test_fast_and_stock_classes_mix(fast_road: bool) -> None:
    want, it = populated("merge", False), populated("merge", fast_road)
    kind = IDMVehicle if fast_road else FastVehicle
    for vehicle in it.vehicles[::2]:
        vehicle.__class__ = kind
    for _ in range(20):
        for each in (want, it):
            each.act()
            each.step(0.1)
        assert states(it) == states(want)


@pytest.mark.parametrize("name", ENDS)
def test_closest_lane_is_that_of_the_stock_network(name: str) -> None:
    stock, rng = network(name), np.random.default_rng(5)
    fast = FastNetwork.of(stock)
    lanes = stock.lanes_list()
    joints = [lane.position(s, 0) for lane in lanes for s in (0.0, lane.length)]  # where several lanes are as close
    for position in [*joints, *rng.uniform(-60, 120, (40, 2)), *rng.uniform(-1e-12, 1e-12, (3, 2))]:
        for heading in (None, 0.0, np.pi, float(rng.uniform(-7, 7))):
            assert fast.get_closest_lane_index(position, heading) == stock.get_closest_lane_index(position, heading)


def test_lanes_added_later_are_found() -> None:
    fast = FastNetwork.of(network("highway"))
    assert fast.get_closest_lane_index(np.array([5.0, 40.0])) == ("0", "1", 3)
    fast.add_lane("0", "2", StraightLane([0, 40], [50, 40]))
    assert fast.get_closest_lane_index(np.array([5.0, 40.0])) == ("0", "2", 0)
    fast.graph["0"]["2"].insert(0, StraightLane([0, 30], [50, 30]))  # not by add_lane
    assert fast.get_closest_lane_index(np.array([5.0, 40.0])) == ("0", "2", 1)
    fast.graph = {"0": {"3": fast.graph["0"]["1"], "4": fast.graph["0"]["2"]}}
    assert fast.get_closest_lane_index(np.array([5.0, 40.0])) == ("0", "4", 1)


CASES: dict[str, tuple[bool, list[tuple[float, float]]]] = {  # whether the arrays can tell on the own lane
    "nobody": (True, []),
    "one ahead, one behind": (True, [(60, 0), (40, 0)]),
    "beside on the next lane": (True, [(50, 4)]),
    "as far along the lane": (False, [(50, 0.5)]),
    "two as far along the lane": (False, [(50, 0.5), (50, -0.5)]),
    "two as far ahead": (False, [(60, 0), (60, 0.5)]),
    "two as far behind": (False, [(40, 0), (40, 0.5)]),
    "just on the margin of the lane": (False, [(55, 3.0), (58, 0)]),
    "just off the margin": (False, [(55, 3.0 + 1e-12), (58, 0)]),
    "clearly off the margin": (True, [(55, 3.0 + 1e-6), (58, 0)]),
    "at the end of the overhang": (False, [(-5.0, 0), (55, 0)]),
    "beyond the overhang": (False, [(-5.0 - 1e-12, 0)]),
}


@pytest.mark.parametrize(("clear", "others"), CASES.values(), ids=CASES)
def test_neighbours_are_those_of_the_stock_road(clear: bool, others: list[tuple[float, float]]) -> None:
    fast, stock = road(network("highway"), True), road(network("highway"), False)
    for it, kind in ((fast, FastVehicle), (stock, IDMVehicle)):
        it.vehicles = [kind(it, [x, y], 0.0, 10.0) for x, y in [(50, 0), *others]]
        it.objects = [Landmark(it, [52, 0])]
    with fast.frozen():
        assert (fast.still.neighbours(fast.vehicles[0], ("0", "1", 0)) is not None) == clear
        for lane_index in (None, ("0", "1", 0), ("0", "1", 1)):
            want, got = (
                [
                    None if one is None else it.vehicles.index(one)
                    for one in it.neighbour_vehicles(it.vehicles[0], lane_index)
                ]
                for it in (stock, fast)
            )
            assert got == want


def test_arrays_settle_nearly_all_queries(monkeypatch: pytest.MonkeyPatch) -> None:
    """The stock methods would hide wrong arrays, and the time they take."""
    asked = []

    def counted(method: Any) -> Any:
        def call(*given: Any) -> Any:
            asked.append(method.__name__)
            return method(*given)

        return call

    it = populated("roundabout", True)
    monkeypatch.setattr(Road, "neighbour_vehicles", counted(Road.neighbour_vehicles))
    for kind in (StraightLane, CircularLane):
        monkeypatch.setattr(kind, "distance_with_heading", counted(kind.distance_with_heading))
    for _ in range(20):
        it.act()
        it.step(0.1)
    assert len(asked) < 5


def test_queries_know_only_the_present() -> None:
    """Nothing is remembered once the road is no longer frozen, nor of vehicles that are not on the road."""
    it: Any = road(network("highway"), True)
    made: list[Any] = [FastVehicle(it, [x, 0.0], 0.0, 10.0) for x in (10, 30, 50)]
    one, two, guest = made
    it.vehicles = [one, two]
    with it.frozen():
        assert it.neighbour_vehicles(one) == (two, None)
        assert one.lane_distance_to(guest) == 40
        assert guest.direction.tolist() == [1, 0]
        guest.position[0], guest.heading = 55, 1.0
        assert one.lane_distance_to(guest) == 45
        assert guest.direction.tolist() == [np.cos(1.0), np.sin(1.0)]
    two.position[0], one.heading = 5.0, 1.0
    assert it.neighbour_vehicles(one) == (None, two)
    assert one.direction.tolist() == [np.cos(1.0), np.sin(1.0)]
    with it.frozen(), it.frozen():
        assert it.neighbour_vehicles(one) == (None, two)
    it.vehicles.clear()
    it.act()
    it.step(0.1)


def test_history_is_recorded_on_demand() -> None:
    it = populated("highway", True, vehicles=2)
    it.record_history = True
    for _ in range(3):
        it.act()
        it.step(0.1)
    assert [len(vehicle.history) for vehicle in it.vehicles] == [3, 3]


def test_close_pairs_keep_every_collision() -> None:
    rng, it = np.random.default_rng(2), road(network("highway"), True)
    it.vehicles = [FastVehicle(it, xy, heading, 9.0) for *xy, heading in rng.uniform(0, (30, 12, 6), (25, 3))]
    it.objects = [Obstacle(it, xy) for xy in rng.uniform(0, (30, 12), (4, 2))]
    bodies = [*it.vehicles, *it.objects]
    pairs = [(a, b) for i, a in enumerate(it.vehicles) for b in bodies[i + 1 :]]
    touching = [pair for pair in pairs if any(pair[0]._is_colliding(pair[1], 0.1)[:2])]
    kept = close_pairs(it.vehicles, it.objects, 0.1)
    assert [pair for pair in kept if pair in touching] == touching
    assert all(one is not other for one, other in kept)
    assert 0 < len(touching) <= len(kept) < len(pairs) / 2


def test_snap_rounds_to_a_millionth_and_drops_the_sign_of_zero() -> None:
    vehicle: Any = FastVehicle(road(network("highway"), True), [1.23456749, -1e-9], -1e-12, 3.0000006)
    snap(vehicle)
    assert vehicle.position.tolist() == [1.234567, 0.0]
    assert (vehicle.heading, vehicle.speed) == (0.0, 3.000001)
    assert not np.signbit([*vehicle.position, vehicle.heading]).any()
