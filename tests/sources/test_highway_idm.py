"""Worlds with highway-env's own drivers: the same as on highway-env's own road, crash-free, and for no junction."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from highway_env.road.road import Road
from highway_env.vehicle.behavior import IDMVehicle

from mtp_bench.errors import DataError
from mtp_bench.sources.highway import idm
from mtp_bench.sources.highway.driver import Entry
from mtp_bench.sources.highway.networks import build
from mtp_bench.sources.highway.population import draw_profile
from mtp_bench.sources.highway.road import FastVehicle
from mtp_bench.sources.highway.routes import tabulate
from mtp_bench.sources.highway.simulate import simulate_world
from mtp_bench.sources.highway.world import RATE, Traffic, World
from tests.support.highway_worlds import digest, digests_elsewhere, touching

CASES = {
    "merge": Traffic("merge", "ego", 6.0, 24, 0, "idm"),
    "highway": Traffic("highway", "roadside", 6.0, 30, 0, "idm"),
}
LANE = 3.5  # m


@pytest.fixture(scope="module")
def worlds() -> dict[str, World]:
    return {name: simulate_world(traffic, 1) for name, traffic in CASES.items()}


def crossings(world: World) -> int:
    """How often somebody has come to the middle of another of the parallel lanes."""
    found = 0
    for number in np.unique(world.truth.object_id):
        y = world.truth.box[world.truth.object_id == number, 1] / LANE
        lane = np.round(y)[np.abs(y - np.round(y)) < 0.1]
        found += int((np.diff(lane) != 0).sum())
    return found


@pytest.mark.parametrize("name", CASES)
def test_nobody_touches_anybody(worlds: dict[str, World], name: str) -> None:
    truth = worlds[name].truth
    assert len(truth.box) > 0.9 * RATE * CASES[name].seconds * (CASES[name].vehicles - 1)
    assert touching(truth) == 0


@pytest.mark.parametrize("name", CASES)
def test_vehicles_keep_moving_forward_and_change_lanes(worlds: dict[str, World], name: str) -> None:
    truth = worlds[name].truth
    along = truth.velocity[:, 0]
    assert along.min() >= 0.0
    assert 10.0 < along.mean() < 28.0
    assert crossings(worlds[name]) >= 2
    for number in np.unique(truth.object_id):
        speed = np.hypot(*truth.velocity[truth.object_id == number].T)
        assert np.abs(np.diff(speed)).max(initial=0.0) * RATE < IDMVehicle.ACC_MAX + 1e-3


def test_drivers_differ_from_the_cooperative_ones(worlds: dict[str, World]) -> None:
    assert digest(simulate_world(replace(CASES["merge"], drivers="cooperative"), 1)) != digest(worlds["merge"])


@pytest.mark.parametrize("name", CASES)
def test_worlds_are_those_of_the_stock_road(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    short, kind = replace(CASES[name], seconds=1.0, vehicles=14), cast("Any", idm.IDMDriver)
    fast = digest(simulate_world(short, 2))
    monkeypatch.setattr(idm, "FastRoad", Road)
    kind.__bases__ = (IDMVehicle,)  # monkeypatch cannot take this back
    try:
        assert digest(simulate_world(short, 2)) == fast
    finally:
        kind.__bases__ = (FastVehicle,)


def test_same_world_in_another_process(worlds: dict[str, World]) -> None:
    names = list(CASES)
    assert digests_elsewhere("test_highway_idm", names, 1) == [digest(worlds[name]) for name in names]


def test_classes_of_highway_env_stay_as_they_are(worlds: dict[str, World]) -> None:
    assert (IDMVehicle.LENGTH, IDMVehicle.WIDTH, IDMVehicle.TIME_WANTED) == (5.0, 2.0, 1.5)
    assert (IDMVehicle.DISTANCE_WANTED, IDMVehicle.COMFORT_ACC_MAX, IDMVehicle.DELTA) == (10.0, 3.0, 4.0)
    assert IDMVehicle.LANE_CHANGE_MAX_BRAKING_IMPOSED == 2.0


@pytest.mark.parametrize("scenario", ["intersection", "roundabout"])
def test_junctions_are_refused(scenario: Any) -> None:
    with pytest.raises(DataError, match=r"drivers = 'idm': IDM knows no right of way; expected 'cooperative'"):
        simulate_world(Traffic(scenario, "roadside", 5.0, 10, 0, "idm"), 0)


def alone(scenario: Any, route: int, *places: tuple[tuple[str, str, int], float, float]) -> idm.IDMTraffic:
    """Vehicles of a route, each in a lane, at metres along it, with a speed."""
    town, rng = build(scenario, 5.0), np.random.default_rng(0)
    made = idm.IDMTraffic(town, tabulate(town.routes, town.geometry), rng)
    for number, (index, s, speed) in enumerate(places):
        lane = town.geometry.number[index]
        position = town.geometry.lanes[lane].position(s, 0.0)
        profile = draw_profile(True, rng)
        made.road.vehicles.append(made.make(Entry(profile, number, route, lane, position, 0.0, speed)))
    return made


def test_a_queue_stands_bumper_to_bumper_at_the_end_of_the_ramp() -> None:
    traffic = alone("merge", 1, *((("b", "c", 2), s, 0.0) for s in (100.0, 70.0)))
    for vehicle in traffic.road.vehicles:
        vehicle.enable_lane_change = False
    for step in range(400):
        traffic.step(step, None)
    first, second = traffic.road.vehicles
    end = traffic.road.objects[0].position[0] - traffic.road.objects[0].LENGTH / 2
    nose = first.position[0] + first.LENGTH / 2
    assert 0.0 < end - nose < 2.0 * first.DISTANCE_WANTED
    gap = first.position[0] - second.position[0] - (first.LENGTH + second.LENGTH) / 2
    assert gap == pytest.approx(second.lane_distance_to(first), abs=1e-6)
    assert 0.0 < gap < 2.0 * second.DISTANCE_WANTED


def test_who_leaves_goes_to_the_exit_and_is_gone_at_its_end() -> None:
    traffic = alone("highway", 1, (("a", "b", 0), 5.0, 20.0))
    left: list[int] = []
    for step in range(600):
        left += [vehicle.number for vehicle in traffic.step(step, None)]
        if left:
            break
    assert left == [0]
    assert traffic.road.vehicles[0].lane_index == ("e", "f", 0)


def test_who_misses_the_exit_drives_on() -> None:
    traffic = alone("highway", 1, (("b", "c", 0), 150.0, 20.0))
    for step in range(100):
        traffic.step(step, None)
    assert traffic.road.vehicles[0].lane_index[:2] == ("c", "d")


def test_nobody_of_the_main_road_enters_a_lane_that_ends() -> None:
    traffic = alone("merge", 0, *((("b", "c", 1), s, speed) for s, speed in ((5.0, 24.0), (35.0, 5.0))))
    seen = set()
    for step in range(60):
        traffic.step(step, None)
        seen |= {vehicle.target_lane_index for vehicle in traffic.road.vehicles}
    assert ("b", "c", 2) not in seen
    assert ("b", "c", 0) in seen
