"""Behaviour of drivers and people on foot, routes, parked cars and footways."""

from __future__ import annotations

import numpy as np
import pytest

from mtp_bench.geometry import bev_corners
from mtp_bench.sources.highway.behaviour import DriverBehaviour, OrnsteinUhlenbeck
from mtp_bench.sources.highway.driving import Leaders, RoadState, observe
from mtp_bench.sources.highway.lanes import route_table
from mtp_bench.sources.highway.networks import build_map
from mtp_bench.sources.highway.simulate import overlapping, simulate_world
from mtp_bench.sources.highway.vehicles import Driver, draw_parked_boxes, draw_traits
from mtp_bench.sources.highway.world import CLASSES, RATE, ScenarioName, Traffic, World
from mtp_bench.types import Floats, Ints

DT = 1.0 / RATE
PEDESTRIAN = CLASSES.index("pedestrian")
BUSY = Traffic("intersection", "roadside", 12.0, 18, 20, 30)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def busy() -> World:
    return simulate_world(BUSY, 4)


def people(world: World) -> list[tuple[Ints, Floats]]:
    """Frames and boxes of every person."""
    truth, frame = world.truth, world.truth.frame_of_rows
    numbers = np.unique(truth.object_id[truth.class_id == PEDESTRIAN])
    return [(frame[truth.object_id == number], truth.box[truth.object_id == number]) for number in numbers]


def test_a_drift_has_its_spread_and_forgets() -> None:
    drift, numbers = OrnsteinUhlenbeck(0.5, 2.0, DT, rng()), np.arange(4000)
    first = drift.step(numbers)
    last = first
    for _ in range(20):  # 2 s
        last = drift.step(numbers)
    assert first.std() == pytest.approx(0.5, rel=0.05)
    assert last.std() == pytest.approx(0.5, rel=0.05)
    assert abs(last.mean()) < 0.03
    assert np.corrcoef(first, last)[0, 1] == pytest.approx(np.exp(-1.0), abs=0.05)


@pytest.mark.parametrize("scenario", ["intersection", "roundabout"])
def test_cars_park_at_the_kerb_and_off_the_lanes(scenario: ScenarioName) -> None:
    road_map = build_map(scenario, 5.0)
    box = draw_parked_boxes(road_map.kerbs, 60, rng())
    assert len(box) == 60
    assert len(overlapping(box)) == 0
    corners = bev_corners(box)
    for lane in road_map.geometry.lanes:
        for s, d in (lane.local_coordinates(corner) for corner in corners.reshape(-1, 2)):
            assert not (0 < s < lane.length and abs(d) < lane.width_at(s) / 2 + 0.05)
    for shape, heading in zip(corners, box[:, 3], strict=True):
        room = [_to_kerb(shape, heading, kerb.start, kerb.direction, kerb.length) for kerb in road_map.kerbs]
        assert 0.0 < min(room) < 0.4


def _to_kerb(
    corners: Floats, heading: float, start: tuple[float, float], way: tuple[float, float], length: float
) -> float:
    """Metres between a car and a kerb that it stands along, on its left; inf: it does not."""
    offset = corners - np.array(start)
    along, right = offset @ np.array(way), offset @ np.array([-way[1], way[0]])
    askew = np.cos(heading) * way[0] + np.sin(heading) * way[1] < 0.999
    return float("inf") if askew or along.min() < 0 or along.max() > length else float(-right.max())


def test_parked_cars_are_true_objects_that_never_move(busy: World) -> None:
    truth, parked = busy.truth, 0
    for number in np.unique(truth.object_id[truth.class_id == CLASSES.index("car")]):
        own = truth.object_id == number
        if np.abs(truth.box[own][0, :2]).min() > 7.0 and not truth.velocity[own][0].any():  # off the lanes
            assert own.sum() == truth.frames
            assert np.ptp(truth.box[own], axis=0).max() == 0
            assert not truth.velocity[own].any()
            parked += 1
    assert parked == BUSY.parked


def _before_a_queue(gap: float) -> tuple[RoadState, Leaders]:
    """Somebody at 9 m/s who has ``gap`` m to a standing queue."""
    road_map = build_map("intersection", 5.0)
    lane = road_map.routes[0].roads[0][0]
    way = road_map.geometry.lanes[lane]
    vehicle = Driver(None, way.position(40.0, 0.0), way.heading_at(40.0), 9.0, draw_traits(False, rng()), 0)
    vehicle.route, vehicle.lane_number = 0, lane
    nobody = np.empty((0, 2))
    state = observe([vehicle], road_map, route_table(road_map.routes, road_map.geometry), nobody, nobody)
    return state, Leaders(np.array([gap]), np.zeros(1))


@pytest.mark.parametrize(
    ("gap", "waits", "hardest"),
    [(30.0, True, 5.0), (8.0, False, 8.0)],  # 9 m/s need 1.4 and some 6 m/s2
)
def test_who_is_late_brakes_when_it_is_needed(gap: float, waits: bool, hardest: float) -> None:
    state, ahead = _before_a_queue(gap)
    careful, free = np.array([-2.0]), np.array([0.3])
    habits = DriverBehaviour(DT, rng())
    gas = [float(habits.braking(state, careful, free, ahead, np.array([np.inf]))[0]) for _ in range(6000)]
    assert np.mean(np.array(gas) == -2.0) > 0.5  # most of the time it is as the driver model says
    assert (np.mean(np.array(gas) == 0.3) > 0.05) == (0.3 in gas) == waits
    assert -hardest <= min(gas) < -3.2  # late, or suddenly for nothing


def test_nobody_on_foot_stands_right_in_front_of_the_sensor(busy: World) -> None:
    assert min(np.hypot(*(box[:, :2] - busy.ego[0, :2]).T).min() for _, box in people(busy)) > 3.5
