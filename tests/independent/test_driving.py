"""Numbers of drives against those that another program computes from the stored files alone."""

from pathlib import Path

import numpy as np
import pytest

from mtp_bench import load_card
from mtp_bench._bundle import bundled
from mtp_bench.running.reference import frozen_reference
from mtp_bench.running.stored import open_run
from mtp_bench.scoring.driving import scene_score
from mtp_bench.sources.highway.driven import hit_from_behind
from mtp_bench.sources.highway.simulate import boxes_meet
from mtp_bench.types import Drive
from tests.independent.driving import Numbers, from_behind, meet, numbers_of
from tests.support.command_line import CommandLine

# agent, environment, first and last seed, and what happens in these drives
DRIVES = (
    ("blind", "MTP-Drive-Intersection-v0", 10004, 10006, {"at fault", "near miss", "goal", "comfort"}),
    ("blind", "MTP-Drive-Intersection-10Hz-v0", 10006, 10006, {"at fault"}),
    ("standing", "MTP-Drive-Merge-v0", 10004, 10004, {"hit from behind"}),
    ("standing", "MTP-Drive-Merge-v0", 10009, 10011, {"at fault", "near miss alone", "phantom brake", "no comfort"}),
    ("stp", "MTP-Drive-Roundabout-v0", 10001, 10001, {"near miss alone"}),
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
