"""CPU seconds of making scenes of simulated traffic, as the cards use it, by both generators.

    python benchmarks/traffic.py [--scenes 3] [--json FILE]

Warm-up and rejected attempts are included; milliseconds are per step of an attempt.
"""

from __future__ import annotations

import argparse
import json
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

from mtp_bench.cards import Card, HighwaySource, load_card
from mtp_bench.sources.base import section_of
from mtp_bench.sources.highway.plans import PLANS
from mtp_bench.sources.highway.simulate import simulate_world
from mtp_bench.sources.highway.source import traffic_of
from mtp_bench.sources.highway.world import RATE, Traffic

CARDS = ("MTP-Intersection-v0", "MTP-Roundabout-v0", "MTP-Merge-v0", "MTP-Highway-v0")
SECOND: dict[str, dict[str, int]] = {  # what a card of generator 2 says beside its number
    "MTP-Intersection-v0": {"vehicles": 18, "pedestrians": 20, "parked": 44},
    "MTP-Roundabout-v0": {"vehicles": 24, "parked": 44},
}


def card_of(env_id: str, generator: int) -> Card:
    """The shipped card, with the traffic of a generator."""
    card = load_card(env_id)
    said = {"generator": generator, **(SECOND.get(env_id, {}) if generator == 2 else {})}
    return card.model_copy(update={"source": card.source.model_copy(update=said)})


def generate(traffic: Traffic, scenes: int) -> dict[str, Any]:
    """Times of making whole scenes; the steps of rejected attempts count as if they had run to the end."""
    start, rejected = time.process_time(), 0
    for seed in range(scenes):
        rejected += len(simulate_world(traffic, seed).rejected)
    spent = time.process_time() - start
    simulated = PLANS[traffic.generator].warm_up + traffic.seconds
    return {
        "scenario": traffic.scenario,
        "generator": traffic.generator,
        "vehicles": traffic.vehicles,
        "pedestrians": traffic.pedestrians,
        "parked": traffic.parked,
        "seconds": traffic.seconds,
        "rejected": rejected,
        "step_ms": 1000 * spent / ((scenes + rejected) * simulated * RATE),
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
    parser.add_argument("--scenes", type=int, default=3, help="scenes of each environment")
    parser.add_argument("--json", type=Path, default=None)
    given = parser.parse_args()
    simulate_world(Traffic("merge", "roadside", 1.0, 4, 0), 0)  # first calls take longer
    scenes = [
        generate(traffic_of(section_of(card_of(name, generator), HighwaySource)), given.scenes)
        for name in CARDS
        for generator in PLANS
    ]
    release = version("highway-env")
    show(
        scenes,
        f"highway-env {release}: CPU of making scenes, warm-up included, {given.scenes} of each kind",
    )
    if given.json:
        content = {"scenes": given.scenes, "highway_env": release, "generated": scenes}
        given.json.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
