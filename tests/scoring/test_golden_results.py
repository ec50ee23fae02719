"""The hash of golden results beside the version of the definitions: no number changes without a decision."""

import hashlib
import json
from dataclasses import replace
from functools import cache
from typing import Annotated, Any

import numpy as np
import pytest

from mtp_bench.cards import Card
from mtp_bench.core import Column, Rollout, Scene
from mtp_bench.judge.records.evaluation import scorer_digest
from mtp_bench.scoring import (
    AgentScores,
    Reference,
    find_targets,
    mean_plain_error,
    score_scene,
    summarise,
)
from mtp_bench.scoring.bade import CardBudget
from mtp_bench.scoring.definitions import GOLDEN
from mtp_bench.scoring.rows import Bin, Clear, Details, Errors, PairedRow, Reliability, Row, Tracking
from mtp_bench.scoring.score import SceneScore
from mtp_bench.scoring.weights import SceneWeights, scene_key
from tests.support.scoring_scenes import make_card, random_case, take_objects

AGENTS = {"stp": 4.0, "gt_tracks": 0.5, "stp_same_samples": 2.5, "mtp": 1.5}  # size of the errors of forecasts
SCENES, RUNS = 8, 16
LIVE = 8  # live frames of a scene

# What the hash covers, by the class that holds it. A field that is not listed may come and go, and so may the wording
# of reasons.
FIELDS: dict[type, str] = {
    Row: """
        agent association_gap_closed association_gap_interval budget
        cost_association cost_below_threshold cost_ground_truth cost_history cost_localisation
        cost_no_forecast cost_off_place cost_other_class cost_rest cost_undetected_new cost_undetected_seen
        coverage difference_interval difference_to_stp effective_objects effective_targets effective_units
        energy_score error error_by_score events fixed_error gap_closed
        gap_closed_same_predictor gap_interval gap_same_predictor_interval hypotheses interval localisation
        minADE minFDE missed ms_per_frame objects p place plain_error rank_range samples scenes seeds subset
        targets
    """,
    PairedRow: """
        agent budget error hypotheses interval minADE minADE_interval other p samples scenes shared subset
        targets
    """,
    Details: """
        AP_f EPA PI_ADE agent bins brier budget curve dropped_detections false_per_frame forecasts_per_frame
        guessed_parents hypotheses invalid k_curve miss_rate nothing_predicted own own_events reliability
        samples seeds tracking
    """,
    Bin: """
        EPA bin by errors
    """,
    Errors: """
        coverage error minADE minFDE objects plain_error scenes targets
    """,
    Reliability: """
        confidence forecasts matched
    """,
    Tracking: """
        all classes false_positives false_tracks
    """,
    Clear: """
        FN FP FRAG HOTA IDF1 IDS MOTA MOTP TP
    """,
    SceneScore: """
        fixed_error own_events
    """,
}
SUBSETS = "all ids lost reacquired frag paper_ids paper_frag turning"


@cache
def case(number: int, truth_complete: bool) -> tuple[Scene, Rollout]:
    scene, rollout = random_case(number, hypotheses=2, name=f"s{number}")
    return replace(scene, truth_complete=truth_complete), rollout


@cache
def said(number: int, scale: float, seed: int) -> Rollout:
    """Eight samples per object; an agent of another seed leaves other objects out."""
    _, rollout = case(number, truth_complete=True)
    path = scale * np.concatenate([rollout.forecast, -0.5 * rollout.forecast], axis=1)
    weight = np.tile(rollout.forecast_log_weight, 2)
    weight[np.isinf(weight).all(axis=1), 0] = 0.0  # an answer without a sample would have been taken out
    rollout = replace(rollout, forecast=np.round(path).astype(np.int16), forecast_log_weight=weight)
    return take_objects(rollout, np.delete(np.arange(len(rollout.object_box)), slice(None, None, 9 + seed)))


def reference(card: Card, truth_complete: bool) -> Reference:
    scenes = {}
    for number in range(SCENES):
        rng, (scene, _) = np.random.default_rng(number), case(number, truth_complete=True)
        size = len(find_targets(scene, card))
        counts = rng.integers(0, RUNS, (size, 4), dtype=np.uint8)
        scenes[scene_key(card.id, scene.name)] = SceneWeights(counts, rng.random((size, 3)) < 0.2, (3, 2, 1), 3, 30)
    constants = None if truth_complete else CardBudget(card.id, 30 * SCENES, LIVE * SCENES, false_known=False)
    return Reference(card.id, card.digest, "2.0", "stp", RUNS, {}, scenes, constants=constants)


def results(measure: str, truth_complete: bool) -> list[Any]:
    """Rows, paired differences and details of all agents, scores of their scenes and the plain errors of these."""
    card = make_card(samples=8, measure=measure)
    agents = []
    for name, scale in AGENTS.items():
        runs = tuple(
            tuple(score_scene(case(i, truth_complete)[0], said(i, scale, seed), card) for i in range(SCENES))
            for seed in range(2)
        )
        agents.append(AgentScores(name, 2, 8, "equal", runs, "truth" if name == "gt_tracks" else "detections"))
    summary = summarise(agents, card, reference(card, truth_complete))
    rows = [row for row in summary.rows if row.subset in SUBSETS.split()]
    paired = [row for row in summary.paired if row.subset in SUBSETS.split()]
    scenes = [score for agent in agents for run in agent.seeds for score in run]
    plain_errors = [mean_plain_error([score]) for score in scenes]
    return [rows, paired, summary.details, scenes, plain_errors]


def listed(content: Any) -> Any:
    """The content as JSON has it, of each object the listed fields; AttributeError if it lacks one.

    Numbers have nine decimals, for machines differ in the last bits.
    """
    for kind, names in FIELDS.items():
        if isinstance(content, kind):
            return {name: listed(getattr(content, name)) for name in names.split()}
    if isinstance(content, float):
        return round(content, 9) + 0.0  # -0.0 becomes 0.0
    if isinstance(content, dict):
        return {name: listed(value) for name, value in content.items()}
    return [listed(value) for value in content] if isinstance(content, list | tuple) else content


def digest(*content: Any) -> str:
    """Hex sha256 of the listed fields."""
    return hashlib.sha256(json.dumps(listed(content), sort_keys=True).encode()).hexdigest()


@pytest.fixture(scope="module")
def unchanged() -> list[Any]:
    """The golden results with a complete truth, computed before a test changes anything."""
    return results("center_distance", True)


def test_the_golden_results_are_those_of_the_definitions(unchanged: list[Any]) -> None:
    """The remedy depends on what changed.

    - A column was added: nothing to do. It is not in FIELDS, so this test does not see it.
    - The hash differs: a number of an unchanged rollout changed. Find out why. If the change is meant, raise
      DEFINITIONS, say so in CHANGELOG.md, and only then take over the new hash.
    - AttributeError: a listed field was removed or renamed. Change FIELDS, then do as for a changed number.
    - A new field becomes a part of the definitions: add it to FIELDS, then do as for a changed number.
    """
    assert digest(unchanged, results("iou_3d", False)) == GOLDEN
    assert len(scorer_digest()) == 64


def changed(content: list[Any], part: int, **numbers: Any) -> list[Any]:
    """The golden results with other numbers in the first object of one part."""
    first, *others = content[part]
    other = first.model_copy(update=numbers) if isinstance(first, Row) else replace(first, **numbers)
    return [*content[:part], [other, *others], *content[part + 1 :]]


def test_a_changed_number_is_seen_and_an_added_column_is_not(unchanged: list[Any], monkeypatch: Any) -> None:
    class FurtherRow(Row):
        further_error: Annotated[float | None, Column("further", "m", "lower", optional=True)] = 1.5

    before = digest(unchanged)
    row, score = unchanged[0][0], unchanged[3][0]
    assert digest(changed(unchanged, 0, error=row.error + 1e-6)) != before
    assert digest(changed(unchanged, 3, fixed_error=score.fixed_error + 1e-6)) != before
    further = [[FurtherRow(**dict(row)) for row in unchanged[0]], *unchanged[1:]]
    assert digest(further) == before
    monkeypatch.setitem(FIELDS, Row, f"{FIELDS[Row]} further_error")
    assert listed(further[0][0])["further_error"] == 1.5
