"""An episode in rerun while it is played: what is logged equals what was answered, and evaluations show no truth."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest
from gymnasium.envs.registration import EnvSpec

from mtp_bench import MTPEnv
from mtp_bench.viz.rerun.entities import TOP_SAMPLES
from mtp_bench.viz.rerun.sdk import rr
from tests.support.recordings import Rows, assert_recorded, read
from tests.support.small_scenes import CARD_ID, full_action


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[Path]:
    """The file of the user's active recording."""
    before = rr.get_global_data_recording()
    rr.set_strict_mode(True)
    stream = rr.RecordingStream("user", make_default=True)
    stream.save(tmp_path / "live.rrd")
    yield tmp_path / "live.rrd"
    rr.set_strict_mode(False)
    if before is not None:
        rr.set_global_data_recording(before)


def play(card: str, data: str, episodes: int = 1, **keywords: Any) -> MTPEnv:
    spec = EnvSpec(id=CARD_ID, entry_point="mtp_bench:MTPEnv", kwargs={"card": card, "data": data, **keywords})
    env = gym.make(spec, render_mode="rerun").unwrapped
    assert isinstance(env, MTPEnv)
    for episode in range(episodes):
        env.reset(seed=episode)
        over = False
        while not over:
            over = env.step(full_action(env.task))[2]
    env.close()
    stream = rr.get_global_data_recording()
    assert stream is not None
    stream.disconnect()  # completes the file
    return env


def episodes(path: Path) -> list[dict[str, Rows]]:
    """Entities of each episode of a recording, in the order of their numbers."""
    found: dict[int, dict[str, Rows]] = {}
    for entity, rows in read(path).items():
        if entity.startswith("episode-"):
            root, name = entity.split("/", 1)
            found.setdefault(int(root.removeprefix("episode-")), {})[name] = rows
    return [found[number] for number in sorted(found)]


def test_what_is_logged_is_what_was_answered(card: str, kitti: str, recording: Path) -> None:
    env = play(card, kitti, scenes=["0001"])
    found, rollout = episodes(recording)[-1], env.rollout()
    assert_recorded(found, env.scene, rollout, range(2), TOP_SAMPLES)
    assert sorted(t for t in found["world/det"] if t >= 0) == list(range(rollout.frames))


def test_an_evaluation_shows_nothing_of_the_truth(card: str, kitti: str, recording: Path) -> None:
    play(card, kitti, evaluation=True)
    (found,) = episodes(recording)
    assert {"world/det", "world/ego", "world/forecast", "world/hyp/00/box"} <= set(found)
    secret = ("gt", "curves", "marks", "events", "identity", "focus")
    assert not any(word in path for word in secret for path in found)


def test_an_episode_of_another_env_has_its_own_place_too(card: str, kitti: str, recording: Path) -> None:
    for _ in range(2):
        env = MTPEnv(card, data=kitti, render_mode="rerun", scenes=["0001"])
        env.reset(seed=0)
        env.step(full_action(env.task))
        env.close()
    stream = rr.get_global_data_recording()
    assert stream is not None
    stream.disconnect()
    assert ["world/det" in found for found in episodes(recording)] == [True, True]
