"""Records rank as the comparison of the same runs does."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mtp_bench.judge import Record
from mtp_bench.judge.records.attestation import SignedLevel
from mtp_bench.judge.records.evaluation import numbers_of, unit_errors
from mtp_bench.judge.records.targets import targets_of
from mtp_bench.scoring import SUBSETS, AgentScores, Reference, SceneScore, score_scene, summarise
from mtp_bench.scoring.table import agent_table
from mtp_bench.scoring.weights import SceneWeights, scene_key
from tests.support.scoring_scenes import make_card, random_case, take_objects
from tests.support.stored_records import make_record, scene_part, ships_of, signed_level, standings_of, write_record

CARD = make_card(samples=4)
NAMES = [f"s{i}" for i in range(9)]
KEPT = {"gt_tracks": 1.0, "best": 0.95, "stp": 0.6, "poor": 0.2}  # share of its forecasts that an agent makes


def scores_of(kept: float) -> tuple[SceneScore, ...]:
    scores = []
    for i, name in enumerate(NAMES):
        scene, rollout = random_case(i, name=name)
        rows = np.random.default_rng(i).random(len(rollout.object_class)) < kept
        scores.append(score_scene(scene, take_objects(rollout, np.flatnonzero(rows)), CARD))
    return tuple(scores)


def weights_of(scores: tuple[SceneScore, ...]) -> Reference:
    rng = np.random.default_rng(0)
    scenes = {}
    for score in scores:
        counts, flags = rng.integers(0, 9, (len(score), 4)).astype(np.uint8), rng.random((len(score), 3)) < 0.3
        scenes[scene_key(CARD.id, score.scene)] = SceneWeights(counts, flags, (3, 3, 3), 40, 80)
    return Reference(CARD.id, CARD.digest, "2.0", "stp", 48, {}, scenes)


def record(name: str, error: float, networks: Sequence[str] = (), ends: str | None = None, **env: str) -> Record:
    said = {"gap_references": ends, "networks": {f"{network}-MTP-X-v0.safetensors": "0" * 64 for network in networks}}
    return write_record(*(error + 0.1 * (i % 3) for i in range(8)), name=name, submission=said, env=env)


def test_the_gap_of_an_agent_with_a_network_is_between_ends_with_it() -> None:
    """0: one hypothesis with the network; 1: true pasts with it. Of one with another network there is none."""
    ends = [record("stp_modes", 4.0, ends="own"), record("gt_tracks_modes", 2.0, observe="truth")]
    mine, other = record("mine", 3.5, ["modes-tracklets"], "own"), record("other", 3.5, ["affinity-tracklets"], "own")
    perfect = record("perfect_association_modes_tracklets", 3.3, observe="associated")
    records = [record("stp", 5.0, ends="controls"), record("gt_tracks", 1.0, observe="truth"), *ends, mine, other]
    ships, none = record("mtp_modes", 3.5, ends="own"), record("none", 3.5, ends="own")
    records += [record("stp_modes_tracklets", 3.7), perfect, ships, none]
    found = standings_of(records, ships=ships_of(*records))
    assert found[mine.digest].own_gaps["all"] == pytest.approx(0.25)
    assert found[ships.digest].own_gaps["all"] == pytest.approx(0.25), "weights that ship are in no list of a record"
    assert found[none.digest].own_gaps == {}, "what says nothing of networks is no baseline"
    assert (found[mine.digest].gaps, found[mine.digest].gap_blank) == ({}, "its predictor is not that of stp")
    assert found[mine.digest].association_gaps["all"] == pytest.approx(0.5)
    assert found[perfect.digest].places["all"].why == "saw which detections are of one object"
    assert found[other.digest].association_gap_blank == "no reference with its predictor ships"
    assert found[records[0].digest].association_gap_blank == "no record of stp_same_samples beside it"
    assert (found[records[1].digest].association_gap_blank, found[other.digest].own_gaps) == ("saw the truth", {})
    assert found[records[0].digest].own_gaps == found[records[0].digest].gaps
    assert found[ends[0].digest].own_gaps["all"] == 0


def two_subsets(name: str, error: float, on_events: float, **changed: Any) -> Record:
    """A record with one error over all targets and another one on identity switches."""
    scenes = [scene_part(str(i), 10, error + 0.1 * (i % 3)) for i in range(8)]
    for scene in scenes:
        scene["weight"]["ids"], scene["error"]["ids"] = [10.0], [10 * on_events]
    return make_record(name, scenes, objects=40, **changed)


def test_worse_than_stp_with_its_own_network_is_not_ranked_on_events() -> None:
    """As in the comparison: a better predictor must not pay for forecasts that are made for the events alone."""
    network = {"modes-tracklets-MTP-X-v0.safetensors": "0" * 64}
    records = [
        two_subsets("stp", 2.0, 3.0),
        two_subsets("stp_modes", 1.0, 2.0, submission={"gap_references": "own"}),
        two_subsets("flood", 1.9, 0.5, submission={"gap_references": "own", "networks": network}),
    ]
    places = [standings_of(records, ships=ships_of(*records))[each.digest].places["ids"] for each in records]
    assert places[0].place is not None
    assert places[1].place == 1
    assert places[2].why == "over all targets its bADE is above that of stp with its own predictor"


def test_who_is_better_than_ground_truth_is_held_back() -> None:
    """Than with motion models and than with the better network, on a subset that ranks, until it was looked at."""
    errors = {"gt_tracks": (2.0, 2.0), "gt_tracks_modes": (1.0, 1.5), "gt_tracks_ptp": (1.4, 0.1)}
    truths = [two_subsets(name, *pair, env={"observe": "truth"}) for name, pair in errors.items()]
    entries = {"stp": (3.0, 3.0), "table": (0.5, 3.0), "events": (3.0, 1.4), "network": (1.2, 1.9)}
    stp, table, *others = (two_subsets(name, *pair) for name, pair in entries.items())

    def why(records: list[Record], level: SignedLevel | None = None) -> list[str]:
        found = standings_of(records, {table.digest: level} if level else {}, ships_of(*records))
        return [found[record.digest].places["all"].why for record in records]

    held, saw = "better than ground truth: not ranked until looked at", "saw the truth"
    records = [stp, table, *others, *truths]
    assert why(records) == ["", held, held, "", saw, saw, saw]
    assert why([stp, table, truths[0]]) == ["", "", saw], "no learned predictor to compare with"
    level = signed_level(table)
    looked = replace(level, statement=level.statement.model_copy(update={"looked_at": True}))
    assert why(records, looked) == ["", "", held, "", saw, saw, saw]


def test_records_rank_as_the_comparison_of_the_same_runs_does() -> None:
    agents = [
        AgentScores(name, 1, 4, "equal", (scores_of(kept),), "truth" if name == "gt_tracks" else "detections")
        for name, kept in KEPT.items()
    ]
    reference = weights_of(agents[0].seeds[0])
    report = summarise(agents, CARD, reference)
    records = []
    for i, agent in enumerate(agents):
        table = agent_table(agent, reference)
        targets = targets_of(table, SUBSETS, None)
        rows = report.rows[i * len(SUBSETS) : (i + 1) * len(SUBSETS)]
        said: dict[str, Any] = {
            "submission": {"gap_references": "controls"},
            "env": {"observe": agent.observe, "scenes_of_split": len(NAMES)},
            "targets": targets.model_dump(), "targets_sha256": targets.digest,
            "error": {subset: unit_errors(table, subset) for subset in SUBSETS},
            "numbers": {row.subset: numbers_of(row) for row in rows},
        }  # fmt: skip
        record = make_record(agent.agent, [scene_part("a", 1, 1.0)], **said)
        records.append(record)
        for row in rows:  # what follows from the sums is that of the comparison
            stored = record.row_of(row.subset)
            for name in ("error", "localisation", "missed", "minADE", "energy_score", "effective_units", "cost_rest"):
                if row.subset == "all" or not name.startswith("cost"):
                    assert getattr(stored, name) == pytest.approx(getattr(row, name), abs=1e-9), (row.subset, name)
            assert stored.interval == pytest.approx(row.interval, abs=1e-6)
    found = standings_of(records, ships=ships_of(*records))
    places = [
        (found[record.digest].places[s].place, found[record.digest].places[s].why)
        for record in records
        for s in SUBSETS
    ]
    assert places == [(row.place, row.unranked_because or "") for row in report.rows]
    gaps = [found[record.digest].gaps.get(subset) for record in records for subset in SUBSETS]
    expected = [row.gap_closed for row in report.rows]
    assert [gap is None for gap in gaps] == [gap is None for gap in expected]
    known = [np.array([gap for gap in side if gap is not None]) for side in (gaps, expected)]
    np.testing.assert_allclose(known[0], known[1], rtol=1e-9)  # records round their sums
    assert {None, 1, 2, 3} <= {row.place for row in report.rows}
    assert "over all targets its bADE is above that of stp" in {why for _, why in places}
    assert any(gap is not None for gap in gaps)
