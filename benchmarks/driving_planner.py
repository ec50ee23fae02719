"""Drive with the planner of a closed loop alone: on ground-truth tracks, blind, and beside traffic's own drivers.

    python benchmarks/driving_planner.py --env MTP-Drive-Merge-v0 --split train --scenes 200 --set pace=0.9

Prints, per 100 scenes, at-fault collisions and near misses, and the way against that of traffic's own drivers in the
same scenes (those in which own drivers collide are left out of it: on a ramp they do not follow the ego's way). The
weights of `PlannerSection` were chosen with it on training scenes: those of least near misses and hard brakes that keep
the way within 15 % of own drivers'.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtp_bench.agent.loader import submission_of
from mtp_bench.cards import Card, load_card
from mtp_bench.cards.card import DriveSection
from mtp_bench.cards.changes import with_split
from mtp_bench.core import Drive
from mtp_bench.core.parallel import Workers, parallel_map
from mtp_bench.env.environment import MTPEnv
from mtp_bench.running.playing import jobs_of, run_jobs
from mtp_bench.running.settings import setting_of
from mtp_bench.scoring.statistics import bootstrap_interval
from mtp_bench.sources.base import section_of
from mtp_bench.traffic.highway.driven import DrivenTraffic
from mtp_bench.traffic.highway.source import traffic_of
from mtp_bench.traffic.highway.world import RATE, HighwaySource

PLANNED = (
    "gt_tracks",
    "blind",
)  # baselines: ground-truth tracks of constant velocity, and no forecasts


def measure_scene(
    card: Card, name: str, agents: list[str]
) -> tuple[list[Drive], tuple[float, bool]]:
    """Drives of the agents; and the way of traffic's own driver, m, with whether it collided."""
    drives = []
    for agent in agents:
        setting = setting_of(submission_of(agent), card)
        jobs = jobs_of(
            setting.submission,
            card,
            setting.env_keywords(card),
            [name],
            0,
            setting.parameters,
        )
        drives += [rollout.drive for rollout in run_jobs(jobs)]
    return drives, own_driver(card, int(name.rsplit("-", 1)[1]))


def own_driver(card: Card, seed: int) -> tuple[float, bool]:
    """The way, m, of an ego that takes the accelerations of traffic's own driver model, and whether it collided."""
    traffic = DrivenTraffic(traffic_of(section_of(card, HighwaySource)), seed)
    ego: Any = traffic.ego
    start = ego.s
    ego.act = lambda action=None: setattr(
        ego, "wanted", max(float(action["acceleration"]), -8.0)
    )
    for _ in range(round(float(card.source.traits.scene_seconds or 0) * RATE)):
        if not traffic.over:
            traffic.step(0.0)
    return float(ego.s - start), traffic.collision is not None


def shown(
    agent: str,
    drives: list[Drive],
    own: NDArray[np.float64],
    crashed: NDArray[np.bool_],
) -> str:
    """One line of figures."""
    ones, way = np.ones(len(drives)), np.array([drive.way for drive in drives])
    fault = np.array([100.0 * drive.at_fault for drive in drives])
    low, high = bootstrap_interval(fault, ones) or (0.0, 0.0)
    mean = {
        "all collisions": 100.0 * np.mean([bool(drive.collision) for drive in drives]),
        "near misses": 100.0 * np.mean([drive.near_misses for drive in drives]),
        "phantom brakes": 100.0 * np.mean([drive.phantom_brakes for drive in drives]),
        "comfortable": 100.0 * np.mean([drive.comfortable for drive in drives]),
    }
    parts = ", ".join(f"{name} {value:.1f}" for name, value in mean.items())
    ratio = way[~crashed].sum() / own[~crashed].sum()
    way_text = f"way {way.mean():.1f} m, {100 * ratio - 100:+.1f} % of own drivers' ({(~crashed).sum()} scenes)"
    return f"{agent}: at fault {fault.mean():.1f} [{low:.1f}, {high:.1f}], {parts}; {way_text}"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--env", default="MTP-Drive-Intersection-v0")
    parser.add_argument("--split", default="val")
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--agents", default=",".join(PLANNED))
    parser.add_argument("--set", nargs="*", default=[], metavar="WEIGHT=VALUE")
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    card: Any = with_split(load_card(given.env), given.split)
    drive = card.drive or DriveSection()
    changes = {
        name: float(value) for name, value in (each.split("=") for each in given.set)
    }
    planner = drive.planner.model_copy(update=changes)
    card = card.model_copy(
        update={"drive": drive.model_copy(update={"planner": planner})}
    )
    names, agents = MTPEnv(card).scene_names[: given.scenes], given.agents.split(",")
    found = parallel_map(
        measure_scene, [(card, name, agents) for name in names], Workers(given.jobs)
    )
    own, crashed = (
        np.array([each[1][0] for each in found]),
        np.array([each[1][1] for each in found]),
    )
    print(
        f"{card.id}, {given.split}, {len(names)} scenes, {planner}; own drivers collide in {crashed.sum()}"
    )
    for k, agent in enumerate(agents):
        print(shown(agent, [each[0][k] for each in found], own, crashed))


if __name__ == "__main__":
    main()
