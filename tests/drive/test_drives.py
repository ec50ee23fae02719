"""Drives as an env, in another process, stored, scored and compared."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench import MTPEnv
from mtp_bench.cards import load_card
from mtp_bench.core import Drive, Rollout
from mtp_bench.core.errors import RolloutError
from mtp_bench.env.rollouts import digest
from mtp_bench.running.drives import recorded_card
from mtp_bench.running.reference import frozen_path, frozen_reference, make_reference
from mtp_bench.running.stored import open_run
from mtp_bench.sources.base import section_of
from mtp_bench.sources.cache import content_hash
from mtp_bench.traffic.highway.driven import DrivenTraffic
from mtp_bench.traffic.highway.source import traffic_of
from mtp_bench.traffic.highway.store import pack
from mtp_bench.traffic.highway.world import HighwaySource
from tests.drive.test_traffic import elsewhere
from tests.support.command_line import CommandLine, write_submission
from tests.support.small_scenes import empty_action, make_echo

SMALL: dict[str, Any] = {"samples": 2, "max_tracks": 8, "max_objects": 8, "hypotheses": 2, "max_detections": 40}
NAME = "intersection-010000"


def play(card: str, **keywords: Any) -> tuple[MTPEnv, Rollout, Drive, float]:
    """The env after a drive on forecasts along the headings of detections, and the sum of rewards."""
    env, total, over = MTPEnv(card, **keywords), 0.0, False
    agent = make_echo(env.task)
    agent.reset(env.task)
    observation, _ = env.reset(seed=0, options={"scene": NAME})
    while not over:
        observation, reward, over, _, _ = env.step(agent.act(observation))
        total += reward
    rollout = env.rollout()
    assert rollout.drive is not None
    return env, rollout, rollout.drive, total


def digest_of(card: str) -> str:
    return digest(play(card)[1])


def test_the_same_drive_again(drive_card: str) -> None:
    env, rollout, drive, total = play(drive_card)
    assert total == pytest.approx(drive.way - 100.0 * drive.at_fault)
    assert digest_of(drive_card) == digest(rollout) == elsewhere(digest_of, drive_card)
    assert digest(replace(rollout, drive=replace(drive, way=drive.way + 1e-9))) != digest(rollout)
    assert digest(replace(rollout, drive=replace(drive, size=drive.size + 1.0))) == digest(rollout), "fixed arrays"
    _, _, moved, _ = play(drive_card, rigid_motion=True)  # forecasts are rounded to centimetres after it
    np.testing.assert_array_equal(moved.acceleration, drive.acceleration)
    np.testing.assert_allclose(moved.risk, drive.risk, atol=0.02)
    traffic = DrivenTraffic(traffic_of(section_of(env.card, HighwaySource)), 10000)
    for gain in drive.acceleration:
        traffic.step(gain)
    shown = {name: array for name, array in drive.world.items() if name != "ending"}
    assert content_hash(pack(traffic.world(frames=5 * rollout.frames - 4))) == content_hash(shown)


def test_evaluation_shows_nothing_of_the_truth_and_has_pictures(drive_card: str) -> None:
    env = MTPEnv(drive_card, evaluation=True, render_mode="rgb_array", **SMALL)
    _, info = env.reset(options={"scene": NAME})
    known, ways, pictures = set(info), [], []
    for stops in (False, True):  # an agent that sees nothing, and one with an object right ahead
        observation, _ = env.reset(options={"scene": NAME})
        over = False
        while not over:
            action = empty_action(env.task)
            if stops:
                action["object_valid"][0], action["forecast_log_weight"][0] = 1, 0.0
                x, y, _, yaw = observation["ego_pose"]
                action["object_box"][0, :2] = x + 8.0 * np.cos(yaw), y + 8.0 * np.sin(yaw)
            observation, reward, over, truncated, info = env.step(action)
            assert (set(info), reward, truncated) == (known, 0.0, False)
            if info["frame"] in (1, 4):
                pictures.append(env.render())
        ways.append(env.rollout().drive.way)  # type: ignore[union-attr]
    assert known == {"frame", "dropped_detections", "invalid_tracks", "invalid_hypotheses", "invalid_objects"}
    assert ways[1] < ways[0] / 2
    assert [picture.shape for picture in pictures if picture is not None] == [(720, 960, 3)] * 4
    assert not np.array_equal(pictures[0], pictures[1])  # type: ignore[arg-type]


def test_a_stored_run(drive_card: str, tmp_path: Path, cli: CommandLine) -> None:
    folder, agent = tmp_path / "run", write_submission(tmp_path / "echo")
    cli.ok("run", agent, "--env", drive_card, "--scenes", "1", "-o", folder)
    opened = open_run(folder)
    (rollout,), (env, _, drive, _) = opened.run.rollouts, play(drive_card)
    for name in ("acceleration", "risk", "cause"):
        np.testing.assert_array_equal(getattr(rollout.drive, name), getattr(drive, name))
    stored, driven = opened.scene(NAME), env.scene
    for mine, own in ((stored.truth, driven.truth), (stored.detections, driven.detections)):
        for name, value in vars(own).items():
            np.testing.assert_array_equal(getattr(mine, name), value, name)
    np.testing.assert_array_equal(stored.ego, driven.ego)
    assert stored.frames == rollout.frames
    cli.ok("score", folder, "--json", tmp_path / "score.json")
    assert json.loads((tmp_path / "score.json").read_text())["rows"][0]["targets"] > 0
    assert NAME in cli.ok("events", folder)
    short, lost = replace(drive, risk=np.zeros(1)), replace(drive, world={})
    for other, why in ((None, "has no drive, or"), (short, "fit its"), (lost, "its drive cannot be read .'lane'.")):
        with pytest.raises(RolloutError, match=why):
            recorded_card(MTPEnv(drive_card).card, [replace(rollout, drive=other)])
    another = replace(rollout, scene="intersection-010001")
    both = MTPEnv(recorded_card(MTPEnv(drive_card).card, [another, rollout, rollout]))
    both.reset(options={"scene": f"{NAME}-2"})
    np.testing.assert_array_equal(both.scene.detections.box, driven.detections.box)
    for name in ("drive_way", "world_ego"):
        changed = Path(shutil.copytree(folder, tmp_path / name)) / f"{NAME}.npz"
        with np.load(changed) as content:
            arrays = {key: content[key] + 1 if key == name else content[key] for key in content.files}
        np.savez(changed, **arrays)
        with pytest.raises(RolloutError, match=NAME):
            open_run(changed.parent)
    del arrays["drive_station"]
    np.savez(changed, **arrays)
    with pytest.raises(RolloutError, match=r"not a rollout \('drive_station'\); run the agent again"):
        open_run(changed.parent)


@pytest.mark.parametrize("env_id", sorted(path.stem for path in frozen_path("").parent.glob("MTP-Drive-*.json")))
def test_frozen_ways_are_those_of_this_traffic_and_planner(env_id: str) -> None:
    card = load_card(env_id)
    names = MTPEnv(card).scene_names[20:21]  # at the intersection small changes of the planner show in it
    made, frozen = make_reference(card, names), frozen_reference(card)
    assert frozen is not None
    assert made.ways(names) == frozen.ways(names)


def test_comparison_with_an_agent_that_fails(drive_card: str, tmp_path: Path, cli: CommandLine) -> None:
    bodies, file = {"echo": "pass", "fails": "raise ValueError('no idea')"}, tmp_path / "compared.json"
    agents = [write_submission(tmp_path / name, name, body=body) for name, body in bodies.items()]
    output = cli("compare", *agents, "--env", drive_card, "--scenes", "1", "--seeds", "1", "--json", file)
    assert (output.status, output.err) == (1, f"fails: failed on scene '{NAME}' at frame 0: ValueError: no idea\n")
    content = json.loads(file.read_text())
    rows = {row["agent"]: row for row in content["rows"]}
    assert (list(content["failures"]), set(rows)) == (["fails"], {"echo", "stp", "gt_tracks"})
    assert (rows["gt_tracks"]["progress"], rows["stp"]["difference"]) == (1.0, None)
    assert "drive score, more is better" in output.out
    cli.ok("run", "gt_tracks", "--env", drive_card, "--scenes", "1", "-o", tmp_path / "run")
    cli.ok("score", tmp_path / "run", "--json", file)
    assert rows["gt_tracks"]["bade"] == pytest.approx(json.loads(file.read_text())["rows"][0]["error"])
