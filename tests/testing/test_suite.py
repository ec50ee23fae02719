"""The conformance suite: sound agents pass, and each way to break the contract has its finding."""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mtp_bench import load_submission
from mtp_bench.errors import MtpBenchError, UnknownNameError
from mtp_bench.submission import SubmissionFactory
from mtp_bench.submission.starting import new_submission
from mtp_bench.testing import Finding, check_agent, check_card
from mtp_bench.types import Task
from tests.support.small_scenes import CARD, Action, EchoAgent, bare_scene, make_echo, write_card

Observation = dict[str, NDArray[Any]]
SCENES = ["0006", "0001"]
START = time.monotonic()


def check(make: Callable[[Task], Any], card: str, kitti: str, scenes: list[str] | None = None) -> list[Finding]:
    return check_agent(make, card, scenes or SCENES, {"data": kitti})


def faults(findings: list[Finding]) -> list[tuple[str, str]]:
    return [(finding.level, finding.check) for finding in findings if finding.level != "ok"]


def only(findings: list[Finding], level: str = "error") -> Finding:
    (found,) = [finding for finding in findings if finding.level == level]
    return found


@pytest.mark.parametrize("name", ["stp", "mtp", "stp_hedged", "template"])
def test_good_agents_pass(name: str, tmp_path: Path) -> None:
    submission = load_submission(new_submission("mine", tmp_path) if name == "template" else name)
    findings = check_agent(SubmissionFactory(str(submission.path), submission.parameters))
    assert faults(findings) == []
    checks = [finding.check for finding in findings]
    assert checks == [
        "build", "travels", "contract", "determinism", "reset", "observations", "sizes", "extremes", "rigid motion",
        "latency",
    ]  # fmt: skip
    assert "ms per frame (p50)" in findings[-1].got


def test_the_echo_passes_on_a_card_of_ones_own(card: str, kitti: str) -> None:
    assert faults(check(make_echo, card, kitti)) == []


class Broken(EchoAgent):
    """The echo; what it breaks is in the subclasses."""

    def answer(self, observation: Observation) -> Action:
        return super().act(observation)


class Unclocked(Broken):
    """Answers otherwise every time."""

    def act(self, observation: Observation) -> Action:
        action = self.answer(observation)
        action["forecast"] += np.random.default_rng().normal(scale=0.1, size=action["forecast"].shape)
        return action


class Clocked(Broken):
    """Says something else later in the day."""

    def act(self, observation: Observation) -> Action:
        action = self.answer(observation)
        action["forecast"] += np.float32(0.1 * (time.monotonic() > START + 1800.0))
        return action


class Ragged(Broken):
    """Answers with lists that are no array, and takes apart what it is shown."""

    def act(self, observation: Observation) -> Action:
        action = self.answer(observation)
        observation.pop("time")
        observation["dt"] = None  # type: ignore[assignment]
        action["track_box"] = [[1.0], [1.0, 2.0]]  # type: ignore[assignment]
        return action


class Remembering(Broken):
    """Goes on counting ids in the next scene."""

    count = 0

    def act(self, observation: Observation) -> Action:
        action = self.answer(observation)
        action["track_id"] = action["track_id"] + self.count
        self.count += 10
        return action


class Writing(Broken):
    """Writes into what it is shown."""

    def act(self, observation: Observation) -> Action:
        action = self.answer(observation)
        observation["detection_box"][:, 2] = 0.0
        return action


class Keeping(Broken):
    """Keeps a reference to the last observation."""

    last: Observation | None = None

    def reset(self, task: Task) -> None:
        super().reset(task)
        self.last = None

    def act(self, observation: Observation) -> Action:
        action = self.answer(self.last or observation)
        self.last = observation
        return action


class FixedSize(Broken):
    """Has the sizes of one env in its code."""

    def reset(self, task: Task) -> None:
        super().reset(task)
        self._task = globals()["task"]()


class NeedingDetections(Broken):
    """Divides by the number of detections."""

    def act(self, observation: Observation) -> Action:
        _ = 1 // int(observation["detection_valid"].sum() > 0 or observation["time"] > 0.25)
        return self.answer(observation)


class Located(Broken):
    """Knows where the scene lies: nothing is forecast outside its neighbourhood."""

    def act(self, observation: Observation) -> Action:
        action = self.answer(observation)
        near = np.abs(observation["ego_pose"][:2]).max() < 9.0
        action["object_valid"] *= np.int8(near)
        return action


class NotANumber(Broken):
    def act(self, observation: Observation) -> Action:
        action = self.answer(observation)
        action["track_box"][0, 0] = np.nan
        return action


class SameId(Broken):
    def act(self, observation: Observation) -> Action:
        action = self.answer(observation)
        action["track_id"][:] = 3
        return action


class OtherShape(Broken):
    def act(self, observation: Observation) -> Action:
        action = self.answer(observation)
        action["forecast"] = action["forecast"][:, :2]
        return action


class OtherType(Broken):
    def act(self, observation: Observation) -> Action:
        action = self.answer(observation)
        action["track_id"] = action["track_id"].astype(np.float64)
        return action


class Silent(Broken):
    def act(self, observation: Observation) -> Action:
        action = self.answer(observation)
        action["object_valid"][:] = 0
        return action


class Chatty(Broken):
    def act(self, observation: Observation) -> Action:
        return {**self.answer(observation), "debug": np.zeros(1)}


class Loose(Broken):
    def act(self, observation: Observation) -> Action:
        action = self.answer(observation)
        action["hypothesis_member"][:] = 0
        return action


BROKEN: dict[str, tuple[type[Broken], list[tuple[str, str]], str]] = {
    "random": (Unclocked, [("error", "determinism")], "scene 0006, frame 0, forecast"),
    "clock": (Clocked, [("warning", "determinism")], "scene 0006, frame 0, forecast"),
    "ragged": (Ragged, [("error", "contract"), ("warning", "observations")], "scene 0006, frame 0"),
    "leaks": (Remembering, [("error", "reset")], "scene 0006, frame 0, track_id"),
    "writes": (Writing, [("warning", "observations")], "scene 0006, frame 0, detection_box"),
    "keeps": (Keeping, [("error", "observations")], "scene 0006, frame 1"),
    "fixed sizes": (FixedSize, [("error", "sizes")] * 2, "tracks 3, objects 2, hypotheses 1, samples 1"),
    "no detections": (NeedingDetections, [("error", "extremes")], "frame 0 (no detections)"),
    "located": (Located, [("error", "rigid motion")], "scene 0006, scene 0001"),
    "not a number": (NotANumber, [("error", "contract")], "scene 0006, frame 0, track_box[0] = [nan"),
    "same id": (SameId, [("error", "contract")], "scene 0006, frame 0, track_id[0] = 3"),
    "other shape": (OtherShape, [("error", "contract")], "scene 0006, frame 0"),
    "other type": (OtherType, [("error", "contract")], "scene 0006, frame 0"),
    "silent": (Silent, [("warning", "contract")], "scene 0006, scene 0001"),
    "chatty": (Chatty, [("warning", "contract")], "scene 0006, frame 0, debug"),
    "loose": (Loose, [("warning", "contract")] * 2, "scene 0006, frame 0, track_valid[0]"),
}


@pytest.mark.parametrize(("agent", "expected", "where"), BROKEN.values(), ids=BROKEN)
def test_each_way_to_break_the_contract_is_found_and_placed(
    agent: type[Broken], expected: list[tuple[str, str]], where: str, card: str, kitti: str
) -> None:
    findings = check(lambda task: agent(), card, kitti)
    found = [finding for finding in findings if finding.level != "ok" and finding.check != "travels"]
    assert faults(found) == expected, [str(finding) for finding in found]
    assert where in found[0].where
    assert found[0].expected


def test_an_agent_that_raises_shows_its_own_lines(card: str, kitti: str) -> None:
    class Raising(Broken):
        def act(self, observation: Observation) -> Action:
            if observation["time"] > 0.25:
                raise ValueError("no more")
            return self.answer(observation)

    findings = check(lambda task: Raising(), card, kitti)
    assert [finding.check for finding in findings][-1] == "contract", "the other checks would say the same"
    error = only(findings)
    assert error.got == "ValueError: no more"
    assert error.where == "scene 0006, frame 3"
    assert len(error.traceback) == 1
    assert error.traceback[0].startswith("test_suite.py, line ")
    assert error.traceback[0].endswith('in act: raise ValueError("no more")')


def test_an_agent_that_cannot_be_built(card: str, kitti: str) -> None:
    def make(task: Task) -> EchoAgent:
        raise FileNotFoundError("weights.safetensors")

    findings = check(make, card, kitti)
    assert [finding.check for finding in findings] == ["build"]
    assert "FileNotFoundError: weights.safetensors" in only(findings).got
    assert "in make: raise FileNotFoundError" in only(findings).traceback[-1]


def test_what_is_no_agent(card: str, kitti: str) -> None:
    findings = check(lambda task: object(), card, kitti)
    assert [str(finding) for finding in findings] == [
        "build: object without reset and act, expected reset(task) and act(observation) (build); write them"
    ]


def test_an_agent_that_fails_at_reset(card: str, kitti: str) -> None:
    class NoReset(Broken):
        def reset(self, task: Task) -> None:
            raise KeyError("weights")

    error = only(check(lambda task: NoReset(), card, kitti))
    assert (error.got, error.where) == ("KeyError: 'weights'", "scene 0006, reset")


def test_what_cannot_go_to_other_processes_is_a_warning(card: str, kitti: str) -> None:
    finding = only(check(lambda task: EchoAgent(), card, kitti), "warning")
    assert finding.check == "travels"
    heavy = Heavy(np.zeros(1 << 18))
    assert len(pickle.dumps(heavy)) > 1 << 20
    assert only(check(heavy, card, kitti), "warning").got == "pickles as 2 MiB"


class Heavy:
    def __init__(self, weights: NDArray[np.float64]) -> None:
        self.weights = weights

    def __call__(self, task: Task) -> EchoAgent:
        return EchoAgent()


def test_scenes_and_envs_that_are_not_there(card: str, kitti: str) -> None:
    with pytest.raises(UnknownNameError, match="unknown scene '0007'"):
        check(make_echo, card, kitti, ["0007"])
    with pytest.raises(MtpBenchError, match="no scene to check on"):
        check_agent(make_echo, card, [], {"data": kitti})
    with pytest.raises(MtpBenchError, match="MTP-Kitti"):
        check_agent(make_echo, "MTP-Kitti-v0")


def test_a_scene_without_anything_has_no_score_to_compare(card: str, kitti: str) -> None:
    assert bare_scene().frames == 3
    findings = check(make_echo, card, kitti, ["0008"])
    assert faults(findings) == [("warning", "contract")] * 2  # no track, no forecast


def test_a_card_that_is_sound(card: str, kitti: str) -> None:
    findings = check_card(card, kitti)
    assert [(finding.level, finding.check) for finding in findings] == [
        ("ok", "card"), ("ok", "gymnasium"), ("ok", "content"),
    ]  # fmt: skip


def test_a_shipped_card_by_its_id() -> None:
    assert faults(check_card("MTP-Intersection-v0")) == []


CARDS: dict[str, tuple[str, str, str, str]] = {
    "misspelt": ("samples = 4", "smaples = 4", "error", "unknown key 'task.smaples'"),
    "too few rows": ("detections = 6", "detections = 2", "warning", "3 detections in a frame"),
    "no future": ("future = 3", "future = 30", "warning", "none in this scene"),
}


@pytest.mark.parametrize(("old", "new", "level", "text"), CARDS.values(), ids=CARDS)
def test_what_is_wrong_with_a_card_is_found(
    old: str, new: str, level: str, text: str, kitti: str, tmp_path: Path
) -> None:
    found = only(check_card(write_card(tmp_path, CARD.replace(old, new)), kitti), level)
    assert text in found.got


def test_a_card_without_its_data_is_only_read(card: str, tmp_path: Path) -> None:
    finding = only(check_card(card, str(tmp_path)), "warning")
    assert finding.check == "data"
    assert str(tmp_path) in finding.advice
