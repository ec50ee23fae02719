"""The env on scenes in memory: what is shown, what is taken, what is never told."""

import json
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import Any

import gymnasium.spaces.utils as space_utils
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from mtp_bench import MTPEnv
from mtp_bench.core import Rollout, Scene
from mtp_bench.core.errors import DataError, MtpBenchError, RolloutError, UnknownNameError
from mtp_bench.env.rollouts import digest
from mtp_bench.scoring import live_frames, score_scene
from tests.env.conftest import MakeEnv
from tests.support.small_scenes import Action, EchoAgent, bare_scene, empty_action, make_scene

INFO = ["frame", "dropped_detections", "invalid_tracks", "invalid_hypotheses", "invalid_objects"]
METRICS = ["targets", "covered", "min_ade", "false_forecasts", "cost_missed", "cost_false", "cost_error"]


def play(env: MTPEnv, answer: Callable[[dict[str, Any]], Action], **reset: Any) -> tuple[list[Any], list[float]]:
    """All observations with their infos, and all rewards, of one episode."""
    seen, rewards = [env.reset(**reset)], []
    over = False
    while not over:
        observation, reward, over, _, info = env.step(answer(seen[-1][0]))
        seen.append((observation, info))
        rewards.append(float(reward))
    return seen, rewards


def echo(env: MTPEnv) -> Callable[[dict[str, Any]], Action]:
    agent = EchoAgent()
    agent.reset(env.task)
    return agent.act


def echo_rollout(env: MTPEnv, **reset: Any) -> Rollout:
    play(env, echo(env), **reset)
    return env.rollout()


# ---- what is shown
def test_the_first_ego_pose_is_the_origin_and_time_starts_at_zero(make_env: MakeEnv) -> None:
    observation, info = make_env(make_scene()).reset()
    np.testing.assert_allclose(observation["ego_pose"], 0, atol=1e-6)
    assert (float(observation["time"]), float(observation["dt"])) == (0.0, 0.1)
    # The car is 0.1 m ahead along the scene's x axis, which runs 0.5 rad to the right of the ego heading.
    want = [0.1 * np.cos(0.5), -0.1 * np.sin(0.5), -0.2, -0.5, 4, 1.8, 1.5]
    np.testing.assert_allclose(observation["detection_box"][0], want, atol=1e-6)
    assert observation["detection_score"].tolist() == [3.0, 1.0, -2.0, 0.0, 0.0, 0.0]
    assert observation["detection_class"].tolist() == [0, 0, 1, -1, -1, -1]
    assert observation["detection_valid"].tolist() == [1, 1, 1, 0, 0, 0]
    assert not observation["detection_box"][3:].any()
    assert info == dict.fromkeys([*INFO, "scene", *METRICS], 0)


@pytest.mark.parametrize("keywords", [{}, {"observe": "truth"}, {"evaluation": True}], ids=str)
def test_every_frame_and_the_one_after_the_last_lie_in_the_space(keywords: dict[str, Any], make_env: MakeEnv) -> None:
    env = make_env(make_scene(empty=(0, 4, 7)), **keywords)
    seen, _ = play(env, echo(env))
    assert len(seen) == 9
    for t, (observation, info) in enumerate(seen):
        assert env.observation_space.contains(observation)
        assert (info.pop("episode_metrics", None) is not None) == (t == 8 and "evaluation" not in keywords)
        assert list(info) == (INFO if "evaluation" in keywords else [*INFO, "scene", *METRICS])
        assert all(type(value) in (int, float) for value in info.values())
        assert info["frame"] == t
    (before, _), (after, _) = seen[-2:]
    assert not after["detection_valid"].any()
    assert after["time"] == before["time"]
    np.testing.assert_array_equal(after["ego_pose"], before["ego_pose"])


def test_more_detections_than_rows_the_best_stay_in_order_and_the_rest_is_counted(make_env: MakeEnv) -> None:
    env = make_env(make_scene(empty=(1,)), max_detections=2)
    assert env.reset()[0]["detection_score"].tolist() == [3.0, 1.0]
    seen, _ = play(env, lambda observation: empty_action(env.task))
    assert [info["dropped_detections"] for _, info in seen] == [1, 0, 1, 1, 1, 1, 1, 1, 0]
    assert env.rollout().dropped.tolist() == [1, 0, 1, 1, 1, 1, 1, 1]


BAD_DETECTION = {
    "NaN": (0, 1, np.nan), "infinite": (0, 0, np.inf), "far away": (0, 0, 2e5), "too large": (0, 4, 150.0),
    "negative size": (0, 5, -1.0), "beyond single precision": (0, 0, 1e300),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_DETECTION, ids=str)
def test_a_detection_outside_of_the_space_is_left_out_and_counted(case: str, make_env: MakeEnv) -> None:
    scene, (row, column, value) = make_scene(), BAD_DETECTION[case]
    scene.detections.box[row, column] = value
    env = make_env(scene)
    observation, info = env.reset()
    assert (observation["detection_valid"].sum(), info["dropped_detections"]) == (2, 1)
    assert env.observation_space.contains(observation)


def test_true_boxes_come_as_detections_with_their_ids(make_env: MakeEnv) -> None:
    scene = make_scene()
    neutral = scene.truth.neutral.copy()
    neutral[1::3] = True  # the second car becomes a van
    env = make_env(replace(scene, truth=replace(scene.truth, neutral=neutral)), observe="truth")
    observation, _ = env.reset()
    assert (env.task.observe, observation["detection_id"].tolist()) == ("truth", [7, 5, -1, -1, -1, -1])
    assert observation["detection_score"].tolist() == [1, 1, 0, 0, 0, 0]
    np.testing.assert_allclose(np.hypot(*observation["detection_box"][0, :2]), 0, atol=1e-6)
    assert not observation["detection_velocity"].any()  # the task says that velocity is not measured
    assert env.task.velocity is False


def test_detections_carry_the_true_object_that_they_are_matched_to(make_env: MakeEnv) -> None:
    """One-to-one by frame and class, to neutral boxes too: most pairs first, then least distance, by brute force."""
    rng, scene = np.random.default_rng(3), make_scene(frames=40)
    box, kind = scene.detections.box.copy(), np.zeros(120, dtype=np.int64)
    truth = replace(scene.truth, box=scene.truth.box.copy(), class_id=kind, neutral=rng.random(120) < 0.3)
    box[:, :2], truth.box[:, :2] = rng.uniform(0, 4, (2, 120, 2))
    score = np.full(120, 1.0)
    score[2::6] = np.nan  # left out, so it takes no object
    env = make_env(
        replace(scene, truth=truth, detections=replace(scene.detections, box=box, class_id=kind, score=score)),
        observe="associated",
    )
    frames, _ = play(env, lambda _: empty_action(env.task))
    for t, (observation, _) in enumerate(frames[:-1]):
        rows, seen = np.arange(3 * t, 3 * t + 3), [d for d in range(3 * t, 3 * t + 3) if np.isfinite(score[d])]
        gap = np.linalg.norm(box[seen, None, :2] - truth.box[None, rows, :2], axis=2)
        costs = {
            chosen: sum(gap[i, j] - 100 for i, j in enumerate(chosen) if j >= 0)
            for chosen in product(range(-1, 3), repeat=len(seen))
            if len(of := [j for j in chosen if j >= 0]) == len(set(of))
            and all(j < 0 or gap[i, j] <= 2.0 for i, j in enumerate(chosen))
        }
        best = [-1 if j < 0 else int(truth.object_id[rows[j]]) for j in min(costs, key=costs.__getitem__)]
        assert observation["detection_id"].tolist() == best + [-1] * (6 - len(seen))
        assert env.observation_space.contains(observation)


def test_observations_are_never_reused(make_env: MakeEnv) -> None:
    env = make_env(make_scene())
    first, _ = env.reset()
    kept = {key: value.copy() for key, value in first.items()}
    second, *_ = env.step(empty_action(env.task))
    for key, value in kept.items():
        np.testing.assert_array_equal(first[key], value)
        second[key][...] = 1
    again, _ = env.reset()
    for key, value in kept.items():
        np.testing.assert_array_equal(again[key], value)
        assert not np.shares_memory(again[key], first[key])


# ---- episodes
def test_only_the_last_answer_terminates_and_nothing_truncates(make_env: MakeEnv) -> None:
    env = make_env(make_scene(frames=3))
    env.reset()
    ends = [env.step(empty_action(env.task))[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (True, False)]
    with pytest.raises(ResetNeeded, match="after the last frame of 'one'"):
        env.step(empty_action(env.task))
    env.reset()
    env.step(empty_action(env.task))


def test_an_episode_of_target_frames_earns_what_the_whole_one_does_there(make_env: MakeEnv) -> None:
    """The car is a target in frames 1 to 4 of 8; frame 0 is the past, which is shown on request."""
    whole = make_env(make_scene())
    seen, rewards = play(whole, echo(whole))
    env = make_env(make_scene(), make_scene("short", frames=4), target_frames=True)
    part, earned = play(env, echo(env), options={"scene": "one"})
    assert ([info["frame"] for _, info in part], earned) == ([1, 2, 3, 4, 5], rewards[1:5])
    assert part[-1][1]["episode_metrics"] == seen[-1][1]["episode_metrics"]
    assert [float(past["time"]) for past in env.past] == [0.0]
    np.testing.assert_array_equal(env.past[0]["detection_box"], seen[0][0]["detection_box"])
    for (observation, _), (same, _) in zip(part, seen[1:], strict=False):
        np.testing.assert_array_equal(observation["detection_box"], same["detection_box"])
    assert env.scene_names[part[0][1]["scene"]] == env.scene_name == "one"
    with pytest.raises(RolloutError, match="part of a scene"):
        env.rollout()
    with pytest.raises(DataError, match="scene 'short' has no frame that can hold a target"):
        env.reset(options={"scene": "short"})
    with pytest.raises(MtpBenchError, match="target_frames is for training"):
        make_env(target_frames=True, evaluation=True)


def test_the_reward_of_an_action_is_known_without_a_step(make_env: MakeEnv) -> None:
    env = make_env(make_scene())
    env.reset()
    env.step(empty_action(env.task))
    assert env.reward_of(empty_action(env.task)) == env.step(empty_action(env.task))[1] < 0
    assert env.past == ()


def test_nothing_can_be_asked_before_reset_and_no_rollout_of_half_an_episode(make_env: MakeEnv) -> None:
    env = make_env(make_scene())
    with pytest.raises(ResetNeeded, match="call reset"):
        env.step(empty_action(env.task))
    with pytest.raises(ResetNeeded):
        env.rollout()
    env.reset()
    env.step(empty_action(env.task))
    with pytest.raises(RolloutError, match="frame 1 of 8"):
        env.rollout()


def test_the_seed_chooses_the_scene_and_options_name_it(make_env: MakeEnv) -> None:
    env = make_env(make_scene("a"), make_scene("b"), make_scene("c"))
    chosen = []
    for seed in range(20):
        env.reset(seed=seed)
        chosen.append(env.scene.name)
        env.reset(seed=seed)
        assert env.scene.name == chosen[-1]
    assert set(chosen) == {"a", "b", "c"}
    env.reset(seed=0, options={"scene": "b"})
    assert env.scene.name == "b"
    few = make_env(make_scene("a"), make_scene("b"), make_scene("c"), scenes=["c", "a"])
    assert few.scene_names == ("c", "a")
    for options in ({"scene": "b"}, {"scenes": "a"}):
        with pytest.raises(UnknownNameError):
            few.reset(options=options)


@pytest.mark.parametrize(("evaluation", "kept"), [(False, 16), (True, 1)])
def test_the_last_scenes_stay_open(
    evaluation: bool, kept: int, make_env: MakeEnv, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenes = [make_scene(f"scene-{number}") for number in range(18)]
    env = make_env(*scenes, evaluation=evaluation)
    read: list[str] = []
    load = env._source.load

    def counted(name: str) -> Scene:
        read.append(name)
        return load(name)

    monkeypatch.setattr(env._source, "load", counted)
    for name in [*env.scene_names, *reversed(env.scene_names)]:
        env.reset(options={"scene": name})
    assert len(env._kept) == kept
    assert read == [*env.scene_names, *reversed(env.scene_names[:-kept])]


def test_sizes_come_from_the_keywords_else_from_the_card(make_env: MakeEnv) -> None:
    env = make_env(samples=9, max_tracks=11)
    assert (env.task.samples, env.task.k, env.task.tracks, env.task.objects) == (9, 4, 11, 4)
    assert env.action_space["forecast"].shape == (4, 9, 3, 2)  # type: ignore[index]
    assert make_env(samples=2).task.k == 2


# ---- what is taken
def test_the_rollout_holds_the_answer_in_the_frame_of_the_scene(make_env: MakeEnv) -> None:
    env = make_env(make_scene())
    rollout = echo_rollout(env)
    detections = env.scene.detections
    np.testing.assert_array_equal(rollout.track_start, detections.start)
    np.testing.assert_allclose(rollout.track_box, detections.box, atol=1e-4)
    np.testing.assert_allclose(rollout.object_box, detections.box, atol=1e-4)
    assert rollout.track_class.tolist() == detections.class_id.tolist()
    # The first car heads along x: its four samples run at 50, 60, 70 and 80 cm per frame.
    assert rollout.forecast[0, :, -1].tolist() == [[150, 0], [180, 0], [210, 0], [240, 0]]
    # The second one heads along y.
    assert rollout.forecast[1, :, 0].tolist() == [[0, 50], [0, 60], [0, 70], [0, 80]]
    assert rollout.member[:, :2].all()
    assert not rollout.member[:, 2].any()
    assert rollout.forecast.dtype == np.int16
    assert not rollout.invalid.any()
    assert rollout.seconds.tolist() == [0.0] * 8


def test_a_random_turn_and_shift_changes_what_is_seen_but_neither_answers_nor_rewards(make_env: MakeEnv) -> None:
    plain = make_env(make_scene())
    _, rewards = play(plain, echo(plain))
    still = plain.rollout()
    moved = make_env(make_scene(), rigid_motion=True)
    first, _ = moved.reset(seed=1)
    assert np.abs(first["ego_pose"][:2]).min() > 1
    other, _ = moved.reset(seed=2)
    assert np.abs(first["ego_pose"] - other["ego_pose"]).max() > 1
    _, turned = play(moved, echo(moved), seed=1)
    np.testing.assert_allclose(turned, rewards, atol=0.02)
    rollout = moved.rollout()
    for name in ("track_start", "track_id", "track_class", "member", "object_start", "object_class", "invalid"):
        np.testing.assert_array_equal(getattr(rollout, name), getattr(still, name))
    for name in ("track_box", "object_box", "hypothesis_log_weight", "forecast_log_weight"):
        np.testing.assert_allclose(getattr(rollout, name), getattr(still, name), atol=1e-4)
    assert np.abs(rollout.forecast.astype(int) - still.forecast).max() <= 1  # cm
    assert digest(echo_rollout(moved, seed=1)) == digest(rollout)


def test_every_action_of_the_space_is_sound(make_env: MakeEnv) -> None:
    env = make_env(make_scene(frames=40))
    env.action_space.seed(3)
    env.reset(seed=3)
    for t in range(40):
        action = env.action_space.sample()
        action["track_id"] = np.arange(5)  # the space cannot say that ids are unique,
        action["forecast_log_weight"][:, 0] = 0.0  # nor that a sample is there
        observation, reward, over, _, info = env.step(action)
        assert env.observation_space.contains(observation)
        assert np.isfinite(reward)
        assert over == (t == 39)
        assert not any(info[name] for name in INFO[2:])
    rollout = env.rollout()
    assert len(rollout.track_id) > 0
    assert len(rollout.object_box) > 0


# ---- what it earns, and what is never told
def fixed_error(env: MTPEnv) -> float:
    return score_scene(env.scene, env.rollout(), env.card).fixed_error


def targets_only(scene: Scene) -> Scene:
    return replace(scene, truth_complete=False)


EPISODES = {
    "complete": make_scene(empty=(4,)),
    "targets only": targets_only(make_scene(empty=(4,))),
    "an official list": replace(targets_only(make_scene()), listed_targets=True),
    "no target": make_scene(frames=4),
    "nothing at all": bare_scene(frames=6),
}


@pytest.mark.parametrize("scene", EPISODES.values(), ids=EPISODES.keys())
@pytest.mark.parametrize("wild", [False, True], ids=["echo", "anything"])
def test_rewards_add_up_to_the_error_at_the_fixed_operating_point(scene: Scene, wild: bool, make_env: MakeEnv) -> None:
    env = make_env(scene, strict=not wild)
    answer, rng = echo(env), np.random.default_rng(0)

    def said(observation: dict[str, Any]) -> Action:
        action = answer(observation)
        if wild:  # rows that are malformed, unsure or nowhere, and answers that cannot be read
            action["object_confidence"] = rng.random(4).astype(np.float32)
            action["object_box"][rng.random(4) < 0.3, 0] = rng.choice([np.nan, 1e5, 3.0])
            action["object_class"][rng.random(4) < 0.3] = 9
            action["object_valid"][rng.random(4) < 0.5] = 1
            if rng.random() < 0.3:
                action = {} if rng.random() < 0.5 else {**action, "forecast": np.zeros(3)}
        return action

    for _ in range(1 + 5 * wild):
        seen, rewards = play(env, said)
        live, score = live_frames(env.scene, env.card), score_scene(env.scene, env.rollout(), env.card)
        assert sum(rewards) == pytest.approx(-score.fixed_error)
        *frames, last = [info for _, info in seen[1:]]
        assert [-sum(info[name] for name in METRICS[-3:]) for info in [*frames, last]] == pytest.approx(rewards)
        found = score.covered
        assert last["episode_metrics"] == pytest.approx({
            "targets": len(score),
            "covered": found.sum(),
            "min_ade": score.min_ade[found].mean() if found.any() else 0.0,
            "false_forecasts": score.false_forecasts if scene.truth_complete else 0,
            "cost_missed": score.cuts.at(0.5)[1].sum(),
            "cost_false": score.fixed_error - score.cuts.at(0.5)[0].sum(),
            "cost_error": score.cuts.at(0.5)[0].sum() - score.cuts.at(0.5)[1].sum(),
            "fixed_error": score.fixed_error / max(len(score), 1),
        })  # fmt: skip
        assert not any(reward for t, reward in enumerate(rewards) if t == scene.frames or not live[t])


def test_an_answer_that_cannot_be_read_is_a_false_forecast_per_detection(make_env: MakeEnv) -> None:
    env = make_env(make_scene(empty=(2,)), strict=False)
    unreadable: list[Any] = [None, {}, "forecast", {"forecast": 3}]
    for nothing in unreadable:
        _, rewards = play(env, lambda observation, said=nothing: said)  # type: ignore[misc]
        assert rewards[1] == rewards[3] == -(3 * 2.0 + 3 * 1.0)
        assert (rewards[2], sum(rewards)) == (-3 * 2.0, -fixed_error(env))


def other_truth(scene: Scene) -> Scene:
    truth = replace(scene.truth, eligible=~scene.truth.eligible, neutral=~scene.truth.neutral)
    truth = replace(truth, box=truth.box[::-1] + 3.0, velocity=truth.velocity + 1)
    truth = replace(truth, class_id=1 - truth.class_id, object_id=truth.object_id + 50)
    return replace(scene, truth=truth, truth_complete=False)


@pytest.mark.parametrize(("evaluation", "rigid_motion"), [(True, False), (True, True), (False, False)])
def test_what_is_returned_does_not_depend_on_the_truth(evaluation: bool, rigid_motion: bool, make_env: MakeEnv) -> None:
    scene = make_scene(empty=(2,))
    episodes = []
    for version in (scene, other_truth(scene)):
        env = make_env(version, evaluation=evaluation, max_detections=2, rigid_motion=rigid_motion)
        episodes.append((env.task, *play(env, echo(env), seed=5)))
    (task, seen, rewards), (other_task, other_seen, other_rewards) = episodes
    assert task == other_task
    if evaluation:
        assert rewards == other_rewards == [0.0] * 8
    else:
        assert rewards != other_rewards, "only the reward and its parts do"
    for (observation, info), (other_observation, other_info) in zip(seen, other_seen, strict=True):
        assert list(info) == INFO if evaluation else list(info)[:5] == INFO
        assert [info[name] for name in INFO] == [other_info[name] for name in INFO]
        assert observation.keys() == other_observation.keys()
        for key in observation:
            np.testing.assert_array_equal(observation[key], other_observation[key])


def test_a_scene_elsewhere_and_at_another_time_looks_the_same(make_env: MakeEnv) -> None:
    scene, shift = make_scene(), np.array([500.0, -300.0, 7.0, 0, 0, 0, 0])
    truth = replace(scene.truth, box=scene.truth.box + shift)
    found = replace(scene.detections, box=scene.detections.box + shift)
    elsewhere = replace(scene, time=scene.time + 5e4, ego=scene.ego + shift[:4], truth=truth, detections=found)
    seen, _ = play(here := make_env(scene), echo(here))
    other, _ = play(there := make_env(elsewhere), echo(there))
    for (observation, _), (moved, _) in zip(seen, other, strict=True):
        for key in observation:
            np.testing.assert_allclose(observation[key], moved[key], atol=1e-4)


# ---- flattening
def test_observations_and_actions_can_be_flattened(make_env: MakeEnv) -> None:
    env = make_env(make_scene())
    observation, _ = env.reset()
    flat: Any = space_utils.flatten(env.observation_space, observation)
    assert space_utils.flatten_space(env.observation_space).contains(flat)
    back = space_utils.unflatten(env.observation_space, flat)
    for key in observation:
        np.testing.assert_array_equal(back[key], observation[key])
    env.action_space.seed(0)
    action = env.action_space.sample()
    back = space_utils.unflatten(env.action_space, space_utils.flatten(env.action_space, action))
    (read,) = env.action_space.from_jsonable(json.loads(json.dumps(env.action_space.to_jsonable([action]))))
    for key in action:
        np.testing.assert_array_equal(back[key], action[key])
        np.testing.assert_array_equal(read[key], action[key])
