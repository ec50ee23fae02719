"""Parts of bADE: they add up to it, and each is what its name says."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mtp_bench.running.compare import compare
from mtp_bench.running.options import RunOptions
from mtp_bench.scoring import AgentScores, References, SceneScore, score_scene, summarise
from mtp_bench.scoring.absence import AbsentCause
from mtp_bench.scoring.bade import at_budgets
from mtp_bench.scoring.parts import PARTS, error_parts, reference_errors
from mtp_bench.scoring.rows import Row
from mtp_bench.scoring.table import agent_table
from mtp_bench.scoring.targets import find_targets
from mtp_bench.types import Detections, Scene
from tests.support.scoring_scenes import (
    WALKER,
    Array,
    Thing,
    make_card,
    make_rollout,
    make_scene,
    random_case,
    take_objects,
    with_detections,
)

CARD = make_card()
SMALL = make_card(past=2, future=3, samples=1)
steady = settings(derandomize=True, deadline=None, max_examples=15)
REFERENCES = ("ground_truth", "localisation", "history", "association")


def seen_some(scene: Scene, seed: int) -> Scene:
    """The scene with detections of some of its true boxes, up to 3 m off, some of another class."""
    rng = np.random.default_rng(seed)
    truth = scene.truth.select(rng.random(len(scene.truth.box)) < 0.6)
    box, other = truth.box.copy(), rng.random(len(truth.box)) < 0.3
    box[:, :2] += rng.uniform(-2, 2, (len(box), 2))
    class_id = np.where(other, 1 - truth.class_id, truth.class_id)
    return replace(scene, detections=Detections(truth.start, box, truth.velocity, class_id, rng.random(len(box))))


def scored(seed: int, agent: str, runs: int = 2) -> tuple[list[Scene], AgentScores]:
    """Two scenes and what the runs of an agent say of them: other objects at other confidences in each run."""
    cases = [random_case(2 * seed + i, name=name) for i, name in enumerate("ab")]
    scenes = [seen_some(scene, seed) for scene, _ in cases]
    rng, seeds = np.random.default_rng([seed, len(agent)]), []
    for _ in range(runs):
        scores = []
        for scene, (_, rollout) in zip(scenes, cases, strict=True):
            count = len(rollout.object_box)
            confidence = (rng.integers(0, 9, count) / 8).astype(np.float32)
            kept = np.flatnonzero(rng.random(count) < 0.7)
            scores.append(score_scene(scene, take_objects(replace(rollout, object_confidence=confidence), kept), CARD))
        seeds.append(tuple(scores))
    return scenes, AgentScores(agent, 1, 4, "equal", tuple(seeds))


def cause_of(scene: Scene, row: int) -> str:
    """The cause of a true box by its definition, box by box."""
    truth, seen = scene.truth, scene.detections
    gate = CARD.per_class(CARD.task.forecast_gate)[truth.class_id[row]]

    def near(box: int, own: bool, limit: float) -> bool:
        now = seen.frame_of_rows == truth.frame_of_rows[box]
        there = now & ((seen.class_id == truth.class_id[row]) == own)
        return bool((np.hypot(*(seen.box[there, :2] - truth.box[box, :2]).T) <= limit).any())

    past = [i for i in range(row) if truth.object_id[i] == truth.object_id[row]]
    if near(row, True, gate):
        return "no_forecast"
    if near(row, False, gate):
        return "other_class"
    if near(row, True, 2 * gate):
        return "off_place"
    return "undetected_seen" if any(near(i, True, gate) for i in past) else "undetected_new"


def plain(scores: AgentScores, name: str) -> Array:
    """Mean over the seeds that cover, target by target."""
    runs = [[(getattr(score, name)[i], score.covered[i]) for score in run for i in range(len(score))]
            for run in scores.seeds]  # fmt: skip
    values = [[error for error, covered in each if covered] for each in zip(*runs, strict=True)]
    return np.array([np.mean(each) if each else np.nan for each in values])


def parts_at(run: list[SceneScore], causes: list[str], p: Array, centred: Array, g: Array, budgets: Any) -> Array:
    """Parts [len(PARTS), n] of one run, split at every cut and then averaged."""
    first = np.cumsum([0, *map(len, run)])

    def value(scene: int, least: float) -> Array:
        cuts, parts = run[scene].cuts, {name: np.zeros(len(run[scene])) for name in PARTS}
        error, missed = cuts.at(least)
        for i in range(len(error)):
            at = first[scene] + i
            if missed[i]:
                parts["below_threshold" if run[scene].covered[i] else causes[at]][i] = error[i]
            elif np.isnan(p[at]) or np.isnan(g[at]):
                parts["rest"][i] = error[i]
            else:
                split = (g[at], p[at] - centred[at], centred[at] - g[at], error[i] - p[at])
                for name, part in zip(REFERENCES, split, strict=True):
                    parts[name][i] = part
        return np.stack(list(parts.values()))

    parts: Array = at_budgets([score.cuts for score in run], budgets, value).mean(axis=0)
    return parts


@given(st.integers(0, 5_000))
@steady
def test_parts_equal_those_of_every_cut_and_add_up_to_the_error(seed: int) -> None:
    scenes, agent = scored(seed, "x")
    associated, tracks = (scored(seed, name, runs)[1] for name, runs in (("yy", 2), ("zzz", 1)))
    causes = [cause_of(scene, row) for scene in scenes for row in find_targets(scene, CARD).row]
    assert [AbsentCause[c.upper()] for c in causes] == [c for s in agent.seeds[0] for c in s.absent_cause]
    p, centred, g = plain(associated, "capped"), plain(associated, "centred"), plain(tracks, "capped")
    table = agent_table(agent, None)
    runs = [parts_at(list(run), causes, p, centred, g, table.budgets.all) for run in agent.seeds]
    parts = error_parts(table, "all", reference_errors(associated, tracks, 4))
    ordered = np.stack([parts[name] for name in PARTS])
    np.testing.assert_allclose(ordered, np.mean(runs, axis=0), atol=1e-9)
    np.testing.assert_allclose(ordered.sum(axis=0), table.of_all.error, atol=1e-9)
    alone = error_parts(table, "ids", reference_errors(associated, tracks, 5))  # of another number of samples
    assert not set(REFERENCES) & set(alone)
    np.testing.assert_allclose(sum(alone.values()), table.of_subsets.error, atol=1e-9)


def still(x: float, y: float = 0.0) -> Any:
    return np.tile([x, y], (1, 3, 1))


def costs(objects: list[Thing], detected: list[list[Thing]], said: list[Thing], *others: list[Thing]) -> dict[str, Any]:
    """Parts that are above 0, of objects at rest whose only targets are in frame 1; ``others``: what references say."""
    scene = with_detections(make_scene([objects] * 5), [*detected, [], [], []])

    def scores(forecasts: list[Thing]) -> AgentScores:
        rollout = make_rollout([[]] * 5, [[], forecasts], samples=1)
        return AgentScores("x", 1, 1, "equal", ((score_scene(scene, rollout, SMALL),),))

    runs = map(scores, others)
    references = {"x": References(associated=next(runs), tracks=next(runs))} if others else {}
    row = next(row for row in summarise([scores(said)], SMALL, references=references).rows if row.subset == "all")
    values = {name: getattr(row, f"cost_{key}") for key, name in PARTS.items()}
    assert sum(value or 0.0 for value in values.values()) == pytest.approx(row.error, abs=1e-9)
    return {name: round(value, 6) for name, value in values.items() if value}


def test_every_cost_of_a_row_has_a_printed_name() -> None:
    assert {f"cost_{part}" for part in PARTS} == {name for name in Row.model_fields if name.startswith("cost_")}
    assert set(PARTS) == {*REFERENCES, "rest", "below_threshold", *(cause.name.lower() for cause in AbsentCause)}


CAR, BESIDE = Thing(1, 0, 0), Thing(1, 3, 0)
CAUSES: dict[str, list[list[Thing]]] = {  # detections of a car at 0 in frames 0 and 1
    "no forecast": [[], [Thing(1, 2, 0)]],  # the gate is 2 m, inclusive
    "other class": [[], [Thing(1, 2, 0, class_id=WALKER), BESIDE]],
    "off place": [[CAR], [BESIDE]],
    "never detected so far": [[BESIDE], [Thing(1, 4.1, 0)]],
    "not detected now": [[CAR], []],
}


@pytest.mark.parametrize("cause", CAUSES)
def test_the_first_cause_of_a_missing_forecast(cause: str) -> None:
    assert costs([CAR], CAUSES[cause], []) == {cause: 10.0}


def test_a_forecast_that_is_not_sure_enough() -> None:
    # a false forecast is surer than the right one: of ten budgets, up to one false forecast, the last alone keeps both
    said = [Thing(1, 0, 0, forecast=still(0), confidence=0.5), Thing(2, 50, 0, forecast=still(50))]
    assert costs([CAR], [[], [CAR]], said) == {"below threshold": 9.0}


def test_the_parts_of_a_forecast() -> None:
    # it starts 1 m beside the car and ends 2.5 m off; with perfect association it starts 1 m off and stays there,
    # on ground-truth tracks it is .25 m off
    said, associated = Thing(1, 1, 0, forecast=still(2.5)), Thing(1, 1, 0, forecast=still(1))
    tracks = Thing(1, 0, 0, forecast=still(0.25))
    split = costs([CAR], [[], [CAR]], [said], [associated], [tracks])
    assert split == {"predictor": 0.25, "localisation": 1.0, "history": -0.25, "association": 1.5}
    for others in ([[associated], []], [[], [tracks]], []):  # type: list[list[Thing]]
        assert costs([CAR], [[], [CAR]], [said], *others) == {"rest": 2.5}


@pytest.mark.data
@pytest.mark.parametrize("env", ["nuScenes-mini", "KITTI", "WILDTRACK", "Intersection"])
def test_parts_of_agents_on_envs_add_up_to_their_error(data_root: object, env: str) -> None:
    rows = compare(["stp"], f"MTP-{env}-v0", RunOptions(scenes=1, seeds=(0,))).report.rows
    assert {row.agent for row in rows if row.cost_association is not None} >= {"stp", "stp_same_budget"}
    for row in rows:
        parts = [value for part in PARTS if (value := getattr(row, f"cost_{part}")) is not None]
        assert (row.error is None) == (not parts)
        assert sum(parts) == pytest.approx(row.error or 0.0, abs=1e-9), (row.agent, row.subset)
