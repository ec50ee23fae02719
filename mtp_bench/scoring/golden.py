"""Golden results: what the scorer says of small worlds that are made here, by which its versions are told apart.

A record names the version of the definitions and the hash of these results, so it is marked as made by another scorer
when a number changes, and not when a file is moved or written anew.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cards import Card, parse_card
from ..types import Detections, Ints, Rollout, Scene, Truth, starts_of
from .error import error_sum
from .report import summarise
from .score import SceneScore, score_scene
from .subsets import reference_subsets
from .table import AgentScores

_SCENES, _FRAMES, _OBJECTS, _HYPOTHESES, _SAMPLES, _PAST, _FUTURE = 8, 12, 6, 2, 6, 2, 3
_DECIMALS = 9  # machines differ in the last bits
_AGENTS = {"stp": 0.9, "truth_past": 0.2, "stp_same_budget": 0.7, "mtp": 0.5}  # scale of the forecasts' errors, m


def golden_digest() -> str:
    """Hex sha256 of the golden results as this scorer gives them; GOLDEN holds what they should be."""
    results = [_results("center_distance", True), _results("iou_3d", False)]
    return hashlib.sha256(json.dumps(_rounded(results), sort_keys=True).encode()).hexdigest()


def _results(measure: str, truth_complete: bool) -> list[Any]:
    """The report of all agents with the events of the first one as reference, and errors and events per scene."""
    card = _card(measure)
    agents = [_agent(name, scale, card, truth_complete) for name, scale in _AGENTS.items()]
    reference = reference_subsets(agents[0].seeds[0], card)
    report = summarise(agents, card, reference).to_json("ranks", "paired", "details")
    return [report, *(_per_scene(score) for agent in agents for run in agent.seeds for score in run)]


def _per_scene(score: SceneScore) -> list[Any]:
    events = {kind: keys.tolist() for kind, keys in score.events.items()}
    return [error_sum(score), error_sum(score, score.moving), score.false_forecasts.tolist(), events]


def _agent(name: str, scale: float, card: Card, truth_complete: bool) -> AgentScores:
    """An agent of two seeds; STP has one hypothesis."""
    count = 1 if name == "stp" else _HYPOTHESES
    seeds = tuple(tuple(_scores(card, scale, count, seed, truth_complete)) for seed in range(2))
    return AgentScores(name, count, _SAMPLES, "equal", seeds, ideal=name == "truth_past")


def _scores(card: Card, scale: float, hypotheses: int, seed: int, truth_complete: bool) -> Iterator[SceneScore]:
    for number in range(_SCENES):
        scene = _scene(number, truth_complete)
        rng = np.random.default_rng([number, seed, hypotheses, round(100 * scale)])
        yield score_scene(scene, _rollout(scene, scale, hypotheses, rng), card)


def _card(measure: str) -> Card:
    classes = {"car": 2.0, "pedestrian": 1.0}
    return parse_card(
        {
            "id": "MTP-Golden-v0",
            "summary": "golden results",
            "source": {"name": "kitti"},
            "task": {
                "rate": 2.0,
                "past": _PAST,
                "future": _FUTURE,
                "samples": _SAMPLES,
                "classes": list(classes),
                "miss_error": {"car": 10.0, "pedestrian": 4.0},
                "forecast_gate": classes,
                "event_gate": {"measure": measure, "threshold": classes if measure == "center_distance" else 0.3},
            },
            "size": {"detections": 9, "tracks": 30, "objects": 9, "hypotheses": _HYPOTHESES},
        }
    )


def _scene(number: int, truth_complete: bool) -> Scene:
    """Objects that walk straight, some of which are gone for a frame; the last one is neutral."""
    rng = np.random.default_rng(number)
    start, step = rng.uniform(-20, 20, (_OBJECTS, 2)), rng.normal(0, 0.6, (_OBJECTS, 2))
    frame, identity = np.nonzero(rng.random((_FRAMES, _OBJECTS)) > 0.05)
    ego = np.zeros((_FRAMES, 4))
    ego[:, 0] = np.arange(_FRAMES)
    no_point = np.zeros((0, 2))
    return Scene(
        name=f"golden-{number}",
        time=0.5 * np.arange(_FRAMES),
        ego=ego,
        truth=Truth(
            start=_starts(frame),
            box=_boxes(start[identity] + frame[:, None] * step[identity]),
            velocity=np.full((len(frame), 2), np.nan),
            class_id=identity % 2,
            object_id=identity,
            eligible=identity != 0,
            neutral=identity == _OBJECTS - 1,
        ),
        detections=Detections(np.zeros(_FRAMES + 1, int), _boxes(no_point), no_point, np.zeros(0, int), np.zeros(0)),
        truth_complete=truth_complete,
    )


def _rollout(scene: Scene, scale: float, hypotheses: int, rng: np.random.Generator) -> Rollout:
    """Tracks near the true boxes, some missing, renamed or elsewhere; forecasts near the truth, some false or missing.

    Every hypothesis has tracks of its own. ``scale`` is the size of the errors of forecasts, metres.
    """
    truth, frame = scene.truth, scene.truth.frame_of_rows
    row, hypothesis = np.nonzero(rng.random((len(truth.box), hypotheses)) > 0.1)
    renamed, elsewhere = rng.random((2, len(row))) < 0.1
    noise = rng.normal(0, 0.4, (len(row), 2)) + 60.0 * elsewhere[:, None]
    item = np.flatnonzero(rng.random(len(truth.box)) > 0.15)
    item = np.sort(np.concatenate([item, item[rng.random(len(item)) < 0.1]]))  # some are forecast twice
    path = rng.normal(0, 100 * scale, (len(item), _SAMPLES, _FUTURE, 2)).cumsum(axis=2)
    absent = rng.random((len(item), _SAMPLES)) < 0.1
    return Rollout(
        scene=scene.name,
        track_start=_starts(frame[row]),
        track_id=10 * truth.object_id[row] + renamed,
        track_box=_boxes(truth.box[row, :2] + noise),
        track_class=np.where(rng.random(len(row)) < 0.1, -1, truth.class_id[row]),
        member=hypothesis[:, None] == np.arange(hypotheses),
        hypothesis_log_weight=np.log(rng.dirichlet(np.ones(hypotheses), scene.frames)),
        object_start=_starts(frame[item]),
        object_box=_boxes(truth.box[item, :2] + rng.normal(0, scale, (len(item), 2))),
        object_class=truth.class_id[item],
        forecast=np.round(path).astype(np.int16),
        forecast_log_weight=np.where(absent, -np.inf, -np.log(_SAMPLES)),
        invalid=np.ones((scene.frames, 3), dtype=np.int64),
        dropped=np.ones(scene.frames, dtype=np.int64),
        seconds=np.linspace(0.01, 0.02, scene.frames),
    )


def _starts(frame: Ints) -> Ints:
    return starts_of(np.bincount(frame, minlength=_FRAMES))


def _boxes(xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Boxes [n, 7] of one size at the points [n, 2]."""
    return np.concatenate([xy, np.tile([0.0, 0.0, 4.0, 2.0, 1.5], (len(xy), 1))], axis=1)


def _rounded(content: Any) -> Any:
    if isinstance(content, float):
        return round(content, _DECIMALS) + 0.0  # -0.0 becomes 0.0
    if isinstance(content, dict):
        return {name: _rounded(value) for name, value in content.items()}
    return [_rounded(value) for value in content] if isinstance(content, list) else content
