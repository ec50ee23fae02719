"""Kinematic predictors: the filter against a textbook one, the samples against the distribution they come from."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mtp_bench.agent import Frame
from mtp_bench.core import Bools, Floats
from mtp_bench.core.geometry import transform_boxes
from mtp_bench.core.tracks import Tracks
from mtp_bench.prediction import HedgedPredictor, KinematicPredictor, NoiseTable
from mtp_bench.prediction.kalman import filter_tracks, heading_frame
from tests.support.tracking_scenes import SIZE, kitti_task, tracks_with_past

DT = 0.1
TASK = kitti_task(dt=DT, seed=5)
NOISE = NoiseTable(
    measurement=np.array([0.1, 0.05, 0.2]), jerkiness=np.array([[0.5, 0.2], [0.3, 0.4], [1.0, 0.1]]),
    speed=np.array([[5.0, 0.5], [1.0, 1.0], [3.0, 0.2]]), acceleration=np.array([[0.4, 0.1], [0.2, 0.2], [0.5, 0.3]]),
)  # fmt: skip


def arc(speed: float, rate: float, heading: float = 0.3, frames: int = 10, first: int = -9) -> Floats:
    """Boxes [frames, 7] of a car that moves at ``speed`` m/s and turns at ``rate`` rad/s; frame 0 is at (30, -20)."""
    t = DT * np.arange(first, first + frames)
    box = np.zeros((frames, 7))
    box[:, 4:] = SIZE[0]
    box[:, 3] = heading + rate * t
    # sin(a) / a keeps the straight line in: np.sinc is sin(pi x) / (pi x).
    chord = speed * t * np.sinc(rate * t / (2 * np.pi))
    box[:, 0] = 30 + chord * np.cos(heading + rate * t / 2)
    box[:, 1] = -20 + chord * np.sin(heading + rate * t / 2)
    return box


def predict(
    tracks: Tracks, samples: int = 20, draw: Any = None, track: Any = None, number: int = 0, **settings: Any
) -> Floats:
    """Futures [Q, samples, T, 2] of a new predictor."""
    predictor = KinematicPredictor(**{"noise": NOISE, **settings})
    predictor.reset(TASK)
    track = np.arange(len(tracks.box)) if track is None else np.array(track)
    draw = np.zeros(len(track), dtype=np.int64) if draw is None else np.array(draw)
    return predictor.futures(Frame(number, tracks, ()), track, draw, samples)


def textbook(position: Floats, valid: Bools, class_id: int, noise: NoiseTable) -> tuple[Floats, Floats]:
    """State x y vx vy and covariance [4, 4] of one track by full matrices."""
    move = np.block([[np.eye(2), DT * np.eye(2)], [np.zeros((2, 2)), np.eye(2)]])
    q = np.diag(noise.jerkiness[class_id] ** 2)
    process = np.block([[q * DT**3 / 3, q * DT**2 / 2], [q * DT**2 / 2, q * DT]])
    see = np.eye(2, 4)
    r = noise.measurement[class_id] ** 2 * np.eye(2)
    first = int(np.argmax(valid))
    state: Floats = np.array([*position[first], 0.0, 0.0])
    cov: Floats = np.diag([r[0, 0], r[1, 1], *noise.speed[class_id] ** 2])
    for z, seen in zip(position[first + 1 :], valid[first + 1 :], strict=True):
        state, cov = move @ state, move @ cov @ move.T + process
        if seen:
            gain = cov @ see.T @ np.linalg.inv(see @ cov @ see.T + r)
            state, cov = state + gain @ (z - see @ state), (np.eye(4) - gain @ see) @ cov
    return state, cov


def test_the_filter_is_the_textbook_filter() -> None:
    rng = np.random.default_rng(0)
    position = np.cumsum(rng.normal(size=(60, 10, 2)), axis=1)
    valid = rng.random((60, 10)) < rng.uniform(0.1, 1.0, 60)[:, None]
    valid[np.arange(60), rng.integers(0, 10, 60)] = True  # each is seen at least once
    position[~valid] = 1e6  # where nothing was seen nothing may be read
    class_id = rng.integers(0, 3, 60)
    found = filter_tracks(position, valid, class_id, NOISE, DT)
    for i in range(60):
        state, cov = textbook(position[i], valid[i], int(class_id[i]), NOISE)
        np.testing.assert_allclose(np.concatenate([found.position[i], found.velocity[i]]), state, rtol=1e-9, atol=1e-9)
        for axis in range(2):
            np.testing.assert_allclose(found.covariance[i, axis], cov[axis::2, axis::2], rtol=1e-9)
        np.testing.assert_allclose(cov[0::2, 1::2], 0, atol=1e-12)  # along and across the heading are independent


@pytest.mark.parametrize("class_id", range(3))
def test_samples_have_the_mean_and_covariance_of_the_model(class_id: int) -> None:
    rng = np.random.default_rng(class_id)
    past = arc(speed=3.0, rate=0.4)[None]
    past[..., :2] += rng.normal(0, 0.1, (1, 10, 2))
    valid = np.array([[True, True, False, True, True, True, False, True, True, False]])
    samples = predict(tracks_with_past(past, valid, np.array([class_id])), samples=40_000)[0]
    heading = past[0, -1, 3]
    axes = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    state, cov = textbook(heading_frame(past, np.array([heading]))[0], valid[0], class_id, NOISE)
    for step, tau in enumerate(DT * np.arange(1, 11)):
        ahead = np.hstack([np.eye(2), tau * np.eye(2)])
        expected = ahead @ cov @ ahead.T + np.diag((NOISE.acceleration[class_id] * tau**2 / 2) ** 2)
        local = (samples[:, step] - past[0, -1, :2]) @ axes
        deviation = np.sqrt(np.diag(expected))
        np.testing.assert_array_less(np.abs(local.mean(axis=0) - ahead @ state), 5 * deviation / np.sqrt(40_000))
        got = np.cov(local.T)
        np.testing.assert_allclose(np.diag(got), np.diag(expected), rtol=0.04)
        assert abs(got[0, 1]) < 0.03 * deviation.prod()
    # A sample is one motion: its error persists from step to step.
    first, last = samples[:, 4] - samples[:, 4].mean(axis=0), samples[:, 9] - samples[:, 9].mean(axis=0)
    assert np.corrcoef((first @ axes)[:, 0], (last @ axes)[:, 0])[0, 1] > 0.8


def test_a_single_sample_is_the_mean() -> None:
    tracks = tracks_with_past(arc(speed=3.0, rate=0.2)[None])
    single, many = predict(tracks, samples=1), predict(tracks, samples=20_000)
    np.testing.assert_array_equal(single, predict(tracks, samples=1, draw=[7]))
    np.testing.assert_allclose(single[:, 0], many.mean(axis=1), atol=0.05 * many.std(axis=1).max())


def test_equal_windows_and_draws_give_equal_samples() -> None:
    past = np.stack([arc(3.0, 0.2), arc(3.0, 0.2), arc(2.0, 0.0)])
    futures = predict(tracks_with_past(past), track=[0, 1, 2, 0, 1], draw=[0, 0, 0, 1, 1])
    np.testing.assert_array_equal(futures[0], futures[1])
    np.testing.assert_array_equal(futures[3], futures[4])
    assert not np.isclose(futures[0], futures[3]).any()
    # The same numbers are behind the samples of another window, too.
    np.testing.assert_allclose(futures[0] - futures[0].mean(0), futures[2] - futures[2].mean(0), atol=1e-9)


def test_draws_depend_on_seed_and_frame_alone() -> None:
    tracks, predictor = tracks_with_past(arc(3.0, 0.2)[None]), KinematicPredictor(noise=NOISE)

    def samples(number: int, **changes: Any) -> Floats:
        predictor.reset(replace(TASK, **changes))
        return predictor.predict(Frame(number, tracks, ())).samples

    first = samples(0)
    np.testing.assert_array_equal(first, samples(0))
    assert not np.array_equal(first, samples(1))
    assert not np.array_equal(first, samples(0, seed=6))


def test_each_hypothesis_draws_for_itself() -> None:
    """Two hypotheses share track 0; the second one holds track 1 too."""
    tracks = replace(
        tracks_with_past(np.stack([arc(3.0, 0.2)] * 2)), member=np.array([[True, False], [True, True]]),
        log_weight=np.log([0.5, 0.5]),
    )  # fmt: skip
    predictor = KinematicPredictor(noise=NOISE, draws=2)
    predictor.reset(replace(TASK, k=4))
    forecasts = predictor.predict(Frame(0, tracks, ()))
    row = forecasts.rows_of(tracks)
    assert (row[0, 0], row[1, 0], row[1, 1], forecasts.samples.shape) == (0, 1, 2, (3, 8, 10, 2))
    expected = predictor.futures(Frame(0, tracks, ()), np.zeros(4, dtype=np.int64), np.arange(4), 4)
    np.testing.assert_array_equal(forecasts.samples[:2].reshape(expected.shape), expected)
    np.testing.assert_array_equal(forecasts.samples[1], forecasts.samples[2])


def hedged(samples: int, past: int = 10) -> Floats:
    """Futures [samples, T, 2] of one track that is bent, of a hedged predictor."""
    predictor = HedgedPredictor()
    predictor.reset(replace(TASK, k=samples, samples=samples, past=past))
    return np.asarray(predictor.predict(Frame(0, tracks_with_past(arc(3.0, 1.0)[None]), ())).samples[0])


@pytest.mark.parametrize(("samples", "shares"), [(20, [5, 5, 5, 4]), (7, [2, 2, 1, 1]), (3, [1, 1]), (1, [1])])
def test_hedged_samples_are_shared_by_the_pasts(samples: int, shares: list[int]) -> None:
    futures = hedged(samples)
    assert len(futures) == samples
    still = (futures == arc(3.0, 1.0)[-1, :2]).all(axis=(1, 2))
    assert (still.tolist(), sum(shares)) == ([False] * (samples - 1) + [samples > 1], samples - (samples > 1))
    assert len(np.unique(futures[:, -1], axis=0)) == samples, "each past draws numbers of its own"


def test_pasts_are_cut_to_what_the_task_gives() -> None:
    assert len(np.unique(hedged(9, past=2)[:, -1], axis=0)) == 9


def test_a_shorter_past_is_the_past_cut_off() -> None:
    past = arc(3.0, 0.3)[None] + np.random.default_rng(2).normal(0, 0.05, (1, 10, 7))
    valid = np.ones((1, 10), dtype=bool)
    valid[0, :7] = False
    np.testing.assert_array_equal(predict(tracks_with_past(past), past=3), predict(tracks_with_past(past, valid)))
    np.testing.assert_array_equal(predict(tracks_with_past(past), past=10), predict(tracks_with_past(past)))


def test_noise_of_objects_that_never_change_their_motion() -> None:
    still = replace(NOISE, jerkiness=np.zeros((3, 2)), acceleration=np.zeros((3, 2)))
    past = arc(5.0, 0.0)[None]
    assert np.isfinite(predict(tracks_with_past(past), noise=still)).all()
    unseen = tracks_with_past(past, np.arange(10)[None] < 5)  # it coasts longer than the window that is read
    assert np.isfinite(predict(unseen, noise=still, past=2)).all()


def test_turning_the_world_turns_the_samples() -> None:
    rng = np.random.default_rng(4)
    past = np.stack([arc(4.0, 0.5), arc(1.0, -0.3, heading=-3.0)]) + rng.normal(0, 0.05, (2, 10, 7))
    yaw, shift = 2.5, np.array([100.0, -7.0, 1.0])
    moved = tracks_with_past(transform_boxes(past, yaw, shift))
    futures, other = (predict(tracks) for tracks in (tracks_with_past(past), moved))
    c, s = np.cos(yaw), np.sin(yaw)
    np.testing.assert_allclose(other, futures @ np.array([[c, s], [-s, c]]) + shift[:2], atol=1e-9)
