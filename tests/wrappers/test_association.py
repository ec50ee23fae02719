"""The agent associates, the wrapper does the rest: its rules, its observation, and what simple policies earn."""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray

from mtp_bench import ActionError, MTPEnv
from mtp_bench.wrappers import CONTINUE, IGNORE, NEW, AssociationOnly, PerDetection
from tests.env.conftest import MakeEnv, make_env as make_env
from tests.env.test_gymnasium import make_small
from tests.support.small_scenes import make_scene


@pytest.fixture
def env(make_env: MakeEnv) -> AssociationOnly:
    """A car along x, seen surest, a car along y, and a walker, who is seen least surely; one frame has no detection."""
    return AssociationOnly(make_env(make_scene(frames=8, empty=(5,))), detections=4, choices=2)


def play(env: AssociationOnly, *choices: list[int]) -> Any:
    """What the env was told of the tracks, frame by frame, after these choices and the nearest for the other frames."""
    observation, _ = env.reset(seed=0)
    over, t = False, 0
    while not over:
        choice = np.array(choices[t]) if t < len(choices) else env.nearest(observation)
        observation, _, over, *_ = env.step(choice)
        t += 1
    inner = env.unwrapped
    assert isinstance(inner, MTPEnv)
    rollout = inner.rollout()
    return [rollout.track_id[rollout.tracks.rows(t)].tolist() for t in range(rollout.frames)]


def test_the_nearest_neighbour_keeps_the_identities(env: AssociationOnly) -> None:
    assert play(env) == [[0, 1, 2]] * 8  # also in the frame without a detection


def test_ignored_detections_have_no_track(env: AssociationOnly) -> None:
    assert play(env, *[[IGNORE] * 4] * 8) == [[]] * 8


def test_what_cannot_be_continued_is_ignored(env: AssociationOnly) -> None:
    """Nothing is there yet; then the cars are 20 m apart, and the walker is of another class."""
    far = [CONTINUE + 1] * 4
    assert play(env, [CONTINUE] * 4, far, [NEW, IGNORE, IGNORE, IGNORE], far, far, far)[:6] == [
        [], [], [0], [0], [0], []
    ]  # fmt: skip


def test_of_two_that_continue_a_track_the_nearer_one_does(make_env: MakeEnv) -> None:
    env = AssociationOnly(make_env(make_scene()), detections=4, choices=1, near=1000.0)
    first, _ = env.reset(seed=0)
    assert (env.table(first)[:3, 4:6] == [[1, 0], [1, 0], [0, 1]]).all()  # two cars, a walker
    env.step(np.array([IGNORE, NEW, IGNORE, IGNORE]))
    env.step(np.array([CONTINUE, CONTINUE, CONTINUE, IGNORE]))
    inner = env.unwrapped
    assert isinstance(inner, MTPEnv)
    box = inner._episode.actions[-1].track_box  # type: ignore[union-attr]
    np.testing.assert_allclose(box[:, :2], [[40.1, 5.5]], atol=1e-3)  # the second car itself


def test_columns_of_the_observation(env: AssociationOnly) -> None:
    observation, _ = env.reset(seed=0)
    table = env.table(observation)
    assert (table.shape, table[:, 0].tolist()) == ((4, 4 + 2 + 2 * 4), [1, 1, 1, 0])
    np.testing.assert_allclose(table[:3, 1], [3 / 4, 1 / 2, -2 / 3], rtol=1e-6)  # scores 3, 1, -2
    # The car is 0.1 m along the scene's x axis, 0.5 rad to the right of the platform's heading.
    np.testing.assert_allclose(table[0, 2:4], 0.001 * np.array([np.cos(0.5), -np.sin(0.5)]), atol=1e-6)
    assert not table[:, 6:].any(), "there is no track yet"
    assert not table[3].any()
    observation, *_ = env.step(np.array([NEW, IGNORE, NEW, IGNORE]))
    near = env.table(observation)[:3, 6:].reshape(3, 2, 4)
    np.testing.assert_allclose(near[0, 0], [1, 1 - 0.8 / 10, 0, 0], atol=1e-5)  # it moves 0.8 m per frame
    np.testing.assert_allclose(near[2, 0], [1, 1, 0, 0], atol=1e-5)  # the walker stands still
    assert not near[:, 1].any()
    assert not near[1].any(), "the other car is 20 m away"
    observation, *_ = env.step(np.array([CONTINUE, IGNORE, IGNORE, IGNORE]))
    near = env.table(observation)[:3, 6:].reshape(3, 2, 4)
    np.testing.assert_allclose(near[0, 0], [1, 1, 0.5, 0], atol=1e-5)  # now its velocity is known
    np.testing.assert_allclose(near[2, 0], [1, 1, 0, 1 / 3], atol=1e-5)  # the walker waited a frame


@pytest.mark.parametrize("action", [
    None, [0, 0], [0, 0, 0, 4], [-1, 0, 0, 0], [0.5, 0, 0, 0], [[1], [1, 2]], np.zeros((4, 4), dtype=int),
], ids=str)  # fmt: skip
def test_what_is_no_choice_is_one_clear_error(action: Any, env: AssociationOnly) -> None:
    env.reset()
    with pytest.raises(ActionError, match="expected 4 whole numbers from 0 to 3"):
        env.step(action)
    one_by_one = PerDetection(env)
    one_by_one.reset()
    with pytest.raises(ActionError, match="expected a whole number from 0 to 3"):
        one_by_one.step(action)


def test_the_reward_is_that_of_the_env_less_that_of_the_nearest_neighbour(make_env: MakeEnv) -> None:
    """Also where the episode begins with tracks, and choice by choice."""
    episodes = {}
    for name, policy in POLICIES.items():
        for kind in ("absolute", "relative", "one by one"):
            inner = make_env(make_scene(frames=12, empty=(5,)), target_frames=True)
            env: Any = AssociationOnly(inner, detections=4, choices=2, relative=kind != "absolute")
            env = PerDetection(env) if kind == "one by one" else env
            observation, info = env.reset(seed=0)
            assert observation[6] == 1, "the first car was seen in the frame before"
            rewards, absolute, over = [], 0.0, False
            while not over:
                observation, reward, over, _, info = env.step(policy(env, observation))
                rewards.append(reward)
                absolute += info.get("absolute_reward", 0.0)
            episodes[name, kind] = rewards
            assert absolute == pytest.approx(-sum(info["episode_metrics"][cost] for cost in COSTS))
        assert len(rewards) == 7 * 3 + 1, "a frame without a detection is a step"
        usual = sum(episodes["nearest", "absolute"])
        assert sum(episodes[name, "relative"]) == pytest.approx(sum(episodes[name, "absolute"]) - usual)
        assert sum(episodes[name, "one by one"]) == pytest.approx(sum(episodes[name, "relative"]))
    assert not any(episodes["nearest", "relative"] + episodes["nearest", "one by one"])
    assert all(episodes["ignore", "one by one"][:2]), "a choice earns at once what it changes"


@pytest.mark.parametrize("rigid_motion", [False, True])
def test_what_the_nearest_neighbour_earns_is_kept_while_scenes_stay_the_same(
    rigid_motion: bool, make_env: MakeEnv, monkeypatch: pytest.MonkeyPatch
) -> None:
    env = AssociationOnly(make_env(make_scene(frames=12), rigid_motion=rigid_motion), detections=4)
    asked: list[float] = []
    reward_of = MTPEnv.reward_of

    def counted(self: MTPEnv, action: Any) -> float:
        asked.append(reward_of(self, action))
        return asked[-1]

    monkeypatch.setattr(MTPEnv, "reward_of", counted)
    for _ in range(2):  # cut short: nothing is kept of it
        env.reset(seed=0)
        env.step(np.full(4, NEW))
    assert len(asked) == 2
    episodes = []
    for _ in range(2):
        observation, _ = env.reset(seed=0)
        rewards, over = [], False
        while not over:
            observation, reward, over, *_ = env.step(POLICIES["begin"](env, observation))
            rewards.append(float(reward))
        episodes.append(rewards)
    assert len(asked) == 2 + 12 * (2 if rigid_motion else 1)
    assert any(episodes[0])
    assert episodes[0] == episodes[1]


COSTS = ("cost_missed", "cost_false", "cost_error")
POLICIES: dict[str, Callable[[Any, NDArray[np.float32]], Any]] = {
    "nearest": lambda env, observation: env.nearest(observation),
    "ignore": lambda env, observation: IGNORE * env.nearest(observation),
    "begin": lambda env, observation: NEW + 0 * env.nearest(observation),
}


@pytest.mark.parametrize("wrap", [lambda env: env, PerDetection], ids=["all at once", "one by one"])
def test_both_checkers_accept_it(wrap: Any, card: str, kitti: str) -> None:
    env: Any = wrap(AssociationOnly(make_small(card, kitti), detections=4))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", ".*is different from the unwrapped version.*")  # said of every wrapper
        check_env(env, skip_render_check=True)
        sb3 = pytest.importorskip("stable_baselines3.common.env_checker", reason="stable-baselines3 is not installed")
        sb3.check_env(env)
