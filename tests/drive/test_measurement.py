"""Lower references, dishonest agents and the measurement of a closed loop (`benchmarks/driving.py`)."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import kendalltau

from benchmarks.driving_attacks import ATTACKS, AWAY
from benchmarks.driving_figures import Measured, figures
from benchmarks.driving_measure import TRUTH, Kept, Moments, measure_scene
from benchmarks.driving_switches import Windows, cost_in_windows
from benchmarks.kendall import kendall_tau
from mtp_bench import Action, Agent, MTPEnv, Task, load_card, load_submission
from mtp_bench.core import Floats
from mtp_bench.running.playing import agent_task, run_scene
from tests.drive.test_record import of
from tests.support.command_line import CommandLine, read_json

AGENTS = (TRUTH, "stp", "blind", "standing")


@pytest.fixture(scope="module")
def env(drive_card: str) -> MTPEnv:
    return MTPEnv(drive_card, evaluation=True)


def actions(agent: Agent, env: MTPEnv) -> list[Action]:
    """The actions of an agent on three frames, with the same scene for all agents."""
    observation, _ = env.reset(options={"scene": env.scene_names[0]})
    agent.reset(agent_task(env, 0))
    said, nothing = [], load_submission("blind").build(env.task).act(observation)
    for _ in range(3):
        said.append(agent.act(observation))
        observation, *_ = env.step(nothing)
    return said


def objects(action: Action) -> int:
    return int(action["object_valid"].sum())


def test_objects_everywhere_stop_the_ego_and_far_away_they_are_as_none(env: MTPEnv) -> None:
    def gains(build: Callable[[Task], Agent]) -> Floats:
        drive = run_scene(build(agent_task(env, 0)), env, env.scene_names[0], 0).drive
        assert drive is not None
        return drive.acceleration

    blind = gains(load_submission("blind").build)
    assert gains(ATTACKS["everywhere"]).min() < -3.0 < blind.min()
    np.testing.assert_array_equal(gains(ATTACKS["far_away"]), blind)


def test_attacks_change_what_stp_states(env: MTPEnv) -> None:
    stp = actions(load_submission("stp").build(agent_task(env, 0)), env)
    assert min(map(objects, stp)) > 0
    said = {name: actions(build(agent_task(env, 0)), env) for name, build in ATTACKS.items()}
    assert list(map(objects, said["flickering"])) == [objects(stp[0]), 0, objects(stp[2])]
    assert list(map(objects, said["late"])) == [0, objects(stp[0]), objects(stp[1])]
    moved = said["far_away"][1]["object_box"] - stp[1]["object_box"]
    np.testing.assert_allclose(moved[:, 0], AWAY, atol=1e-4)
    assert (said["sure"][1]["object_confidence"] == 1.0).all()


def test_standing_states_the_detections(env: MTPEnv) -> None:
    observation, _ = env.reset(options={"scene": env.scene_names[0]})
    action = load_submission("standing").build(env.task).act(observation)
    rows = observation["detection_valid"] == 1
    assert objects(action) == rows.sum() > 0
    np.testing.assert_array_equal(action["object_box"][: rows.sum()], observation["detection_box"][rows])
    np.testing.assert_array_equal(action["object_confidence"][: rows.sum()], observation["detection_score"][rows])
    assert not action["forecast"].any()


def test_a_full_comparison_has_the_lower_references(drive_card: str, cli: CommandLine, tmp_path: Path) -> None:
    words = ("compare", "stp", "--env", drive_card, "--seeds", 1, "--jobs", 1, "--scenes", 1)
    cli.ok(*words, "--full", "--json", tmp_path / "a.json")
    assert {row["agent"] for row in read_json(tmp_path / "a.json")["rows"]} == set(AGENTS)


def test_agents_are_scored_on_the_scenes_in_which_ground_truth_tracks_drove(
    drive_card: str, cli: CommandLine, tmp_path: Path
) -> None:
    cli.ok("run", TRUTH, "--env", drive_card, "--scenes", 1, "-o", tmp_path / "run")
    words = ("--env", tmp_path / "run", "--seeds", 1, "--jobs", 1, "--json", tmp_path / "a.json")
    cli.ok("compare", "standing", "blind", *words)
    error = {row["agent"]: row["error"] for row in read_json(tmp_path / "a.json")["rows"] if row["subset"] == "all"}
    assert error[TRUTH] < error["stp"] < error["standing"] < error["blind"]


def test_figures_of_two_scenes(drive_card: str, tmp_path: Path) -> None:
    card = load_card(drive_card)
    for name in MTPEnv(card).scene_names:
        measure_scene(card, name, [*AGENTS, "everywhere"], tmp_path)
    (tmp_path / "env.txt").write_text(f"{card.digest} {drive_card}")
    made = figures(Measured(tmp_path))
    assert (made["scenes"], {*made["rows"]}, {*made["attacks"]}) == (2, {*AGENTS}, {"stp", "everywhere"})
    near = [made["rows"][agent]["errors"]["bADE near the ego"] for agent in (TRUTH, "blind")]
    assert near[0] < near[1]
    assert -1.0 <= made["tau"]["all"]["measures"]["bADE"]["low"] <= 1.0


def test_tau_is_that_of_scipy() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.integers(0, 4, (2, 6, 20)).astype(float)
    expected = [kendalltau(x, y).statistic for x, y in zip(a.T, b.T, strict=True)]
    np.testing.assert_allclose(kendall_tau(a, b), np.nan_to_num(expected))


def drive_with_switches(rng: np.random.Generator, cost: float) -> Kept:
    """40 frames at 2 Hz, each tenth with a switch; accidents come at random, likelier by ``cost`` for 2 s after one."""
    switch = rng.random(40) < 0.1
    after = np.convolve(switch, np.ones(4))[:40] > 0
    brakes, hits = (np.flatnonzero(rng.random(40) < share + cost * after) for share in (0.03, 0.01))
    frames = int(hits[0]) + 1 if len(hits) else 40
    events = np.array([[f, 0, 5.0, 0.0, 0.0] for f in np.flatnonzero(switch[:frames])]).reshape(-1, 5)
    same, phantom = np.ones(frames), brakes[brakes < frames] / 2 + 0.1
    record = replace(of(50.0, "car" * len(hits), len(hits) > 0), seconds=frames / 2 - 0.2)
    return Kept("", record, Moments(events, 8 * same, same, 5 * same, phantom, np.zeros(0)))


@pytest.mark.parametrize("cost", [0.0, 0.06])
def test_cost_of_planted_switches(cost: float) -> None:
    rng = np.random.default_rng(5)
    parts = [Windows.of(drive_with_switches(rng, cost), 0.5, scene, agent) for agent in (0, 1) for scene in range(150)]
    costs = cost_in_windows(Windows.joined(parts))
    for name in ("collision at fault", "phantom brake"):
        found = costs[f"{name}, no switch before it"]
        assert found is not None
        assert (found["low"] > 0) == (cost > 0)
        assert 0 < found["seen"] < 0.1
