"""Milliseconds per step of simulated traffic: highway-env's own road against `FastRoad`, then what the cards use.

    python benchmarks/traffic.py [--vehicles 30 50 100] [--steps 50] [--scenes 3] [--json FILE]

The first table has the same traffic on both roads. A step is `road.act(); road.step(0.1)`. Both roads are stepped in
turn, so that a busy machine slows both; CPU time (all threads) is added up. States agree if position, heading, speed,
lane change timer, lane, target lane and crashes of every vehicle are the same bits after every step.

The second table has whole scenes of the environments, and with highway-env's own drivers: CPU seconds per scene,
warm-up and rejected attempts included, and milliseconds per step of an attempt.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from highway_env.envs.highway_env import HighwayEnv
from highway_env.envs.roundabout_env import ConnectedLaneRoundaboutGenericEnv
from highway_env.road.road import Road
from highway_env.vehicle.behavior import IDMVehicle

from mtp_bench.cards import load_card
from mtp_bench.sources.highway.road import FastRoad, FastVehicle
from mtp_bench.sources.highway.simulate import WARM_UP, simulate_world
from mtp_bench.sources.highway.source import section_of, traffic_of
from mtp_bench.sources.highway.world import RATE, Traffic

DT = 0.1  # s
NETWORKS = {  # environment, its maker of roads, exits, speeds m/s, metres of lane to fill per vehicle
    "roundabout": (ConnectedLaneRoundaboutGenericEnv, "_make_road", ("exr", "sxr", "nxr", "wxr"), (3, 9), 100.0),
    "highway": (HighwayEnv, "_create_road", ("1",), (18, 28), 12.0),
}
CARDS = ("MTP-Intersection-v0", "MTP-Roundabout-v0", "MTP-Merge-v0", "MTP-Highway-v0")
IDM = {"merge": 24, "highway": 30}  # vehicles with highway-env's own drivers
STATE = ("lane_index", "target_lane_index", "crashed")


def stock_network(name: str) -> Any:
    """The lanes of the stock environment, straight from its own maker."""
    kind, maker, *_ = NETWORKS[name]
    env: Any = object.__new__(kind)
    env.config = kind.default_config()
    getattr(env, maker)()
    return env.road.network


def populated(name: str, fast: bool, vehicles: int, seed: int) -> Any:
    """A road with vehicles at least 5.5 m apart, each on its way to a random exit."""
    exits, speeds, room = NETWORKS[name][2:]
    rng = np.random.default_rng(seed)
    road: Any = (FastRoad if fast else Road)(
        stock_network(name),
        np_random=np.random.RandomState(seed),
        neighbour_vehicles_connected_lanes=NETWORKS[name][0].default_config()["neighbour_vehicles_connected_lanes"],
    )
    lanes = road.network.lanes_dict()
    for _ in range(400 * vehicles):
        index = list(lanes)[rng.integers(len(lanes))]
        s, speed = rng.uniform(0, min(lanes[index].length, room * vehicles)), rng.uniform(*speeds)
        wish, end, position = speed + rng.uniform(0, 5), exits[rng.integers(len(exits))], lanes[index].position(s, 0)
        if all(np.hypot(*(other.position - position)) > 5.5 for other in road.vehicles):
            kind: Any = FastVehicle if fast else IDMVehicle
            made = kind(road, position, lanes[index].heading_at(s), speed, target_speed=wish)
            made.plan_route_to(end)
            road.vehicles.append(made)
        if len(road.vehicles) == vehicles:
            return road
    raise SystemExit(f"no room for {vehicles} vehicles on {name}: {len(road.vehicles)} fit; give fewer")


def state(road: Any) -> tuple[bytes, list[Any]]:
    """Bits of the numbers, and the rest, of all vehicles."""
    numbers = [[*v.position, v.heading, v.speed, v.timer] for v in road.vehicles]
    return np.array(numbers, np.float64).tobytes(), [[getattr(v, name) for name in STATE] for v in road.vehicles]


def stepped(road: Any) -> float:
    """CPU seconds of one step."""
    start = time.process_time()
    road.act()
    road.step(DT)
    return time.process_time() - start


def measure(name: str, vehicles: int, scenes: int, steps: int) -> dict[str, Any]:
    """Times and agreement over some scenes of one network and size."""
    stock_s = fast_s = 0.0
    same, crashed = True, 0
    for seed in range(scenes):
        stock, fast = (populated(name, kind, vehicles, seed) for kind in (False, True))
        for _ in range(steps):
            stock_s += stepped(stock)
            fast_s += stepped(fast)
            same = same and state(stock) == state(fast)
        crashed += sum(vehicle.crashed for vehicle in stock.vehicles)
    per_step = 1000 / (scenes * steps)
    return {
        "network": name,
        "vehicles": vehicles,
        "crashed": crashed / scenes,
        "stock_ms": stock_s * per_step,
        "fast_ms": fast_s * per_step,
        "ratio": stock_s / fast_s,
        "same": same,
    }


def generate(traffic: Traffic, scenes: int) -> dict[str, Any]:
    """Times of making whole scenes; the steps of rejected attempts count as if they had run to the end."""
    start, rejected = time.process_time(), 0
    for seed in range(scenes):
        rejected += len(simulate_world(traffic, seed).rejected)
    spent = time.process_time() - start
    return {
        "scenario": traffic.scenario,
        "drivers": traffic.drivers,
        "vehicles": traffic.vehicles,
        "pedestrians": traffic.pedestrians,
        "seconds": traffic.seconds,
        "rejected": rejected,
        "step_ms": 1000 * spent / ((scenes + rejected) * (WARM_UP + traffic.seconds) * RATE),
        "scene_s": spent / scenes,
    }


def show(rows: list[dict[str, Any]], title: str) -> None:
    """Prints rows as a table with their keys as columns."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title)
    for column in rows[0]:
        table.add_column(column.replace("_", " "), justify="right")
    for row in rows:
        table.add_row(*(f"{value:.2f}" if isinstance(value, float) else str(value) for value in row.values()))
    Console(width=120).print(table)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, nargs="+", default=[30, 50, 100])
    parser.add_argument("--steps", type=int, default=50, help="steps of 0.1 s per scene")
    parser.add_argument("--scenes", type=int, default=3, help="scenes per network and number of vehicles")
    parser.add_argument("--json", type=Path, default=None)
    given = parser.parse_args()
    measure("roundabout", 5, 1, 2)  # first calls take longer
    rows = [measure(name, n, given.scenes, given.steps) for name in NETWORKS for n in given.vehicles]
    show(rows, f"highway-env {version('highway-env')}: CPU ms per step, {given.scenes} scenes x {given.steps} steps")
    simulate_world(Traffic("merge", "roadside", 1.0, 4, 0), 0)
    kinds = [traffic_of(section_of(load_card(name))) for name in CARDS]
    kinds += [replace(kind, drivers="idm", vehicles=IDM[kind.scenario]) for kind in kinds if kind.scenario in IDM]
    scenes = [generate(kind, given.scenes) for kind in kinds]
    show(scenes, f"CPU of making scenes, {WARM_UP:g} s of warm-up each, {given.scenes} of each kind")
    if given.json:
        setting = {"steps": given.steps, "scenes": given.scenes, "highway_env": version("highway-env")}
        given.json.write_text(
            json.dumps({**setting, "rows": rows, "generated": scenes}, indent=1) + "\n", encoding="utf-8"
        )
    if not all(row["same"] for row in rows):
        sys.exit("states differ")


if __name__ == "__main__":
    main()
