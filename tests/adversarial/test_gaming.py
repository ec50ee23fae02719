"""What cheating earns (`benchmarks/gaming.py`), on the first scenes of the Intersection: nothing."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from mtp_bench.env.environment import MTPEnv
from mtp_bench.running.reference import reference_for
from mtp_bench.running.run import agent_task, run_scene
from mtp_bench.scoring import AgentScores, Report, score_scene, summarise
from mtp_bench.scoring.rows import Row
from mtp_bench.submission.loader import load_submission

ENV, SCENES = "MTP-Intersection-v0", 2
GAMING = Path(__file__).parents[2] / "benchmarks" / "gaming.py"
SHUFFLED = (
    "random confidence", "inverted confidence", "confidence 1", "surer in a crowd", "surer of what moves"
)  # fmt: skip


@pytest.fixture(scope="module")
def gaming() -> ModuleType:
    spec = importlib.util.spec_from_file_location("gaming", GAMING)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules["gaming"] = importlib.util.module_from_spec(spec)  # its dataclasses look themselves up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def report(gaming: ModuleType) -> Report:
    env = MTPEnv(ENV, evaluation=True)
    stp = load_submission("stp")
    scores: dict[str, list[object]] = {}
    for name in env.scene_names[:SCENES]:
        rollout = run_scene(stp.build(agent_task(env, 0)), env, name, 0)
        scores.setdefault("stp", []).append(score_scene(env.scene, rollout, env.card))
        for label, change in gaming.CHANGES.items():
            scores.setdefault(label, []).append(score_scene(env.scene, change(env.scene, rollout, env.card), env.card))
    agents = [AgentScores(label, 1, env.task.k, "equal", (tuple(rows),)) for label, rows in scores.items()]  # type: ignore[arg-type]
    return summarise(agents, env.card, reference_for(env.card, env.scene_names[:SCENES]))


def row(report: Report, agent: str, subset: str = "all") -> Row:
    return next(row for row in report.rows if (row.agent, row.subset) == (agent, subset))


def error(report: Report, agent: str, subset: str = "all") -> float:
    value = row(report, agent, subset).error
    assert value is not None
    return value


@pytest.mark.parametrize("subset", ["all", "ids", "reacquired"])
def test_silence_is_last(report: Report, subset: str) -> None:
    worst = error(report, "silence", subset)
    assert all(error(report, agent, subset) <= worst + 1e-9 for agent in {r.agent for r in report.rows})


@pytest.mark.parametrize("subset", ["all", "ids", "reacquired", "lost"])
def test_silence_where_no_target_can_be_changes_nothing(report: Report, subset: str) -> None:
    assert error(report, "silence where nobody looks", subset) == error(report, "stp", subset)


@pytest.mark.parametrize("agent", SHUFFLED)
@pytest.mark.parametrize("subset", ["ids", "reacquired"])
def test_other_confidences_of_the_same_forecasts_change_no_event_subset(
    report: Report, agent: str, subset: str
) -> None:
    assert error(report, agent, subset) == error(report, "stp", subset)


def test_no_cheat_gains_over_all_targets(report: Report, gaming: ModuleType) -> None:
    honest = error(report, "stp")
    gains = {agent: honest - error(report, agent) for agent in gaming.CHANGES}
    assert max(gains.values()) < 0.01 * honest, gains  # wider samples may be the better forecast, by a little


def test_repeats_and_copies_cost_or_are_never_looked_at(report: Report) -> None:
    for frames in (1, 3):
        said = "1 frame" if frames == 1 else "3 frames"
        assert error(report, f"repeats {said}, confidence 1") > error(report, "stp") + 1.0
        assert error(report, f"repeats {said}, confidence 0") == pytest.approx(error(report, "stp"), abs=1e-9)
    assert error(report, "every class") > error(report, "stp") + 1.0
    assert error(report, "duplicates") > error(report, "stp") + 1.0


def test_a_far_pair_of_samples_costs_the_energy_score(report: Report) -> None:
    far, stp = row(report, "far pair").energy_score, row(report, "stp").energy_score
    assert far is not None
    assert stp is not None
    assert far > 10.0 * stp
    assert np.isclose(error(report, "far pair"), error(report, "silence"))
