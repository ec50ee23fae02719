"""What cheating earns (`benchmarks/gaming.py`), on the first scenes of the Intersection: nothing."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.attacks import CHANGES, joined
from mtp_bench.agent.loader import load_submission
from mtp_bench.env.environment import MTPEnv
from mtp_bench.running.playing import agent_task, run_scene
from mtp_bench.running.reference import reference_for
from mtp_bench.scoring import AgentScores, Report, score_scene, summarise
from mtp_bench.scoring.bade import CardBudget
from mtp_bench.scoring.rows import Row

ENV, SCENES = "MTP-Intersection-v0", 2
SHUFFLED = ("random confidence", "inverted confidence", "confidence 1", "surer in a crowd", "surer of what moves",
            "value order")  # fmt: skip


@pytest.fixture(scope="module")
def report() -> Report:
    env = MTPEnv(ENV, evaluation=True)
    stp = load_submission("stp")
    scores: dict[str, list[object]] = {}
    for name in env.scene_names[:SCENES]:
        rollout = run_scene(stp.build(agent_task(env, 0)), env, name, 0)
        again = run_scene(stp.build(agent_task(env, 0)), env, name, 1)  # the same tracks with other samples
        said = {label: change(env.scene, rollout, env.card) for label, change in CHANGES.items()}
        said |= {"stp": rollout, "twins": joined(rollout, again, lambda c: np.full_like(c, 0.001))}
        for label, one in said.items():
            scores.setdefault(label, []).append(score_scene(env.scene, one, env.card))
    agents = [AgentScores(label, 1, env.task.k, "equal", (tuple(rows),)) for label, rows in scores.items()]  # type: ignore[arg-type]
    reference = reference_for(env.card, env.scene_names[:SCENES])
    of_scenes = [reference.of(name) for name in env.scene_names[:SCENES]]
    # as on a whole split, whose constants are STP's own numbers there
    false, targets = (sum(getattr(each, name) for each in of_scenes) for name in ("false_forecasts", "targets"))
    constants = CardBudget(env.card.id, false, targets)
    return summarise(agents, env.card, replace(reference, constants=constants))


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
def test_other_confidences_change_event_subsets_where_gates_overlap(report: Report, agent: str, subset: str) -> None:
    assert error(report, agent, subset) == pytest.approx(error(report, "stp", subset), abs=0.01)


def test_no_cheat_gains_over_all_targets(report: Report) -> None:
    honest = error(report, "stp")
    gains = {agent: honest - error(report, agent) for agent in CHANGES if agent != "value order"}
    assert max(gains.values()) < 0.02 * honest, gains  # wider samples may be the better forecast, by a little


@pytest.mark.parametrize("subset", ["all", "ids", "reacquired"])
def test_unsure_twins_with_other_samples_gain_nothing(report: Report, subset: str) -> None:
    assert error(report, "twins", subset) == pytest.approx(error(report, "stp", subset), abs=1e-3)


def test_repeats_and_copies_cost_or_are_never_looked_at(report: Report) -> None:
    for frames in (1, 3):
        said = "1 frame" if frames == 1 else "3 frames"
        assert error(report, f"repeats {said}, confidence 1") > error(report, "stp") + 1.0
        assert error(report, f"repeats {said}, confidence 0") == pytest.approx(error(report, "stp"), abs=1e-9)
    assert error(report, "every class") > error(report, "stp") + 1.0
    assert error(report, "every class, others half as sure") > error(report, "stp")
    assert error(report, "duplicates") > error(report, "stp") + 1.0


def test_a_far_pair_of_samples_costs_the_energy_score(report: Report) -> None:
    far, stp = row(report, "far pair").energy_score, row(report, "stp").energy_score
    assert far is not None
    assert stp is not None
    assert far > 10.0 * stp
    assert np.isclose(error(report, "far pair"), error(report, "silence"))
