"""Every flat action is sound, and its entries mean what the columns say."""

from __future__ import annotations

import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import FlattenObservation

from mtp_bench import ActionError, MtpBenchError
from mtp_bench.env.checks import examine
from mtp_bench.wrappers import FlattenAction
from tests.env.test_gymnasium import SMALL, make_small

INVALID = ("invalid_tracks", "invalid_hypotheses", "invalid_objects")


@pytest.fixture
def env(card: str, kitti: str) -> FlattenAction:
    """The small card: N 3, H 2, O 2, K 2, T 3."""
    return FlattenAction(make_small(card, kitti, **SMALL))


def test_the_columns_are_the_fields_in_their_order(env: FlattenAction) -> None:
    sizes = {name: part.stop - part.start for name, part in env.columns.items()}
    assert list(sizes.values()) == [21, 3, 3, 6, 2, 2, 14, 2, 2, 2, 2 * 2 * 3 * 2, 2 * 2]
    assert "track_id" not in sizes
    assert env.action_space.shape == (sum(sizes.values()),)


@pytest.mark.parametrize(("value", "count"), [(-1.0, 0), (0.0, 0), (1.0, 2)])
def test_the_ends_of_the_range(value: float, count: int, env: FlattenAction) -> None:
    action = env.action(np.full(env.action_space.shape or (), value))
    assert action["object_valid"].sum() == count
    np.testing.assert_allclose(action["object_box"][0, :4], value * np.array([100, 100, 100, np.pi]), rtol=1e-6)
    np.testing.assert_allclose(action["object_box"][0, 4:], 10.05 + 9.95 * value, rtol=1e-5)
    np.testing.assert_allclose(action["forecast"][0, 0, :, 0], value * 20.0 * 0.1 * np.array([1, 2, 3]), rtol=1e-5)
    assert action["object_class"].tolist() == [{-1.0: 0, 0.0: 1, 1.0: 1}[value]] * 2
    assert action["track_class"].tolist() == [{-1.0: -1, 0.0: 0, 1.0: 1}[value]] * 3
    np.testing.assert_allclose(action["object_confidence"], (1 + value) / 2)
    np.testing.assert_allclose(action["forecast_log_weight"], 5 * (value - 1))
    assert action["track_id"].tolist() == [0, 1, 2]


def test_no_speed_leads_out_of_the_action_space(card: str, kitti: str) -> None:
    fast = FlattenAction(make_small(card, kitti, **SMALL), speed=1e6)
    action = fast.action(np.ones(fast.action_space.shape or (), np.float32))
    assert not examine(action, fast.get_wrapper_attr("task")).problems
    assert fast.env.action_space["forecast"].contains(action["forecast"])  # type: ignore[index]


WRONG = {"reach": (0, -1.0, float("nan"), float("inf"), "x", True), "speed": (0, -1, float("nan"), None)}


@pytest.mark.parametrize(("name", "value"), [(name, value) for name in WRONG for value in WRONG[name]])
def test_a_reach_or_a_speed_that_is_none(name: str, value: Any, card: str, kitti: str) -> None:
    said = rf"{name} is {value!r}, expected a finite number above 0 \(FlattenAction\)"
    with pytest.raises(MtpBenchError, match=said):
        FlattenAction(make_small(card, kitti, **SMALL), **{name: value})


def test_a_reach_beyond_the_coordinates_of_the_env(card: str, kitti: str) -> None:
    with pytest.raises(MtpBenchError, match=r"reach is 200000\.0, expected at most 100000 m.* \(FlattenAction\)"):
        FlattenAction(make_small(card, kitti, **SMALL), reach=2e5)
    far = FlattenAction(make_small(card, kitti, **SMALL), reach=1e5)
    assert not examine(
        far.action(np.ones(far.action_space.shape or (), np.float32)), far.get_wrapper_attr("task")
    ).problems


def test_around_another_action_it_is_refused(env: FlattenAction) -> None:
    with pytest.raises(MtpBenchError, match="action_space of the env is a Box, expected the Dict that it has before"):
        FlattenAction(env)  # type: ignore[arg-type]


def test_a_random_flat_action_is_sound_and_nothing_is_said_of_it(env: FlattenAction) -> None:
    space: Any = env.action_space
    space.seed(0)
    env.reset(seed=0)
    for _ in range(50):
        flat = space.sample()
        assert not examine(env.action(flat), env.get_wrapper_attr("task")).problems
        *_, truncated, info = env.step(flat)
        assert not any(info[name] for name in INVALID)
        if truncated:
            env.reset()


@pytest.mark.parametrize(
    ("flat", "text"),
    [
        (np.zeros(3), "the flat action has shape (3,), expected a vector of 85 finite numbers from -1 to 1"),
        (None, "the flat action has shape (), expected a vector of 85"),
        ("forecast", "the flat action is a str, expected a vector of 85"),
        (np.r_[np.zeros(80), np.nan, np.zeros(4)], "the flat action is not finite, expected a vector of 85"),
    ],
    ids=["shape", "None", "text", "NaN"],
)
def test_what_is_no_vector_is_one_clear_error(flat: Any, text: str, env: FlattenAction) -> None:
    env.reset()
    with pytest.raises(ActionError) as caught:
        env.step(flat)
    assert text in str(caught.value)


def test_both_checkers_accept_it(env: FlattenAction) -> None:
    flat: Any = FlattenObservation(env)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", ".*is different from the unwrapped version.*")  # said of every wrapper
        check_env(flat, skip_render_check=True)
        sb3 = pytest.importorskip("stable_baselines3.common.env_checker", reason="stable-baselines3 is not installed")
        sb3.check_env(flat)


def test_it_works_at_the_sizes_of_a_card() -> None:
    env = FlattenAction(gym.make("MTP-Intersection-v0"))
    space: Any = env.action_space
    space.seed(0)
    env.reset(seed=0)
    *_, info = env.step(space.sample())
    assert not any(info[name] for name in INVALID)
