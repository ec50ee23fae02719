"""The runner: agents through scenes, in one process or several, with the same result."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mtp_bench.agent import Agent
from mtp_bench.cards import Card
from mtp_bench.env import MTPEnv
from mtp_bench.env.rollouts import digest
from mtp_bench.errors import SubmissionError, UnknownNameError
from mtp_bench.running.run import agent_task, run_scene
from mtp_bench.running.settings import setting_of
from mtp_bench.running.stored import run_info
from mtp_bench.submission import load_submission
from mtp_bench.types import Rollout, Scene, Task
from tests.support.command_line import write_submission
from tests.support.runs import run_scenes
from tests.support.small_scenes import Action, EchoAgent, make_noisy

NAMES = ["0006", "0001", "0008"]


@dataclass
class FailingAgent:
    """Fails at one frame, or at reset with -1."""

    at: int
    frame: int = 0

    def reset(self, task: Task) -> None:
        self.frame = 0
        if self.at < 0:
            raise RuntimeError("no weights")

    def act(self, observation: dict[str, NDArray[Any]]) -> Action:
        self.frame += 1
        if self.frame > self.at:
            raise ZeroDivisionError("by zero")
        return {}


def make_failing(task: Task) -> FailingAgent:
    return FailingAgent(at=2)


def make_misspelt(task: Task) -> Agent:
    raise UnknownNameError("parameter", "nosie", ["noise"])


def summary(scene: Scene, rollout: Rollout, card: Card) -> tuple[str, int, str]:
    return scene.name, len(scene.truth.box), card.id


def test_a_scene_is_run_from_the_first_to_the_last_frame(card: str, kitti: str) -> None:
    env = MTPEnv(card, kitti, evaluation=True)
    rollout = run_scene(EchoAgent(), env, "0006", seed=0)
    assert rollout.scene == "0006"
    assert rollout.frames == 7
    assert np.diff(rollout.track_start).tolist() == [3, 3, 3, 0, 0, 3, 3]
    np.testing.assert_allclose(rollout.track_box, env.scene.detections.box, atol=1e-4)
    assert (rollout.seconds > 0).all()
    assert rollout.seconds.sum() < 60


def test_results_come_in_the_order_of_the_names_whatever_the_number_of_jobs(card: str, kitti: str) -> None:
    alone = run_scenes(make_noisy, card, {"data": kitti}, NAMES, seed=5, workers=1)
    together = run_scenes(make_noisy, card, {"data": kitti}, NAMES, seed=5, workers=2)
    assert [rollout.scene for rollout in alone] == NAMES
    assert [digest(rollout) for rollout in alone] == [digest(rollout) for rollout in together]
    assert len({digest(rollout) for rollout in alone}) == 3
    env = MTPEnv(card, kitti, evaluation=True)
    seeds = {agent_task(env, seed, name).seed for seed in (0, 1) for name in NAMES}
    assert len(seeds) == 6, "the seed of an agent mixes that of the run and the scene"
    again = run_scene(make_noisy(env.task), env, NAMES[0], seed=5)
    assert digest(again) == digest(alone[0]), "whatever the seed was when the agent was built"


def test_a_failing_agent_is_named_with_scene_and_frame(card: str, kitti: str) -> None:
    text = "agent 'mine' failed on scene '0001' at frame 2: ZeroDivisionError: by zero"
    with pytest.raises(SubmissionError, match=text):
        run_scenes(make_failing, card, {"data": kitti}, ["0001"] * 2, workers=2)


def test_a_misspelt_parameter_is_one_clear_error(card: str, kitti: str) -> None:
    with pytest.raises(SubmissionError, match="cannot be built: unknown parameter 'nosie': did you mean 'noise'"):
        run_scenes(make_misspelt, card, {"data": kitti}, ["0001"])


def test_run_info_says_where_a_run_comes_from(card: str, kitti: str, tmp_path: Path) -> None:
    env = MTPEnv(card, kitti, observe="truth", samples=7, rigid_motion=True)
    tables = '[parameters]\nnoise = 0.1\nrivals = 5\n[compare]\nhypotheses = "rivals"'
    submission = load_submission(write_submission(tmp_path / "echo", tables=tables))
    info = run_info(env, setting_of(submission, env.card), 3, {"rigid_motion": True, "samples": 7})
    assert (info.env_id, info.observe, info.samples, info.split) == ("MTP-Small-v0", "truth", 7, "val")
    assert info.card_digest == env.card.digest
    assert info.keywords == {"rigid_motion": True}
    assert (info.agent, info.seed, info.hypotheses, info.submission_digest) == ("echo", 3, 5, submission.digest)
    assert {"python", "mtp-bench", "numpy"} <= info.versions.keys()
    assert kitti not in info.model_dump_json()
