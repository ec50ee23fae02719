"""Rows of a comparison, by hand on small scenes."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mtp_bench.errors import RolloutError
from mtp_bench.scoring import (
    DEFINITIONS,
    SUBSETS,
    AgentScores,
    ReferenceSubsets,
    Report,
    SceneScore,
    reference_subsets,
    score_scene,
    summarise,
)
from mtp_bench.scoring.rows import Clear, Row
from tests.support.scoring_scenes import WALKER, Thing, make_card, make_rollout, make_scene, random_case

CARD = make_card(past=2, future=3, samples=2)
KEYS = {
    "agent", "hypotheses", "samples", "budget", "subset", "minADE", "minFDE", "missing_aware", "energy_score",
    "coverage", "gap_closed", "targets", "events", "objects", "scenes", "interval", "ms_per_frame",
}  # fmt: skip


def answer(error: float, false: int = 0, seen: bool = True, switch: bool = False, name: str = "s") -> SceneScore:
    """A car and a walker at rest are targets in frame 1; the forecasts of the car are ``error`` off, twice."""
    things = [Thing(1, 3, 0), Thing(2, 30, 0, class_id=WALKER)]
    objects = [Thing(1, 3, 0, forecast=np.tile([3 + error, 0.0], (2, 3, 1)))] if seen else []
    objects += [Thing(9, 60 + 9 * i, 0) for i in range(false)]
    tracks = [[Thing(1, 3, 0)], [Thing(2 if switch else 1, 3, 0)], *[[Thing(2 if switch else 1, 3, 0)]] * 3]
    rollout = make_rollout(tracks, [[], objects], samples=2, name=name)
    return score_scene(make_scene([things] * 5, name), rollout, CARD)


def agent(name: str, *runs: list[SceneScore], samples: int = 2, budget: Any = "equal") -> AgentScores:
    return AgentScores(name, 1, samples, budget, tuple(tuple(run) for run in runs), ideal=name == "truth_past")


def row(report: Report, subset: str = "all", agent: int = 0) -> Row:
    return report.rows[len(SUBSETS) * agent + SUBSETS.index(subset)]


def test_a_row_by_hand() -> None:
    got = row(summarise([agent("a", [answer(0.5, false=1)])], CARD))
    assert got.minADE == got.minFDE == pytest.approx(0.5)
    assert got.energy_score == pytest.approx(0.5)
    assert got.coverage == 0.5
    assert got.missing_aware == pytest.approx((0.5 + 4.0 + 5.0) / 2)  # the walker is missing, and a false forecast
    assert (got.targets, got.objects, got.scenes, got.events) == (2, 2, 1, None)
    assert got.interval is None  # one scene
    assert got.gap_closed is None
    assert got.ms_per_frame == pytest.approx(10.0)


def test_an_agent_that_says_nothing_has_no_errors_but_pays() -> None:
    got = row(summarise([agent("a", [answer(0, seen=False)])], CARD))
    assert got.minADE is got.minFDE is got.energy_score is None
    assert got.coverage == 0.0
    assert got.missing_aware == pytest.approx((10 + 4) / 2)


def test_silence_is_what_an_agent_without_forecasts_scores() -> None:
    report = summarise([agent("loud", [answer(0.5, false=9)]), agent("silent", [answer(0, seen=False)])], CARD)
    assert report.details[0].silence == report.details[1].silence == row(report, agent=1).missing_aware
    loud, silence = row(report, agent=0).missing_aware, report.details[0].silence
    assert loud is not None
    assert silence is not None
    assert loud > silence


def test_seeds_are_averaged_per_target() -> None:
    report = summarise([agent("a", [answer(0.5)], [answer(1.5, false=1)], [answer(0, seen=False)])], CARD)
    got = row(report)
    assert got.minADE == pytest.approx(1.0)  # over the two seeds that cover the car
    assert got.coverage == pytest.approx(2 / 6)
    assert got.missing_aware == pytest.approx(((0.5 + 1.5 + 10) / 3 + 4 + 5 / 3) / 2)
    parts = report.details[0].parts
    assert parts.localisation == pytest.approx(2.0 / 3 / 2)
    assert parts.missed == pytest.approx((10 / 3 + 4) / 2)
    assert parts.false == pytest.approx(5 / 3 / 2)
    assert sum(parts.model_dump().values()) == pytest.approx(got.missing_aware)


def test_event_subsets_have_no_false_term_and_no_targets_without_a_reference() -> None:
    reference = reference_subsets([answer(0, switch=True)], CARD)
    agents = [agent("a", [answer(0.5, false=1)])]
    got = summarise(agents, CARD, reference)
    assert row(got, "ids").missing_aware == pytest.approx(0.5)
    assert (row(got, "ids").events, row(got, "ids").targets, row(got, "ids").objects) == (1, 1, 1)
    assert (row(got, "lost").events, row(got, "lost").targets) == (0, 0)
    bare = row(summarise(agents, CARD), "ids")
    assert (bare.events, bare.targets, bare.missing_aware) == (None, 0, None)


def test_events_that_are_no_targets_are_counted_too() -> None:
    # the switch happens in the last frame, where there is no future
    tracks = [[Thing(1, 3, 0)]] * 4 + [[Thing(2, 3, 0)]]
    score = score_scene(make_scene([[Thing(1, 3, 0)]] * 5), make_rollout(tracks, samples=2), CARD)
    got = row(summarise([agent("a", [score])], CARD, reference_subsets([score], CARD)), "ids")
    assert (got.events, got.targets) == (1, 0)


def test_false_forecasts_are_free_where_the_truth_has_holes() -> None:
    things = [Thing(1, 3, 0)]
    objects = [Thing(1, 3, 0, forecast=np.tile([3.0, 0.0], (2, 3, 1))), Thing(9, 60, 0)]
    scene = make_scene([things] * 5, truth_complete=False)
    score = score_scene(scene, make_rollout([[]] * 5, [[], objects], samples=2), CARD)
    report = summarise([agent("a", [score])], CARD)
    assert row(report).missing_aware == 0.0
    detail = report.details[0]
    assert detail.EPA is detail.AP_f is detail.spurious_per_frame is detail.parts.false is None
    assert detail.tracking.all.MOTA is None
    assert detail.forecasts_per_frame == pytest.approx(2 / 5)
    assert report.condition["truth"].endswith("false positives are not measurable")


# ---- several scenes: STP, the truth, and agents between them

SCENES = [f"s{i}" for i in range(6)]


def run(error: float, **more: Any) -> list[SceneScore]:
    return [answer(error + 0.01 * i, name=name, **more) for i, name in enumerate(SCENES)]


def comparison(*others: AgentScores, reference: ReferenceSubsets | None = None, stp: float = 1.0) -> Report:
    ends = agent("stp", run(stp)), agent("truth_past", run(0.2))
    return summarise([*ends, *others], CARD, reference)


def test_gap_closed() -> None:
    report = comparison(agent("half", run(0.6)), agent("worse", run(1.4)), agent("noisy", run(0.6, false=3)))
    closed = [row(report, agent=i).gap_closed for i in range(5)]
    assert closed == pytest.approx([0.0, 1.0, 0.5, -0.5, 0.5])  # no false term


def test_gap_closed_is_undefined_at_another_k_and_where_there_is_no_gap() -> None:
    free = agent("half", run(0.6), samples=40, budget="free")
    assert row(comparison(free), agent=2).gap_closed is None
    assert row(comparison(agent("half", run(0.6)), stp=0.2), agent=2).gap_closed is None
    assert row(summarise([agent("half", run(0.6))], CARD)).gap_closed is None


def test_intervals_hold_the_error_and_pairs_their_difference() -> None:
    report = comparison(agent("half", run(0.6)))
    for i in range(3):
        got = row(report, agent=i)
        assert got.interval is not None
        assert got.missing_aware is not None
        assert got.interval[0] <= got.missing_aware <= got.interval[1]
        assert got.scenes == 6
    pairs = {(p.agent, p.other, p.subset): p for p in report.paired}
    pair = pairs["half", "stp", "all"]
    assert pair.missing_aware == pytest.approx(-0.2)  # half of the targets are cars
    assert pair.interval == pytest.approx([-0.2, -0.2])
    assert pair.p == 2 / 2**6
    assert pair.minADE == pytest.approx(-0.4)
    assert (pair.targets, pair.shared, pair.scenes) == (12, 6, 6)
    assert pairs["half", "stp", "ids"].p is None
    assert ("stp", "stp", "all") not in pairs


def test_ranks_need_twenty_objects_and_equal_budget() -> None:
    agents = [agent("a", run(0.6)), agent("b", run(0.3))]
    assert {r.rank for r in comparison(*agents).ranks} == {None}  # 12 objects

    def many(error: float) -> list[SceneScore]:
        return [answer(error + 0.01 * (i % 3), name=f"s{i}") for i in range(12)]

    free = agent("free", many(0.1), samples=40, budget="free")
    agents = [
        agent("stp", many(1.0)),
        agent("a", many(0.6)),
        agent("same", many(0.6)),
        free,
        agent("truth_past", many(0)),
    ]
    ranks = [r.rank for r in summarise(agents, CARD).ranks if r.subset == "all"]
    assert ranks == [3, 1, 1, None, None]


@pytest.mark.parametrize(("complete", "forecasts", "rank"), [(False, 3, 1), (False, 4, None), (True, 4, 1)])
def test_a_flood_is_not_ranked_where_false_forecasts_cost_nothing(
    complete: bool, forecasts: int, rank: int | None
) -> None:
    def many(error: float, count: int) -> list[SceneScore]:
        scores = [answer(error, name=f"s{i}") for i in range(12)]
        return [replace(score, truth_complete=complete, forecasts=count) for score in scores]

    agents = [agent("stp", many(1.0, 2)), agent("flood", many(0.1, forecasts))]
    ranks = {r.agent: r.rank for r in summarise(agents, CARD).ranks if r.subset == "all"}
    assert ranks["flood"] == rank
    assert ranks["stp"] == (1 if rank is None else 2)


def test_bins_and_planning() -> None:
    report = summarise([agent("a", [answer(0.5)])], CARD)
    detail = report.details[0]
    bins = {(b.by, b.bin): b for b in detail.bins}
    assert [b for _, b in bins] == [
        "0-5 m", "5-10 m", "10-15 m", "15-30 m", "30-50 m", "beyond 50 m", "car", "pedestrian", "moving", "static",
    ]  # fmt: skip
    assert bins["distance", "0-5 m"].errors.minADE == pytest.approx(0.5)
    assert bins["distance", "30-50 m"].errors.missing_aware == 4.0
    assert bins["distance", "5-10 m"].errors.minADE is None
    assert (bins["motion", "moving"].errors.targets, bins["motion", "static"].errors.targets) == (0, 2)
    assert bins["class", "car"].EPA == 1.0
    assert bins["class", "pedestrian"].EPA == 0.0
    near, far = math.exp(-0.5), math.exp(-50.0)
    assert pytest.approx((near * 0.5 + far * 4.0) / (near + far)) == detail.PI_ADE
    assert detail.EPA == 0.5
    assert detail.AP_f == pytest.approx(0.5)  # car 1, pedestrian 0
    assert detail.k_curve == {"1": pytest.approx(0.5)}


def test_what_comes_near_weighs_more_in_planning() -> None:
    things = [Thing(1, 3, 0), Thing(2, 6, 0)]
    objects = [
        Thing(1, 3, 0, forecast=np.tile([3.5, 0.0], (2, 3, 1))),
        Thing(2, 6, 0, forecast=np.tile([7, 0], (2, 3, 1))),
    ]
    score = score_scene(make_scene([things] * 5), make_rollout([[]] * 5, [[], objects], samples=2), CARD)
    near, far = math.exp(-0.5), math.exp(-2.0)
    got = summarise([agent("a", [score])], CARD).details[0].PI_ADE
    assert got == pytest.approx((near * 0.5 + far * 1.0) / (near + far))


def test_every_distance_belongs_to_one_bin() -> None:
    things = [Thing(i, x, 0) for i, x in enumerate((0.0, 5.0, 10.0, 15.0, 30.0, 49.0, 50.0))]
    score = score_scene(make_scene([things] * 5), make_rollout([[]] * 5, samples=2), CARD)
    bins = summarise([agent("a", [score])], CARD).details[0].bins
    assert [b.errors.targets for b in bins if b.by == "distance"] == [1, 1, 1, 1, 2, 1]


def test_own_events_are_shown() -> None:
    detail = summarise([agent("a", [answer(0.5, switch=True)])], CARD).details[0]
    assert detail.own["own_ids"].targets == detail.own["all_h_ids"].targets == 1
    assert detail.own["own_ids"].minADE == pytest.approx(0.5)
    assert detail.own["own_frag"].minADE is None
    assert detail.own_events == {"ids": 1, "lost": 0, "wrong": 0, "reacquired": 0}
    tracking = detail.tracking
    assert tracking.classes["car"] == Clear(TP=5, FP=0, FN=0, IDS=1, FRAG=0, MOTA=0.8, MOTP=0.0)
    assert tracking.classes["pedestrian"].MOTP is None
    assert tracking.all.FN == 5


def test_motp_of_an_overlap_gate_is_the_mean_overlap() -> None:
    card = make_card(measure="iou_3d")
    scene = make_scene([[Thing(1, 0, 0)]] * 5)
    score = score_scene(scene, make_rollout([[Thing(1, 1.0, 0)]] * 5, samples=4), card)
    detail = summarise([agent("a", [score], samples=4)], card).details[0]
    assert pytest.approx(0.6) == detail.tracking.classes["car"].MOTP


def test_everything_can_be_written_as_json_without_nan() -> None:
    card = make_card()
    scores = [score_scene(*random_case(seed, name=f"s{seed}"), card) for seed in range(4)]
    reference = reference_subsets(scores, card)
    agents = [agent("stp", scores, scores, samples=4), agent("truth_past", scores, samples=4)]
    report = summarise(agents, card, reference)
    content = report.to_json("ranks", "paired", "details")
    json.dumps(content, allow_nan=False)
    assert (content["env"], content["definitions"]) == ("MTP-Test-v0", DEFINITIONS)
    assert all(set(r) == KEYS for r in content["rows"])
    assert [(r.agent, r.subset) for r in report.rows] == [(a, s) for a in ("stp", "truth_past") for s in SUBSETS]


def test_order_of_agents_does_not_change_their_rows() -> None:
    agents = [agent("stp", run(1.0)), agent("truth_past", run(0.2)), agent("a", run(0.6))]
    one, two = summarise(agents, CARD), summarise(agents[::-1], CARD)
    assert sorted(map(repr, one.rows)) == sorted(map(repr, two.rows))


def test_an_empty_scene_is_no_error() -> None:
    empty = score_scene(make_scene([[]] * 3), make_rollout([[]] * 3, samples=2), CARD)
    got = row(summarise([agent("a", [empty])], CARD))
    assert (got.targets, got.missing_aware, got.scenes) == (0, None, 0)


def test_agents_on_different_targets_are_an_error() -> None:
    one, other = agent("a", run(0.5)), agent("b", run(0.5)[:5])
    with pytest.raises(RolloutError, match="agents 'a' and 'b' were scored on different scenes"):
        summarise([one, other], CARD)
    with pytest.raises(RolloutError, match="the seeds of agent 'a' were scored on different scenes"):
        summarise([agent("a", run(0.5), run(0.5)[::-1])], CARD)
    strange = [replace(score, key=score.key + 1) for score in run(0.5)]
    with pytest.raises(RolloutError, match="agents 'a' and 'b' have different targets in scene 's0'"):
        summarise([one, agent("b", strange)], CARD)
    with pytest.raises(RolloutError, match="agent 'c' has no scored scene"):
        summarise([agent("c")], CARD)
