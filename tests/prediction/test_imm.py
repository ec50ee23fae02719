"""The IMM predictor: its filter against full matrices, its samples against the mixture they come from, its noise."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from mtp_bench import Pipeline
from mtp_bench.errors import ShapeError, UnknownNameError
from mtp_bench.geometry import transform_boxes
from mtp_bench.prediction import ImmNoise, ImmPredictor, KinematicPredictor, KMeansSampler, stored_imm_noise
from mtp_bench.prediction.imm import mixture
from mtp_bench.prediction.kalman import heading_frame
from mtp_bench.tracking import HypothesisTracker
from mtp_bench.tracks import Tracks
from mtp_bench.types import Bools, Floats
from tests.support.tracking_scenes import SIZE, at_once, frame, kitti_task, observation, tracks_with_past

DT = 0.1
TASK = kitti_task(dt=DT, seed=5)
NOISE = ImmNoise(
    measurement=np.array([0.1, 0.05, 0.2]),
    speed=np.array([[5.0, 0.5], [1.0, 1.0], [3.0, 0.2]]),
    jerkiness=np.array([[[0.1, 0.1], [1.5, 0.5], [3.0, 1.0]]] * 3),
    acceleration=np.array([[[0.1, 0.1], [1.0, 0.5], [2.0, 1.0]]] * 3),
    stay=np.array([0.9, 0.8, 0.95]),
)


def predict(tracks: Tracks, samples: int = 20, draw: Any = None, leaf: Any = None, **settings: Any) -> Floats:
    """Futures [Q, samples, T, 2] of a new predictor."""
    predictor = ImmPredictor(**{"noise": NOISE, **settings})
    predictor.reset(TASK)
    predictor.begin(tracks)
    leaf = np.arange(len(tracks.box)) if leaf is None else np.array(leaf)
    draw = np.zeros(len(leaf), dtype=np.int64) if draw is None else np.array(draw)
    return predictor.sample(tracks, leaf, draw, samples)


def walks(n: int, seed: int = 0) -> Tracks:
    """Tracks with rough pasts and gaps."""
    rng = np.random.default_rng(seed)
    past = np.zeros((n, 10, 7))
    past[:, :, :2] = 20 + np.cumsum(0.5 + 0.2 * rng.normal(size=(n, 10, 2)), axis=1)
    past[:, :, 3] = rng.uniform(-3, 3, (n, 1))
    past[:, :, 4:] = SIZE[0]
    valid = rng.random((n, 10)) < 0.8
    valid[:, -1] = True
    return tracks_with_past(past, valid, rng.integers(0, 3, n))


def textbook(position: Floats, valid: Bools, c: int) -> tuple[Floats, Floats, Floats]:
    """Means [3, 2, 3], covariances [3, 2, 3, 3] and probabilities [3] of one track, model by model and axis by axis."""
    move = [np.array([[1, DT, 0], [0, 1, 0], [0, 0, 0]])] * 2 + [np.array([[1, DT, DT**2 / 2], [0, 1, DT], [0, 0, 1]])]
    acceleration, jerk = np.zeros((3, 3)), np.zeros((3, 3))
    nodes, weights = np.polynomial.legendre.leggauss(8)
    for u, w in zip(DT * (nodes + 1) / 2, DT * weights / 2, strict=True):  # white noise that comes in u before the end
        acceleration += w * np.outer([u, 1, 0], [u, 1, 0])
        jerk += w * np.outer([u**2 / 2, u, 1], [u**2 / 2, u, 1])
    first = int(np.argmax(valid))
    mean, cov, mu = np.zeros((3, 2, 3)), np.zeros((3, 2, 3, 3)), np.full(3, 1 / 3)
    for m in range(3):
        for a in range(2):
            mean[m, a, 0] = position[first, a]
            cov[m, a] = np.diag([NOISE.measurement[c] ** 2, NOISE.speed[c, a] ** 2, NOISE.acceleration[c, m, a] ** 2])
    change = np.full((3, 3), (1 - NOISE.stay[c]) / 2)
    np.fill_diagonal(change, NOISE.stay[c])
    for z, seen in zip(position[first + 1 :], valid[first + 1 :], strict=True):
        ahead = change.T @ mu
        new_mean, new_cov, log_likelihood = np.zeros_like(mean), np.zeros_like(cov), np.zeros(3)
        for m in range(3):
            share = change[:, m] * mu / ahead[m]
            for a in range(2):
                center = share @ mean[:, a]
                spread = sum(
                    share[i] * (cov[i, a] + np.outer(mean[i, a] - center, mean[i, a] - center)) for i in range(3)
                )
                q = NOISE.jerkiness[c, m, a] ** 2 * (jerk if m == 2 else acceleration)
                if m < 2:
                    q[2, 2] = NOISE.acceleration[c, m, a] ** 2
                x, p = move[m] @ center, move[m] @ spread @ move[m].T + q
                if seen:
                    s = p[0, 0] + NOISE.measurement[c] ** 2
                    log_likelihood[m] += -0.5 * ((z[a] - x[0]) ** 2 / s + np.log(s))
                    gain = p[:, 0] / s
                    x, p = x + gain * (z[a] - x[0]), p - np.outer(gain, p[0])
                new_mean[m, a], new_cov[m, a] = x, p
        mean, cov = new_mean, new_cov
        mu = ahead * np.exp(log_likelihood)
        mu /= mu.sum()
    return mean, cov, mu


def test_the_filter_is_the_textbook_filter() -> None:
    tracks = walks(30)
    tracks.past_valid[:5, :7] = False  # young ones
    position = heading_frame(tracks.past, tracks.box[:, 3])
    state = mixture(position, tracks.past_valid, tracks.class_id, NOISE, DT)
    for n in range(30):
        mean, cov, mu = textbook(position[n], tracks.past_valid[n], int(tracks.class_id[n]))
        np.testing.assert_allclose(state.mean[:, n], mean, atol=1e-8)
        np.testing.assert_allclose(state.covariance[:, n], cov, atol=1e-8)
        np.testing.assert_allclose(state.probability[:, n], mu, atol=1e-8)


def steady(acceleration: float) -> Tracks:
    """A car along a slanted line, from standing where it accelerates."""
    t = DT * np.arange(-9, 1)
    past = np.zeros((1, 10, 7))
    length = 10 * t + acceleration * (t + 1) ** 2 / 2
    past[0, :, 0], past[0, :, 1] = 30 + 0.6 * length, -20 + 0.8 * length
    past[0, :, 3] = np.arctan2(0.8, 0.6)
    return tracks_with_past(past)


@pytest.mark.parametrize(("acceleration", "model"), [(0.0, 0), (8.0, 2)])
def test_the_model_that_fits_is_the_likeliest(acceleration: float, model: int) -> None:
    tracks = steady(acceleration)
    sharp = replace(NOISE, measurement=np.full(3, 0.01), jerkiness=NOISE.jerkiness * [[1.0], [1.0], [0.1]])
    position = heading_frame(tracks.past, tracks.box[:, 3])
    state = mixture(position, tracks.past_valid, tracks.class_id, sharp, DT)
    assert state.probability[:, 0].argmax() == model
    tau = DT * np.arange(1, 11)
    length = (10 + acceleration) * tau + acceleration * tau**2 / 2
    expected = tracks.past[0, -1, :2] + length[:, None] * [0.6, 0.8]
    np.testing.assert_allclose(predict(tracks, 1, noise=sharp)[0, 0], expected, atol=0.6)


def test_samples_come_from_the_mixture() -> None:
    tracks = walks(4)
    many = predict(tracks, 40_000)
    np.testing.assert_allclose(many.mean(axis=1), predict(tracks, 1)[:, 0], atol=0.03)
    state = mixture(heading_frame(tracks.past, tracks.box[:, 3]), tracks.past_valid, tracks.class_id, NOISE, DT)
    weight = state.probability[..., None]
    center = (weight * state.mean[..., 0]).sum(axis=0)
    variance = (weight * (state.covariance[..., 0, 0] + state.mean[..., 0] ** 2)).sum(axis=0) - center**2
    still = ImmPredictor(NOISE)
    still.reset(replace(TASK, dt=1e-9))
    still._state, still._factor, still._frame = state, np.linalg.cholesky(state.covariance), 1
    drawn = still.sample(tracks, np.arange(4), np.zeros(4, dtype=np.int64), 40_000)[:, :, 0]
    # The sum of the variances along both axes does not know the heading.
    np.testing.assert_allclose(drawn.var(axis=1).sum(axis=-1), variance.sum(axis=-1), rtol=0.03)


def test_every_model_is_drawn_as_often_as_it_is_likely() -> None:
    tracks = walks(20)
    predictor = ImmPredictor(replace(NOISE, speed=np.full((3, 2), 1e-3), acceleration=np.full((3, 3, 2), 1e-3)))
    predictor.reset(TASK)
    predictor.begin(tracks)
    probability = predictor._state.probability
    predictor._state = replace(
        predictor._state, mean=predictor._state.mean * 0 + 1e4 * np.arange(3)[:, None, None, None]
    )
    far = predictor._drawn(np.arange(20), np.arange(20) % 3, 20)[:, :, 0, 0]
    counts = np.stack([(np.abs(far - 1e4 * m) < 5e3).sum(axis=1) for m in range(3)])
    assert (np.abs(counts - 20 * probability) < 1 + 1e-9).all()


def test_equal_draws_are_equal_numbers_whoever_asks() -> None:
    tracks = walks(6)
    whole = predict(tracks, draw=[0, 1, 2, 0, 1, 2])
    part = predict(tracks, draw=[2, 0], leaf=[5, 3])
    np.testing.assert_array_equal(part, whole[[5, 3]])
    assert not np.allclose(predict(tracks, draw=[1] * 6)[0], whole[0])


def test_its_draws_are_those_of_nobody_else(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither of the sampler of a pipeline nor of a kinematic predictor beside it (`HedgedPredictor`)."""
    tracks, leaf = walks(4), np.arange(4)
    made = np.random.default_rng
    streams: list[set[tuple[int, ...]]] = []

    def noted(seed: Any = None) -> np.random.Generator:
        streams[-1].add(tuple(seed))
        return made(seed)

    monkeypatch.setattr(np.random, "default_rng", noted)
    for predictor in (ImmPredictor(NOISE), KinematicPredictor()):
        streams.append(set())
        predictor.reset(TASK)
        predictor.begin(tracks)
        predictor.sample(tracks, leaf, leaf, 20)
    streams.append(set())
    agent = Pipeline(HypothesisTracker(2, parameters=at_once()), ImmPredictor(NOISE), KMeansSampler())
    agent.reset(TASK)
    monkeypatch.setattr(ImmPredictor, "_drawn", lambda self, leaf, draw, samples: np.zeros((len(leaf), samples, 2, 3)))
    agent.act(observation(frame((0.0, 0.0, 0), (9.0, 0.0, 0))))
    assert all(streams)
    assert len(set().union(*streams)) == sum(map(len, streams))


def test_it_turns_with_the_world() -> None:
    tracks = walks(6)
    turned = transform_boxes(tracks.past.reshape(-1, 7), 0.7, np.array([5.0, -3.0, 0.0])).reshape(tracks.past.shape)
    moved = replace(tracks, past=turned, box=turned[:, -1].copy())
    future = predict(tracks)
    flat = np.zeros((future[..., 0].size, 7))
    flat[:, :2] = future.reshape(-1, 2)
    expected = transform_boxes(flat, 0.7, np.array([5.0, -3.0, 0.0]))[:, :2].reshape(future.shape)
    np.testing.assert_allclose(predict(moved), expected, atol=1e-8)


def test_shapes_and_wrong_settings() -> None:
    tracks = walks(3)
    assert predict(tracks, 7).shape == (3, 7, 10, 2)
    assert predict(tracks, 7, leaf=[]).shape == (0, 7, 10, 2)
    assert predict(walks(0), 7).shape == (0, 7, 10, 2)
    assert np.isfinite(predict(tracks, past=1)).all()
    with pytest.raises(ShapeError, match="past"):
        ImmPredictor(past=0)


def test_a_track_that_was_never_detected() -> None:
    tracks = walks(2)
    tracks.past_valid[0] = False
    assert np.isfinite(predict(tracks)).all()


@pytest.mark.parametrize("observe", ["detections", "truth"])
def test_stored_noise(observe: str) -> None:
    noise = stored_imm_noise(kitti_task(motion_noise="KITTI", observe=observe))
    for field, shape in zip(fields(ImmNoise), [(3,), (3, 2), (3, 3, 2), (3, 3, 2), (3,)], strict=True):
        values = getattr(noise, field.name)
        assert values.shape == shape
        assert (values > 0).all()
    assert (noise.stay < 1).all()


def test_no_stored_noise() -> None:
    with pytest.raises(UnknownNameError, match="motion noise"):
        stored_imm_noise(kitti_task(motion_noise="KITTI", classes=("pedestrain",)))


NO_NOISE = {
    "measurement": (0.0, "noise.measurement holds 0.0, expected numbers above 0"),
    "speed": (0.0, "noise.speed holds 0.0, expected numbers above 0"),
    "jerkiness": (-1.0, "noise.jerkiness holds -1.0, expected numbers >= 0"),
    "acceleration": (np.nan, r"noise.acceleration\[0, 0, 0\] is nan, expected a finite number"),
    "stay": (1.5, "noise.stay holds 1.5, expected probabilities"),
}


@pytest.mark.parametrize("name", NO_NOISE)
def test_noise_that_no_motion_has_is_one_clear_error(name: str) -> None:
    value, message = NO_NOISE[name]
    with pytest.raises(ShapeError, match=message):
        ImmPredictor(replace(NOISE, **{name: np.full_like(getattr(NOISE, name), value)}))


def test_noise_of_another_form_is_one_clear_error() -> None:
    with pytest.raises(ShapeError, match=r"noise.jerkiness has shape \(3, 2\), expected \(3, 3, 2\)"):
        ImmPredictor(replace(NOISE, jerkiness=NOISE.speed))


def test_noise_of_another_task() -> None:
    with pytest.raises(ShapeError, match="got noise of 3 classes, test has 1"):
        ImmPredictor(NOISE).reset(kitti_task(classes=("car",)))
