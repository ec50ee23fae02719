"""Operating points: what a forecast is worth, and the score from which on it is worth more than it costs."""

from __future__ import annotations

import math
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.agent import Pipeline
from mtp_bench.cards import load_card
from mtp_bench.env import MTPEnv
from mtp_bench.errors import SubmissionError
from mtp_bench.prediction import KinematicPredictor, KMeansSampler
from mtp_bench.running.run import run_scene
from mtp_bench.scoring import score_scene
from mtp_bench.submission.loader import load_submission
from mtp_bench.tracking import HypothesisTracker
from mtp_bench.training.operating_point import Worth, as_toml, gains, least_scores, worth_of_scene
from mtp_bench.types import Rollout, Scene
from tests.support.command_line import CommandLine
from tests.support.small_scenes import EchoAgent

ENV = "MTP-Merge-v0"
SCENE = "merge-010000"


@pytest.fixture(scope="module")
def env() -> MTPEnv:
    return MTPEnv(ENV, evaluation=True)


@pytest.fixture(scope="module")
def worth(env: MTPEnv) -> Worth:
    return worth_of_scene(agent(), env, SCENE)


def agent(**settings: Any) -> Pipeline:
    return Pipeline(HypothesisTracker(1), KinematicPredictor(), KMeansSampler(), **settings)


def error(scene: Scene, rollout: Rollout, env: MTPEnv) -> float:
    """The ranked error, summed."""
    score = score_scene(scene, rollout, env.card)
    return float(score.capped.sum()) + score.false_error


def silent(env: MTPEnv) -> Rollout:
    rollout = run_scene(agent(min_score=math.inf), env, SCENE, 0)
    assert len(rollout.object_box) == 0
    return rollout


def test_gains_are_what_an_agent_is_better_than_silence(env: MTPEnv) -> None:
    rollout = run_scene(agent(), env, SCENE, 0)
    gain = gains(env.scene, rollout, env.card)
    assert gain.sum() == pytest.approx(error(env.scene, silent(env), env) - error(env.scene, rollout, env))
    assert (gain > 0).sum() > 50
    assert (gain < 0).sum() > 20


def test_where_the_truth_is_not_complete_nothing_costs(card: str, kitti: str) -> None:
    env = MTPEnv(card, kitti, evaluation=True)
    rollout = run_scene(EchoAgent(), env, "0006", 0)
    box = rollout.object_box.copy()
    box[0, :2] += 1000
    odd = replace(rollout, object_box=box)
    cost = 0.5 * env.card.per_class(env.card.task.miss_error)[odd.object_class[0]]
    assert gains(env.scene, odd, env.card)[0] == -cost
    assert gains(replace(env.scene, truth_complete=False), odd, env.card)[0] == 0


def test_the_least_score_is_where_the_sum_of_gains_is_greatest() -> None:
    score, gain = np.array([5.0, 4.0, 4.0, 3.0, 2.0, 1.0]), np.array([1.0, -3.0, 2.5, 2.0, -1.0, 0.5])
    one = Worth(np.zeros(6, dtype=np.int64), score, gain)
    none = Worth(np.full(2, 2), np.array([9.0, 8.0]), np.array([-1.0, 0.5]))
    assert least_scores([one, none], ["car", "bus", "truck"]) == {"car": 3.0, "truck": math.inf}
    all_worth = Worth(one.class_id, score, np.abs(gain))
    assert least_scores([all_worth], ["car"]) == {"car": -math.inf}
    order = np.array([3, 0, 5, 2, 4, 1])
    assert least_scores([Worth(one.class_id, score[order], gain[order])], ["car"]) == {"car": 3.0}


def test_the_fitted_point_is_best_on_what_it_was_fitted_to(env: MTPEnv, worth: Worth) -> None:
    names = env.card.task.classes
    least = least_scores([worth], names)

    def of(points: dict[str, float]) -> float:
        return error(env.scene, run_scene(agent(min_score=points), env, SCENE, 0), env)

    fitted = of(least)
    rollout = run_scene(agent(), env, SCENE, 0)
    assert fitted < min(error(env.scene, rollout, env), error(env.scene, silent(env), env))
    for change in (-1.0, -0.3, 0.3, 1.0):
        assert fitted <= of({name: value + change for name, value in least.items()}) + 1e-9


def test_scores_are_those_of_the_forecasts(env: MTPEnv, worth: Worth) -> None:
    least = float(np.median(worth.score))
    kept = run_scene(agent(min_score=least), env, SCENE, 0)
    np.testing.assert_array_equal(kept.object_class, worth.class_id[worth.score >= least])


def test_points_per_class(env: MTPEnv) -> None:
    every = run_scene(agent(), env, SCENE, 0)
    no_cars = run_scene(agent(min_score={"car": math.inf}), env, SCENE, 0)
    assert set(every.object_class) > set(no_cars.object_class) == set(every.object_class) - {0}
    with pytest.raises(SubmissionError, match="unknown class in min_score 'cars'"):
        run_scene(agent(min_score={"cars": 1.0}), env, SCENE, 0)


def test_the_table_is_read_as_it_was_written() -> None:
    text = as_toml("MTP-X-v0", {"car": 2.64951, "bus": math.inf, "truck": -1.0001, "van": -math.inf})
    assert tomllib.loads(text) == {"MTP-X-v0": {"car": 2.649, "bus": math.inf, "truck": -1.001, "van": -math.inf}}


def test_the_command(cli: CommandLine, tmp_path: Path) -> None:
    arguments = ("train", "operating-point", "--env", ENV, "--scenes", 1)
    table = tomllib.loads(cli.ok(*arguments))[ENV]
    assert set(table) <= set(load_card(ENV).task.classes)
    assert cli(*arguments, "--observe", "truth").status == 2


def test_the_baseline_keeps_to_its_points_and_else_is_mtp(env: MTPEnv, tmp_path: Path) -> None:
    loaded = load_submission("mtp_selective")
    picky, every = (
        run_scene(load_submission(name).build(env.task), env, SCENE, 0) for name in ("mtp_selective", "mtp")
    )
    assert 0 < len(picky.object_box) < len(every.object_box)
    points = tomllib.loads((loaded.path / "operating_points.toml").read_text())[ENV]
    tracker, predictor, sampler = HypothesisTracker(20), KinematicPredictor(), KMeansSampler()
    same = run_scene(Pipeline(tracker, predictor, sampler, min_score=points), env, SCENE, 0)
    np.testing.assert_array_equal(picky.forecast, same.forecast)
    copy = Path(shutil.copytree(loaded.path, tmp_path / "copy"))
    (copy / "operating_points.toml").write_text("")
    as_mtp = run_scene(load_submission(copy).build(env.task), env, SCENE, 0)
    np.testing.assert_array_equal(as_mtp.forecast, every.forecast)
