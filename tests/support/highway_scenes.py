"""Roads of highway-env's own environments with traffic on them, fast and stock."""

from __future__ import annotations

from typing import Any

import numpy as np
from highway_env.envs.highway_env import HighwayEnv
from highway_env.envs.intersection_env import ConnectedLaneIntersectionEnv
from highway_env.envs.merge_env import ConnectedLaneMergeGenericEnv
from highway_env.envs.roundabout_env import ConnectedLaneRoundaboutGenericEnv
from highway_env.road.lane import CircularLane, PolyLaneFixedWidth, StraightLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.objects import Landmark, Obstacle

from mtp_bench.sources.highway.road import FastRoad, FastVehicle

ENVS: dict[str, Any] = {
    "roundabout": ConnectedLaneRoundaboutGenericEnv,
    "highway": HighwayEnv,
    "intersection": ConnectedLaneIntersectionEnv,
    "merge": ConnectedLaneMergeGenericEnv,
}
ENDS = {
    "roundabout": ["exr", "sxr", "nxr", "wxr"],
    "highway": ["1"],
    "intersection": ["o0", "o1", "o2", "o3"],
    "merge": ["d"],
    "curve": ["c"],
}


def network(name: str) -> Any:
    """The lanes of a stock environment, which is not reset: that would change IDMVehicle for the whole process."""
    if name == "curve":
        return curve()
    env = object.__new__(ENVS[name])
    env.config = ENVS[name].default_config()
    env._create_road() if name == "highway" else env._make_road()
    return env.road.network


def curve() -> Any:
    """A straight road of two lanes, then one lane of a kind that the arrays do not know, then an arc."""
    made = RoadNetwork()
    for y in (0.0, 4.0):
        made.add_lane("start", "a", StraightLane([0, y], [60, y]))
    made.add_lane("a", "b", PolyLaneFixedWidth([(60, 0), (70, 0), (80, 1), (90, 3), (100, 3)]))
    made.add_lane("b", "c", CircularLane([100, 33], 30, -np.pi / 2, np.pi / 2))
    return made


def road(lanes: Any, fast: bool, connected: bool = True) -> Any:
    options: Any = {"np_random": np.random.RandomState(3), "neighbour_vehicles_connected_lanes": connected}
    return FastRoad(lanes, **options) if fast else Road(lanes, **options)


def enter(onto: Any, name: str, rng: np.random.Generator, tries: int = 40) -> None:
    """One more vehicle of own size and speeds on a free place of any lane."""
    lanes, pace = onto.network.lanes_dict(), 3 if name == "highway" else 1
    for _ in range(tries):
        index = list(lanes)[rng.integers(len(lanes))]
        s, speed = rng.uniform(0, min(lanes[index].length, 80 * pace)), rng.uniform(4, 9) * pace
        position, ahead = lanes[index].position(s, 0), rng.uniform(0, 4) * pace
        length, end = rng.uniform(3, 9), ENDS[name][rng.integers(len(ENDS[name]))]
        if all(np.hypot(*(v.position - position)) > 6 + 2 * pace for v in onto.vehicles):
            kind: Any = FastVehicle if isinstance(onto, FastRoad) else IDMVehicle
            made = kind(onto, position, lanes[index].heading_at(s), speed, target_speed=speed + ahead)
            made.plan_route_to(end)
            if name == "highway":
                made.route = None  # a route keeps a vehicle to its lane
            made.LENGTH, made.WIDTH = length, 1.8
            made.diagonal = float(np.hypot(made.LENGTH, made.WIDTH))
            onto.vehicles.append(made)
            return


def populated(name: str, fast: bool, vehicles: int = 14, connected: bool = True) -> Any:
    rng = np.random.default_rng(7)
    made = road(network(name), fast, connected)
    for _ in range(vehicles):
        enter(made, name, rng)
    if name == "merge":
        lane = made.network.get_lane(("b", "c", 2))
        made.objects = [Obstacle(made, lane.position(lane.length, 0)), Landmark(made, lane.position(20, 0))]
    return made


def states(of: Any) -> tuple[list[bytes], list[Any]]:
    """Bits of the numbers, and the rest, of every vehicle."""
    numbers = [np.array([*v.position, v.heading, v.speed, v.timer, *v.action.values()]) for v in of.vehicles]
    rest = [
        (v.lane_index, tuple(v.target_lane_index), v.crashed, of.network.lanes_list().index(v.lane))
        for v in of.vehicles
    ]
    return [row.astype(np.float64).tobytes() for row in numbers], rest
