"""Worlds of simulated traffic: what a detector and a task may rely on."""

import numpy as np
import pytest
from highway_env.road import lane as lanes_of_highway_env, road
from highway_env.vehicle import kinematics, objects
from shapely import STRtree
from shapely.geometry import Polygon

from mtp_bench.core import overlapping
from mtp_bench.core.errors import DataError
from mtp_bench.core.geometry import bev_corners
from mtp_bench.sources.cache import content_hash
from mtp_bench.traffic.highway import library, simulate
from mtp_bench.traffic.highway.networks import build_map
from mtp_bench.traffic.highway.simulate import simulate_world
from mtp_bench.traffic.highway.source import pack
from mtp_bench.traffic.highway.world import RATE, ScenarioName, Traffic, World

CASES = {
    "intersection": Traffic("intersection", "roadside", 6.0, 18, 16, 30),
    "roundabout": Traffic("roundabout", "roadside", 5.0, 20, 0, 24),
    "merge": Traffic("merge", "ego", 5.0, 20, 0),
    "highway": Traffic("highway", "ego", 5.0, 24, 0),
}
WORLDS = {  # first digits of the digests under seed 3; others need the next number of the generator, and new records
    "intersection": "6a9fef1134b0", "roundabout": "a33b8f8f159d", "merge": "864ebcde6428", "highway": "6d8dc961d2c0",
}  # fmt: skip


@pytest.fixture(scope="module")
def worlds() -> dict[str, World]:
    return {name: simulate_world(traffic, 3) for name, traffic in CASES.items()}


@pytest.fixture(params=CASES)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def world(name: str, worlds: dict[str, World]) -> World:
    return worlds[name]


def digest(world: World) -> str:
    return content_hash(pack(world))


def test_shape_of_a_world(name: str, world: World) -> None:
    traffic, truth = CASES[name], world.truth
    frames = round(traffic.seconds * RATE)
    np.testing.assert_allclose(world.time, np.arange(frames) / RATE)
    assert (world.ego.shape, truth.start.shape, truth.start[0]) == ((frames, 4), (frames + 1,), 0)
    assert {truth.start[-1]} == {len(column) for name, column in vars(truth).items() if name != "start"}
    assert truth.eligible.all()
    assert not truth.neutral.any()
    assert np.unique(truth.object_id).tolist() == list(range(truth.object_id.max() + 1))
    assert len(truth.box) / frames > 0.8 * (traffic.vehicles + traffic.pedestrians)
    for t in range(frames):
        assert (np.diff(truth.object_id[truth.rows(t)]) > 0).all()
    for t in range(0, frames, 3):  # no two boxes touch
        shapes = [Polygon(corners) for corners in bev_corners(truth.box[truth.rows(t)])]
        a, b = STRtree(shapes).query(shapes, predicate="intersects")
        assert not (a < b).any()


def test_lane_map(world: World) -> None:
    lanes = world.lanes
    assert 4 <= len(lanes) <= 40
    assert any(not lane.following for lane in lanes)
    for lane in lanes:
        step = np.diff(lane.center, axis=0)
        assert np.hypot(step[:, 0], step[:, 1]).max() < 2.2
        assert lane.center.shape == lane.left.shape == lane.right.shape
        aside = lane.left - lane.right
        across = step[:, 0] * aside[:-1, 1] - step[:, 1] * aside[:-1, 0]
        assert (across > 0).all()  # left is on the left in a right-handed frame
        for after in lane.following:
            np.testing.assert_allclose(lanes[after].center[0], lane.center[-1], atol=0.01)


def test_worlds_are_those_of_this_generator(name: str, world: World) -> None:
    """No other version of a library, Python or processor changes a scene unnoticed."""
    assert digest(world)[:12] == WORLDS[name]


SHARED = (
    kinematics.Vehicle, objects.RoadObject, road.Road, road.RoadNetwork,
    *(getattr(lanes_of_highway_env, f"{kind}Lane") for kind in ("Abstract", "Straight", "Sine", "Circular")),
)  # fmt: skip


def small_worlds() -> list[str]:
    small = Traffic("intersection", "roadside", 0.5, 12, 0), Traffic("merge", "roadside", 0.5, 12, 0)
    return [digest(simulate_world(traffic, 3)) for traffic in small]


@pytest.fixture(scope="module")
def unchanged() -> list[str]:
    return small_worlds()


@pytest.mark.parametrize("shared", SHARED, ids=lambda shared: str(shared.__name__))
def test_attributes_of_highway_env(shared: type, unchanged: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    changed = [name for name in vars(shared) if not name.startswith("_")]
    for name in changed:
        value = getattr(shared, name)
        monkeypatch.setattr(shared, name, value / 2 if isinstance(value, int | float) else None)
    simulate._map_of.cache_clear()
    assert changed
    assert small_worlds() == unchanged
    if shared is kinematics.Vehicle:
        assert library._copy(kinematics.__name__).Vehicle.MAX_SPEED == library.Vehicle.MAX_SPEED == 40.0


def test_another_attempt_follows_a_crash_until_they_are_too_many(monkeypatch: pytest.MonkeyPatch) -> None:
    crashes = [1]
    traffic = Traffic("roundabout", "roadside", 0.5, 4, 0)
    first = digest(simulate_world(traffic, 0))
    monkeypatch.setattr(simulate, "overlapping", lambda box, still: np.zeros((crashes.pop() if crashes else 0, 2)))
    assert digest(simulate_world(traffic, 0)) != first
    crashes.append(1)
    monkeypatch.setattr(simulate, "ATTEMPTS", 2)
    with pytest.raises(DataError, match=r"all 2 attempts were rejected \(1 x crash, 1 x no_ego\)"):
        simulate_world(Traffic("intersection", "ego", 40.0, 1, 0), 0)


# ---- beside other programs: lanes beside highway_env, overlap beside shapely
SCENARIOS: tuple[ScenarioName, ...] = ("intersection", "roundabout", "merge", "highway")


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_lane_coordinates_are_those_of_highway_env(scenario: ScenarioName) -> None:
    geometry = build_map(scenario, 5.0).geometry
    points = np.random.default_rng(0).uniform(-60.0, 60.0, (20, 2))
    s, d = geometry.coordinates(points.T)
    for k, lane in enumerate(geometry.lanes):
        expected = np.array([lane.local_coordinates(point) for point in points])
        np.testing.assert_allclose(np.stack([s[k], d[k]], axis=1), expected, atol=1e-9)
        heading = geometry.heading(np.full(20, k), s[k])
        np.testing.assert_allclose(heading, [lane.heading_at(a) for a in s[k]], atol=1e-9)


def test_overlap_against_polygons() -> None:
    rng = np.random.default_rng(1)
    box = np.zeros((40, 7))
    box[:, :2] = rng.uniform(-10.0, 10.0, (40, 2))
    box[:, 3] = rng.uniform(-4.0, 4.0, 40)
    box[:, 4:] = rng.uniform(0.4, 5.0, (40, 3))
    shapes = [Polygon(corners) for corners in bev_corners(box)]
    expected = [(i, j) for i in range(40) for j in range(i + 1, 40) if shapes[i].intersects(shapes[j])]
    assert ([tuple(pair) for pair in overlapping(box).tolist()], len(overlapping(box[:1]))) == (expected, 0)
