"""A strict env says what is wrong with an action; in any mode a wrong action earns no more than a right one."""

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench import Action, ActionError, MTPEnv, Observation, load_submission, make_action
from mtp_bench.agent.checks import check_action
from mtp_bench.core import Scene
from mtp_bench.running.playing import agent_task
from tests.env.conftest import MakeEnv
from tests.env.test_answer import CASES, Break, both, cast, drop, put
from tests.env.test_env import play
from tests.support.small_scenes import empty_action, make_scene


def right(env: MTPEnv) -> Callable[[Observation], Action]:
    """The detections as one hypothesis and as objects, each with two samples along its heading."""

    def act(observation: Observation) -> Action:
        seen = observation["detection_valid"] == 1
        boxes, classes = observation["detection_box"][seen], observation["detection_class"][seen]
        ahead = np.stack([np.cos(boxes[:, 3]), np.sin(boxes[:, 3])], axis=-1)
        speed = np.array([0.5, 0.8])[:, None] * np.arange(1, env.task.future + 1)  # m, [2, T]
        forecasts = speed[None, :, :, None] * ahead[:, None, None]
        sure, ids = np.ones(len(boxes)), np.arange(len(boxes))
        return make_action(env.task, boxes, classes, forecasts, confidence=sure, ids=ids)

    return act


def absolute(action: Action) -> None:
    action["forecast"] += action["object_box"][:, None, None, :2]


def degrees(action: Action) -> None:
    action["object_box"][:, 3] = np.degrees(action["object_box"][:, 3])


def misspelt(action: Action) -> None:
    action["object_confidenc"] = action.pop("object_confidence")


# Mistakes in an action that is right otherwise, in the order of docs/environment/errors.md; None: no action at all.
WRONG: dict[str, Break | None] = {
    "`None`": None, "no forecasts": drop("forecast"), "a misspelt key": misspelt,
    "no axis of samples": lambda action: action.__setitem__("forecast", action["forecast"][:, 0]),
    "classes as floats": cast("object_class", float), "NaN in a forecast": put("forecast", (0, 0, 0, 0), np.nan),
    "a score as confidence": put("object_confidence", 0, 3.0),
    "padding as an object": both(put("object_valid", 3, 1), put("object_box", 3, 0.0)),
    "class -1": put("object_class", 0, -1), "forecasts of kilometres": put("forecast", (0, 0), 1000.0),
    "absolute coordinates": absolute, "degrees": degrees, "one id twice": put("track_id", slice(0, 2), 123456),
    "an object without samples": put("forecast_log_weight", 0, -np.inf),
}  # fmt: skip
WARNED = list(WRONG)[-4:]  # the action space cannot express them, or they are legal
MISTAKES = {**{name: case.change for name, case in CASES.items() if case.counted[2]}, **WRONG}


def scene() -> Scene:
    """The small scene, its objects turned a little so that degrees and radians differ."""
    whole = make_scene()
    turn = np.array([0, 0, 0, 0.3, 0, 0, 0])
    truth, seen = whole.truth, whole.detections
    return replace(whole, truth=replace(truth, box=truth.box + turn), detections=replace(seen, box=seen.box + turn))


def wrong(case: str, env: MTPEnv) -> Callable[[Observation], Any]:
    """The agent that makes the mistake whenever it sees an object."""
    act, change = right(env), MISTAKES[case]

    def mistaken(observation: Observation) -> Any:
        action = act(observation)
        if not action["object_valid"].any():
            return action
        if change is None:
            return None
        change(action)
        return action

    return mistaken


def message_of(case: str, env: MTPEnv) -> str:
    """The error or the only warning for the first action of the agent that makes the mistake."""
    observation, _ = env.reset()
    action = wrong(case, env)(observation)
    if case not in WARNED:
        with pytest.raises(ActionError) as caught:
            env.step(action)
        return str(caught.value)
    with warnings.catch_warnings(record=True) as caught_warnings:
        warnings.simplefilter("always")
        env.step(action)
    (only,) = caught_warnings
    return str(only.message).replace("\x1b[33mWARN: ", "").replace("\x1b[0m", "").removesuffix(" (said once per env)")


@pytest.mark.parametrize("case", WRONG, ids=str)
def test_a_mistake_is_an_error_that_leaves_the_frame_or_one_warning(case: str, make_env: MakeEnv) -> None:
    env = make_env(scene())
    observation, _ = env.reset()
    action = wrong(case, env)(observation)
    assert env.action_space.contains(right(env)(observation))
    assert env.action_space.contains(action) == (case in WARNED)
    if case in WARNED:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            for _ in range(2):
                play(env, wrong(case, env))
        assert len(caught) == 1
    else:
        with pytest.raises(ActionError):
            env.step(action)
        *_, info = env.step(right(env)(observation))
        assert (info["frame"], info["invalid_objects"]) == (1, 0)


@pytest.mark.parametrize("case", MISTAKES, ids=str)
def test_no_mistake_pays(case: str, make_env: MakeEnv) -> None:
    """Not more than the right action or the sound part of the wrong one; nor than an empty one if none is left."""
    env = make_env(replace(scene(), truth_complete=case in WRONG), strict=False)  # else prediction targets alone

    def sound(observation: Observation) -> Action:
        action, checked = right(env)(observation), check_action(wrong(case, env)(observation), env.task)
        return {**action, "object_valid": checked.sound["objects"].astype(np.int8)}

    def empty(observation: Observation) -> Action:
        return empty_action(env.task)

    agents = (wrong(case, env), right(env), sound, empty)
    got, best, left, nothing = (np.array(play(env, agent)[1]) for agent in agents)
    assert best.sum() > nothing.sum()
    assert (got <= best).all()
    if case not in ("absolute coordinates", "degrees"):  # rows that count
        assert (got <= left).all()
    if (left == nothing).all():
        assert (got <= nothing).all()


def test_strict_is_the_default_outside_of_evaluation(make_env: MakeEnv) -> None:
    for keywords, raises in (
        ({}, True),
        ({"evaluation": True}, False),
        ({"strict": False}, False),
        ({"strict": True, "evaluation": True}, True),
    ):
        env = make_env(scene(), **keywords)
        env.reset()
        if raises:
            with pytest.raises(ActionError):
                env.step(None)  # type: ignore[arg-type]
        else:
            assert env.step(None)[4]["frame"] == 1  # type: ignore[arg-type]


def test_the_messages_in_the_documentation_are_these(make_env: MakeEnv, repository: Path) -> None:
    lines = ["| mistake | | what the env says |", "|---|---|---|"]
    for case in WRONG:
        kind = "warning" if case in WARNED else "error"
        lines.append(f"| {case} | {kind} | {message_of(case, make_env(scene()))} |")
    assert "\n".join(lines) + "\n" in (repository / "docs/environment/errors.md").read_text()


# ---- no false alarm


def silent_play(agent: str, env: MTPEnv) -> int:
    """Frames of the first scene that a baseline plays, at most 150; whatever is said becomes an error."""
    observation, _ = env.reset(seed=0, options={"scene": env.scene_names[0]})
    player = load_submission(agent).build(agent_task(env, 0))
    player.reset(agent_task(env, 0))
    over, frames = False, 0
    while not over and frames < 150:
        action = player.act(observation)
        assert env.action_space.contains(action)
        observation, _, over, *_ = env.step(action)
        frames += 1
    return frames


SIMULATED = ("MTP-Intersection-v0", "MTP-Highway-v0")
RECORDED = ("MTP-KITTI-v0", "MTP-nuScenes-mini-v0", "MTP-WILDTRACK-v0", "MTP-PETS-v0")


@pytest.mark.parametrize("agent", ["stp", "mtp"])
@pytest.mark.parametrize("env_id", [*SIMULATED, *(pytest.param(env_id, marks=pytest.mark.data) for env_id in RECORDED)])
def test_nothing_is_said_of_baselines(env_id: str, agent: str) -> None:
    assert silent_play(agent, MTPEnv(env_id, rigid_motion=True)) > 10
