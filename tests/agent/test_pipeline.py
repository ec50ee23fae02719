"""Tracker, predictor and sampler put together: one hypothesis is STP, more of them pool their samples."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mtp_bench import load_submission
from mtp_bench.agent import Action, Agent, Pipeline
from mtp_bench.env.action import FORECAST_LIMIT
from mtp_bench.errors import ShapeError
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, StandingStill
from mtp_bench.tracking import HypothesisTracker
from mtp_bench.tracks import Tracks, group
from mtp_bench.types import Floats, Ints, Task
from tests.support.tracking_scenes import CYCLIST, Frame, at_once, frame, kitti_task, observation, random_frames

TASK = kitti_task(seed=3)
CROWD = random_frames(np.random.default_rng(2), 30, objects=12, area=7.0)


def answers(agent: Agent, task: Task = TASK, frames: Iterable[Frame] = CROWD) -> list[Any]:
    """Actions; Any stands for their arrays of numbers, which NumPy's types cannot tell from others."""
    agent.reset(task)
    return [agent.act(observation(detections)) for detections in frames]


def assert_equal_actions(first: list[Action], second: list[Action]) -> None:
    for a, b in zip(first, second, strict=True):
        assert a.keys() == b.keys()
        for key in a:
            np.testing.assert_array_equal(a[key], b[key], err_msg=key)


def pipeline(hypotheses: int, **settings: Any) -> Pipeline:
    return Pipeline(HypothesisTracker(hypotheses, at_once()), KinematicPredictor(), KMeansSampler(), **settings)


def test_mtp_with_one_hypothesis_is_stp() -> None:
    stp = answers(load_submission("stp").build(TASK))
    assert_equal_actions(stp, answers(load_submission("mtp").build(TASK, hypotheses=1)))
    assert_equal_actions(stp, answers(load_submission("mtp").build(TASK, hypotheses=1, weighting="uniform")))
    assert_equal_actions(stp, answers(load_submission("stp_same_budget").build(TASK, draws=1)))
    assert sum(int(a["object_valid"].sum()) for a in stp) > 100


def test_an_agent_repeats_itself_after_reset() -> None:
    agent = load_submission("mtp").build(TASK)
    first = answers(agent)
    assert_equal_actions(first, answers(agent))
    other = answers(agent, replace(TASK, seed=4))
    np.testing.assert_array_equal(first[-1]["track_box"], other[-1]["track_box"])
    assert not np.array_equal(first[-1]["forecast"], other[-1]["forecast"])


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


def test_all_samples_of_all_hypotheses_fit_into_a_larger_task() -> None:
    free, equal = replace(TASK, samples=6 * 20), TASK
    for all_samples, reduced in zip(answers(pipeline(6), free), answers(pipeline(6), equal), strict=True):
        np.testing.assert_array_equal(all_samples["object_box"], reduced["object_box"])
        alive = int(np.isfinite(all_samples["hypothesis_log_weight"]).sum())
        drawn = np.isfinite(all_samples["forecast_log_weight"]).sum(axis=1)
        assert set(drawn.tolist()) <= {20 * h for h in range(alive + 1)}
        assert (np.isfinite(reduced["forecast_log_weight"]).sum(axis=1) <= 20).all()
        if len(all_samples["object_valid"].nonzero()[0]):
            assert drawn.max() == 20 * alive
            far = np.abs(all_samples["forecast"]).max(axis=(1, 2, 3))
            assert (np.abs(reduced["forecast"]).max(axis=(1, 2, 3)) <= far + 1e-4).all()  # centres lie among them


def test_samples_weigh_as_much_as_their_hypothesis() -> None:
    free = replace(TASK, samples=4 * 20)
    posterior, uniform = answers(pipeline(4), free)[-1], answers(pipeline(4, weighting="uniform"), free)[-1]
    np.testing.assert_array_equal(posterior["forecast"], uniform["forecast"])
    weight = np.unique(posterior["forecast_log_weight"][0])
    np.testing.assert_allclose(weight, np.sort(posterior["hypothesis_log_weight"][:4]))
    assert np.unique(uniform["forecast_log_weight"][0]).tolist() == [0.0]


def test_every_hypothesis_draws_as_often() -> None:
    free = replace(TASK, samples=4 * 3 * 20)
    action = answers(pipeline(4, draws=3), free)[-1]
    np.testing.assert_allclose(action["forecast_log_weight"][0], np.repeat(action["hypothesis_log_weight"][:4], 60))
    samples = action["forecast"][0].reshape(240, -1)
    assert len(np.unique(samples, axis=0)) == 240


def test_objects_of_small_mass_are_left_out() -> None:
    few, many = (answers(pipeline(20, min_mass=mass)) for mass in (0.9, 0.0))
    counts = np.array([[a["object_valid"].sum() for a in actions] for actions in (few, many)])
    assert (counts[0] <= counts[1]).all()
    assert counts[0].sum() < counts[1].sum()
    for a, b in zip(few, many, strict=True):
        np.testing.assert_array_equal(a["track_box"], b["track_box"])  # the tracks are all there


class Halves:
    """Every second track is certainly there, the others by one half."""

    def reset(self, task: Task) -> None:
        self.frames = 0

    def probability(self, tracks: Tracks, observation: Any) -> Any:
        self.frames += 1
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


def test_without_presence_confidence_is_the_mass() -> None:
    for action in answers(pipeline(1)):
        assert (action["object_confidence"][action["object_valid"] == 1] == 1).all()
    confidence = [a["object_confidence"][a["object_valid"] == 1] for a in answers(pipeline(20))]
    assert min(values.min() for values in confidence if len(values)) >= 0.5 - 1e-6  # min_mass
    assert max(values.max() for values in confidence if len(values)) <= 1
    assert any((values < 0.99).any() for values in confidence)


def test_an_unknown_weighting_is_an_error() -> None:
    with pytest.raises(ShapeError, match="weighting is 'equal'"):
        pipeline(1, weighting="equal")


@pytest.mark.parametrize("draws", [0, -1, 1.5, True])
def test_draws_that_are_no_count_are_an_error(draws: float) -> None:
    with pytest.raises(ShapeError, match="expected a whole number of at least 1"):
        pipeline(1, draws=draws)


def test_a_mass_that_is_no_weight_is_an_error() -> None:
    with pytest.raises(ShapeError, match="min_mass is 50, expected a weight from 0 to 1"):
        pipeline(1, min_mass=50)


class Told(StandingStill):
    """Counts the frames that it is told, and those that it is asked about."""

    def __init__(self) -> None:
        self.frames: list[Tracks] = []

    def begin(self, tracks: Tracks) -> None:
        self.frames.append(tracks)

    def sample(self, tracks: Tracks, leaf: Any, draw: Any, samples: int) -> Any:
        assert tracks is self.frames[-1]
        return super().sample(tracks, leaf, draw, samples)


def test_a_predictor_is_told_every_frame_once_before_it_is_asked() -> None:
    told = Told()
    answers(Pipeline(HypothesisTracker(3, at_once()), told, KMeansSampler()))
    assert len(told.frames) == len(CROWD)


def test_frames_without_detections() -> None:
    for action in answers(pipeline(5), frames=[frame()] * 3):
        assert not action["track_valid"].any()
        assert not action["object_valid"].any()
        assert action["hypothesis_log_weight"][0] == 0.0


def test_parts_can_be_exchanged() -> None:
    agent = Pipeline(HypothesisTracker(1, at_once()), StandingStill(), KMeansSampler(iterations=0))
    for action in answers(agent):
        coasting = np.abs(action["forecast"]).max(axis=(1, 2, 3))
        assert (coasting < 2.0).all()  # from the filtered box to the last detection


def test_forecasts_end_where_no_answer_may_go_on() -> None:
    class Far(StandingStill):
        def sample(self, tracks: Tracks, leaf: Ints, draw: Ints, samples: int) -> Floats:
            futures = super().sample(tracks, leaf, draw, samples)
            futures[..., 1:, 0] += 400.0
            return futures

    action = answers(Pipeline(HypothesisTracker(1, at_once()), Far(), KMeansSampler()))[-1]
    offset = action["forecast"][action["object_valid"] == 1]
    assert len(offset)
    reach = np.linalg.norm(offset, axis=-1)
    assert (reach[:, :, 0] < 1).all()
    np.testing.assert_allclose(reach[:, :, 1:], 0.999 * FORECAST_LIMIT, rtol=1e-6)
    assert (offset[..., 1:, 0] > 0).all()
