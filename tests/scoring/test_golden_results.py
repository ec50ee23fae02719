"""The hash of golden results beside the version of the definitions: no number changes without a decision."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import Card
from mtp_bench.records.provenance import scorer_digest
from mtp_bench.scoring import AgentScores, SceneScore, error, reference_subsets, score_scene, summarise
from mtp_bench.scoring.definitions import GOLDEN
from mtp_bench.scoring.error import error_sum
from tests.support.scoring_scenes import make_card, random_case, take_objects

AGENTS = {"stp": 4.0, "truth_past": 0.5, "stp_same_budget": 2.5, "mtp": 1.5}  # size of the errors of forecasts


def scores(card: Card, scale: float, seed: int, truth_complete: bool) -> tuple[SceneScore, ...]:
    """Eight scenes with eight samples per object; an agent of another seed leaves other objects out."""
    scored = []
    for number in range(8):
        scene, rollout = random_case(number, hypotheses=2, name=f"s{number}")
        path = scale * np.concatenate([rollout.forecast, -0.5 * rollout.forecast], axis=1)
        weight = np.tile(rollout.forecast_log_weight, 2)
        rollout = replace(rollout, forecast=np.round(path).astype(np.int16), forecast_log_weight=weight)
        rollout = take_objects(rollout, np.delete(np.arange(len(rollout.object_box)), slice(None, None, 9 + seed)))
        scored.append(score_scene(replace(scene, truth_complete=truth_complete), rollout, card))
    return tuple(scored)


def results(measure: str, truth_complete: bool) -> list[Any]:
    """The report of all agents with the events of the first one as reference, and errors and events per scene."""
    card = make_card(samples=8, measure=measure)
    agents = [
        AgentScores(name, 2, 8, "equal", tuple(scores(card, scale, seed, truth_complete) for seed in range(2)))
        for name, scale in AGENTS.items()
    ]
    agents[1] = replace(agents[1], ideal=True)
    report = summarise(agents, card, reference_subsets(agents[0].seeds[0], card)).to_json("ranks", "paired", "details")
    scenes = [score for agent in agents for run in agent.seeds for score in run]
    events = [{kind: keys.tolist() for kind, keys in score.events.items()} for score in scenes]
    return [report, events, [(error_sum(score), error_sum(score, score.moving)) for score in scenes]]


def rounded(content: Any) -> Any:
    """To nine decimals, for machines differ in the last bits."""
    if isinstance(content, float):
        return round(content, 9) + 0.0  # -0.0 becomes 0.0
    if isinstance(content, dict):
        return {name: rounded(value) for name, value in content.items()}
    return [rounded(value) for value in content] if isinstance(content, list | tuple) else content


def golden_digest() -> str:
    content = rounded([results("center_distance", True), results("iou_3d", False)])
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def test_the_golden_results_are_those_of_the_definitions() -> None:
    """Where this fails a number changed: find out why, raise DEFINITIONS, and only then take over the new hash."""
    assert golden_digest() == GOLDEN
    assert len(scorer_digest()) == 64


def test_a_changed_number_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(error, "FALSE_FORECAST_SHARE", 0.5 + 1e-6)
    assert golden_digest() != GOLDEN
