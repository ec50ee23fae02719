"""Tracker, predictor and sampler put together: one hypothesis is STP, more of them pool their samples."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mtp_bench import load_submission
from mtp_bench.agent import Agent, Forecasts, Frame, FunctionPredictor, Pipeline
from mtp_bench.agent.action import FORECAST_LIMIT
from mtp_bench.agent.pipeline import make_pools, reduce_pools
from mtp_bench.core import Action, Floats, Task
from mtp_bench.core.errors import ShapeError
from mtp_bench.core.tracks import Tracks, group
from mtp_bench.prediction import KinematicPredictor, KMeansSampler
from mtp_bench.tracking import HypothesisTracker
from tests.support import tracking_scenes
from tests.support.tracking_scenes import CYCLIST, at_once, frame, kitti_task, observation, random_frames

TASK = kitti_task(seed=3)
SMALL = kitti_task(k=2, samples=2, future=3)
CROWD = random_frames(np.random.default_rng(2), 25, objects=12, area=7.0)
PAIR = [frame((0, 0, 0), (10, 0, 1))]


def answers(agent: Agent, task: Task = TASK, frames: Iterable[tracking_scenes.Frame] = CROWD) -> list[Any]:
    """Actions; Any stands for their arrays of numbers, which NumPy's types cannot tell from others."""
    agent.reset(task)
    return [agent.act(observation(detections)) for detections in frames]


def assert_equal_actions(first: list[Action], second: list[Action]) -> None:
    for a, b in zip(first, second, strict=True):
        assert a.keys() == b.keys()
        for key in a:
            np.testing.assert_array_equal(a[key], b[key], err_msg=key)


def pipeline(hypotheses: int, draws: int = 1, **settings: Any) -> Pipeline:
    tracker = HypothesisTracker(hypotheses, at_once())
    return Pipeline(tracker, KinematicPredictor(draws=draws), KMeansSampler(), **settings)


def still(tracks: Tracks, task: Task) -> Floats:
    return np.repeat(tracks.past[:, -1:, None, :2], task.future, axis=2)


class Recorder:
    def __init__(self, forecast: Any = None) -> None:
        self.forecast = forecast or (lambda frame, task: Forecasts(still(frame.tracks, task)))

    def reset(self, task: Task) -> None:
        self.task, self.frames = task, list[Frame]()

    def predict(self, frame: Frame) -> Forecasts:
        self.frames.append(frame)
        forecasts: Forecasts = self.forecast(frame, self.task)
        return forecasts


def play(predictor: Any, hypotheses: int = 1, frames: Any = CROWD, task: Task = SMALL) -> list[Any]:
    return answers(Pipeline(HypothesisTracker(hypotheses, at_once()), predictor, KMeansSampler()), task, frames)


def test_mtp_with_one_hypothesis_is_stp() -> None:
    stp = answers(load_submission("stp").build(TASK))
    assert_equal_actions(stp, answers(load_submission("mtp").build(TASK, hypotheses=1)))
    assert_equal_actions(stp, answers(load_submission("mtp").build(TASK, hypotheses=1, weighting="uniform")))
    assert_equal_actions(stp, answers(load_submission("stp_same_samples").build(TASK, draws=1)))
    assert sum(int(a["object_valid"].sum()) for a in stp) > 100


def test_the_order_of_the_actions_arrays() -> None:
    # One cyclist at rest in view of one hypothesis.
    (action,) = answers(pipeline(1), frames=[frame((3.0, 4.0, CYCLIST))])
    assert action["track_valid"].tolist() == [1] + [0] * 639
    assert action["hypothesis_member"].sum() == action["hypothesis_member"][0, 0] == 1
    assert action["hypothesis_log_weight"].tolist() == [0.0] + [-np.inf] * 19
    assert action["object_valid"].tolist() == [1] + [0] * 79
    assert action["object_class"][0] == action["track_class"][0] == CYCLIST
    np.testing.assert_array_equal(action["object_box"][0], action["track_box"][0])
    np.testing.assert_allclose(action["object_box"][0, :2], [3.0, 4.0])
    assert np.isfinite(action["forecast_log_weight"][0]).all()
    assert (action["forecast_log_weight"][1:] == -np.inf).all()
    # Forecasts are offsets from the object: they do not start 5 m away from it.
    assert np.abs(action["forecast"][0, :, 0]).max() < 5.0


def test_samples_weigh_as_much_as_their_hypothesis() -> None:
    free = replace(TASK, samples=4 * 3 * 20)
    posterior, uniform = (answers(pipeline(4, 3, weighting=name), free)[-1] for name in ("posterior", "uniform"))
    np.testing.assert_array_equal(posterior["forecast"], uniform["forecast"])
    expected = np.repeat(posterior["hypothesis_log_weight"][:4], 60)
    np.testing.assert_allclose(posterior["forecast_log_weight"][0], expected)
    assert np.unique(uniform["forecast_log_weight"][0]).tolist() == [0.0]
    assert len(np.unique(posterior["forecast"][0].reshape(240, -1), axis=0)) == 240


class Halves:
    """Every second track is certainly there, the others by one half."""

    def reset(self, task: Task) -> None: ...

    def probability(self, tracks: Tracks, observation: Any) -> Any:
        return np.where(np.arange(len(tracks.box)) % 2, 0.5, 1.0)


def test_confidence_is_the_mean_presence_over_hypotheses() -> None:
    several = 0
    agent = pipeline(8, min_mass=0.0, presence=Halves())
    tracker = HypothesisTracker(8, at_once())
    tracker.reset(TASK)
    for detections, action in zip(CROWD, answers(agent), strict=True):
        tracks = tracker.step(observation(detections))
        objects = group(tracks, TASK.objects)
        weight = np.exp(tracks.log_weight)
        expected = [
            sum(w * (0.5 if leaf % 2 else 1.0) for w, leaf in zip(weight, row, strict=True) if leaf >= 0)
            for row in objects.leaf
        ]
        np.testing.assert_allclose(action["object_confidence"][: len(expected)], expected, rtol=1e-6)
        several += sum(0.5 < value < 0.99 for value in expected)
    assert several > 20


def test_a_function_is_a_predictor() -> None:
    for action in play(FunctionPredictor(still), task=TASK):
        there = action["object_valid"] > 0
        np.testing.assert_array_equal(action["forecast"][there], action["forecast"][there][:, :, :1].repeat(10, axis=2))
        assert np.isfinite(action["forecast_log_weight"]).sum() == action["object_valid"].sum()


def test_forecasts_end_at_the_limit_of_an_action() -> None:
    def far(tracks: Tracks, task: Task) -> Floats:
        futures = still(tracks, task)
        futures[..., 1:, 0] += 400.0
        return futures

    action = play(FunctionPredictor(far), task=TASK)[-1]
    offset = action["forecast"][action["object_valid"] == 1][:, 0]
    assert len(offset)
    reach = np.linalg.norm(offset, axis=-1)
    assert (reach[:, 0] < 1).all()
    np.testing.assert_allclose(reach[:, 1:], 0.999 * FORECAST_LIMIT, rtol=1e-6)
    assert (offset[:, 1:, 0] > 0).all()


def test_a_predictor_gets_the_tracks_that_stand_for_objects_once_per_frame() -> None:
    recorder = Recorder()
    actions = play(recorder, hypotheses=5)
    for asked, action in zip(recorder.frames, actions, strict=True):
        tracks = asked.tracks
        assert len(tracks.box) <= int(action["track_valid"].sum())
        assert tracks.member.shape == (len(tracks.log_weight), len(tracks.box))
        assert tracks.past_detection is not None
        for back in range(1, len(asked.seen) + 1):  # the rows taken are those of the observations
            took = np.flatnonzero(tracks.past_detection[:, -back] >= 0)
            box = asked.seen[-back]["detection_box"][tracks.past_detection[took, -back]]
            np.testing.assert_array_equal(tracks.past[took, -back], box)
    assert [f.number for f in recorder.frames] == list(range(len(CROWD)))
    assert [len(f.seen) for f in recorder.frames[:12]] == [*range(1, 11), 10, 10]
    agent = Pipeline(HypothesisTracker(), recorder, KMeansSampler())
    agent.reset(SMALL)
    for t, seen in enumerate(CROWD[:9]):  # a hole in time before frame 5
        agent.act(observation(seen) | {"dt": np.array(2.0 if t == 5 else SMALL.dt)})
    assert [len(f.seen) for f in recorder.frames] == [1, 2, 3, 4, 5, 1, 2, 3, 4]


def test_forecasts_may_move_an_object_state_its_presence_and_leave_it_out() -> None:
    def forecast(frame: Frame, task: Task) -> Forecasts:
        samples = np.repeat(still(frame.tracks, task), task.k, axis=1)
        weight = np.where(frame.tracks.class_id[:, None] == 0, -np.inf, [[0.0, -np.inf]])
        return Forecasts(samples, weight, frame.tracks.box[:, :2] + 1.0, np.full(len(samples), 0.25))

    action = play(Recorder(forecast), frames=PAIR * 3)[-1]
    there = action["object_valid"] > 0
    assert there.sum() == 1  # there is no forecast of the car
    np.testing.assert_allclose(action["object_box"][there, :2], [[11.0, 1.0]], atol=1e-3)
    np.testing.assert_allclose(action["forecast"][there][0, 0], -1.0, atol=1e-3)
    np.testing.assert_allclose(action["object_confidence"][there], 0.25)
    assert action["forecast_log_weight"][there][0, 1] < -1e29


@pytest.mark.parametrize(("shape", "row", "message"), [
    ((1, 2, 3, 2), [0], r"row has shape \(1,\), expected \(2,\) or \(1, 2\)"),
    ((1, 2, 3, 2), [0, 1], "row is 1, expected 0 to 0"), ((1, 2, 3, 2), [[0, -1]], "row is -1, expected 0 to 0"),
    ((3, 2, 3, 2), None, "samples has 3 rows, expected 2: one for each track"),
    ((2, 2, 4, 2), None, r"forecasts has shape \(2, 2, 4, 2\), expected \(2, k, 3, 2\)"),
])  # fmt: skip
def test_forecasts_that_do_not_fit_the_frame(shape: tuple[int, ...], row: Any, message: str) -> None:
    wrong = Forecasts(np.zeros(shape), row=None if row is None else np.array(row))
    with pytest.raises(ShapeError, match=message):
        play(Recorder(lambda *_: wrong), frames=PAIR)


def test_a_pool_has_a_row_once_with_the_mass_of_its_hypotheses() -> None:
    pools = make_pools(np.array([[3, 3, 1], [-1, 2, -1], [0, 0, 0]]), np.log([0.5, 0.3, 0.2]))
    assert (pools.start.tolist(), pools.row.tolist()) == ([0, 2, 3, 4], [1, 3, 2, 0])
    np.testing.assert_allclose(np.exp(pools.log_mass), [0.2, 0.8, 0.3, 1.0])
    assert len(make_pools(np.zeros((0, 3), dtype=int), np.log([0.5, 0.3, 0.2])).row) == 0


def test_only_pools_that_are_too_large_are_reduced() -> None:
    samples = np.arange(4 * 2 * 3 * 2, dtype=float).reshape(4, 2, 3, 2)
    forecasts = Forecasts(samples, np.log([[0.9, 0.1]] * 4))
    pools = make_pools(np.array([[3, 1], [2, 2]]), np.log([0.6, 0.4]))
    calls: list[Any] = []

    class Spy(KMeansSampler):
        def reduce(self, pool: Any, log_weight: Any, k: int, rng: Any) -> Any:
            calls.append((pool, log_weight, k))
            return super().reduce(pool, log_weight, k, rng)

    reduced, weight = reduce_pools(pools, forecasts, SMALL, Spy(), np.random.default_rng(0))
    np.testing.assert_array_equal(reduced[1], samples[2])
    np.testing.assert_allclose(np.exp(weight[1]), [0.9, 0.1])
    ((table, log_weight, k),) = calls
    assert k == 2
    np.testing.assert_array_equal(table, np.concatenate([samples[1], samples[3]])[None])
    np.testing.assert_allclose(np.exp(log_weight), [[0.36, 0.04, 0.54, 0.06]])
    np.testing.assert_allclose(np.exp(weight).sum(axis=1), 1.0)
