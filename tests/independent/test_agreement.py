"""The product's scorer against the independent one: every number of random rollouts, to 1e-9."""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import Card
from mtp_bench.core import Detections, ImageField, Rollout, Scene
from mtp_bench.scoring import SUBSETS, AgentScores, Reference, References, Report, score_scene, summarise
from mtp_bench.scoring.bade import CardBudget
from mtp_bench.scoring.definitions import WEIGHTS_DEFINITIONS
from mtp_bench.scoring.table import agent_table
from mtp_bench.scoring.targets import find_targets
from mtp_bench.scoring.weights import SceneWeights, scene_key
from tests.independent import scorer
from tests.independent.events import own_events
from tests.independent.parts import ABSENT, COVERED
from tests.support.scoring_scenes import make_card, random_case, take_objects, take_tracks

LONG, FEW = 221, 3  # frames: two blocks of at most 20 s; objects
KINDS = ("KITTI", "nuScenes mini", "nuScenes targets only", "WILDTRACK", "simulated", "official list", "long")
CASES = [(kind, seed) for kind in KINDS for seed in range(2 if kind in ("official list", "long") else 5)]
RUNS = 48
SHARED = (
    "error", "localisation", "missed", "plain_error", "coverage", "targets", "objects", "effective_targets",
    "effective_objects", "effective_units",
)  # fmt: skip
PARTS = tuple(f"cost_{name}" for name in ABSENT + COVERED)
RENAMED = {"MR": "miss_rate", "pi_ade": "PI_ADE", "epa": "EPA", "ap_f": "AP_f"}


def image_field(frames: int, back: float) -> ImageField:
    """A camera ``back`` metres behind the crowd's middle that looks along x, with a region in its image."""
    turn = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    focus = np.array([[700.0, 0.0, 600.0], [0.0, 700.0, 180.0], [0.0, 0.0, 1.0]])
    matrix = focus @ np.column_stack([turn, turn @ [back, 0.0, -1.65]])
    return ImageField(
        projection=np.tile(matrix, (frames, 1, 1)), height=np.full(frames, 1.65), heading=np.full(frames, 0.1),
        size=(1242, 375), region=np.tile([580.0, 100.0, 640.0, 300.0], (frames, 1)), region_start=np.arange(frames + 1),
        box_size=np.array([[4.0, 1.6, 1.5], [0.8, 0.6, 1.4]]),
    )  # fmt: skip


@lru_cache(maxsize=32)  # a case asks for its scenes again with each rollout
def crowd(kind: str, seed: int, place: int) -> tuple[Scene, Rollout]:
    frames, objects = (LONG, FEW) if kind == "long" else (12, 7)
    return random_case(100 * seed + place, frames=frames, objects=objects, name=f"s{place}")


@lru_cache(maxsize=32)
def drawn(kind: str, seed: int, place: int) -> Scene:
    """Scene number ``place`` of a case: every second one with a hole in time, the last ones on a grid."""
    scene, _ = crowd(kind, seed, place)
    rng = np.random.default_rng([seed, place])
    truth = scene.truth
    if seed > 2:
        truth = replace(truth, box=np.round(truth.box))
    if kind == "WILDTRACK":
        truth = replace(truth, class_id=np.ones_like(truth.class_id))
    if kind == "simulated":
        truth = replace(truth, neutral=np.zeros_like(truth.neutral))
    hole = rng.integers(1, scene.frames) if seed % 2 else scene.frames
    scene = replace(scene, truth=truth, time=scene.time + 2.0 * (np.arange(scene.frames) >= hole))
    seen = truth.select(rng.random(len(truth.box)) < 0.6)
    box, class_id = seen.box.copy(), seen.class_id ^ (rng.random(len(seen.box)) < 0.2)
    box[:, :2] += rng.normal(0, 1, (len(box), 2))
    scene = replace(scene, detections=Detections(seen.start, box, seen.velocity, class_id, rng.random(len(box))))
    if kind in ("nuScenes targets only", "official list"):
        return replace(scene, truth_complete=kind == "official list", listed_targets=True)
    return replace(scene, image=image_field(scene.frames, 4.0 + 36.0 * (seed % 2))) if kind == "KITTI" else scene


def said(kind: str, seed: int, place: int, draw: int) -> Rollout:
    """A rollout of that scene: confidences with ties, copies of forecasts, rows that were taken out, silent frames."""
    scene, rollout = crowd(kind, seed, place)
    rng = np.random.default_rng([seed, place, draw])
    rows = np.arange(len(rollout.object_box))
    rollout = take_objects(rollout, np.sort(np.append(rows, rng.choice(rows, len(rows) // 4))))  # some twice
    shift = rng.normal(0, 0.5, (len(rollout.object_box), 2))
    box = rollout.object_box.copy()
    box[:, :2] = np.round(box[:, :2] + shift * (rng.random((len(box), 1)) < 0.5), 0 if seed > 2 else 6)
    levels = (10, 1, 4, 2**24)[(seed + draw) % 4]  # of confidence; 1: all are equal
    confidence = np.where(levels == 1, 0.5, np.round(levels * rng.random(len(box))) / levels).astype(np.float32)
    parent = rng.integers(0, 3, rollout.hypothesis_parent.shape)
    malformed = rng.poisson(0.1, (scene.frames, 3))
    forecast = rollout.forecast + rng.integers(-50, 50, (len(box), 1, 1, 2), dtype=np.int16)
    weight = rollout.forecast_log_weight.copy()
    weight[rng.random(weight.shape) < 0.1] -= 9.0  # next to nothing
    weight[np.isinf(weight).all(axis=1), 0] = 0.0  # an answer without a sample would have been taken out
    samples = 1 if kind == "WILDTRACK" else 4
    silent = rng.random(scene.frames) < 0.1  # frames in which no hypothesis is stated
    rollout = take_tracks(rollout, np.flatnonzero(~silent[rollout.tracks.frame_of_rows]))
    return replace(
        rollout, hypothesis_log_weight=np.where(silent[:, None], -np.inf, rollout.hypothesis_log_weight),
        hypothesis_parent=np.where(silent[:, None], -1, parent), object_box=box,
        object_class=np.ones_like(rollout.object_class) if kind == "WILDTRACK" else rollout.object_class,
        object_confidence=confidence, malformed=malformed, forecast=forecast[:, :samples],
        forecast_log_weight=np.zeros((len(box), 1)) if samples == 1 else weight,
    )  # fmt: skip


def reference_of(card: Card, scenes: list[Scene], seed: int) -> Reference:
    rng = np.random.default_rng(seed)
    of_scenes = {}
    for scene in scenes:
        count = len(find_targets(scene, card))
        counts = np.minimum(rng.poisson(4.0, (count, 4)) * (rng.random((count, 4)) < 0.5), RUNS).astype(np.uint8)
        stated = int(rng.integers(1, 20))
        weights = SceneWeights(counts, rng.random((count, 3)) < 0.2, (3, 2, 1), stated, 4 * stated)
        of_scenes[scene_key(card.id, scene.name)] = weights
    return Reference(card.id, card.digest, WEIGHTS_DEFINITIONS, "stp", RUNS, {}, of_scenes)


@pytest.mark.parametrize(("kind", "seed"), CASES)
def test_both_scorers_give_the_same_numbers(kind: str, seed: int) -> None:
    card = make_card()
    scenes = [drawn(kind, seed, place) for place in range(2)]
    stated, of = np.random.default_rng(seed).integers(1, 60, 2).tolist()
    constants = CardBudget(card.id, stated, of, false_known=scenes[0].truth_complete)
    reference = replace(reference_of(card, scenes, seed), constants=constants)
    draws = range(1 + seed % 2)
    runs = {
        name: [[said(kind, seed, p, d + 2 * i) for p in range(2)] for d in draws]
        for i, name in enumerate(("stp", "other"))
    }
    agents = [agent_scores(name, scenes, seeds, card) for name, seeds in runs.items()]
    known = References(associated=agents[0], tracks=agents[1])
    report = summarise(agents, card, reference, references={"other": known})
    plain = [scorer.score(card, scenes, seeds, (0, 1)) for seeds in runs.values()]
    others: dict[str, scorer.Scored] = {}
    for agent, seeds in zip(agents, runs.values(), strict=True):
        table = agent_table(agent, reference)
        subsets = {name: weight for name, weight in table.weight.items() if name != "all"}
        parts = (plain[0], plain[1]) if agent.agent == "other" else None
        own = others[agent.agent] = scorer.score(card, scenes, seeds, (stated, of), subsets, parts)
        assert [(t.scene, t.t, t.row) for t in own.targets] == targets_of(scenes, card)
        for subset in SUBSETS:
            np.testing.assert_allclose(table.bade(subset).error, own.errors[subset], rtol=1e-9, atol=1e-9)
            row = rows_of(report, agent.agent)[subset]
            same(row, own.rows[subset], SHARED + PARTS)
            assert row["error"] == close(row["error"] and sum(row[part] or 0.0 for part in PARTS))
            if len(seeds) == 1:  # over several seeds the product pools covered targets, the other averages the means
                same(row, own.rows[subset], ("minADE", "minFDE", "energy_score"))
        details = next(d for d in report.details if d.agent == agent.agent).model_dump()
        whole = {**own.rows["all"], **{new: own.rows["all"][old] for old, new in RENAMED.items()}}
        same({**rows_of(report, agent.agent)["all"], **details}, whole, ("fixed_error", "miss_rate", "PI_ADE"))
        if len(seeds) == 1:
            same(details, whole, ("brier", "false_per_frame", "EPA", "AP_f"))
            assert details["k_curve"].get("1") == close(whole["one_sample"])
        for event, found in own_events(scenes, seeds[0], card).items():
            assert details["own_events"][event] == len(found), event
    assert kind != "long" or {unit for _, unit in others["stp"].units} == {0, 1}
    compared = scorer.compare(others)
    for subset in SUBSETS:
        for name, values in compared[subset].items():
            same(rows_of(report, name)[subset], values, ("difference_to_stp", "p"))


def agent_scores(name: str, scenes: list[Scene], seeds: list[list[Rollout]], card: Card) -> AgentScores:
    scores = tuple(tuple(score_scene(s, r, card) for s, r in zip(scenes, run, strict=True)) for run in seeds)
    return AgentScores(name, 3, scores[0][0].samples, "equal", scores)


def targets_of(scenes: list[Scene], card: Card) -> list[tuple[int, int, int]]:
    return [
        (place, int(t), int(row))
        for place, scene in enumerate(scenes)
        for found in [find_targets(scene, card)]
        for t, row in zip(found.frame, found.row, strict=True)
    ]


def rows_of(report: Report, agent: str) -> dict[str, dict[str, Any]]:
    return {row.subset: row.model_dump() for row in report.rows if row.agent == agent}


def same(row: dict[str, Any], other: dict[str, Any], names: tuple[str, ...]) -> None:
    for name in names:
        assert row[name] == close(other[name]), name


def close(value: float | None) -> Any:
    return None if value is None else pytest.approx(value, rel=1e-9, abs=1e-9)
