"""Controls that guess: futures of near neighbours among the samples, and bends to the left and right."""

from types import ModuleType

import numpy as np
import pytest

from mtp_bench import load_submission
from mtp_bench.agent import Forecasts, Frame
from mtp_bench.agent.submission_files import import_from
from mtp_bench.core import Action, Floats, Observation, Task
from mtp_bench.core.tracks import Tracks
from mtp_bench.prediction import KinematicPredictor
from tests.support.tracking_scenes import CAR, PEDESTRIAN, frame, kitti_task, observation, tracks_with_past

TASK = kitti_task(seed=5)
FAR = 50.0  # m
Place = tuple[float, float, int]  # x, y and class


def code_of(name: str) -> ModuleType:
    return import_from(load_submission(name).path, "agent", name)


def tracks_at(*places: Place, speed: float = 8.0) -> Tracks:
    """Tracks that end at these places, of cars and pedestrians that move along y."""
    box, class_id = frame(*places)
    box[:, 3] = np.pi / 2
    past = np.repeat(box[:, None], TASK.past, axis=1)
    past[:, :, 1] += speed * TASK.dt * np.arange(1 - TASK.past, 1)
    return tracks_with_past(past, class_id=class_id)


def kinematic(tracks: Tracks, draws: int = 1, task: Task = TASK) -> Floats:
    predictor = KinematicPredictor(draws=draws)
    predictor.reset(task)
    return predictor.predict(Frame(0, tracks, ())).samples


def with_neighbours(tracks: Tracks, draws: int = 20, task: Task = TASK) -> Forecasts:
    predictor = code_of("stp_neighbours").NeighbourPredictor(draws)
    predictor.reset(task)
    forecasts = predictor.predict(Frame(0, tracks, ()))
    assert isinstance(forecasts, Forecasts)
    return forecasts


NEIGHBOURS: dict[str, tuple[list[Place], list[int | None]]] = {
    "near": ([(0, 0, CAR), (2.9, 0, CAR)], [1, 0]),
    "at the limit": ([(0, 0, CAR), (3.0, 0, CAR)], [1, 0]),
    "too far": ([(0, 0, CAR), (3.1, 0, CAR)], [None, None]),
    "another class": ([(0, 0, CAR), (1.0, 0, PEDESTRIAN)], [None, None]),
    "the nearest of two": ([(0, 0, CAR), (-2.0, 0, CAR), (1.5, 0, CAR)], [2, 0, 0]),
    "a nearer one of another class": ([(0, 0, CAR), (1.0, 0, PEDESTRIAN), (2.0, 0, CAR)], [2, None, 0]),
    "one place": ([(0, 0, CAR), (0, 0, CAR)], [1, 0]),
    "alone": ([(0, 0, CAR)], [None]),
    "no track": ([], []),
}


@pytest.mark.parametrize(("places", "expected"), NEIGHBOURS.values(), ids=NEIGHBOURS)
def test_every_third_sample_is_the_future_of_the_nearest_neighbour(
    places: list[Place], expected: list[int | None]
) -> None:
    tracks = tracks_at(*places)
    own, forecasts = kinematic(tracks, draws=20), with_neighbours(tracks)
    assert forecasts.samples.shape == own.shape == (len(places), 20 * TASK.k, TASK.future, 2)
    assert forecasts.log_weight is None, "all samples weigh the same"
    third = np.arange(20 * TASK.k) % 3 == 2
    assert third.sum() == 133
    for samples, before, neighbour in zip(forecasts.samples, own, expected, strict=True):
        np.testing.assert_array_equal(samples[~third], before[~third])
        source = before if neighbour is None else own[neighbour]
        np.testing.assert_array_equal(samples[third], source[third])


def frames_of_two_cars(gap: float) -> list[Observation]:
    return [observation(frame((0.0, 0.8 * t, CAR), (gap, 0.8 * t, CAR))) for t in range(6)]


def actions(name: str, frames: list[Observation]) -> list[Action]:
    agent = load_submission(name).build(TASK)
    agent.reset(TASK)
    return [agent.act(each) for each in frames]


def test_without_a_neighbour_it_answers_as_stp_same_samples() -> None:
    alone = frames_of_two_cars(FAR)
    for answer, expected in zip(actions("stp_neighbours", alone), actions("stp_same_samples", alone), strict=True):
        for key, value in expected.items():
            np.testing.assert_array_equal(answer[key], value)


def test_with_a_neighbour_k_samples_remain_and_some_of_them_end_where_it_ends() -> None:
    last = actions("stp_neighbours", frames_of_two_cars(2.5))[-1]
    control = actions("stp_same_samples", frames_of_two_cars(2.5))[-1]
    rows = np.flatnonzero(last["object_valid"])
    assert len(rows) == 2
    for key in ("object_box", "object_confidence", "track_id"):
        np.testing.assert_array_equal(last[key], control[key])
    aside = np.abs(last["forecast"][rows, :, :, 0]).max(axis=2)  # m, of each sample
    weight = np.exp(last["forecast_log_weight"][rows])
    assert (weight > 0).sum(axis=1).tolist() == [TASK.k, TASK.k]
    np.testing.assert_allclose((weight * (aside > 2.0)).sum(axis=1), 133 / 400, atol=0.03)
    assert np.abs(control["forecast"][rows, :, :, 0]).max() < 2.0


def bent(tracks: Tracks, task: Task) -> Floats:
    predictor = code_of("stp_bends").BendPredictor()
    predictor.reset(task)
    forecasts = predictor.predict(Frame(0, tracks, ()))
    assert forecasts.log_weight is None, "all samples weigh the same"
    return np.asarray(forecasts.samples)


def steps_of(samples: Floats, tracks: Tracks) -> Floats:
    """Steps [N, S, T, 2] of samples, the first one from the place of now."""
    now = np.broadcast_to(tracks.past[:, None, -1:, :2], (*samples.shape[:2], 1, 2))
    return np.diff(samples, axis=2, prepend=now)


@pytest.mark.parametrize(("k", "count"), [(1, 0), (4, 2), (10, 4), (20, 8)])
def test_four_of_ten_samples_bend_left_and_right_and_the_others_are_those_of_stp(k: int, count: int) -> None:
    task = kitti_task(seed=5, k=k, samples=k)
    tracks = tracks_at((0, 0, CAR), (FAR, 0, PEDESTRIAN))
    straight, samples = kinematic(tracks, task=task), bent(tracks, task)
    assert samples.shape == (2, k, task.future, 2)
    np.testing.assert_allclose(samples[:, : k - count], straight[:, : k - count], atol=1e-12)
    before, after = (steps_of(each, tracks)[:, k - count :] for each in (straight, samples))
    length, bent_length = (np.linalg.norm(steps, axis=-1) for steps in (before, after))
    np.testing.assert_allclose(bent_length, length, atol=1e-9, err_msg="bends keep the speed")
    complex_before, complex_after = (steps[..., 0] + 1j * steps[..., 1] for steps in (before, after))
    angle = np.angle(complex_after / complex_before)  # rad, of each step
    middle = task.dt * (np.arange(task.future) + 0.5)  # s
    rates = np.resize(code_of("stp_bends").TURN_RATES, count)
    np.testing.assert_allclose(angle, np.broadcast_to(rates[:, None] * middle, angle.shape), atol=1e-9)


def test_turn_rates_are_as_many_to_the_left_as_to_the_right() -> None:
    rates = code_of("stp_bends").TURN_RATES
    assert sorted(rates) == sorted(-rate for rate in rates)
    assert len(set(rates)) == len(rates) == 4


def test_bends_do_not_depend_on_the_past() -> None:
    """A car that has turned and one that drove straight are bent by the same angles."""
    angles = []
    for turn in (0.0, 0.4):
        tracks = tracks_at((0, 0, CAR))
        tracks.past[0, :, 0] = 30 * (1 - np.cos(turn * TASK.dt * np.arange(1 - TASK.past, 1)))
        straight, samples = (steps_of(each, tracks) for each in (kinematic(tracks), bent(tracks, TASK)))
        ratio = (samples[..., 0] + 1j * samples[..., 1]) / (straight[..., 0] + 1j * straight[..., 1])
        angles.append(np.angle(ratio))
    np.testing.assert_allclose(angles[0], angles[1], atol=1e-9)


@pytest.mark.parametrize("name", ["stp_neighbours", "stp_bends"])
def test_a_frame_without_detections_has_an_empty_answer(name: str) -> None:
    (answer,) = actions(name, [observation(frame())])
    assert not answer["object_valid"].any()
