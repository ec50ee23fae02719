"""False positives: rate, dispersion, places, sizes and classes; no simple rule shows that they are false."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mtp_bench.core import Bools, Detections, Floats, Truth
from mtp_bench.detector import load_profile
from mtp_bench.detector.simulation import simulate
from mtp_bench.detector.visibility import Sensor
from tests.support.detector_scenes import AHEAD, DT, FREE, cars, detect, grid_truth, profile_of, truth_of

MEGVII = load_profile("nuscenes_megvii")


def in_empty_scene(frames: int = 2000, seed: int = 0, view: float = 90.0, **free: Any) -> Detections:
    profile = profile_of(free={**FREE, **free}).model_copy(update={"field_of_view": view})
    return detect(cars(frames, 0), profile, seed, sensor=AHEAD)


@pytest.mark.parametrize(("view", "dispersion", "rate", "expected"), [
    pytest.param(90.0, 1.0, 3.0, 1.0, id="scenes alike"), pytest.param(90.0, 2.5, 3.0, 2.5, id="scenes that differ"),
    pytest.param(45.0, 2.0, 6.0, 3.0, id="a sensor that covers more of the circle than the fitted one"),
])  # fmt: skip
def test_rates_and_dispersion_of_the_profile(view: float, dispersion: float, rate: float, expected: float) -> None:
    scenes = [in_empty_scene(10, seed, view, dispersion=dispersion) for seed in range(200)]
    count = np.diff([scene.start for scene in scenes], axis=1)
    assert count.mean() == pytest.approx(rate, rel=0.1)
    assert count[:, 0].mean() == pytest.approx(rate, rel=0.2), "in equilibrium from the first frame on"
    assert count.var() / count.mean() == pytest.approx(expected, rel=0.25)


def test_places_have_the_distances_of_the_profile_and_even_bearings_and_headings() -> None:
    quantiles = (3.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0, 22.0, 24.0, 30.0, 55.0)
    box = in_empty_scene(survive=0.0, distance=quantiles).box
    distance, bearing = np.hypot(box[:, 0], box[:, 1]), np.arctan2(box[:, 1], box[:, 0])
    tenths = np.linspace(0.1, 0.9, 9)
    np.testing.assert_allclose(np.quantile(distance, np.linspace(0, 1, 11)), quantiles, atol=0.7)
    np.testing.assert_allclose(np.quantile(bearing, tenths), (tenths - 0.5) * np.pi / 2, atol=0.04)
    np.testing.assert_allclose(np.quantile(box[:, 3], tenths), (tenths - 0.5) * 2 * np.pi, atol=0.15)
    np.testing.assert_allclose(box[:, 4:].mean(0), [4.0, 1.8, 1.5], rtol=0.01)
    np.testing.assert_allclose(box[:, 4:].std(0), [0.4, 0.18, 0.15], rtol=0.05)
    np.testing.assert_allclose(box[:, 2], box[:, 6] / 2)  # on the ground at the ego's feet


def test_places_are_inside_the_area_of_the_sensor() -> None:
    profile = profile_of(free=FREE)
    box = detect(cars(500, 0), profile, sensor=Sensor(60.0, 2 * np.pi, (-10.0, -5.0, 20.0, 30.0))).box
    assert len(box) > 500
    assert ((box[:, :2] >= [-10.0, -5.0]) & (box[:, :2] <= [20.0, 30.0])).all()


def test_boxes_stand_still_while_the_sensor_drives_past_and_none_born_out_of_reach_appears() -> None:
    ego = np.zeros((400, 4))
    ego[:, 0] = np.arange(400) * 2.0
    for distance, expected in (((3.0,) + (50.0,) * 10, True), ((80.0,) * 11, False)):
        profile = profile_of(free={**FREE, "distance": distance})
        found = simulate(cars(400, 0), ego, ("car",), profile, AHEAD, 0, DT)
        assert (len(found.box) > 0) == expected
        ahead = found.box[:, :2] - ego[found.frame_of_rows, :2]
        assert (np.hypot(*ahead.T) <= 60.0).all()
        assert (np.abs(np.arctan2(ahead[:, 1], ahead[:, 0])) <= np.pi / 4).all()
        assert not expected or len(np.unique(found.box[:, 0])) < len(found.box) / 1.5


def test_boxes_stand_on_the_ground_of_the_true_ones() -> None:
    truth = truth_of(np.zeros(3, int), np.arange(3), np.tile([5.0, 0, -1.0, 0, 4.0, 2.0, 1.4], (3, 1)), frames=200)
    found = detect(truth, profile_of(free=FREE), sensor=AHEAD)
    np.testing.assert_allclose((found.box[:, 2] - found.box[:, 6] / 2), -1.7)


def test_classes_of_one_noise_share_its_false_positives_as_their_true_boxes() -> None:
    box = np.tile([500.0, 0.0, 1.5, 0.0, 9.0, 2.5, 3.0], (4, 1))  # out of reach: only their number matters
    truth = replace(truth_of(np.zeros(4, int), np.arange(4), box, frames=600), class_id=np.array([0, 0, 0, 2]))
    found = simulate(truth, np.zeros((600, 4)), ("truck", "car", "bus", "pedestrian"), MEGVII, AHEAD, 3, 0.5)
    vehicle = found.class_id[found.class_id < 3]
    assert len(vehicle) > 50
    assert ((vehicle == 0).mean(), (vehicle == 1).sum()) == (pytest.approx(0.75, abs=0.12), 0)
    assert (found.class_id == 3).sum() > 50, "there is no pedestrian: the class itself"
    np.testing.assert_allclose(np.median(found.box[found.class_id == 0, 4:], axis=0), [9.0, 2.5, 3.0], rtol=0.1)
    for classes, expected in ((("truck", "car", "pedestrian"), {1, 2}), (("truck", "bus"), {0})):
        found = simulate(cars(200, 0), np.zeros((200, 4)), classes, MEGVII, AHEAD, 0, 0.5)
        assert set(found.class_id.tolist()) == expected


SIZES = np.array([[4.5, 1.9, 1.6], [9.0, 2.5, 3.0], [0.9, 0.8, 1.75]])
FRAMES, OBJECTS = 120, 60


def flat_traffic() -> tuple[Truth, Floats]:
    """Objects on flat ground 1.7 m below the sensor, which drives slowly; half of them stand."""
    rng = np.random.default_rng(7)
    kind = np.array([0, 0, 0, 1, 1, 2])[np.arange(OBJECTS) % 6]
    velocity = rng.normal(0, 1.0, (OBJECTS, 2)) * (np.arange(OBJECTS) % 2)[:, None]
    box = np.zeros((FRAMES, OBJECTS, 7))
    box[..., :2] = rng.uniform(-40, 40, (OBJECTS, 2)) + 0.1 * np.arange(FRAMES)[:, None, None] * velocity
    box[..., 3] = rng.uniform(-np.pi, np.pi, OBJECTS)
    box[..., 4:] = SIZES[kind] * rng.normal(1, 0.1, (OBJECTS, 3))
    box[..., 2] = box[..., 6] / 2 - 1.7
    ego = np.zeros((FRAMES, 4))
    ego[:, 0] = 0.1 * np.arange(FRAMES)
    return grid_truth(box, velocity, kind), ego


@pytest.fixture(scope="module")
def labelled() -> tuple[Detections, Bools]:
    runs = []
    for parts in ({}, {"free": None, "near": None}):
        classes = {name: noise.model_copy(update=parts) for name, noise in MEGVII.classes.items()}
        profile = MEGVII.model_copy(update={"classes": classes})
        classes_of_task = ("car", "truck", "pedestrian")
        runs.append(simulate(*flat_traffic(), classes_of_task, profile, Sensor(60.0, 2 * np.pi), 4, MEGVII.dt))
    true = {row.tobytes() for row in runs[1].box}
    false = np.array([row.tobytes() not in true for row in runs[0].box])
    assert false.sum() > 200
    return runs[0], false


def repeated(found: Detections, value: Floats) -> Bools:
    """Mask of values that another row of the same or the previous frame has exactly."""
    frame = found.frame_of_rows
    again = np.zeros(len(value), dtype=bool)
    for t in range(FRAMES):
        now, near = frame == t, (frame == t) | (frame == t - 1)
        values, count = np.unique(value[near], return_counts=True)
        again[now] = np.isin(value[now], values[count > 1])
    return again


def test_false_positives_repeat_no_number_more_often_than_objects(labelled: tuple[Detections, Bools]) -> None:
    """A real detector estimates every number anew. (The least size of a side can occur twice.)"""
    found, false = labelled
    columns = [*found.box.T, found.box[:, 2] - found.box[:, 6] / 2, *found.velocity.T]
    for column in columns:
        again = repeated(found, column)
        assert again[false].mean() <= again[~false].mean() + 0.002


def test_undersides_and_classes_of_false_positives_are_those_of_objects(labelled: tuple[Detections, Bools]) -> None:
    found, false = labelled
    vehicle, underside = found.class_id < 2, found.box[:, 2] - found.box[:, 6] / 2
    assert np.std(underside[vehicle & false]) == pytest.approx(np.std(underside[vehicle & ~false]), rel=0.25)
    assert np.median(underside[vehicle & false]) == pytest.approx(np.median(underside[vehicle & ~false]), abs=0.04)
    assert set(found.class_id[false].tolist()) == {0, 1, 2}
