"""Rows of a comparison, by hand on small scenes."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mtp_bench.core.errors import DataError, RolloutError
from mtp_bench.scoring import DEFINITIONS, SUBSETS, AgentScores, Report, SceneScore, score_scene, summarise
from mtp_bench.scoring.rank import ALONE_TEXT, References
from mtp_bench.scoring.report import paired_row
from mtp_bench.scoring.rows import Row
from mtp_bench.scoring.table import agent_table
from mtp_bench.scoring.weights import Reference, SceneWeights, scene_key
from tests.support.scoring_scenes import WALKER, Thing, make_card, make_rollout, make_scene, random_case

CARD = make_card(past=2, future=3, samples=2)
RUNS = 4


def answer(
    error: float, false: int = 0, seen: bool = True, switch: bool = False, name: str = "s", sure: float = 1.0
) -> SceneScore:
    """A car and a walker at rest are targets in frame 1; the forecasts of the car are ``error`` off, twice."""
    things = [Thing(1, 3, 0), Thing(2, 30, 0, class_id=WALKER)]
    objects = [Thing(1, 3, 0, forecast=np.tile([3 + error, 0.0], (2, 3, 1)), confidence=sure)] if seen else []
    objects += [Thing(9, 60 + 9 * i, 0) for i in range(false)]
    tracks = [[Thing(1, 3, 0)], [Thing(2 if switch else 1, 3, 0)], *[[Thing(2 if switch else 1, 3, 0)]] * 3]
    rollout = make_rollout(tracks, [[], objects], samples=2, name=name)
    return score_scene(make_scene([things] * 5, name), rollout, CARD)


def agent(name: str, *runs: Sequence[SceneScore], samples: int = 2, budget: Any = "equal") -> AgentScores:
    seeds = tuple(tuple(replace(score, samples=samples) for score in run) for run in runs)
    return AgentScores(name, 1, samples, budget, seeds, "truth" if name == "gt_tracks" else "detections")


def reference(names: Sequence[str] = ("s",), counts: Any = ((0,) * 4, (0,) * 4), **more: Any) -> Reference:
    """Weights of the car and the walker: in how many of four runs they have ids, lost, reacquired, frag."""
    plain = np.zeros((len(counts), 3), dtype=bool)
    plain[0, 0] = True
    whole: dict[str, Any] = {"stp_events": (3, 2, 1), "false_forecasts": 2, "forecasts": 30, **more}
    weights = SceneWeights(np.array(counts, dtype=np.uint8), plain, **whole)
    scenes = {scene_key(CARD.id, name): weights for name in names}
    return Reference(CARD.id, CARD.digest, DEFINITIONS, "stp", RUNS, {}, scenes)


def row(report: Report, subset: str = "all", agent: int = 0) -> Any:
    """A `Row`; Any lets it be compared with approximate numbers."""
    return report.rows[len(SUBSETS) * agent + SUBSETS.index(subset)]


def test_a_row_by_hand() -> None:
    report = summarise([agent("a", [answer(0.5, false=1)])], CARD, reference(counts=[[1, 0, 0, 0], [3, 0, 0, 0]]))
    got = row(report)
    assert got.minADE == got.minFDE == got.energy_score == pytest.approx(0.5)
    assert got.coverage == 0.5
    assert got.plain_error == pytest.approx((0.5 + 4) / 2)  # the walker is missing
    assert got.fixed_error == pytest.approx((0.5 + 4 + 5) / 2)
    # budgets are 0.2, 0.4, ... 2 false forecasts: up to one the agent is silent for the rest, at 7 m
    assert (got.error, got.missed) == (pytest.approx(0.2 * 7 + 0.8 * 2.25), pytest.approx(0.2 * 7 + 0.8 * 2))
    assert got.localisation == pytest.approx(0.8 * 0.25)
    assert got.error_by_score == got.error  # there are no detections: all alike
    assert (got.targets, got.objects, got.scenes, got.events, got.seeds) == (2, 2, 1, None, 1)
    assert (got.effective_targets, got.effective_objects, got.effective_units) == (2, 2, 1)
    assert got.interval is got.gap_closed is got.p is None  # one unit, no ends
    assert got.ms_per_frame == pytest.approx(10.0)
    ids = row(report, "ids")
    assert ids.error == ids.plain_error == pytest.approx((0.5 + 3 * 4) / 4)  # at STP's two false forecasts
    assert ids.fixed_error is None
    assert ((ids.events, ids.targets, ids.objects), ids.effective_targets) == ((1.0, 2, 2), pytest.approx(16 / 10))
    lost = row(report, "lost")
    assert (lost.error, lost.events, lost.targets) == (None, 0, 0)
    paper = row(report, "paper_ids")
    assert (paper.error, paper.minADE, paper.targets, paper.events) == (pytest.approx(0.5), pytest.approx(0.5), 1, 3)
    assert row(report, "paper_frag").events == 3


def test_without_a_reference_only_all_targets_have_weight_and_budgets_go_up_to_one_per_target() -> None:
    report = summarise([agent("a", [answer(0.5, false=4)])], CARD)
    assert row(report).error == pytest.approx(7 - (7 - 2.25) * np.mean(np.arange(1, 11) / 5 / 4))
    assert (row(report, "ids").events, row(report, "ids").targets, row(report, "ids").error) == (None, 0, None)
    assert report.condition["weights"] == "none"


# ---- several scenes: STP, the truth, and agents between them
SCENES = [f"s{i}" for i in range(12)]
ALIKE = reference(SCENES, counts=[[2, 1, 2, 2], [2, 0, 2, 2]])


def run(error: float, **more: Any) -> list[SceneScore]:
    return [answer(error + 0.01 * (i % 5), name=name, **more) for i, name in enumerate(SCENES)]


def comparison(*others: AgentScores, stp: float = 1.0, own: Mapping[str, References | None] | None = None) -> Report:
    ends = agent("stp", run(stp)), agent("gt_tracks", run(0.2))
    return summarise([*ends, *others], CARD, ALIKE, references=own)


def test_the_gaps_with_an_agent_s_own_predictor_and_why_others_are_blank() -> None:
    runs = (agent("r", run(error)) for error in (0.7, 0.3, 0.65, 0.6, 0.6, 0.3))
    kinematic = References(agent("stp", run(1.0)), agent("gt_tracks", run(0.2)), *[agent("r", run(0.5))] * 2)
    own: dict[str, References | None] = {"half": References(*runs), "stp": kinematic, "unknown": None}
    report = comparison(agent("half", run(0.62)), agent("unknown", run(0.6)), own=own)
    unstated = "its manifest does not state gap_references"
    for place, gaps, reasons in (
        (0, (0.0, 0.0, None), (None, "the gap is not significantly above 0")),
        (1, (1.0, None, None), (None, "its references were not run")),
        (2, (None, 0.2, 0.6), ("its predictor is not that of stp", None)),
        (3, (None, None, None), (unstated, unstated)),
    ):
        got = row(report, agent=place)
        found = got.gap_closed, got.gap_closed_same_predictor, got.association_gap_closed
        assert found == tuple(None if gap is None else pytest.approx(gap) for gap in gaps)
        assert (got.gap_blank_because, got.association_gap_blank_because) == reasons


def test_min_ade_is_compared_over_targets_that_both_cover() -> None:
    """Either side may lack a forecast: without the check of one the minADE of 0 of an uncovered target would count."""
    seldom = agent("seldom", [answer(1.0, name=name, seen=i < 6) for i, name in enumerate(SCENES)])
    always = agent("always", [answer(0.6, name=name) for name in SCENES])
    tables = agent_table(seldom, ALIKE), agent_table(always, ALIKE)
    for table, control, gain in ((*tables, 0.4), (*tables[::-1], -0.4)):
        pair = paired_row(table, control, "all")
        assert pair.minADE == pytest.approx(gain)
        assert (pair.shared, pair.targets) == (6, 24)


@pytest.mark.parametrize("seen", [True, False], ids=["sees the car", "says nothing"])
def test_one_agent_alone_is_not_ranked(seen: bool) -> None:
    report = summarise([agent("a", run(0.6, seen=seen))], CARD, ALIKE)
    for subset in ("all", "ids", "reacquired"):
        assert (row(report, subset).place, row(report, subset).unranked_because) == (None, ALONE_TEXT)
    assert row(report, "lost").unranked_because == "shown only"
    truth = summarise([agent("gt_tracks", run(0.6, seen=seen))], CARD, ALIKE)
    assert row(truth).unranked_because == "saw the truth"


def test_objects_are_those_of_the_recording() -> None:
    cut = [replace(score, recording="whole" if i < 9 else score.scene) for i, score in enumerate(run(0.6))]
    got = row(summarise([agent("a", cut)], CARD))
    assert (got.objects, got.effective_objects, got.scenes) == (8, pytest.approx(24**2 / (2 * 81 + 6)), 12)


def test_everything_can_be_written_as_json_without_nan() -> None:
    card = make_card()
    scores = [score_scene(*random_case(seed, name=f"s{seed}"), card) for seed in range(4)]
    silent = [replace(score, truth_complete=False) for score in scores]
    for runs in ((scores, scores), (silent,)):
        report = summarise([agent("stp", *runs, samples=4), agent("gt_tracks", *runs, samples=4)], card)
        content = report.to_json("condition", "paired", "details")
        json.dumps(content, allow_nan=False)
        assert (content["env"], content["definitions"]) == ("MTP-Test-v0", DEFINITIONS)
        assert all({*r, "ms_per_frame"} == set(Row.model_fields) for r in content["rows"])
        assert len(content["ms_per_frame"]) == len(content["rows"])
    assert [(r.agent, r.subset) for r in report.rows] == [(a, s) for a in ("stp", "gt_tracks") for s in SUBSETS]


def test_an_empty_scene_is_no_error() -> None:
    empty = score_scene(make_scene([[]] * 3), make_rollout([[]] * 3, samples=2), CARD)
    got = row(summarise([agent("a", [empty])], CARD))
    assert (got.targets, got.error, got.plain_error, got.fixed_error, got.scenes) == (0, None, None, None, 0)


def strange(scores: Sequence[SceneScore]) -> list[SceneScore]:
    return [replace(score, frame=score.frame + 1) for score in scores]


BACKWARDS = References(agent("stp", run(1.0)[::-1]), agent("gt_tracks", run(0.2)[::-1]))
DIFFERENT: dict[str, tuple[list[AgentScores], dict[str, Any]]] = {
    "agents 'a' and 'b' were scored on different scenes": ([agent("a", run(0.5)), agent("b", run(0.5)[:5])], {}),
    "the seeds of agent 'a' were scored on different": ([agent("a", run(0.5), run(0.5)[::-1])], {}),
    "agents 'a' and 'b' have different targets in scene 's0'": (
        [agent("a", run(0.5)), agent("b", strange(run(0.5)))], {}),
    "'a' and a reference of 'a' were scored on different": (
        [agent("a", run(0.5))], {"references": {"a": BACKWARDS}}),
    "agent 'c' has no scored scene": ([agent("c")], {}),
    "scene 's1' of agent 'a' has 3 samples per object, expected 2 as in the others": (
        [AgentScores("a", 1, 2, "equal", ((run(0.5)[0], replace(run(0.5)[1], samples=3)),))], {}),
    "no event weights of scene 's3'": ([agent("a", run(0.5))], {"reference": reference(SCENES[:3])}),
    "scene 's' are of 3 targets, the scene has 2: delete /made/here, whose": (
        [agent("a", [answer(0)])], {"reference": reference(counts=[[0] * 4] * 3)}),
}  # fmt: skip


@pytest.mark.parametrize("message", DIFFERENT)
def test_agents_on_different_targets_are_an_error(message: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MTP_BENCH_CACHE", "/made/here")
    agents, options = DIFFERENT[message]
    with pytest.raises((DataError, RolloutError), match=message):
        summarise(agents, CARD, **options)
