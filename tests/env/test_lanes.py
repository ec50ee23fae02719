"""Lanes in observations: pieces of the road map, nearest first, in the moving frame of the episode."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from mtp_bench import MTPEnv
from mtp_bench.cards import load_card
from mtp_bench.core import Floats, Lane, Scene
from mtp_bench.core.errors import CardError, DataError
from tests.support.small_scenes import CARD, empty_action, make_scene, write_card

LANES = CARD.replace("[source]", "[lanes]\npieces = 4\npoints = 4\nreach = 30.0\n[source]").replace("kitti", "files")
FIELDS = ("lane_point", "lane_valid", "lane_next")


def lane(*points: tuple[float, float], following: tuple[int, ...] = ()) -> Lane:
    center = np.array(points, dtype=np.float64)
    return Lane(center, center, center, following)


# A road of 10 m along the way of the ego, which starts at (20, 10); two that follow, and one 75 m away.
ROAD = (
    lane((15, 12), (25, 12), following=(2, 1)),
    lane((25, 12), (28, 12)),
    lane((25, 12), (25, 14), following=(3,)),
    lane((25, 85), (25, 90)),
)


@pytest.fixture
def make_env(tmp_path: Path) -> Callable[..., MTPEnv]:
    def make(lanes: tuple[Lane, ...] = ROAD, content: str = LANES, **keywords: Any) -> MTPEnv:
        scene: Scene = replace(make_scene(), lanes=lanes, detector="pointrcnn")
        return MTPEnv(write_card(tmp_path, content), scenes=[scene], **keywords)

    return make


def test_pieces_share_end_points_and_know_their_successors(make_env: Callable[..., MTPEnv]) -> None:
    seen, _ = make_env().reset()
    turned = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    here = seen["lane_point"] @ turned.T + [20, 10]  # back in the frame of the scene
    shown = [here[i][seen["lane_valid"][i] == 1] for i in range(4)]
    # The road of 10 m has five steps of 2 m: a piece of four points and one of three.
    want: list[Any] = [
        [(15, 12), (17, 12), (19, 12), (21, 12)],
        [(21, 12), (23, 12), (25, 12)],
        [(25, 12), (26.5, 12), (28, 12)],
    ]
    for got, points in zip(shown, [*want, [(25, 12), (25, 14)]], strict=True):
        np.testing.assert_allclose(got, points, atol=1e-5)
    assert seen["lane_next"].tolist() == [[1, -1, -1, -1], [3, 2, -1, -1], [-1] * 4, [-1] * 4]
    assert not seen["lane_point"][seen["lane_valid"] == 0].any()
    few, _ = make_env(content=LANES.replace("pieces = 4", "pieces = 2")).reset()
    assert few["lane_next"].tolist() == [[1, -1, -1, -1], [-1] * 4]
    np.testing.assert_array_equal(few["lane_point"], seen["lane_point"][:2])


def around_ego(seen: dict[str, Any]) -> Floats:
    x, y, _, yaw = seen["ego_pose"].astype(np.float64)
    away = seen["lane_point"].astype(np.float64) - [x, y]
    turned = away @ np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return np.where(seen["lane_valid"][..., None] == 1, turned, 0.0)


def test_the_map_moves_with_the_scene_and_is_the_same_without_truth(make_env: Callable[..., MTPEnv]) -> None:
    plain, moved = make_env(), make_env(rigid_motion=True, evaluation=True)
    seen, other = plain.reset(seed=1)[0], moved.reset(seed=1)[0]
    for _ in range(8):
        assert not np.allclose(other["lane_point"], seen["lane_point"], atol=1.0)
        np.testing.assert_allclose(around_ego(other), around_ego(seen), atol=1e-3)
        for name in FIELDS[1:]:
            np.testing.assert_array_equal(other[name], seen[name])
        assert plain.observation_space.contains(seen)
        assert moved.observation_space.contains(other)
        seen, other = plain.step(empty_action(plain.task))[0], moved.step(empty_action(moved.task))[0]


def test_gymnasium_takes_an_env_with_lanes(make_env: Callable[..., MTPEnv]) -> None:
    env: gymnasium.Env[Any, Any] = make_env(observe="truth")
    check_env(env, skip_render_check=True)
    vector: Any = SyncVectorEnv([make_env, make_env], autoreset_mode=AutoresetMode.SAME_STEP)
    assert vector.reset(seed=0)[0]["lane_point"].shape == (2, 4, 4, 2)


@pytest.mark.parametrize(
    ("lanes", "message"),
    [
        ((), "has no lanes"),
        ((lane((0, 0)),), "expected 2 or more points \\[n, 2\\] of finite metres"),
        ((lane((0, 0), (np.nan, 0)),), "expected 2 or more points"),
        ((lane((0, 0), (1, 0), following=(1,)),), "expected lanes from 0 to 0"),
    ],
    ids=["none", "one point", "NaN", "unknown successor"],
)
def test_lanes_that_cannot_be_shown(lanes: tuple[Lane, ...], message: str, make_env: Callable[..., MTPEnv]) -> None:
    with pytest.raises(DataError, match=message):
        make_env(lanes).reset()


def test_lanes_of_a_card(tmp_path: Path) -> None:
    plain = load_card(write_card(tmp_path, CARD.replace("kitti", "files")))
    switched = {value: load_card(write_card(tmp_path, f"lanes = {value}\n{CARD}".replace("kitti", "files")))
                for value in ("true", "false")}  # fmt: skip
    assert switched["false"].digest == plain.digest != switched["true"].digest
    apart = CARD.replace('"kitti"', '"files"\nego_motion = false')
    wrong = {f"lanes = true\n{CARD}": "source 'kitti', without a road map", f"lanes = true\n{apart}": "separate axes",
             f"drive = true\n{CARD}": "nothing drives in source 'kitti'"}  # fmt: skip
    for content, message in wrong.items():
        with pytest.raises(CardError, match=message):
            load_card(write_card(tmp_path, content))
