"""Parts of the error that ranks: they add up to it, and each is what its name says."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mtp_bench.scoring import SceneScore, score_scene
from mtp_bench.scoring.ranking_error import Budgets, budgets_of, errors_at
from mtp_bench.scoring.targets import find_targets
from mtp_bench.study.causes import CAUSES, Circumstances, causes, causes_at, circumstances
from mtp_bench.types import Detections, Rollout, Scene
from tests.support.scoring_scenes import (
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
seeds = st.integers(0, 10_000)


def seen_some(scene: Scene, seed: int) -> Scene:
    """The scene with detections of some of its true boxes, up to 3 m off."""
    rng = np.random.default_rng(seed)
    truth = scene.truth.select(rng.random(len(scene.truth.box)) < 0.7)
    box = truth.box.copy()
    box[:, :2] += rng.uniform(-2, 2, (len(box), 2))
    return replace(scene, detections=Detections(truth.start, box, truth.velocity, truth.class_id, rng.random(len(box))))


def looked_at(seed: int, name: str, draw: int) -> tuple[SceneScore, Circumstances]:
    """A scene and what one of several runs of an agent says of it: other objects at other confidences in each."""
    scene, rollout = random_case(seed, name=name)
    scene = seen_some(scene, seed)
    rng, count = np.random.default_rng([seed, draw]), len(rollout.object_box)
    confidence = (rng.integers(0, 9, count) / 8).astype(np.float32)
    rollout = take_objects(replace(rollout, object_confidence=confidence), np.flatnonzero(rng.random(count) < 0.7))
    return score_scene(scene, rollout, CARD), circumstances(scene, rollout, CARD)


def parts_of(runs: list[list[tuple[SceneScore, Circumstances]]], budgets: Budgets, rng: Any, subsets: bool) -> Array:
    n = sum(len(score) for score, _ in runs[0])
    scores = [[score for score, _ in run] for run in runs]
    around = [[near for _, near in run] for run in runs]
    return causes(scores, around, budgets, rng.uniform(0, 5, n), rng.random(n) < 0.5, subsets)


@given(seeds, st.floats(0, 12), st.booleans())
@steady
def test_parts_add_up_to_the_error_that_ranks_at_every_budget(seed: int, stp: float, known: bool) -> None:
    # two seeds of two scenes, true pasts and switches of any value
    runs = [[looked_at(2 * seed, "a", draw), looked_at(2 * seed + 1, "b", draw)] for draw in range(2)]
    n = sum(len(score) for score, _ in runs[0])
    budgets, rng = budgets_of(n, stp, known), np.random.default_rng(seed)
    for subsets in (False, True):
        allowed = [budgets.subsets] if subsets else budgets.all
        live = None if known else sum(score.live for score, _ in runs[0])
        errors = [errors_at([score.cuts for score, _ in run], allowed, live).error.mean(axis=0) for run in runs]
        parts = parts_of(runs, budgets, rng, subsets)
        np.testing.assert_allclose(parts.sum(axis=0), np.mean(errors, axis=0), atol=1e-9)


def still(x: float, y: float = 0.0) -> Any:
    return np.tile([x, y], (1, 3, 1))


def scene_of(objects: list[Thing], detected: list[Thing]) -> Scene:
    """True ``objects`` at rest in five frames; the only live frame with targets is 1, where ``detected`` are seen."""
    return with_detections(make_scene([objects] * 5), [[], detected, [], [], []])


def named(
    scene: Scene, rollout: Rollout, least: float, from_truth: Any = 0.0, switched: bool = False
) -> dict[str, Any]:
    score, near = score_scene(scene, rollout, SMALL), circumstances(scene, rollout, SMALL)
    n = len(score)
    parts = causes_at(score.cuts, near, np.full(n, from_truth), np.full(n, switched), least)
    return dict(zip(CAUSES, parts.round(6).tolist(), strict=True))


def test_the_first_cause_of_a_missing_forecast() -> None:
    # three cars: one never seen, one seen with a weak forecast, one seen with none
    cars = [Thing(1, 0, 0), Thing(2, 20, 0), Thing(3, 40, 0)]
    scene = scene_of(cars, cars[1:])
    said = make_rollout([[]] * 5, [[], [Thing(2, 20, 0, forecast=still(20), confidence=0.25)]], samples=1)
    parts = named(scene, said, least=0.5)
    assert parts["undetected"] == [10, 0, 0]
    assert parts["below_threshold"] == [0, 10, 0]
    assert parts["not_forecast"] == [0, 0, 10]
    kept = named(scene, said, least=0.0)
    assert kept["below_threshold"] == [0, 0, 0]
    assert sum(kept[name][1] for name in CAUSES) == 0  # the weak forecast is right


@pytest.mark.parametrize(("switched", "name"), [(True, "switched"), (False, "rest")])
def test_the_parts_of_a_forecast(switched: bool, name: str) -> None:
    # the forecast starts 1 m beside the car and stays there: all of its error is that of the present place
    car = Thing(1, 0, 0)
    beside = make_rollout([[]] * 5, [[], [Thing(1, 1, 0, forecast=still(1))]], samples=1)
    parts = named(scene_of([car], [car]), beside, 0.0, from_truth=0.25, switched=switched)
    assert parts["gt_tracks"] == [0.25]
    assert parts["localisation"] == [1.0]
    assert parts[name] == [-0.25]  # without the wrong place it is better than from the true past
    assert sum(parts[each][0] for each in CAUSES) == pytest.approx(1.0)


def test_time_since_an_event_and_age_of_the_track() -> None:
    # a car whose track changes its name in frame 3, and is gone in frame 5
    cars = [[Thing(1, 0, 0)]] * 10
    ids = [7, 7, 7, 8, 8, None, 8, 8, 8, 8]
    tracks = [[] if i is None else [Thing(i, 0, 0)] for i in ids]
    scene, rollout = make_scene(cars), make_rollout(tracks, samples=1)
    near = circumstances(scene, rollout, SMALL)
    frames = find_targets(scene, SMALL).frame.tolist()
    assert frames == [1, 2, 3, 4, 5, 6]
    assert near.since["ids"].tolist() == [-1, -1, 0, 1, 2, 3]
    assert near.since["lost"].tolist() == [-1, -1, -1, -1, 0, 1]
    assert near.since["reacquired"].tolist() == [-1, -1, -1, -1, -1, 0]
    assert near.age.tolist() == [1, 2, 0, 1, -1, 3]
    assert near.own == {"ids": 1, "lost": 1, "reacquired": 1, "frag": 2}
    assert (near.objects, near.frames) == (1, 10)


def test_an_event_that_one_hypothesis_does_not_have_is_not_shared() -> None:
    # the name changes in the first hypothesis only; the second keeps it
    cars = [[Thing(1, 0, 0)]] * 5
    tracks = [[Thing(7, 0, 0, hypotheses=(0, 1))], [Thing(7, 0, 0, hypotheses=(0, 1))]]
    tracks += [[Thing(8, 0, 0, hypotheses=(0,)), Thing(7, 0, 0, hypotheses=(1,))]] * 3
    rollout = make_rollout(tracks, samples=1, hypotheses=2, log_weight=np.log([[0.6, 0.4]] * 5))
    parents = replace(rollout, hypothesis_parent=np.tile([0, 1], (5, 1)))
    near = circumstances(make_scene(cars), parents, SMALL)
    assert (near.own["ids"], near.shared["ids"]) == (1, 0)
