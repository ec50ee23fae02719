"""Predictors that spread their samples over several readings of the past."""

from __future__ import annotations

import numpy as np
import pytest

from mtp_bench.errors import ShapeError, SubmissionError
from mtp_bench.prediction import HedgedPredictor, KinematicPredictor, LearnedPredictor, StandingStill
from mtp_bench.tracks import Tracks
from mtp_bench.types import Floats, Ints, Task
from tests.support.tracking_scenes import kitti_task, tracks_with_past

TASK = kitti_task()
PAST = np.zeros((10, 7))
PAST[:, :2] = np.arange(10)[:, None] + [21.0, -29.0]  # it ends at (30, -20)


class Counting:
    """A predictor that says its own number."""

    def __init__(self, number: float) -> None:
        self.number = number
        self.asked: list[int] = []

    def reset(self, task: Task) -> None:
        self.asked = []

    def sample(self, tracks: Tracks, leaf: Ints, draw: Ints, samples: int) -> Floats:
        self.asked.append(samples)
        return np.full((len(leaf), samples, 10, 2), self.number)


class Told(Counting):
    """One that wants to know the frame."""

    told = 0

    def begin(self, tracks: Tracks) -> None:
        self.told += 1


def test_predictors_that_want_to_know_the_frame_are_told_it() -> None:
    parts = [Told(0.0), Counting(1.0), Told(2.0)]
    hedged = HedgedPredictor(parts)
    for _ in range(3):
        hedged.begin(tracks_with_past(PAST[None]))
    assert [getattr(part, "told", None) for part in parts] == [3, None, 3]


@pytest.mark.parametrize(
    ("samples", "shares"),
    [(20, [4, 4, 4, 4, 4]), (7, [2, 2, 1, 1, 1]), (5, [1, 1, 1, 1, 1]), (3, [1, 1, 1, 0, 0]), (1, [1, 0, 0, 0, 0])],
)
def test_the_hedged_predictor_shares_its_samples(samples: int, shares: list[int]) -> None:
    parts = [Counting(float(i)) for i in range(5)]
    hedged = HedgedPredictor(parts)
    hedged.reset(TASK)
    tracks = tracks_with_past(np.stack([PAST] * 2))
    futures = hedged.sample(tracks, np.arange(2), np.zeros(2, dtype=np.int64), samples)
    assert futures.shape == (2, samples, 10, 2)
    assert [int((futures[1, :, 0, 0] == i).sum()) for i in range(5)] == shares
    assert [part.asked for part in parts] == [[n] if n else [] for n in shares]


def test_what_has_one_thing_to_say_says_it_once() -> None:
    parts = [Counting(0.0), Counting(1.0), Counting(9.0)]
    hedged = HedgedPredictor(parts[:2], once=parts[2:])
    tracks = tracks_with_past(PAST[None])
    for samples, shares in ((7, [3, 3, 1]), (2, [1, 0, 1]), (1, [1, 0, 0])):
        futures = hedged.sample(tracks, np.arange(1), np.zeros(1, dtype=np.int64), samples)
        assert [int((futures[0, :, 0, 0] == part.number).sum()) for part in parts] == shares


def test_readings_of_one_past_draw_different_samples() -> None:
    hedged = HedgedPredictor([KinematicPredictor(), KinematicPredictor()], once=[StandingStill()])
    hedged.reset(TASK)
    tracks = tracks_with_past(PAST[None])
    hedged.begin(tracks)
    for draw in (0, 1):
        futures = hedged.sample(tracks, np.zeros(1, dtype=np.int64), np.array([draw]), 11)
        assert len(np.unique(futures[0, :, -1], axis=0)) == 11


def test_standing_still_is_the_last_box_repeated() -> None:
    still = StandingStill()
    still.reset(TASK)
    futures = still.sample(tracks_with_past(np.stack([PAST] * 3)), np.array([2, 0]), np.zeros(2, dtype=np.int64), 3)
    np.testing.assert_array_equal(futures, np.broadcast_to([30.0, -20.0], (2, 3, 10, 2)))


def test_what_cannot_be_hedged() -> None:
    with pytest.raises(ShapeError, match="got no predictors, expected at least one"):
        HedgedPredictor([])
    with pytest.raises(SubmissionError, match="a LearnedPredictor as predictor 1, expected one that draws samples"):
        HedgedPredictor([StandingStill(), LearnedPredictor()])  # type: ignore[list-item]
    with pytest.raises(SubmissionError, match="the class StandingStill as predictor 0"):
        HedgedPredictor([StandingStill])  # type: ignore[list-item]


def test_no_tracks_no_samples() -> None:
    predictor = HedgedPredictor([StandingStill()])
    predictor.reset(TASK)
    nothing = np.zeros(0, dtype=np.int64)
    assert predictor.sample(tracks_with_past(np.zeros((0, 10, 7))), nothing, nothing, 20).shape == (0, 20, 10, 2)
