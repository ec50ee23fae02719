"""Lower references, dishonest agents and the measurement of a closed loop (`benchmarks/driving.py`)."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import kendalltau

from benchmarks.driving_attacks import ATTACKS, AWAY_M, CHANGES, SCAN, base_of, changed
from benchmarks.driving_figures import Measured, figures
from benchmarks.driving_honesty import ORACLE, apart, chances_of_scene, gains
from benchmarks.driving_measure import TRUTH, Kept, Moments, measure_scene
from benchmarks.driving_switches import Windows, cost_in_windows
from benchmarks.kendall import kendall_tau
from mtp_bench import Action, Agent, MTPEnv, load_card, load_submission
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
    def gains(agent: str) -> Floats:
        task = agent_task(env, 0)
        made = changed(agent, load_submission(base_of(agent)).build(task))
        drive = run_scene(made, env, env.scene_names[0], 0).drive
        assert drive is not None
        return drive.acceleration

    blind = gains("blind")
    assert gains("stp: everywhere").min() < -3.0 < blind.min()
    np.testing.assert_array_equal(gains("stp: far away"), blind)
    np.testing.assert_array_equal(gains("blind: ghosts behind"), blind)


def test_changes_of_what_stp_states(env: MTPEnv) -> None:
    def stated(change: str) -> list[Action]:
        made = load_submission("stp").build(agent_task(env, 0))
        return actions(changed(change and f"stp: {change}", made), env)

    stp = stated("")
    assert min(map(objects, stp)) > 0
    assert list(map(objects, stated("flickering"))) == [objects(stp[0]), 0, objects(stp[2])]
    assert list(map(objects, stated("late"))) == [0, objects(stp[0]), objects(stp[1])]
    assert list(map(objects, stated("ghosts behind"))) == [objects(each) + 3 for each in stp]
    assert list(map(objects, stated("nobody oncoming"))) < list(map(objects, stp))
    valid = stp[1]["object_valid"] == 1
    now = {name: values[valid] for name, values in stp[1].items() if name.startswith(("object", "forecast"))}

    def after(change: str, name: str) -> Floats:
        return np.asarray(stated(change)[1][name][valid], dtype=float)

    moved = after("far away", "object_box") - now["object_box"]
    np.testing.assert_allclose(moved[:, 0], AWAY_M, atol=1e-4)
    assert (after("all certain", "object_confidence") == 1.0).all()
    confidence = now["object_confidence"]
    for change, expected in (
        ("scale 0.5", confidence / 2), ("scale 2", np.minimum(2 * confidence, 1)), ("floor 0.3", np.maximum(confidence, 0.3)),
        ("none below 0.3", confidence * (confidence >= 0.3)), ("ceiling 0.5", np.minimum(confidence, 0.5)),
    ):  # fmt: skip
        np.testing.assert_allclose(after(change, "object_confidence"), expected, rtol=1e-6)
    np.testing.assert_allclose(after("small boxes", "object_box")[:, 4:6], now["object_box"][:, 4:6] / 2)
    path, there = now["forecast"], np.isfinite(now["forecast_log_weight"])
    weight = np.exp(now["forecast_log_weight"].astype(float))
    mean = np.einsum("ok,oktx->otx", weight / weight.sum(axis=1, keepdims=True), path)
    for change, factor in (("samples at their mean", 0.0), ("samples twice as wide", 2.0)):
        expected = mean[:, None] + factor * (path - mean[:, None])
        np.testing.assert_allclose(after(change, "forecast")[there], expected[there], atol=1e-3)
    waited = after("leaves late", "forecast")
    steps = round(2.0 / env.task.dt)
    assert not waited[:, :, :steps].any()
    np.testing.assert_array_equal(waited[:, :, steps:], path[:, :, :-steps])
    apart = np.linalg.norm(after("two peaks", "forecast") - path, axis=-1)
    np.testing.assert_allclose(apart, 4.0, atol=1e-4)


def test_every_attack_is_a_change_of_stp() -> None:
    assert {attack.partition(": ")[0] for attack in ATTACKS} == {"stp"}
    assert {attack.partition(": ")[2] for attack in ATTACKS} == {*CHANGES} - {*SCAN} | {
        "scale 0.5",
        "samples at their mean",
    }


def test_contacts_of_true_places_come_true() -> None:
    """Forecasts of what will happen leave the planner no contact that does not come; constant velocity does."""
    card = load_card("MTP-Drive-Intersection-v0")
    sums = chances_of_scene(card, MTPEnv(card).scene_names[6], [TRUTH])
    wrong = {agent: np.abs(each[:, 0] - each[:, 1]).sum() for agent, each in sums.items()}
    assert sums[ORACLE][:, 1].sum() > 5
    assert wrong[ORACLE] < 0.1 * sums[ORACLE][:, 1].sum() < wrong[TRUTH]


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
        measure_scene(card, name, [*AGENTS, "stp: everywhere", "stp: scale 0.5"], tmp_path)
    (tmp_path / "env.txt").write_text(f"{card.digest} {drive_card}")
    made = figures(Measured(tmp_path))
    assert (made["scenes"], {*made["rows"]}, {*made["attacks"]}) == (
        2,
        {*AGENTS},
        {"stp", "stp: everywhere", "stp: scale 0.5"},
    )
    rows = gains(tmp_path, "scan") | gains(tmp_path, "attacks")
    assert rows["stp"]["score"] + rows["stp: everywhere"]["gain"] == pytest.approx(rows["stp: everywhere"]["score"])
    assert rows["stp: scale 0.5"]["p by Holm"] >= rows["stp: scale 0.5"]["p"]
    pair = apart(tmp_path, ["blind", "stp"])
    assert pair["stp"]["gain"] == pytest.approx(rows["stp"]["score"] - pair["blind"]["score"])
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
