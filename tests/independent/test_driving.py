"""Numbers of drives against those that another program computes from the stored files alone."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from mtp_bench import load_card
from mtp_bench.core import Drive, Lane, Truth, boxes_meet, starts_of_sorted
from mtp_bench.core.bundle import bundled
from mtp_bench.env.rollouts import drive_arrays
from mtp_bench.running.reference import frozen_reference
from mtp_bench.running.stored import open_run
from mtp_bench.scoring.driving import scene_score
from mtp_bench.traffic.drive_record import record_of, rows_from
from mtp_bench.traffic.highway.driven import Way, hit_from_behind
from mtp_bench.traffic.highway.source import pack
from mtp_bench.traffic.highway.world import World
from mtp_bench.traffic.planner import Decision
from tests.independent.driving import Numbers, from_behind, meet, numbers_of
from tests.support.command_line import CommandLine

# agent, environment, first and last seed, and what happens in these drives
DRIVES = (
    ("blind", "MTP-Drive-Intersection-v0", 10004, 10006, {"at fault", "near miss", "goal", "comfort"}),
    ("blind", "MTP-Drive-Intersection-10Hz-v0", 10006, 10006, {"at fault"}),
    ("standing", "MTP-Drive-Merge-v0", 10000, 10000, {"hit from behind", "no comfort"}),
    ("standing", "MTP-Drive-Merge-v0", 10010, 10011, {"at fault", "near miss alone"}),
    ("stp", "MTP-Drive-Intersection-v0", 10013, 10013, {"phantom brake"}),
    ("stp", "MTP-Drive-Roundabout-v0", 10000, 10000, {"comfort"}),
)


def happened(drive: Drive) -> set[str]:
    """Names of what happened in a drive."""
    names = {
        "at fault": drive.at_fault,
        "hit from behind": drive.collision and not drive.at_fault,
        "near miss": drive.near_misses,
        "near miss alone": drive.near_misses and not drive.collision,
        "phantom brake": drive.phantom_brakes,
        "goal": drive.goal,
        "comfort": drive.comfortable,
        "no comfort": not drive.comfortable,
    }
    return {name for name, value in names.items() if value}


def compare(numbers: Numbers, drive: Drive, way: float) -> None:
    """Assert that all numbers are those of the product. ``way``: that with ground-truth tracks, m."""
    assert (numbers.way, numbers.seconds) == pytest.approx((drive.way, drive.seconds), abs=1e-9)
    assert (numbers.goal, numbers.at_fault) == (drive.goal, drive.at_fault)
    assert bool(numbers.hits) == bool(drive.collision) == (drive.hit >= 0)
    assert not numbers.hits or (drive.collision, drive.hit) in numbers.hits
    assert (numbers.near_misses, numbers.phantom_brakes) == (drive.near_misses, drive.phantom_brakes)
    assert numbers.comfortable == drive.comfortable
    assert numbers.score(way) == pytest.approx(scene_score(drive, way), abs=1e-9)


@pytest.mark.parametrize(("agent", "env_id", "first", "last", "shown"), DRIVES)
def test_every_number_of_stored_drives(
    agent: str, env_id: str, first: int, last: int, shown: set[str], tmp_path: Path, cli: CommandLine
) -> None:
    card = tmp_path / f"{env_id}.toml"
    lines = (bundled("envs") / card.name).read_text().splitlines()
    seeds = f"val = [{first}, {last + 1}]"
    card.write_text("\n".join(seeds if line.startswith("val = ") else line for line in lines))
    cli.ok("run", agent, "--env", card, "-o", tmp_path / "run")
    reference = frozen_reference(load_card(env_id))
    assert reference is not None
    seen = set[str]()
    for rollout in open_run(tmp_path / "run").run.rollouts:
        drive = rollout.drive
        assert drive is not None
        seen |= happened(drive)
        (way,) = reference.ways([rollout.scene]).values()
        compare(numbers_of(tmp_path / "run" / f"{rollout.scene}.npz"), drive, way)
    assert shown <= seen


def drawn_drive(seed: int, file: Path) -> Drive:
    """Return a drive with random brakes among vehicles that move at random, and store it in ``file``."""
    rng = np.random.default_rng(seed)
    steps = int(rng.integers(10, 60))
    acceleration = gaussian_filter1d(rng.normal(-0.5, rng.choice([1.0, 3.0, 12.0]), steps), rng.uniform(1.0, 5.0))
    speed = np.maximum(rng.uniform(2.0, 14.0) + np.cumsum(np.append(0.0, acceleration[:-1])) / 10, 0.0)
    stations = 5.0 + np.cumsum(np.append(0.0, speed)) / 10
    s = np.arange(0.0, stations[-1] + 50.0, 0.5)
    heading = 0.5 + np.cumsum(gaussian_filter1d(rng.normal(0.0, 0.15, len(s)), 12.0))
    xy = np.cumsum(0.5 * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)
    way = Way(s, xy, heading, np.zeros(0), np.zeros(0, dtype=int))
    place, yaw = way.at(stations)
    ego = np.column_stack([place, np.zeros(steps + 1), yaw])
    rows = []
    for number in range(8):
        first, last = np.sort(rng.integers(0, steps + 1, 2))
        start, course = way.at(stations[first] + rng.uniform(-10.0, 45.0))
        angle = course + rng.choice([0.0, 0.0, np.pi / 2, np.pi]) + rng.normal(0.0, 0.2)
        velocity = rng.choice([0.0, 4.0, 10.0]) * np.array([np.cos(angle), np.sin(angle)])
        size = rng.choice([[4.5, 1.9, 1.5], [0.7, 0.6, 1.7], [11.0, 2.6, 3.2]])
        start = start + rng.normal(0.0, 2.5, 2)
        for state in range(first, last + 1):
            box = [*(start + (state - first) / 10 * velocity), 0.8, angle, *size]
            rows.append([state, number, 0, *box, *velocity])
    table = np.array(sorted(rows)).reshape(-1, 12)
    no = np.zeros(len(table), dtype=bool)
    ids = table[:, :3].astype(int)
    truth = Truth(starts_of_sorted(ids[:, 0], steps + 1), table[:, 3:10], table[:, 10:], ids[:, 2], ids[:, 1], ~no, no)
    lane = Lane(xy, xy, xy)
    world = World(np.arange(steps + 1) / 10, ego, truth, (lane,))
    traffic: Any = SimpleNamespace(world=lambda: world, collision=None, way=way, size=(4.7, 1.9), at_goal=False)
    drive = record_of(traffic, stations, acceleration, [Decision(0.0, 0.0, -1, stations[:1])])
    shown = steps - 4
    stored = pack(replace(world, truth=truth.select(ids[:, 0] < shown)))
    stored = {**stored, "start": stored["start"][: shown + 1], "ending": rows_from(truth, shown)}
    arrays: Any = drive_arrays(replace(drive, world=stored))
    np.savez(file, **arrays)
    return drive


def test_drawn_drives(tmp_path: Path) -> None:
    file, found = tmp_path / "drive.npz", []
    for seed in range(120):
        drive = drawn_drive(seed, file)
        numbers = numbers_of(file)
        for name in ("near_misses", "phantom_brakes", "comfortable"):
            assert getattr(numbers, name) == getattr(drive, name), f"{name}, seed {seed}"
        found.append((drive.near_misses, drive.phantom_brakes, drive.comfortable))
    near, brakes, comfortable = np.array(found).T
    assert near.sum() > 20
    assert brakes.sum() > 20
    assert 20 < comfortable.sum() < 100


def test_contacts_and_hits_from_behind_of_random_boxes() -> None:
    rng = np.random.default_rng(0)
    ego = np.array([3.0, -2.0, 0.0, 0.7, 4.6, 1.9, 1.5])
    others = np.tile(ego, (3000, 1))
    others[:, :2] += rng.normal(0.0, 3.0, (3000, 2))
    others[:, 3] += rng.normal(0.0, 1.0, 3000)
    others[:, 4:6] = rng.uniform([0.5, 0.5], [12.0, 3.0], (3000, 2))
    contact = boxes_meet(np.tile(ego, (3000, 1)), others)
    behind = [hit_from_behind(ego, other) for other in others]
    assert contact.tolist() == [meet(ego, other) for other in others]
    assert behind == [from_behind(ego, other) for other in others]
    assert 100 < sum(behind) < 2900
