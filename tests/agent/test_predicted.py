"""Predictors that forecast a frame at once: what they are told, and what becomes of their forecasts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mtp_bench import Action, Forecasts, Frame, Pipeline, ShapeError, Task
from mtp_bench.agent.pools import pool_of, reduced
from mtp_bench.prediction import KMeansSampler
from mtp_bench.prediction.windows import windows_of
from mtp_bench.tracking import HypothesisTracker
from tests.support.tracking_scenes import at_once, frame, kitti_task, observation, random_frames

TASK = kitti_task(k=2, samples=2, future=3)
CROWD = random_frames(np.random.default_rng(2), 25, objects=10, area=6.0)


class Still:
    """Every object stays; eight lines are enough for a predictor."""

    def reset(self, task: Task) -> None:
        self.task, self.frames = task, list[Frame]()

    def predict(self, frame: Frame) -> Forecasts:
        self.frames.append(frame)
        here = frame.tracks.box[:, None, None, :2]
        return Forecasts(np.repeat(np.repeat(here, self.task.k, axis=1), self.task.future, axis=2))


def play(predictor: Any, hypotheses: int = 1, frames: Any = CROWD, **settings: Any) -> list[Action]:
    agent = Pipeline(HypothesisTracker(hypotheses, at_once()), predictor, KMeansSampler(), **settings)
    agent.reset(TASK)
    return [agent.act(observation(detections)) for detections in frames]


def test_a_predictor_is_asked_once_per_frame_for_the_tracks_that_stand_for_objects() -> None:
    still = Still()
    actions = play(still, hypotheses=5)
    assert [f.number for f in still.frames] == list(range(25))
    assert [len(f.seen) for f in still.frames[:12]] == [*range(1, 11), 10, 10]
    for asked, action in zip(still.frames, actions, strict=True):
        assert len(asked.tracks.box) <= int(action["track_valid"].sum())
        assert asked.tracks.member.shape == (len(asked.tracks.log_weight), len(asked.tracks.box))
        assert asked.tracks.past_detection is not None
        assert asked.seen[-1]["detection_box"] is not None
    there = actions[-1]["object_valid"] > 0
    heaviest = actions[-1]["forecast_log_weight"][there]
    np.testing.assert_allclose(np.exp(heaviest).sum(axis=1) > 0.49, True)


def test_what_trackers_tell_beside_the_past() -> None:
    still = Still()
    play(still, hypotheses=3)
    tracks = still.frames[-1].tracks
    assert tracks.covariance is not None
    assert tracks.affinity is not None
    assert (np.linalg.eigvalsh(tracks.covariance) > 0).all()
    pairs = tracks.affinity
    assert len(pairs.before) == len(tracks.box)
    taken = np.flatnonzero((tracks.detection >= 0) & (pairs.before >= 0))
    assert len(taken)
    for row in taken:  # the detection that a track took is among the pairs of the track that it continues
        mine = slice(pairs.start[pairs.before[row]], pairs.start[pairs.before[row] + 1])
        assert tracks.detection[row] in pairs.detection[mine]
    assert (pairs.gain > 0).all()


def test_the_rows_taken_are_those_of_the_observations() -> None:
    still = Still()
    play(still, hypotheses=5)
    for asked in still.frames:
        tracks = asked.tracks
        assert tracks.past_detection is not None
        for back in range(1, len(asked.seen) + 1):
            took = np.flatnonzero(tracks.past_detection[:, -back] >= 0)
            box = asked.seen[-back]["detection_box"][tracks.past_detection[took, -back]]
            np.testing.assert_array_equal(tracks.past[took, -back], box)
        np.testing.assert_array_equal(tracks.past_detection >= 0, tracks.past_valid)


def test_tracks_with_the_same_past_share_a_window() -> None:
    still = Still()
    play(still, hypotheses=8)
    shared = 0
    for asked in still.frames:
        windows, row = windows_of(asked, 3)
        tracks = asked.tracks
        assert tracks.past_detection is not None
        for window in range(len(windows)):
            mine = tracks.past_detection[row == window, -3:]
            assert (mine == mine[0]).all()
            shared += len(mine) - 1
            np.testing.assert_array_equal(windows.taken[window], mine[0] >= 0)
        np.testing.assert_allclose(windows.mass.sum(), (np.exp(tracks.log_weight) @ tracks.member).sum())
    assert shared > 0


class Outspoken(Still):
    """Says all that can be said."""

    def predict(self, frame: Frame) -> Forecasts:
        plain = super().predict(frame)
        n = len(plain.samples)
        weight = np.where(frame.tracks.class_id[:, None] == 0, -np.inf, [[0.0, -np.inf]]) if n else np.zeros((0, 2))
        return Forecasts(plain.samples, weight, frame.tracks.box[:, :2] + 1.0, np.full(n, 0.25))


def test_present_place_presence_and_silence() -> None:
    told = play(Outspoken(), frames=[frame((0, 0, 0), (10, 0, 1))] * 3)[-1]
    there = told["object_valid"] > 0
    assert there.sum() == 1  # nothing is said of the car
    np.testing.assert_allclose(told["object_box"][there, :2], [[11.0, 1.0]], atol=1e-3)
    np.testing.assert_allclose(told["forecast"][there][0, 0], -1.0, atol=1e-3)
    np.testing.assert_allclose(told["object_confidence"][there], 0.25)
    assert told["forecast_log_weight"][there][0, 1] < -1e29


def test_no_detections_no_forecasts() -> None:
    assert play(Still(), frames=[frame()] * 2)[-1]["object_valid"].sum() == 0


def test_forecasts_of_the_wrong_shape_are_refused() -> None:
    with pytest.raises(ShapeError, match=r"log_weight has shape \(2, 3\), expected \(2, 4\)"):
        Forecasts(np.zeros((2, 4, 3, 2)), np.zeros((2, 3)))


@pytest.mark.parametrize("shape", [(2, 3, 2), (2, 3), ()])
def test_forecasts_without_an_axis_of_samples(shape: tuple[int, ...]) -> None:
    with pytest.raises(ShapeError, match=r"samples has shape .*, expected \[rows, samples, frames, 2\]"):
        Forecasts(np.zeros(shape))


def test_a_predictor_that_answers_with_an_array() -> None:
    class Wrong(Still):
        def predict(self, frame: Frame) -> Forecasts:
            return np.zeros((2, 1, 3, 2))  # type: ignore[return-value]

    with pytest.raises(ShapeError, match=r"predict returned a ndarray, expected mtp_bench\.agent\.Forecasts"):
        play(Wrong(), frames=[frame((0, 0, 0), (10, 0, 1))])


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (Forecasts(np.zeros((1, 2, 3, 2)), row=np.array([0])), r"row has shape \(1,\), expected \(2,\)"),
        (Forecasts(np.zeros((1, 2, 3, 2)), row=np.array([0, 1])), "row is 1, expected 0 to 0"),
        (Forecasts(np.zeros((3, 2, 3, 2))), "samples hold 3 rows, expected 2: one for each track"),
        (Forecasts(np.zeros((2, 2, 4, 2))), r"forecasts has shape \(2, 2, 4, 2\), expected \(2, k, 3, 2\)"),
    ],
)
def test_forecasts_that_do_not_fit_the_frame_are_refused(wrong: Forecasts, said: str) -> None:
    class Wrong(Still):
        def predict(self, frame: Frame) -> Forecasts:
            return wrong

    with pytest.raises(ShapeError, match=said):
        play(Wrong(), frames=[frame((0, 0, 0), (10, 0, 1))])


def test_a_pool_holds_a_row_once_with_the_mass_of_its_hypotheses() -> None:
    row = np.array([[3, 3, 1], [-1, 2, -1], [0, 0, 0]])
    pool = pool_of(row, np.log([0.5, 0.3, 0.2]))
    assert pool.start.tolist() == [0, 2, 3, 4]
    assert pool.row.tolist() == [1, 3, 2, 0]
    np.testing.assert_allclose(np.exp(pool.log_mass), [0.2, 0.8, 0.3, 1.0])
    empty = pool_of(np.zeros((0, 3), dtype=int), np.log([0.5, 0.3, 0.2]))
    assert len(empty.row) == 0


def test_only_pools_that_are_too_large_are_reduced() -> None:
    samples = np.arange(4 * 2 * 3 * 2, dtype=float).reshape(4, 2, 3, 2)
    said = Forecasts(samples, np.log([[0.9, 0.1]] * 4))
    pool = pool_of(np.array([[3, 1], [2, 2]]), np.log([0.6, 0.4]))
    asked: list[Any] = []

    class Spy(KMeansSampler):
        def reduce(self, pool: Any, log_weight: Any, k: int, rng: Any) -> Any:
            asked.append((pool, log_weight, k))
            return super().reduce(pool, log_weight, k, rng)

    found, weight = reduced(pool, said, TASK, Spy(), np.random.default_rng(0), 2048)
    np.testing.assert_array_equal(found[1], samples[2])
    np.testing.assert_allclose(np.exp(weight[1]), [0.9, 0.1])
    ((table, log_weight, k),) = asked
    assert k == 2
    np.testing.assert_array_equal(table, np.concatenate([samples[1], samples[3]])[None])
    np.testing.assert_allclose(np.exp(log_weight), [[0.36, 0.04, 0.54, 0.06]])
    np.testing.assert_allclose(np.exp(weight).sum(axis=1), 1.0)


def test_what_was_seen_earlier_stays_as_it_was() -> None:
    """Also where whoever calls fills the same arrays anew for every frame."""
    still = Still()
    agent = Pipeline(HypothesisTracker(1, at_once()), still, KMeansSampler())
    agent.reset(TASK)
    first = observation(frame((0.0, 0.0, 0)))
    agent.act(first)
    seen = first["detection_box"].copy()
    first["detection_box"][:] = 9.0
    agent.act(observation(frame((0.5, 0.0, 0))))
    np.testing.assert_array_equal(still.frames[-1].seen[0]["detection_box"], seen)
