"""Whose forecast is whose; the missing-aware error; EPA and AP_f."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mtp_bench.errors import ShapeError
from mtp_bench.scoring import end_to_end_accuracy, find_targets, forecast_average_precision, frame_error, score_scene
from mtp_bench.scoring.forecasts import match_objects
from mtp_bench.types import Scene
from tests.support.scoring_scenes import WALKER, Thing, make_card, make_rollout, make_scene, random_case

CARD = make_card(past=2, future=3, samples=1)


def car(x: float, id: int = 1, **more: Any) -> Thing:
    return Thing(id, x, 0.0, **more)


def van(x: float, id: int = 2) -> Thing:
    return Thing(id, x, 0.0, neutral=True)


MATCHES: dict[str, tuple[list[Thing], list[Thing], list[int], list[bool]]] = {
    # truth, objects, object of each true box, false forecasts
    "at the gate": ([car(0)], [car(2)], [0], [False]),
    "beyond the gate": ([car(0)], [car(2.01)], [-1], [True]),
    "nearest": ([car(0)], [car(1), car(-0.5)], [1], [True, False]),
    "other class": ([car(0)], [Thing(1, 0, 0, class_id=WALKER)], [-1], [True]),
    "gate of the class": ([Thing(1, 0, 0, class_id=WALKER)], [Thing(1, 1.5, 0, class_id=WALKER)], [-1], [True]),
    "as many as possible": ([car(0, 1), car(1.5, 2)], [car(1.0), car(3.0)], [0, 1], [False, False]),
    "a neutral box is neither right nor wrong": ([van(0)], [car(0.1)], [0], [False]),
    "an evaluated box comes before a neutral one": ([car(1.9), van(0)], [car(0.1)], [0, -1], [False]),
    "what is left over goes to the neutral one": ([car(1.9), van(0)], [car(0.1), car(0.2)], [1, 0], [False, False]),
    "a neutral box takes one only": ([van(0)], [car(0.1), car(0.2)], [0], [False, True]),
    "a box that is no target takes its object too": ([car(0, eligible=False)], [car(0.1)], [0], [False]),
    "no truth": ([], [car(0)], [], [True]),
    "no objects": ([car(0)], [], [-1], []),
}


@pytest.mark.parametrize(("truth", "objects", "want", "false"), MATCHES.values(), ids=MATCHES.keys())
def test_objects(truth: list[Thing], objects: list[Thing], want: list[int], false: list[bool]) -> None:
    scene, rollout = make_scene([truth]), make_rollout([[]], [objects])
    frame = np.zeros(len(objects), dtype=int)
    found = match_objects(scene.truth, frame, rollout.object_box, rollout.object_class, CARD)
    assert found.object_of_truth.tolist() == want
    assert found.unmatched.tolist() == false


# ---- missing-aware error of a frame: a car at rest and a walker at rest are targets in frame 1


def still(*things: Thing) -> Scene:
    return make_scene([list(things)] * 5)


def error(scene: Scene, objects: Sequence[Thing], t: int = 1) -> float:
    rollout = make_rollout([[]] * 5, [*[[]] * t, list(objects)])
    xy = rollout.object_box[:, None, None, :2] + rollout.forecast / 100.0
    targets, weight = find_targets(scene, CARD), rollout.forecast_log_weight
    return frame_error(scene, targets, CARD, t, rollout.object_box, rollout.object_class, xy, weight)


TARGETS = (car(0), Thing(2, 30, 0, class_id=WALKER))
SEEN = (car(0.5, forecast=[[[1, 0]] * 3]), Thing(2, 30, 0, class_id=WALKER, forecast=[[[30, 3]] * 3]))

ERRORS: dict[str, tuple[Scene, Sequence[Thing], float]] = {
    "both covered": (still(*TARGETS), SEEN, (1 + 3) / 2),
    "a perfect answer": (still(*TARGETS), tuple(replace(i, forecast=[[[i.x, 0]] * 3]) for i in TARGETS), 0.0),
    "car missing": (still(*TARGETS), SEEN[1:], (10 + 3) / 2),
    "nothing said": (still(*TARGETS), (), (10 + 4) / 2),
    "worse than missing is capped": (still(*TARGETS), (car(0, forecast=[[[99, 0]] * 3]), SEEN[1]), (10 + 3) / 2),
    "a false car": (still(*TARGETS), (*SEEN, car(60)), (1 + 3 + 5) / 2),
    "a false walker": (still(*TARGETS), (*SEEN, Thing(9, 60, 0, class_id=WALKER)), (1 + 3 + 2) / 2),
    "absent sample": (still(car(0)), [car(0, forecast=[[[0, 0]] * 3], log_weight=[-np.inf])], 10.0),
    "no target": (still(van(0)), [car(0.1)], 0.0),
    "no target and a false car": (still(van(0)), [car(0.1), car(50)], 5.0),
    "nothing at all": (still(), [], 0.0),
    "false forecasts where the truth has holes": (
        make_scene([list(TARGETS)] * 5, truth_complete=False),
        (*SEEN, car(60)),
        2.0,
    ),
}


@pytest.mark.parametrize(("scene", "objects", "want"), ERRORS.values(), ids=ERRORS.keys())
def test_error_of_a_frame(scene: Scene, objects: Sequence[Thing], want: float) -> None:
    assert error(scene, objects) == pytest.approx(want)


def test_frames_without_targets_cost_their_false_forecasts() -> None:
    scene = still(*TARGETS)
    assert error(scene, [car(0)], t=0) == 0.0  # the first frame has no past: nothing to forecast, nothing wrong
    assert error(scene, [car(60)], t=4) == 5.0


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.integers(0, 10_000))
def test_frames_add_up_to_the_scene(seed: int) -> None:
    card = make_card()
    scene, rollout = random_case(seed)
    targets = find_targets(scene, card)
    score = score_scene(scene, rollout, card)
    total = 0.0
    for t in range(scene.frames):
        rows = rollout.objects.rows(t)
        xy = rollout.object_box[rows, None, None, :2] + rollout.forecast[rows] / 100.0
        part = frame_error(scene, targets, card, t, rollout.object_box[rows], rollout.object_class[rows], xy,
                           rollout.forecast_log_weight[rows])  # fmt: skip
        count = int((targets.frame == t).sum())
        assert (part == 0.0) == (count == 0 and score.false_forecasts[t] == 0)
        total += part * max(1, count)
    assert total == pytest.approx(score.capped.sum() + score.false_error)


# ---- EPA and AP_f


def test_epa_by_hand() -> None:
    assert end_to_end_accuracy(8, 4, 12) == 0.5
    assert end_to_end_accuracy(0, 4, 2) == -1.0
    assert end_to_end_accuracy(0, 4, 0) is None


AP: dict[str, tuple[list[bool], list[float], int, float]] = {
    # correct, score, targets, AP: recalls .11 to 1 count, precision less .1
    "all right": ([True, True], [0.9, 0.1], 2, 1.0),
    "all wrong": ([False, False], [0.9, 0.1], 2, 0.0),
    "nothing said": ([], [], 2, 0.0),
    "half found": ([True], [0.9], 2, 40 / 90),
    "a wrong one after the last right one lowers one of 90 points": (
        [True, False],
        [0.9, 0.1],
        1,
        (89 + 0.4 / 0.9) / 90,
    ),
    "one score for all": ([True, False], [0.5, 0.5], 1, 0.4 / 0.9),
    "the order of equal scores does not matter": ([False, True], [0.5, 0.5], 1, 0.4 / 0.9),
    "precision below .1 counts for nothing": ([True, *[False] * 19], [0.5] * 20, 1, 0.0),
}


@pytest.mark.parametrize(("correct", "score", "targets", "want"), AP.values(), ids=AP.keys())
def test_average_precision(correct: list[bool], score: list[float], targets: int, want: float) -> None:
    assert forecast_average_precision(correct, score, targets) == pytest.approx(want)


def test_average_precision_of_nothing_and_of_nonsense() -> None:
    assert forecast_average_precision([], [], 0) is None
    with pytest.raises(ShapeError, match="2 correct forecasts of 1 targets"):
        forecast_average_precision([True, True], [0.1, 0.2], 1)
    with pytest.raises(ShapeError, match=r"correct has shape \(1,\) and score \(2,\)"):
        forecast_average_precision([True], [0.1, 0.2], 1)
