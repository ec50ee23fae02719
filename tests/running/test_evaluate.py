"""Agents of a program, scored in memory, and failing ones beside others."""

import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

import mtp_bench
from mtp_bench.core import Task
from mtp_bench.core.errors import MtpBenchError, SubmissionError, UnknownNameError
from mtp_bench.scoring.table import SceneResult
from tests.support.command_line import write_submission
from tests.support.small_scenes import Action, EchoAgent, make_noisy, make_scene as drawn

pytestmark = pytest.mark.usefixtures("remembered_weights")


@dataclass
class Counting(EchoAgent):
    """Its answers depend on the scenes before, which `reset` does not forget."""

    noise: float = 0.1
    scenes: int = 0
    held: Iterator[int] | None = field(default=None, repr=False)

    def reset(self, task: Task) -> None:
        super().reset(task)
        self.scenes += 1
        self.noise *= self.scenes


def numbers(report: mtp_bench.Report) -> list[dict[str, Any]]:
    return [{**row, "agent": ""} for row in report.to_json()["rows"]]


def test_objects_functions_classes_and_folders_score_alike_in_processes(card: str, kitti: str, tmp_path: Path) -> None:
    folder = write_submission(tmp_path / "echo", tables="[parameters]\nnoise = 0.1\n")
    agents = [folder, str(folder), mtp_bench.load_submission(folder), EchoAgent(0.1), make_noisy, Counting, Counting()]
    reports = [mtp_bench.evaluate(agent, card, data=kitti, seeds=2) for agent in agents]
    named = [report.rows[0].agent for report in reports[2:]]
    assert named == ["echo", "EchoAgent", "make_noisy", "Counting", "Counting"]
    assert [numbers(report) for report in reports[1:]] == [numbers(reports[0])] * 6
    spread = mtp_bench.evaluate(agents[-1], card, data=Path(kitti), seeds=[0, 1], jobs=2)
    assert numbers(spread) == numbers(reports[0])
    mtp_bench.run(agents[-1], card, tmp_path / "run", data=kitti, jobs=2)
    assert numbers(mtp_bench.score(tmp_path / "run", data=kitti).report) == numbers(
        mtp_bench.evaluate(agents[-1], card, data=kitti)
    )


def test_an_object_that_cannot_be_copied_runs_in_this_process_alone(card: str, kitti: str) -> None:
    agent = Counting(held=iter(n for n in range(3)))
    assert (mtp_bench.evaluate(agent, card, data=kitti).rows[0].targets, agent.scenes) == (24, 3)
    with pytest.raises(MtpBenchError, match=r"'Counting' cannot be sent to other processes .*: take jobs=1, or pass"):
        mtp_bench.evaluate(agent, card, data=kitti, jobs=2)


def test_results_are_told_scene_by_scene_and_add_up_to_those_of_the_report(card: str, kitti: str) -> None:
    told: list[SceneResult] = []
    report = mtp_bench.evaluate(EchoAgent(0.2), card, data=kitti, seeds=2, on_scene=told.append)
    rows = report.per_scene()
    assert [(each.scene, each.seed) for each in told] == [(row["scene"], row["seed"]) for row in rows]
    assert [each.min_ade for each in told] == [row["minADE"] for row in rows]
    mean = sum(row["bADE_sum"] for row in rows) / sum(row["targets"] for row in rows)
    assert mean == pytest.approx(report.rows[0].error, rel=1e-12)
    assert rows[2]["bADE"] is None, "a scene without targets"
    assert report.to_frame().set_index("subset").loc["all", "error"] == report.rows[0].error
    assert repr(report).startswith("MTP-Small-v0, 2 scenes, 2 seeds: m, less is better")
    assert "<table" in report._repr_html_()


def test_without_pandas_the_error_says_what_to_install(card: str, monkeypatch: pytest.MonkeyPatch) -> None:
    report = mtp_bench.evaluate(EchoAgent(), card, scenes=[drawn("mine", 12)])
    assert (report.rows[0].targets, report.rows[0].scenes) == (24, 1)
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MtpBenchError, match="pip install pandas"):
        report.to_frame()


WRONG: dict[str, tuple[object, dict[str, Any], type[Exception], str]] = {
    "no agent": (3, {}, MtpBenchError, "agent is of type int, expected an agent with reset"),
    "a keyword": (EchoAgent(), {"seed": 1}, UnknownNameError, "unknown keyword 'seed': did you mean 'seeds'"),
    "a scene": (EchoAgent(), {"scenes": ["1"]}, UnknownNameError, "unknown scene '1': known are 0001"),
    "scenes": (EchoAgent(), {"scenes": "0001"}, MtpBenchError, "scenes is '0001', expected a number of scenes, or"),
    "an empty list": (EchoAgent(), {"scenes": []}, MtpBenchError, "scenes is an empty list"),
    "no agent built": (lambda task: 3, {}, SubmissionError, "'agent' cannot be built: .*returned 'int' without reset"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_arguments_are_one_clear_error(case: str, card: str, kitti: str) -> None:
    agent, keywords, kind, text = WRONG[case]
    with pytest.raises(kind, match=text):
        mtp_bench.evaluate(agent, card, data=kitti, **keywords)


def late(task: Task) -> EchoAgent:
    return Late()


class Late(EchoAgent):
    def reset(self, task: Task) -> None:
        super().reset(task)
        self.left = 8

    def act(self, observation: dict[str, Any]) -> Action:
        self.left -= 1
        if not self.left:
            raise RuntimeError("no\nframe is left")
        return super().act(observation)


def broken(task: Task) -> EchoAgent:
    raise ValueError("of no use")


@pytest.mark.parametrize("jobs", [1, 2])
def test_failing_agents(jobs: int, card: str, kitti: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MTP_BENCH_WEIGHTS", str(tmp_path))
    known: Any = {"data": kitti, "full": False}
    good = mtp_bench.compare([EchoAgent(0.1)], card, **known)
    assert repr(good) == str(good.report)
    report = mtp_bench.compare(["tracking_free", late, EchoAgent(0.1), broken], card, **known, jobs=jobs).report
    assert numbers(report) == numbers(good.report)
    weights = report.failures["tracking_free"]
    assert weights.startswith("cannot be reset: MTP-Small-v0: no weights tracking_free-tracklets-MTP-Small-v0")
    assert "mtp-bench train predictor tracking_free --env MTP-Small-v0 --on tracklets" in weights
    assert {name: reason for name, reason in report.failures.items() if name != "tracking_free"} == {
        "broken": "cannot be built: ValueError: of no use",
        "late": "failed on scene '0001' at frame 7: RuntimeError: no frame is left",
    }
    assert "\nbroken cannot be built: ValueError: of no use" in str(report)
    with pytest.raises(SubmissionError, match=r"agent 'broken' cannot be built: .*; agent 'late' failed on scene"):
        mtp_bench.compare([late, broken], card, **known, jobs=jobs)


GONE = "it exited, crashed, or memory ran out (then take fewer processes, --jobs)"


def vanish(task: Task) -> EchoAgent:
    os._exit(3)


class Vanishing(EchoAgent):
    """Takes its process with it."""

    def act(self, observation: dict[str, Any]) -> Action:
        os._exit(3)


def unreadable(task: Task) -> EchoAgent:
    raise type("Unreadable", (GeneratorExit,), {"__str__": lambda self: 1 / 0})


def test_whatever_an_agent_does_costs_the_others_nothing(card: str, kitti: str) -> None:
    # each run of an agent that ends its process ends those beside it, which begin again in new processes
    known: Any = {"data": kitti, "scenes": ["0006"], "full": False}
    good = mtp_bench.compare([EchoAgent(0.1)], card, **known)
    report = mtp_bench.compare([unreadable, Vanishing(), EchoAgent(0.1), vanish], card, **known, jobs=2).report
    assert numbers(report) == numbers(good.report)
    gone = dict.fromkeys(("Vanishing", "vanish"), f"ended its process: {GONE}")
    assert report.failures == {"unreadable": "cannot be built: Unreadable: its text cannot be read", **gone}


def test_a_failing_control_is_an_error(card: str, kitti: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mtp_bench.tracking.HypothesisTracker.reset", None)
    with pytest.raises(SubmissionError, match="agent 'stp' cannot be reset: TypeError"):
        mtp_bench.compare([EchoAgent()], card, data=kitti)
