"""Whose forecast is whose; the error at the fixed operating point; EPA and AP_f."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from mtp_bench.core import Scene
from mtp_bench.scoring import FrameScore, FrameScorer, forecast_average_precision, score_scene
from mtp_bench.scoring.forecasts import RecordedForecasts
from tests.support.scoring_scenes import WALKER, Thing, make_card, make_rollout, make_scene, random_case

CARD = make_card(past=2, future=3, samples=1)


def car(x: float, id: int = 1, **more: Any) -> Thing:
    return Thing(id, x, 0.0, **more)


def van(x: float, id: int = 2) -> Thing:
    return Thing(id, x, 0.0, neutral=True)


# ---- error at the fixed operating point, of a frame: a car at rest and a walker at rest are targets in frame 1
NOTHING = (0, 0, 0)  # malformed objects: cars, walkers, without a class


def still(*things: Thing, **more: Any) -> Scene:
    return make_scene([list(things)] * 5, **more)


def error(scene: Scene, objects: Sequence[Thing], t: int = 1, malformed: Sequence[int] = NOTHING) -> float:
    said = RecordedForecasts.of(make_rollout([[]] * 5, [*[[]] * t, list(objects)]))
    return FrameScorer(scene, CARD).score(t, said, np.array(malformed)).error


TARGETS = (car(0), Thing(2, 30, 0, class_id=WALKER))
SEEN = (car(0.5, forecast=[[[1, 0]] * 3]), Thing(2, 30, 0, class_id=WALKER, forecast=[[[30, 3]] * 3]))
UNSURE = tuple(replace(thing, confidence=0.49) for thing in SEEN)
MANY = tuple(car(60.0 + 5 * i, id=i) for i in range(40))

ERRORS: dict[str, tuple[Scene, Sequence[Thing], Sequence[int], float]] = {
    # scene, objects, malformed, error
    "both covered": (still(*TARGETS), SEEN, NOTHING, 1 + 3),
    "unsure is not said": (still(*TARGETS), (*UNSURE, car(60, confidence=0.49)), NOTHING, 10 + 4),
    "malformed objects": (still(*TARGETS), SEEN, (1, 2, 3), 1 + 3 + 5 + 2 * 2 + 3 * 5),
    "absent sample": (still(car(0)), [car(0, forecast=[[[0, 0]] * 3], log_weight=[-np.inf])], NOTHING, 10),
    "no target, a false car and a malformed walker": (still(van(0)), [car(0.1), car(50)], (0, 1, 0), 5 + 2),
    "targets only: the 41st is not": (still(*TARGETS, truth_complete=False), (*SEEN, *MANY[1:]), NOTHING, 1 + 3 + 5),
    "targets only: malformed ones are among the 40": (
        still(*TARGETS, truth_complete=False), (*SEEN, *MANY[4:]), (1, 0, 1), 1 + 3),
    "targets only: more malformed ones than are free": (
        still(*TARGETS, truth_complete=False), (*SEEN, *MANY[2:]), (1, 1, 0), 1 + 3 + 5 + 2),
}  # fmt: skip


@pytest.mark.parametrize(("scene", "objects", "malformed", "want"), ERRORS.values(), ids=ERRORS.keys())
def test_error_of_a_frame(scene: Scene, objects: Sequence[Thing], malformed: Sequence[int], want: float) -> None:
    assert error(scene, objects, malformed=malformed) == pytest.approx(want)


def test_only_live_frames_cost() -> None:
    scene = still(*TARGETS)
    assert [error(scene, [car(60)], t, (1, 1, 1)) for t in range(5)] == [0, 10 + 4 + 5 + 5 + 2 + 5, 0, 0, 0]


@settings(derandomize=True, deadline=None, max_examples=20)
@given(st.integers(0, 10_000), st.booleans())
def test_frames_add_up_to_the_scene(seed: int, complete: bool) -> None:
    card = make_card()
    scene, rollout = random_case(seed)
    scene = replace(scene, truth_complete=complete)
    malformed = np.random.default_rng(seed).poisson(0.5 if complete else 30.0, (scene.frames, 3))
    rollout = replace(rollout, malformed=malformed)
    scorer, said = FrameScorer(scene, card), RecordedForecasts.of(rollout)
    parts = []
    for t in range(scene.frames):
        rows = rollout.objects.rows(t)
        now = RecordedForecasts(**{name: value[rows] for name, value in vars(said).items()})
        parts.append(scorer.score(t, now, malformed[t]))
    whole, total = score_scene(scene, rollout, card), FrameScore.total(parts)
    assert sum(part.error for part in parts) == pytest.approx(whole.fixed_error)
    assert total.error == pytest.approx(whole.fixed_error)
    assert (total.targets, total.covered) == (len(whole), whole.covered.sum())
    assert total.min_ade == pytest.approx(whole.min_ade[whole.covered].mean() if whole.covered.any() else 0.0)
    assert total.false_forecasts == (whole.false_forecasts if complete else 0)
    assert total.cost_missed == pytest.approx(float(whole.cuts.at(0.5)[1].sum()))


# ---- EPA and AP_f
AP: dict[str, tuple[list[bool], list[float], int, float | None]] = {
    # correct, score, targets, AP: recalls .11 to 1 count, precision less .1
    "all right": ([True, True], [0.9, 0.1], 2, 1.0),
    "all wrong": ([False, False], [0.9, 0.1], 2, 0.0),
    "nothing said": ([], [], 2, 0.0),
    "no target": ([], [], 0, None),
    "half found": ([True], [0.9], 2, 40 / 90),
    "a wrong one after the last right one lowers one of 90 points": (
        [True, False], [0.9, 0.1], 1, (89 + 0.4 / 0.9) / 90),
    "one score for all": ([True, False], [0.5, 0.5], 1, 0.4 / 0.9),
    "the order of equal scores does not matter": ([False, True], [0.5, 0.5], 1, 0.4 / 0.9),
    "precision below .1 counts for nothing": ([True, *[False] * 19], [0.5] * 20, 1, 0.0),
}  # fmt: skip


@pytest.mark.parametrize(("correct", "score", "targets", "want"), AP.values(), ids=AP.keys())
def test_average_precision(correct: list[bool], score: list[float], targets: int, want: Any) -> None:
    assert forecast_average_precision(correct, score, targets) == pytest.approx(want)
