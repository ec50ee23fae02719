"""Lower references and dishonest agents of a closed loop (`benchmarks/driving.py`), on two short drives."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import kendalltau

from benchmarks.driving_attacks import ATTACKS, AWAY
from benchmarks.driving_figures import Measured, figures, kendall_tau
from benchmarks.driving_measure import TRUTH, measure_scene
from mtp_bench import Action, Agent, MTPEnv, load_card, load_submission
from mtp_bench.running.run import agent_task, run_scene
from mtp_bench.types import Drive
from tests.support.command_line import CommandLine, read_json
from tests.support.small_scenes import write_short_card

ENV = "MTP-Drive-Intersection-v0"
AGENTS = (TRUTH, "stp", "blind", "standing")


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_short_card(tmp_path_factory.mktemp("card"), ENV, 8.0)


@pytest.fixture(scope="module")
def env(short: str) -> MTPEnv:
    return MTPEnv(short, evaluation=True)


@pytest.fixture(scope="module")
def drives(env: MTPEnv) -> dict[str, Drive]:
    """The first drive with each attack, and without objects."""
    agents = {name: build(agent_task(env, 0)) for name, build in ATTACKS.items()}
    agents["blind"] = load_submission("blind").build(agent_task(env, 0))
    found = {name: run_scene(agent, env, env.scene_names[0], 0).drive for name, agent in agents.items()}
    return {name: drive for name, drive in found.items() if drive is not None}


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


def test_objects_everywhere_stop_the_ego(drives: dict[str, Drive]) -> None:
    assert drives["everywhere"].way < 0.8 * drives["blind"].way
    assert drives["everywhere"].acceleration.min() < -3.0


def test_objects_far_away_are_as_none(drives: dict[str, Drive]) -> None:
    np.testing.assert_array_equal(drives["far_away"].acceleration, drives["blind"].acceleration)


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


def test_a_full_comparison_has_the_lower_references(short: str, cli: CommandLine, tmp_path: Path) -> None:
    words = ("compare", "stp", "--env", short, "--seeds", 1, "--jobs", 1, "--scenes", 1, "--json", tmp_path / "a.json")
    cli.ok(*words)
    assert {row["agent"] for row in read_json(tmp_path / "a.json")["rows"]} == {"stp", TRUTH}
    cli.ok(*words, "--full")
    assert {row["agent"] for row in read_json(tmp_path / "a.json")["rows"]} == set(AGENTS)


def test_agents_are_scored_on_the_scenes_in_which_ground_truth_tracks_drove(
    short: str, cli: CommandLine, tmp_path: Path
) -> None:
    cli.ok("run", TRUTH, "--env", short, "--scenes", 1, "-o", tmp_path / "run")
    words = ("--env", tmp_path / "run", "--seeds", 1, "--jobs", 1, "--json", tmp_path / "a.json")
    cli.ok("compare", "standing", "blind", *words)
    error = {row["agent"]: row["error"] for row in read_json(tmp_path / "a.json")["rows"] if row["subset"] == "all"}
    assert error[TRUTH] < error["stp"] < error["standing"] < error["blind"]


def test_figures_of_two_scenes(short: str, tmp_path: Path) -> None:
    card = load_card(short)
    for name in MTPEnv(card).scene_names:
        measure_scene(card, name, [*AGENTS, "everywhere"], tmp_path)
    (tmp_path / "env.txt").write_text(f"{card.digest} {short}")
    made = figures(Measured(tmp_path))
    assert made["scenes"] == 2
    assert set(made["rows"]) == {*AGENTS}
    assert set(made["attacks"]) == {"stp", "everywhere"}
    near = [made["rows"][agent]["errors"]["bADE near the ego"] for agent in (TRUTH, "blind")]
    assert near[0] < near[1]
    assert made["tau"]["all"]["agents"] == 4
    assert -1.0 <= made["tau"]["all"]["measures"]["bADE"]["low"] <= 1.0


def test_tau_is_that_of_scipy() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.integers(0, 4, (2, 6, 20)).astype(float)
    expected = [kendalltau(x, y).statistic for x, y in zip(a.T, b.T, strict=True)]
    np.testing.assert_allclose(kendall_tau(a, b), np.nan_to_num(expected))
