"""CPU time of making scenes of simulated traffic, as the cards use it, beside highway-env's own drivers.

    python benchmarks/traffic.py [--scenes 3] [--json FILE]

A scene's time holds its warm-up and its rejected attempts; milliseconds are per step of a scene, with everything that
it needs: right of way, people on foot, parked cars, the check for crashes, the record. Stock is highway-env's
``IDMVehicle`` on the same roads, as many as the card aims at, by ``road.act()`` and ``road.step()`` alone.
"""

from __future__ import annotations

import argparse
import json
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from mtp_bench.cards import load_card
from mtp_bench.sources.base import section_of
from mtp_bench.traffic.highway.networks import build_map
from mtp_bench.traffic.highway.simulate import simulate_world
from mtp_bench.traffic.highway.source import traffic_of
from mtp_bench.traffic.highway.world import RATE, WARM_UP, HighwaySource, Traffic

CARDS = ("MTP-Intersection-v0", "MTP-Roundabout-v0", "MTP-Merge-v0", "MTP-Highway-v0")
STOCK_STEPS = 100  # as long as most of its vehicles are still on the roads


def measure(traffic: Traffic, scenes: int) -> dict[str, Any]:
    """Times of making whole scenes, rejected attempts included."""
    start = time.process_time()
    for seed in range(scenes):
        simulate_world(traffic, seed)
    spent = time.process_time() - start
    step = 1000 * spent / (scenes * (WARM_UP + traffic.seconds) * RATE)
    stock = stock_step(traffic)
    return {
        "scenario": traffic.scenario,
        "vehicles": traffic.vehicles,
        "pedestrians": traffic.pedestrians,
        "parked": traffic.parked,
        "scene s": spent / scenes,
        "step ms": step,
        "stock ms": stock,
        "ratio": stock / step,
    }


def stock_step(traffic: Traffic) -> float:
    """Milliseconds of a step of as many stock vehicles, spread over the roads that vehicles come in on."""
    from highway_env.road.road import Road
    from highway_env.vehicle.behavior import IDMVehicle

    town = build_map(traffic.scenario, traffic.seconds)
    entries = sorted({lane for route in town.routes for lane in route.roads[0]})
    road: Any = Road(network=town.geometry.network, np_random=np.random.RandomState(0))
    for k in range(traffic.vehicles):
        lane = entries[k % len(entries)]
        rows = -(-traffic.vehicles // len(entries))
        at = float(town.geometry.length[lane]) * (k // len(entries) + 0.5) / rows
        index = town.geometry.index[lane]
        vehicle: Any = IDMVehicle.make_on_lane(
            road, index, at, speed=float(town.geometry.limit[lane])
        )
        vehicle.randomize_behavior()
        road.vehicles.append(vehicle)
    start = time.process_time()
    for _ in range(STOCK_STEPS):
        road.act()
        road.step(1.0 / RATE)
    return 1000 * (time.process_time() - start) / STOCK_STEPS


def show(rows: list[dict[str, Any]], title: str) -> None:
    """Prints rows as a table with their keys as columns."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title)
    for column in rows[0]:
        table.add_column(column, justify="right")
    for row in rows:
        table.add_row(
            *(
                f"{value:.2f}" if isinstance(value, float) else str(value)
                for value in row.values()
            )
        )
    Console(width=120).print(table)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--scenes", type=int, default=3, help="scenes of each environment"
    )
    parser.add_argument("--json", type=Path, default=None)
    given = parser.parse_args()
    simulate_world(
        Traffic("merge", "roadside", 1.0, 4, 0), 0
    )  # first calls take longer
    rows = [
        measure(traffic_of(section_of(load_card(name), HighwaySource)), given.scenes)
        for name in CARDS
    ]
    release = version("highway-env")
    show(
        rows,
        f"CPU of making scenes, {given.scenes} of each kind; highway-env {release}",
    )
    if given.json:
        content = {"scenes": given.scenes, "highway_env": release, "generated": rows}
        given.json.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
