"""The env as Gymnasium sees it: registration, checker, specs, vector envs."""

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import mtp_bench
from mtp_bench import MTPEnv
from mtp_bench.cards import load_card, with_split
from mtp_bench.sources import load_scenes
from mtp_bench.sources.base import lane_around
from tests.support.small_scenes import CARD_ID

SMALL: dict[str, Any] = {"samples": 2, "max_tracks": 3, "max_objects": 2, "hypotheses": 2, "max_detections": 4}


def check(env: gym.Env[Any, Any]) -> None:
    """Gymnasium's checker, with every warning an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


@pytest.mark.parametrize(
    "keywords", [SMALL, {"observe": "truth"}, {"evaluation": True}, {"rigid_motion": True}], ids=str
)
def test_checker_on_a_small_card(keywords: dict[str, Any], card: str, kitti: str) -> None:
    check(make_small(card, kitti, **keywords))


def make_small(card: str, data: str, **keywords: Any) -> gym.Env[Any, Any]:
    spec = EnvSpec(id=CARD_ID, entry_point="mtp_bench:MTPEnv", kwargs={"card": card, "data": data, **keywords})
    return gym.make(spec)


NEEDS_NO_DATA = [env_id for env_id in mtp_bench.card_ids() if mtp_bench.load_card(env_id).simulated]
RECORDED = [env_id for env_id in mtp_bench.card_ids() if env_id not in NEEDS_NO_DATA]
EVERY_CARD = [*NEEDS_NO_DATA, *(pytest.param(env_id, marks=pytest.mark.data) for env_id in RECORDED)]


# Of validation scenes there are none here, and of CenterPoint no detections either.
TRAINING: dict[str, dict[str, Any]] = {
    "MTP-nuScenes-v0": {"split": "train"},
    "MTP-nuScenes-3s-v0": {"split": "train"},
    "MTP-nuScenes-CenterPoint-v0": {"split": "train", "detector": "megvii"},
}


def make_here(env_id: str) -> gym.Env[Any, Any]:
    """The env on the first scene that there is: of nuScenes one of training.

    The map expansion of nuScenes is never there: a lane along the way of the ego stands in.
    """
    if env_id == "MTP-nuScenes-Lanes-v0":
        scene = next(load_scenes(with_split(load_card("MTP-nuScenes-v0"), "train")))
        return gym.make(env_id, scenes=[replace(scene, lanes=(lane_around(scene.ego[:, :2], False),))])
    keywords = TRAINING.get(env_id, {})
    return gym.make(env_id, scenes=MTPEnv(env_id, **keywords).scene_names[:1], **keywords)


@pytest.mark.parametrize("env_id", EVERY_CARD)
def test_the_checker_and_random_agents_on_every_card(env_id: str) -> None:
    env = make_here(env_id)
    check(env)
    env.action_space.seed(0)
    env.reset(seed=0)
    for _ in range(30):
        _, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert np.isfinite(float(reward))
        assert not truncated
        assert info["dropped_detections"] == 0
        if terminated:
            break


def test_checker_would_notice_a_wrong_observation(card: str, kitti: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mtp_bench.env.observation.COORDINATE_LIMIT", np.inf)
    monkeypatch.setattr("mtp_bench.env.spaces.COORDINATE_LIMIT", 0.01)
    with pytest.raises(AssertionError, match="not within the observation space"):
        check(make_small(card, kitti))


@pytest.mark.parametrize(("env_id", "observe"), [("MTP-Roundabout-v0", "truth"), ("MTP-KITTI-v0", "associated")])
def test_a_spec_survives_json(env_id: str, observe: str, kitti: str) -> None:
    scene = "0006" if "KITTI" in env_id else MTPEnv(env_id).scene_names[0]
    made = gym.make(env_id, data=kitti, observe=observe, samples=3, scenes=[scene], rigid_motion=True)
    assert made.spec is not None
    again = gym.make(EnvSpec.from_json(made.spec.to_json()))
    for env in (made.unwrapped, again.unwrapped):
        assert isinstance(env, MTPEnv)
        assert (env.task.env_id, env.task.observe, env.task.samples, env.scene_names) == (env_id, observe, 3, (scene,))
    first, second = made.reset(seed=3)[0], again.reset(seed=3)[0]
    for key in first:
        np.testing.assert_array_equal(first[key], second[key])


WRAPPERS: dict[str, Callable[[Any], gym.Env[Any, Any]]] = {
    "TimeLimit": lambda env: wrappers.TimeLimit(env, 3),
    "Autoreset": wrappers.Autoreset,
    "PassiveEnvChecker and OrderEnforcing": lambda env: wrappers.OrderEnforcing(wrappers.PassiveEnvChecker(env)),
    "RecordEpisodeStatistics": wrappers.RecordEpisodeStatistics,
    "RenderCollection": wrappers.RenderCollection,
    "AddRenderObservation": lambda env: wrappers.AddRenderObservation(env, render_only=False),
    "ClipReward": lambda env: wrappers.ClipReward(env, -1, 0),
    "NormalizeReward": wrappers.NormalizeReward,
    "TransformReward": lambda env: wrappers.TransformReward(env, lambda reward: 2 * float(reward)),
    "FilterObservation": lambda env: wrappers.FilterObservation(env, ["detection_box", "detection_valid"]),
    "FlattenObservation": wrappers.FlattenObservation,
    "FrameStackObservation": lambda env: wrappers.FrameStackObservation(env, 3),
    "DelayObservation": lambda env: wrappers.DelayObservation(wrappers.FlattenObservation(env), 1),
    "NormalizeObservation": lambda env: wrappers.NormalizeObservation(wrappers.FlattenObservation(env)),
    "DtypeObservation": lambda env: wrappers.DtypeObservation(wrappers.FlattenObservation(env), np.float32),
    "TimeAwareObservation": lambda env: wrappers.TimeAwareObservation(
        wrappers.TimeLimit(env, 99), flatten=False, dict_time_key="step"
    ),
    "TransformAction": lambda env: wrappers.TransformAction(env, lambda action: action, env.action_space),
    "StickyAction": lambda env: wrappers.StickyAction(env, 0.5),
    "RepeatAction": lambda env: wrappers.RepeatAction(env, 2),
    "MaxAndSkipObservation": lambda env: wrappers.MaxAndSkipObservation(wrappers.FlattenObservation(env), 2),
}


@pytest.mark.filterwarnings("ignore:.*precision lowered by casting")
@pytest.mark.parametrize("name", WRAPPERS)
def test_wrappers_of_gymnasium(name: str, card: str, kitti: str) -> None:
    env = WRAPPERS[name](make_small(card, kitti, render_mode="rgb_array", **SMALL))
    env.action_space.seed(0)
    observation, info = env.reset(seed=0)
    over = False
    while not over:
        assert env.observation_space.contains(observation)
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert np.isfinite(float(reward))
        over = terminated or truncated
    assert (truncated, "episode" in info) == (name == "TimeLimit", name == "RecordEpisodeStatistics")
    assert ("episode_metrics" in info) == terminated
    env.close()


ASYNC = [  # processes start for each: one mode of resetting will do
    ("async", AutoresetMode.NEXT_STEP), ("async, no shared memory", AutoresetMode.SAME_STEP),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "mode"), [*(("sync", mode) for mode in AutoresetMode), *ASYNC])
def test_vector_envs(kind: str, mode: AutoresetMode, card: str, kitti: str) -> None:
    def make() -> gym.Env[Any, Any]:
        return make_small(card, kitti)

    envs: Any
    if kind == "sync":
        envs = SyncVectorEnv([make, make], autoreset_mode=mode)
    else:
        envs = AsyncVectorEnv([make, make], shared_memory=kind == "async", context="spawn", autoreset_mode=mode)
    envs = RecordEpisodeStatistics(envs)
    try:
        envs.action_space.seed(0)
        observation, info = envs.reset(seed=[1, 2], options={"scene": "0006"})
        assert (observation["detection_box"].shape, observation["time"].shape) == ((2, 6, 7), (2,))
        for t in range(9):  # the scene has 7 frames: the eighth step is an automatic reset in mode "next step"
            assert envs.observation_space.contains(observation)
            observation, reward, terminated, truncated, info = envs.step(envs.action_space.sample())
            assert np.isfinite(reward).all()
            assert not truncated.any()
            assert (terminated.tolist(), info["dropped_detections"].tolist()) == ([t == 6] * 2, [0, 0])
            if t == 6:
                last = info.get("final_info", info)
                assert ("final_info" in info) == (mode == AutoresetMode.SAME_STEP)
                np.testing.assert_allclose(-info["episode"]["r"], error(last["episode_metrics"]), rtol=1e-5)
                if mode == AutoresetMode.DISABLED:
                    envs.reset(options={"reset_mask": terminated})
        assert info["frame"].tolist() == [1 if mode == AutoresetMode.NEXT_STEP else 2] * 2
    finally:
        envs.close()


def error(metrics: dict[str, Any]) -> Any:
    return metrics["cost_missed"] + metrics["cost_false"] + metrics["cost_error"]
