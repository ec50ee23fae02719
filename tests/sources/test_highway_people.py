"""People on foot: along the sidewalks, over the crossings, and away."""

from __future__ import annotations

import numpy as np
import pytest

from mtp_bench.sources.highway.networks import build_map
from mtp_bench.sources.highway.simulate import simulate_world
from mtp_bench.sources.highway.walking import Footway, SidewalkUse, keep_off_road, remaining_way
from mtp_bench.sources.highway.world import CLASSES, Traffic, World
from mtp_bench.types import Floats, Ints

PEDESTRIAN = CLASSES.index("pedestrian")


def people(world: World) -> list[tuple[Ints, Floats]]:
    """Frames and boxes of everybody on foot."""
    truth, frame = world.truth, world.truth.frame_of_rows
    numbers = np.unique(truth.object_id[truth.class_id == PEDESTRIAN])
    return [(frame[truth.object_id == number], truth.box[truth.object_id == number]) for number in numbers]


@pytest.fixture(scope="module")
def busy() -> World:
    return simulate_world(Traffic("intersection", "roadside", 40.0, 12, 16), 6)


def test_people_come_from_afar_and_go_there(busy: World) -> None:
    ends = []
    for frame, box in people(busy):
        away = np.hypot(*box[:, :2].T)
        ends += [away[0]] * bool(frame[0] > 0) + [away[-1]] * bool(frame[-1] < len(busy.time) - 1)
    assert len(ends) >= 2
    assert min(ends) > 55.0


def test_nobody_on_foot_stands_right_in_front_of_the_sensor(busy: World) -> None:
    assert min(np.hypot(*(box[:, :2] - busy.ego[0, :2]).T).min() for _, box in people(busy)) > 3.5


def _footway(direction: float, arm: int, around: bool) -> tuple[Footway, Floats]:
    road_map = build_map("intersection", 5.0)
    assert road_map.pavement is not None
    crossing = road_map.crossings[arm]
    way = Footway(
        crossing, road_map.pavement, direction, 0.3, SidewalkUse(around, 65.0, 1.2), SidewalkUse(around, 64.0, 3.0)
    )
    return way, np.array([crossing.direction, (-crossing.direction[1], crossing.direction[0])])


@pytest.mark.parametrize("around", [False, True])
@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("arm", [0, 3])
def test_ways_on_foot_lead_along_the_sidewalks(arm: int, direction: float, around: bool) -> None:
    way, axes = _footway(direction, arm, around)
    for k in range(4):
        for points, end in ((way.arrival(k), 65.0), (way.departure(k)[::-1], 64.0)):
            passed = np.array([remaining_way(points, share)[0] for share in np.linspace(1.0, 0.0, 60)])
            xy = np.array(way.crossing.origin) + passed @ axes
            assert np.abs(xy[0]).max() == pytest.approx(end + 0.95 * (k // 2))
            outside = np.maximum(way.pavement.corner - np.abs(xy), 0.0)
            assert np.hypot(*outside.T).max() < way.pavement.radius - 0.4  # of the kerb's bend: never on the road
            np.testing.assert_allclose(keep_off_road(xy, way.pavement, np.ones(60, dtype=bool)), xy)
