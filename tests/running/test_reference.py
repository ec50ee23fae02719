"""The frozen subsets: used where the card ships, made where it does not, and never taken on trust."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import load_card
from mtp_bench.env import MTPEnv
from mtp_bench.errors import UnknownNameError
from mtp_bench.running.compare import compare
from mtp_bench.running.options import RunOptions
from mtp_bench.running.reference import find_reference, freeze, frozen_path, frozen_reference
from mtp_bench.running.run import jobs_of, run_jobs
from mtp_bench.scoring import read_reference, score_scene, write_reference
from mtp_bench.submission import load_submission
from tests.support.command_line import CommandLine, write_submission
from tests.support.small_scenes import CARD, write_card, write_kitti

KINDS = ("ids", "lost", "reacquired")


def content(env_id: str) -> Any:
    return json.loads(frozen_path(env_id).read_text())


def rewrite(env_id: str, lost: list[str]) -> None:
    """Put other events into the frozen file, with the hash that fits them."""
    read = read_reference(frozen_path(env_id), load_card(env_id))
    keys = np.array(sorted(int(key, 16) for key in lost))
    write_reference(frozen_path(env_id), replace(read, lost=keys))


def test_what_is_frozen_reads_back_equal(cli: CommandLine, shipped: str, kitti: str) -> None:
    made = compare([], shipped, RunOptions(kitti)).reference
    assert not made.frozen
    mask = os.umask(0o077)
    try:
        said = cli.ok("freeze", "--env", shipped, "--data", kitti, "--jobs", 1)
    finally:
        os.umask(mask)
    path = frozen_path(shipped)
    assert said == f"{path}: {{'ids': 0, 'lost': 4, 'reacquired': 2}}\n"
    assert path.stat().st_mode & 0o777 == 0o644
    assert [p.name for p in path.parent.iterdir()] == [path.name]
    read = read_reference(path, load_card(shipped))
    assert read.hash == made.subsets.hash
    for kind in KINDS:
        np.testing.assert_array_equal(read.keys(kind), made.subsets.keys(kind))
    assert (read.env, read.reference, read.card) == (shipped, "stp", load_card(shipped).digest)


def test_freezing_twice_writes_the_same(shipped: str, kitti: str) -> None:
    path, counts = freeze(shipped, RunOptions(kitti))
    first = path.read_bytes()
    assert freeze(shipped, RunOptions(kitti)) == (path, counts)
    assert path.read_bytes() == first


def test_the_frozen_file_of_a_shipped_card_is_used(shipped: str, card: str, kitti: str) -> None:
    freeze(shipped, RunOptions(kitti))
    by_id, by_path = (compare([], name, RunOptions(kitti)).reference for name in (shipped, card))
    for reference in (by_id, by_path):  # the same content is the same card
        assert (reference.frozen, reference.differing) == (True, 0)
        assert reference.origin == f"frozen subsets of 'stp' (hash {reference.subsets.hash[:12]})"


def test_a_changed_card_makes_its_own(shipped: str, tmp_path: Path, kitti: str) -> None:
    freeze(shipped, RunOptions(kitti))
    other = write_card(tmp_path, CARD.replace("miss_error = 2.0", "miss_error = 3.0"))
    assert frozen_reference(load_card(other)) is None
    reference = compare([], other, RunOptions(kitti)).reference
    assert not reference.frozen
    assert "in this run" in reference.origin
    assert reference.subsets.card == load_card(other).digest


def test_another_agent_as_reference_does_not_touch_the_frozen_file(shipped: str, kitti: str) -> None:
    freeze(shipped, RunOptions(kitti))
    other = compare([], shipped, RunOptions(kitti), reference="stp_hedged").reference
    assert (other.frozen, other.subsets.reference) == (False, "stp_hedged")
    assert compare([], shipped, RunOptions(kitti), reference="stp").reference.frozen


def test_events_that_differ_on_this_machine_are_counted(shipped: str, kitti: str) -> None:
    freeze(shipped, RunOptions(kitti))
    events = content(shipped)["events"]["lost"]
    rewrite(shipped, events[1:])
    result = compare([], shipped, RunOptions(kitti))
    assert result.reference.differing == 1
    assert result.reference.origin.endswith("; 'stp' on this machine differs in 1 event")
    lost = next(row for row in result.report.to_json()["rows"] if row["subset"] == "lost")
    assert lost["events"] == 3  # the frozen ones count, not those of this machine


def test_frozen_events_of_scenes_that_were_not_run_do_not_differ(shipped: str, kitti: str) -> None:
    freeze(shipped, RunOptions(kitti))
    one = compare([], shipped, RunOptions(kitti, scenes=1))
    assert (one.reference.frozen, one.reference.differing) == (True, 0)
    lost = next(row for row in one.report.to_json()["rows"] if row["subset"] == "lost")
    assert lost["events"] == 2  # of the 4
    rewrite(shipped, [*content(shipped)["events"]["lost"], "000000000001"])  # of no true box in this data
    assert compare([], shipped, RunOptions(kitti)).reference.differing == 0


@pytest.mark.parametrize("command", ["compare", "score"])
def test_a_changed_frozen_file_is_refused(
    command: str, cli: CommandLine, shipped: str, tmp_path: Path, kitti: str
) -> None:
    freeze(shipped, RunOptions(kitti))
    run = tmp_path / "run"
    cli.ok("run", "stp", "--env", shipped, "--data", kitti, "-o", run, "--jobs", 1)
    file = content(shipped)
    file["events"]["lost"] = file["events"]["lost"][1:]
    frozen_path(shipped).write_text(json.dumps(file))
    # an agent that cannot run: the file is looked at before
    agent = write_submission(tmp_path / "mine", body="raise RuntimeError('it ran')")
    arguments = {"compare": (agent, "--env", shipped), "score": (run,)}[command]
    error = cli(command, *arguments, "--data", kitti).error
    assert "MTP-Small-v0.json: the content has the hash " in error
    assert f"the file says {file['hash']}" in error


def test_only_what_ships_is_frozen(cli: CommandLine, card: str, kitti: str) -> None:
    with pytest.raises(UnknownNameError, match="only those that ship have frozen subsets"):
        freeze(card, RunOptions(kitti))
    assert "only those that ship" in cli("freeze", "--env", card, "--data", kitti).error


def test_a_failed_freeze_leaves_the_earlier_file(cli: CommandLine, shipped: str, tmp_path: Path, kitti: str) -> None:
    path, _ = freeze(shipped, RunOptions(kitti))
    before = path.read_bytes()
    broken = Path(write_kitti(tmp_path / "broken"))
    (broken / "kitti_tracking/training/calib/0006.txt").unlink()
    assert "calib/0006.txt" in cli("freeze", "--env", shipped, "--data", broken, "--jobs", 1).error
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize("env_id", ["MTP-KITTI-v0", "MTP-KITTI-noego-v0", "MTP-KITTI-5Hz-v0"])
def test_the_shipped_files_fit_their_cards(env_id: str) -> None:
    reference = frozen_reference(load_card(env_id))
    assert reference is not None
    assert reference.frozen
    assert reference.subsets.reference == "stp"
    counts = content(env_id)["counts"]
    assert counts == {kind: len(reference.subsets.keys(kind)) for kind in KINDS}
    assert counts["lost"] > counts["ids"]


@pytest.mark.data
@pytest.mark.parametrize("env_id", ["MTP-KITTI-v0", "MTP-KITTI-noego-v0", "MTP-KITTI-5Hz-v0"])
def test_the_reference_still_has_the_frozen_events(env_id: str, data_root: Path) -> None:
    # sequence 0014 has most of the switches, 0012 is the shortest
    card = load_card(env_id)
    submission = load_submission(card.reference)
    jobs = jobs_of(submission, env_id, {"data": str(data_root)}, ["0012", "0014"])
    reference = find_reference(card, run_jobs(jobs, finish=score_scene))
    assert reference.frozen
    assert reference.differing == 0


@pytest.mark.parametrize("env_id", ["MTP-Intersection-v0", "MTP-Roundabout-v0", "MTP-Merge-v0", "MTP-Highway-v0"])
def test_the_reference_still_has_the_frozen_events_of_simulated_traffic(env_id: str) -> None:
    """Traffic, detector and tracker together: a change of any of them needs a new version or new frozen files."""
    card = load_card(env_id)
    jobs = jobs_of(load_submission(card.reference), env_id, {}, MTPEnv(env_id).scene_names[:1])
    scores = run_jobs(jobs, finish=score_scene)
    assert sum(len(kind) for kind in scores[0].events.values()) > 0
    reference = find_reference(card, scores)
    assert (reference.frozen, reference.differing) == (True, 0)
