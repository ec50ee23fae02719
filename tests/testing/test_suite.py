"""The conformance suite: sound agents pass, and each way to break the contract has its finding."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mtp_bench import load_submission
from mtp_bench.agent import SubmissionFactory
from mtp_bench.agent.submission_files import new_submission
from mtp_bench.core import Observation, Task
from mtp_bench.running import Finding, check_agent
from tests.support.small_scenes import Action, EchoAgent, write_short_card

SCENES = ["0006", "0001"]


def check(make: Callable[[Task], Any], card: str, kitti: str, scenes: list[str] | None = None) -> list[Finding]:
    return check_agent(make, card, scenes or SCENES, {"data": kitti})


def faults(findings: list[Finding]) -> list[tuple[str, str]]:
    return [(finding.level, finding.check) for finding in findings if finding.level != "ok"]


def only(findings: list[Finding], level: str = "error") -> Finding:
    (found,) = [finding for finding in findings if finding.level == level]
    return found


@pytest.mark.parametrize("name", ["mtp", "stp_hedged", "stp_neighbours", "stp_bends", "template"])
def test_good_agents_pass(name: str, tmp_path: Path) -> None:
    submission = load_submission(new_submission("mine", tmp_path) if name == "template" else name)
    short = write_short_card(tmp_path, "MTP-Intersection-v0", 8.0)
    findings = check_agent(SubmissionFactory(str(submission.path), submission.parameters), short)
    assert faults(findings) == []
    checks = [finding.check for finding in findings]
    assert checks == [
        "build", "contract", "determinism", "reset", "observations", "extremes", "rigid motion", "latency",
    ]  # fmt: skip
    assert "ms per frame (p50)" in findings[-1].got


class Broken(EchoAgent):
    """The echo, which ``change`` spoils: it gets the action and the observation, and may return another action."""

    def __init__(self, change: "Change") -> None:
        super().__init__()
        self.change = change
        self.calls = 0  # over all scenes

    def act(self, observation: Observation) -> Action:
        self.calls += 1
        action = super().act(observation)
        return self.change(self, action, observation) or action


Change = Callable[[Broken, Action, Observation], Any]


def put(key: str, index: Any, value: Any) -> Change:
    return lambda agent, action, observation: action[key].__setitem__(index, value)


def swap(key: str, value: Callable[[NDArray[Any]], Any]) -> Change:
    return lambda agent, action, observation: action.__setitem__(key, value(action[key]))


def unclocked(agent: Broken, action: Action, observation: Observation) -> None:
    action["forecast"] += np.random.default_rng().normal(scale=0.1, size=action["forecast"].shape)


def ragged(agent: Broken, action: Action, observation: Observation) -> None:
    """Answers with lists that are no array, and takes apart what it is shown."""
    observation.pop("time")
    observation["dt"] = None  # type: ignore[assignment]
    action["track_box"] = [[1.0], [1.0, 2.0]]  # type: ignore[assignment]


def remembering(agent: Broken, action: Action, observation: Observation) -> None:
    """Goes on counting ids in the next scene."""
    action["track_id"] = action["track_id"] + 10 * agent.calls


def needing_detections(agent: Broken, action: Action, observation: Observation) -> None:
    """Divides by the number of detections."""
    _ = 1 // int(observation["detection_valid"].sum() > 0 or observation["time"] > 0.25)


def located(agent: Broken, action: Action, observation: Observation) -> None:
    """Knows where the scene lies: nothing is forecast outside its neighbourhood."""
    action["object_valid"] *= np.int8(np.abs(observation["ego_pose"][:2]).max() < 9.0)


def writing(agent: Broken, action: Action, observation: Observation) -> None:
    observation["detection_box"][:, 2] = 0.0


def chatty(agent: Broken, action: Action, observation: Observation) -> Action:
    return {**action, "debug": np.zeros(1)}


class Keeping(EchoAgent):
    """Keeps a reference to the last observation."""

    def reset(self, task: Task) -> None:
        super().reset(task)
        self.last: Observation | None = None

    def act(self, observation: Observation) -> Action:
        action = super().act(self.last or observation)
        self.last = observation
        return action


BROKEN: dict[str, tuple[Change | type[EchoAgent], list[tuple[str, str]], str]] = {
    "random": (unclocked, [("error", "determinism")], "scene 0006, frame 0, forecast"),
    "ragged": (ragged, [("error", "contract"), ("warning", "observations")], "scene 0006, frame 0"),
    "leaks": (remembering, [("error", "reset")], "scene 0006, frame 0, track_id"),
    "writes": (writing, [("warning", "observations")], "scene 0006, frame 0, detection_box"),
    "keeps": (Keeping, [("error", "observations")], "scene 0006, frame 1"),
    "no detections": (needing_detections, [("error", "extremes")], "frame 0 (no detections)"),
    "located": (located, [("error", "rigid motion")], "scene 0006, scene 0001"),
    "not a number": (put("track_box", (0, 0), np.nan), [("error", "contract")], "frame 0, track_box[0] = [nan"),
    "other shape": (swap("forecast", lambda array: array[:, :2]), [("error", "contract")], "scene 0006, frame 0"),
    "silent": (put("object_valid", ..., 0), [("warning", "contract")], "scene 0006, scene 0001"),
    "chatty": (chatty, [("warning", "contract")], "scene 0006, frame 0, debug"),
    "loose": (put("hypothesis_member", ..., 0), [("warning", "contract")] * 2, "scene 0006, frame 0, track_valid[0]"),
}


@pytest.mark.parametrize(("agent", "expected", "where"), BROKEN.values(), ids=BROKEN)
def test_each_way_to_break_the_contract_is_found_and_placed(
    agent: Change | type[EchoAgent], expected: list[tuple[str, str]], where: str, card: str, kitti: str
) -> None:
    findings = check(lambda task: agent() if isinstance(agent, type) else Broken(agent), card, kitti)
    found = [finding for finding in findings if finding.level != "ok"]
    assert faults(found) == expected, [str(finding) for finding in found]
    assert where in found[0].where
    assert found[0].expected


def test_an_agent_that_raises_shows_its_own_lines(card: str, kitti: str) -> None:
    class Raising(EchoAgent):
        def act(self, observation: Observation) -> Action:
            if observation["time"] > 0.25:
                raise ValueError("no more")
            return super().act(observation)

    findings = check(lambda task: Raising(), card, kitti)
    assert [finding.check for finding in findings][-1] == "contract", "the other checks would say the same"
    error = only(findings)
    assert (error.got, error.where, len(error.traceback)) == ("ValueError: no more", "scene 0006, frame 3", 1)
    assert error.traceback[0].startswith("test_suite.py, line ")
    assert error.traceback[0].endswith('in act: raise ValueError("no more")')
