"""The runner: agents through scenes, in one process or several, with the same result."""

from pathlib import Path

from mtp_bench import MTPEnv
from mtp_bench.agent import load_submission
from mtp_bench.env.rollouts import digest
from mtp_bench.running.playing import agent_task, run_scene
from mtp_bench.running.settings import setting_of
from mtp_bench.running.stored import run_info
from tests.support.command_line import write_submission
from tests.support.runs import run_scenes
from tests.support.small_scenes import make_noisy

NAMES = ["0006", "0001", "0008"]


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


def test_run_info_says_where_a_run_comes_from(card: str, kitti: str, tmp_path: Path) -> None:
    env = MTPEnv(card, kitti, observe="truth", samples=7, rigid_motion=True)
    tables = '[parameters]\nnoise = 0.1\nrivals = 5\n[compare]\nhypotheses = "rivals"'
    submission = load_submission(write_submission(tmp_path / "echo", tables=tables))
    info = run_info(env, setting_of(submission, env.card), 3, {"rigid_motion": True, "samples": 7})
    assert (info.env_id, info.observe, info.samples, info.split) == ("MTP-Small-v0", "truth", 7, "val")
    assert (info.card_digest, info.keywords) == (env.card.digest, {"rigid_motion": True})
    assert (info.agent, info.seed, info.hypotheses, info.submission_digest) == ("echo", 3, 5, submission.digest)
    assert {"python", "mtp-bench", "numpy"} <= info.versions.keys()
    assert kitti not in info.model_dump_json()
