"""A strict env says what is wrong with an action; in any mode a wrong action earns no more than a right one."""

from __future__ import annotations

import pickle
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from mtp_bench import Action, ActionError, Observation, load_submission, make_action
from mtp_bench.env import MTPEnv
from mtp_bench.env.checks import examine
from mtp_bench.running.run import agent_task
from mtp_bench.types import Scene
from tests.env.conftest import MakeEnv
from tests.env.test_answer import Break, both, cast, drop, put, swap
from tests.env.test_env import play
from tests.support.command_line import CommandLine
from tests.support.small_scenes import empty_action, make_scene

BUILDER = "; mtp_bench.make_action makes whole actions of plain arrays"
PADDING = "; leave out the padding of the observation, where detection_valid is 0"
ORIGIN = "metres from the object's own centre"


def right(env: MTPEnv) -> Callable[[Observation], Action]:
    """The detections as one hypothesis and as objects, each with two samples along its heading."""

    def act(observation: Observation) -> Action:
        seen = observation["detection_valid"] == 1
        boxes, classes = observation["detection_box"][seen], observation["detection_class"][seen]
        ahead = np.stack([np.cos(boxes[:, 3]), np.sin(boxes[:, 3])], axis=-1)
        speed = np.array([0.5, 0.8])[:, None] * np.arange(1, env.task.future + 1)  # m, [2, T]
        forecasts = speed[None, :, :, None] * ahead[:, None, None]
        return make_action(
            env.task, boxes, classes, forecasts, confidence=np.ones(len(boxes)), ids=np.arange(len(boxes))
        )

    return act


class Wrong(NamedTuple):
    """A mistake in an action that is right otherwise, and the beginning of what the env says of it."""

    change: Break
    said: str
    warned: bool = False  # the action space cannot say it, or it is legal: no error, but a warning


def instead(value: Any) -> Break:
    """The action is something else."""
    return lambda action: value


def moved(name: str, start: int, end: int) -> Break:
    return lambda action: action.__setitem__(name, np.moveaxis(action[name], start, end))


def absolute(action: Action) -> None:
    action["forecast"] += action["object_box"][:, None, None, :2]


def degrees(action: Action) -> None:
    action["object_box"][:, 3] = np.degrees(action["object_box"][:, 3])


def renamed(old: str, new: str) -> Break:
    return lambda action: action.__setitem__(new, action.pop(old))


# The first of each group are in docs/environment/errors.md, see `table`.
WRONG: dict[str, Wrong] = {
    "`None`": Wrong(instead(None), "action: is a NoneType, expected a dict with track_id"),
    "a list": Wrong(instead([1, 2]), "action: is a list, expected a dict with track_id"),
    "nothing in it": Wrong(
        lambda action: action.clear(), "object_box: is missing, expected an array of shape (4, 7) and floating or"
    ),
    "no forecasts": Wrong(
        drop("forecast"),
        "forecast: is missing, expected an array of shape (4, 4, 3, 2) and floating or integer dtype (frame 0)"
        + BUILDER,
    ),
    "no boxes": Wrong(drop("object_box"), "object_box: is missing, expected an array of shape (4, 7)"),
    "no mask": Wrong(drop("object_valid"), "object_valid: is missing, expected an array of shape (4,) and bool or"),
    "no members": Wrong(drop("hypothesis_member"), "hypothesis_member: is missing, expected an array of shape (3, 5)"),
    "a misspelt key": Wrong(
        renamed("object_confidence", "object_confidenc"),
        "action: has unknown keys, expected track_id, track_box,",
    ),
    "one more key": Wrong(swap("comment", np.zeros(3)), "action: has unknown keys, expected track_id"),
    "no axis of samples": Wrong(
        lambda action: action.__setitem__("forecast", action["forecast"][:, 0]),
        "forecast: has shape (4, 3, 2), expected an array of shape (4, 4, 3, 2)",
    ),
    "axes in another order": Wrong(moved("forecast", 1, 2), "forecast: has shape (4, 3, 4, 2), expected an array of"),
    "another horizon": Wrong(
        lambda action: action.__setitem__("forecast", action["forecast"][:, :, :2]), "forecast: has shape (4, 4, 2, 2)"
    ),
    "no padding": Wrong(
        lambda action: action.__setitem__("object_box", action["object_box"][:3]),
        "object_box: has shape (3, 7), expected an array of shape (4, 7)",
    ),
    "boxes of six numbers": Wrong(
        lambda action: action.__setitem__("object_box", action["object_box"][:, :6]), "object_box: has shape (4, 6)"
    ),
    "classes as floats": Wrong(
        cast("object_class", float),
        "object_class: has dtype float64, expected an array of shape (4,) and integer dtype (frame 0)" + BUILDER,
    ),
    "classes by name": Wrong(swap("object_class", np.full(4, "car")), "object_class: has dtype <U3, expected an array"),
    "mask as floats": Wrong(cast("object_valid", float), "object_valid: has dtype float64"),
    "complex forecasts": Wrong(cast("forecast", complex), "forecast: has dtype complex128"),
    "ragged boxes": Wrong(swap("object_box", [[1.0], [1.0, 2.0]]), "object_box: is not an array (ValueError"),
    "track boxes `None`": Wrong(swap("track_box", None), "track_box: has dtype object, expected an array of shape"),
    "NaN in a box": Wrong(put("object_box", (0, 1), np.nan), "object_box: not finite, expected finite x y z yaw up to"),
    "NaN in a track": Wrong(put("track_box", (0, 1), np.nan), "track_box: not finite, expected finite x y z yaw up to"),
    "NaN in a forecast": Wrong(
        put("forecast", (0, 0, 0, 0), np.nan),
        f"forecast: not finite, expected {ORIGIN}, at most 327 (frame 0, forecast[0])",
    ),
    "infinite forecast": Wrong(put("forecast", (0, 0, 0, 0), np.inf), "forecast: not finite, expected metres from"),
    "NaN as confidence": Wrong(
        put("object_confidence", 0, np.nan), "object_confidence: not a probability, expected 0 to 1"
    ),
    "a score as confidence": Wrong(
        put("object_confidence", 0, 3.0),
        "object_confidence: not a probability, expected 0 to 1 (frame 0, object_confidence[0] = 3);"
        " state how likely it is that the object is there, not the detector's score as it is",
    ),
    "confidence below 0": Wrong(
        put("object_confidence", 0, -0.1), "object_confidence: not a probability, expected 0 to"
    ),
    "padding as an object": Wrong(
        both(put("object_valid", 3, 1), put("object_box", 3, 0.0)),
        "object_box: out of range, expected finite x y z yaw up to 100000, l w h above 0 up to 100 m (frame 0,"
        " object_box[3] = [0, 0, 0, 0, 0, 0, 0])" + PADDING,
    ),
    "negative size": Wrong(put("object_box", (0, 4), -4.0), "object_box: out of range, expected finite x y z yaw up"),
    "coordinates of a map": Wrong(put("object_box", (0, 1), 5.4e6), "object_box: out of range, expected finite x y z"),
    "class -1": Wrong(
        put("object_class", 0, -1), "object_class: unknown, expected 0 to 1 (frame 0, object_class[0] = -1)" + PADDING
    ),
    "a class that is not there": Wrong(put("object_class", 0, 2), "object_class: unknown, expected 0 to 1"),
    "negative id": Wrong(put("track_id", 0, -1), "track_id: out of range, expected 0 to 2147483647"),
    "id beyond 31 bits": Wrong(put("track_id", 0, 2**31), "track_id: out of range, expected 0 to 2147483647"),
    "2 in a mask": Wrong(put("object_valid", 0, 2), "object_valid: neither 0 nor 1, expected 0 or 1"),
    "NaN as weight": Wrong(
        put("hypothesis_log_weight", 0, np.nan), "hypothesis_log_weight: NaN or +inf, expected finite numbers, or -inf"
    ),
    "NaN as weight of a sample": Wrong(put("forecast_log_weight", (0, 0), np.nan), "forecast_log_weight: NaN or +inf"),
    "an unknown parent": Wrong(put("hypothesis_parent", 0, 3), "hypothesis_parent: unknown, expected -1 (not stated)"),
    "forecasts of kilometres": Wrong(
        put("forecast", (0, 0), 1000.0),
        f"forecast: too far, expected {ORIGIN}, at most 327 (frame 0, forecast[0]); subtract the centre of the box from"
        " absolute positions",
    ),
    "absolute coordinates": Wrong(
        absolute,
        f"forecast: looks like absolute coordinates in 2 rows, expected {ORIGIN} (frame 0, first forecast[",
        True,
    ),
    "degrees": Wrong(
        degrees, "object_box: yaw looks like degrees in 2 rows, expected radians, such as -pi to pi", True
    ),
    "one id twice": Wrong(
        put("track_id", slice(0, 2), 123456),
        "track_id: twice in one hypothesis in 2 rows, expected an id once per hypothesis (frame 0,"
        " first track_id[0] = 123456)",
        True,
    ),
    "a track in no hypothesis": Wrong(
        put("hypothesis_member", (slice(None), 0), 0),
        "track_valid: in no hypothesis, so unused, expected every valid track in a hypothesis whose log-weight is"
        " present (frame 0, track_valid[0] = 1)",
        True,
    ),
    "an object without samples": Wrong(
        put("forecast_log_weight", 0, -np.inf), "forecast_log_weight: no sample present, expected at least one", True
    ),
}
IN_THE_DOCS = (
    "`None`", "no forecasts", "a misspelt key", "no axis of samples", "classes as floats",
    "NaN in a forecast", "a score as confidence", "padding as an object", "class -1", "forecasts of kilometres",
    "absolute coordinates", "degrees", "one id twice", "an object without samples",
)  # fmt: skip


def scene() -> Scene:
    """The small scene, its objects turned a little so that degrees and radians differ."""
    whole = make_scene()
    turned = [
        replace(part, box=part.box + np.array([0, 0, 0, 0.3, 0, 0, 0])) for part in (whole.truth, whole.detections)
    ]
    return replace(whole, truth=turned[0], detections=turned[1])  # type: ignore[arg-type]


def wrong(case: str, env: MTPEnv) -> Callable[[Observation], Any]:
    """The agent that makes the mistake."""
    act = right(env)

    def change(observation: Observation) -> Any:
        action = act(observation)
        if len(np.flatnonzero(action["object_valid"])) == 0:
            return action
        got = WRONG[case].change(action)
        return action if case not in INSTEAD else got

    return change


INSTEAD = ("`None`", "a list")  # what is no action at all


def sentence_of(case: str, env: MTPEnv) -> str:
    """What the env says of the first answer of the agent that makes the mistake."""
    observation, _ = env.reset()
    action = wrong(case, env)(observation)
    if not WRONG[case].warned:
        with pytest.raises(ActionError) as caught:
            env.step(action)
        return str(caught.value)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        env.step(action)
    (only,) = said
    return str(only.message).replace("\x1b[33mWARN: ", "").replace("\x1b[0m", "").removesuffix(" (said once per env)")


def test_there_are_at_least_thirty_of_them() -> None:
    assert len(WRONG) >= 30


@pytest.mark.parametrize("case", WRONG, ids=str)
def test_each_mistake_gets_its_sentence(case: str, make_env: MakeEnv) -> None:
    env = make_env(scene())
    said = sentence_of(case, env)
    assert said.startswith(WRONG[case].said)
    assert "frame 0" in said
    env.reset()
    env.step(right(env)(env.reset()[0]))  # and the right action passes in silence


@pytest.mark.parametrize("case", WRONG, ids=str)
def test_the_action_space_holds_what_is_taken(case: str, make_env: MakeEnv) -> None:
    env = make_env(scene())
    observation, _ = env.reset()
    assert env.action_space.contains(right(env)(observation))
    assert env.action_space.contains(wrong(case, env)(observation)) == WRONG[case].warned


@pytest.mark.parametrize("case", WRONG, ids=str)
@pytest.mark.parametrize("complete", [True, False], ids=["complete truth", "targets only"])
def test_no_mistake_pays(case: str, complete: bool, make_env: MakeEnv) -> None:
    """Not more than the right action or the sound part of the wrong one; and not more than silence if none is left."""
    env = make_env(replace(scene(), truth_complete=complete), strict=False)

    def sound(observation: Observation) -> Action:
        action, examined = right(env)(observation), examine(wrong(case, env)(observation), env.task)
        return {**action, "object_valid": examined.sound["objects"].astype(np.int8)}

    def nothing(observation: Observation) -> Action:
        return empty_action(env.task)

    agents = (wrong(case, env), right(env), sound, nothing)
    got, best, left, silent = (np.array(play(env, agent)[1]) for agent in agents)
    assert best.sum() > silent.sum()
    assert (got <= best).all()
    if case not in ("absolute coordinates", "degrees", "2 in a mask"):  # rows that count
        assert (got <= left).all()
    if (left == silent).all():
        assert (got <= silent).all()


@pytest.mark.parametrize("case", [name for name, case in WRONG.items() if not case.warned])
def test_a_refused_action_leaves_the_frame_as_it_was(case: str, make_env: MakeEnv) -> None:
    env = make_env(scene())
    observation, _ = env.reset()
    with pytest.raises(ActionError):
        env.step(wrong(case, env)(observation))
    *_, info = env.step(right(env)(observation))
    assert info["frame"] == 1
    assert info["invalid_objects"] == 0


@pytest.mark.parametrize("case", [name for name, case in WRONG.items() if case.warned])
def test_a_doubt_is_told_once_per_env(case: str, make_env: MakeEnv) -> None:
    env = make_env(scene())
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        for _ in range(2):
            play(env, wrong(case, env))
    assert len(said) == 1


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


def test_a_misspelt_key_is_named_with_the_nearest(make_env: MakeEnv) -> None:
    said = sentence_of("a misspelt key", make_env(scene()))
    assert "(frame 0, object_confidenc); did you mean 'object_confidence'?" in said


def test_the_error_travels() -> None:
    error = pickle.loads(pickle.dumps(ActionError("forecast: is missing")))
    assert str(error) == "forecast: is missing"


def table(make_env: MakeEnv) -> str:
    """Typical mistakes and what is said of them, in Markdown."""
    lines = ["| mistake | | what the env says |", "|---|---|---|"]
    for case in IN_THE_DOCS:
        kind = "warning" if WRONG[case].warned else "error"
        lines.append(f"| {case} | {kind} | {sentence_of(case, make_env(scene()))} |")
    return "\n".join(lines) + "\n"


def test_the_sentences_in_the_documentation_are_these(make_env: MakeEnv, repository: Path) -> None:
    assert table(make_env) in (repository / "docs/environment/errors.md").read_text()


def test_check_never_raises_for_what_an_agent_answers(card: str, kitti: str, cli: CommandLine, tmp_path: Path) -> None:
    (tmp_path / "submission.toml").write_text('name = "mute"\nauthors = ["N. N."]\nagent = "agent:build"\n')
    (tmp_path / "agent.py").write_text(
        "class Mute:\n    def reset(self, task): ...\n    def act(self, observation): ...\n"
        "def build(task):\n    return Mute()\n"
    )
    output = cli("check", tmp_path, "--env", card, "--data", kitti)
    assert output.status == 1
    assert "is a NoneType" in output.out + output.err


# ---- no false alarm


def test_nothing_is_said_of_an_action_from_the_action_space(make_env: MakeEnv) -> None:
    """Also where few rows are claimed, and those happen to lie near: the others are far."""
    env = make_env(scene(), tracks=3, objects=2, samples=2)
    env.reset()
    env.action_space.seed(0)
    for _ in range(100):
        action = env.action_space.sample()
        for rows in ("track", "object"):
            action[f"{rows}_valid"][1:] = 0
            action[f"{rows}_box"][0, :2] = 50.0
        env.step(action)
        env.reset()


def silent_play(agent: str, env: MTPEnv) -> int:
    """Frames of the first scene that a baseline plays, at most 150; whatever is said becomes an error."""
    name = env.scene_names[0]
    observation, _ = env.reset(seed=0, options={"scene": name})
    player = load_submission(agent).build(agent_task(env, 0))
    player.reset(agent_task(env, 0))
    truncated, frames = False, 0
    while not truncated and frames < 150:
        action = player.act(observation)
        assert env.action_space.contains(action)
        observation, _, _, truncated, _ = env.step(action)
        frames += 1
    return frames


SIMULATED = ("MTP-Intersection-v0", "MTP-Highway-v0")
RECORDED = ("MTP-KITTI-v0", "MTP-nuScenes-mini-v0", "MTP-WILDTRACK-v0", "MTP-PETS-v0")


@pytest.mark.parametrize("agent", ["stp", "mtp"])
@pytest.mark.parametrize("env_id", [*SIMULATED, *(pytest.param(env_id, marks=pytest.mark.data) for env_id in RECORDED)])
def test_nothing_is_said_of_baselines(env_id: str, agent: str) -> None:
    assert silent_play(agent, MTPEnv(env_id, rigid_motion=True)) > 10


@pytest.mark.data
def test_a_right_answer_earns_more_than_a_wrong_one_on_pets() -> None:
    """The first version rewarded a right answer on PETS with -1.0, and `None`, NaN or a wrong shape with 0.0."""
    env = MTPEnv("MTP-PETS-v0", strict=False)
    name = env.scene_names[0]
    player = load_submission("stp").build(agent_task(env, 0))
    player.reset(agent_task(env, 0))

    def not_a_number(observation: Observation) -> Action:
        action = player.act(observation)
        action["forecast"][:] = np.nan
        return action

    agents: dict[str, Callable[[Observation], Any]] = {
        "right": player.act,
        "silent": lambda observation: empty_action(env.task),
        "None": lambda observation: None,
        "NaN": not_a_number,
        "shape": lambda observation: {**player.act(observation), "forecast": np.zeros((3, 2))},
    }
    rewards = {}
    for kind, act in agents.items():
        player.reset(agent_task(env, 0))
        rewards[kind] = np.array(play(env, act, options={"scene": name})[1])
    for kind in ("None", "NaN", "shape"):
        assert (rewards[kind] <= rewards["silent"]).all(), kind
        assert rewards[kind].sum() < rewards["silent"].sum() < rewards["right"].sum()
