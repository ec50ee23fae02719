"""The fitter recovers a known detector from what it made of synthetic truth; its text is read back as it was."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mtp_bench.detector import Profile, load_profile, profile_names
from mtp_bench.detector.fit import fit_profile
from mtp_bench.detector.fit.samples import collect
from mtp_bench.detector.profile import profile_text
from mtp_bench.detector.sight import Sensor
from mtp_bench.detector.simulate import simulate
from mtp_bench.errors import DataError
from mtp_bench.geometry import transform_boxes
from mtp_bench.types import Detections, Scene, Truth
from tests.support.detector_scenes import assert_alike, grid_truth, profile1
from tests.support.detector_statistics import ClassStatistics, detector_statistics

SENSOR = Sensor(reach=60.0, field_of_view=2 * np.pi)
CLASSES = ("car", "pedestrian")
DT = 0.1
FRAMES, SCENES, OBJECTS = 80, 6, 60


def a_truth(rng: np.random.Generator) -> Truth:
    """Objects at rest on a jittered grid of 9 m around the sensor, cars and pedestrians by turns."""
    cell = np.stack(np.meshgrid(np.arange(-4, 5), np.arange(-4, 5)), axis=-1).reshape(-1, 2)
    cell = rng.permutation(cell[(cell != 0).any(axis=1)])[:OBJECTS]
    kind = np.arange(OBJECTS) % 2
    box = np.zeros((OBJECTS, 7))
    box[:, :2] = 9.0 * cell + rng.uniform(-2, 2, size=(OBJECTS, 2))
    box[:, 3] = rng.uniform(-np.pi, np.pi, OBJECTS)
    box[:, 4:] = np.array([[4.0, 1.8, 1.5], [0.7, 0.7, 1.8]])[kind]
    box[:, 2] = box[:, 6] / 2
    return grid_truth(np.tile(box, (FRAMES, 1, 1)), np.zeros((OBJECTS, 2)), kind)


def empty_scenes() -> list[Scene]:
    rng = np.random.default_rng(5)
    nothing = Detections(np.zeros(FRAMES + 1, int), np.zeros((0, 7)), np.zeros((0, 2)), np.zeros(0, int), np.zeros(0))
    time, ego = DT * np.arange(FRAMES), np.zeros((FRAMES, 4))
    return [Scene(f"synthetic {i}", time, ego, a_truth(rng), nothing) for i in range(SCENES)]


def detected(scenes: list[Scene], profile: Profile, seed: int) -> list[Scene]:
    return [
        replace(one, detections=simulate(one.truth, one.ego, CLASSES, profile, SENSOR, 100 * seed + i, DT))
        for i, one in enumerate(scenes)
    ]


def fitted(scenes: list[Scene]) -> Profile:
    return fit_profile(scenes, CLASSES, DT, SENSOR, "refit", "a refit", "simulated detections")


@pytest.fixture(scope="module")
def original() -> Profile:
    shipped = profile1("kitti_pointrcnn")
    noise = {name: shipped.classes[name].model_copy(update={"velocity": 0.3}) for name in CLASSES}
    return shipped.model_copy(update={"classes": noise, "alike": {}})


@pytest.fixture(scope="module")
def scenes(original: Profile) -> list[Scene]:
    return detected(empty_scenes(), original, seed=1)


@pytest.fixture(scope="module")
def refit(scenes: list[Scene]) -> Profile:
    return fitted(scenes)


@pytest.fixture(scope="module")
def statistics(scenes: list[Scene], refit: Profile) -> tuple[dict[str, ClassStatistics], dict[str, ClassStatistics]]:
    """Of the original, and of the refit on the same truth with other random numbers."""
    again = detected(scenes, refit, seed=2)
    return detector_statistics(scenes, CLASSES, SENSOR), detector_statistics(again, CLASSES, SENSOR)


@pytest.mark.parametrize("name", CLASSES)
class TestRefit:
    """One class each; the truth has 30 objects of it in each of 6 scenes."""

    def test_statistics_come_back(
        self, name: str, statistics: tuple[dict[str, ClassStatistics], dict[str, ClassStatistics]]
    ) -> None:
        before, after = statistics[0][name], statistics[1][name]
        assert_alike(after, before)
        assert after.radial_scale == pytest.approx(before.radial_scale, rel=0.1)
        assert after.score_true == pytest.approx(before.score_true, rel=0.05)

    def test_undetected(self, name: str, original: Profile, refit: Profile) -> None:
        before, after = original.classes[name].miss, refit.classes[name].miss
        assert after.later[6] == pytest.approx(before.later[6], abs=0.3)
        assert after.later[1] == pytest.approx(before.later[1], abs=0.15)
        assert after.later[5] == 0.0  # nothing is truncated in a full circle
        assert after.first[1] == pytest.approx(before.first[1], abs=0.4)

    def test_position_errors(self, name: str, original: Profile, refit: Profile) -> None:
        for axis in ("radial", "tangential"):
            before, after = getattr(original.classes[name], axis), getattr(refit.classes[name], axis)
            for distance in (1.5, 3.0):
                scale = before.s0 + before.s1 * distance
                assert after.s0 + after.s1 * distance == pytest.approx(scale, rel=0.12)
            assert 1 / after.nu == pytest.approx(1 / before.nu, abs=0.05)
            assert after.bias + after.ar + after.white == pytest.approx(1.0, abs=1e-3)
            for lag in (1, 4):
                correlation = before.bias + before.ar * before.phi**lag
                assert after.bias + after.ar * after.phi**lag == pytest.approx(correlation, abs=0.08)

    def test_heading_size_height_score_and_velocity(self, name: str, original: Profile, refit: Profile) -> None:
        before, after = original.classes[name], refit.classes[name]
        assert after.heading.scale == pytest.approx(before.heading.scale, rel=0.05)
        assert after.heading.flip == pytest.approx(before.heading.flip, rel=0.25)
        assert after.heading.flip_again == pytest.approx(before.heading.flip_again, abs=0.1)
        assert after.size.deviation == pytest.approx(before.size.deviation, rel=0.15)
        assert after.size.white == pytest.approx(before.size.white, abs=0.06)
        assert after.z == pytest.approx(before.z, abs=0.01)
        assert after.velocity == pytest.approx(0.3, rel=0.05)
        assert after.score.deviation == pytest.approx(before.score.deviation, rel=0.15)
        assert after.score.floor == pytest.approx(before.score.floor, abs=0.01)
        assert after.score.ceiling is None

    def test_false_positives(self, name: str, refit: Profile, scenes: list[Scene]) -> None:
        false, counted = refit.classes[name].false_positives, detector_statistics(scenes, CLASSES, SENSOR)[name]
        law = profile1("kitti_pointrcnn").classes[name].false_positives
        assert false is not None
        assert law is not None
        assert false.rate <= counted.false_positives
        assert false.rate == pytest.approx(counted.false_positives, rel=0.2)
        assert false.survive == pytest.approx(law.survive, abs=0.1)
        assert false.size == pytest.approx({"car": (4.0, 1.8, 1.5), "pedestrian": (0.7, 0.7, 1.8)}[name], rel=0.1)
        assert false.distance[3:-1] == pytest.approx(law.distance[3:-1], rel=0.2)
        assert false.score_deviation == pytest.approx(law.score_deviation, rel=0.6)
        assert min(false.distance) >= 2.0


def test_what_is_fitted_does_not_depend_on_the_frame_of_reference(scenes: list[Scene]) -> None:
    here, there = fitted(scenes[:2]), fitted([_turned(one) for one in scenes[:2]])
    for name in CLASSES:
        before, after = here.classes[name], there.classes[name]
        assert after.miss == before.miss
        assert after.radial.s0 == pytest.approx(before.radial.s0, abs=2e-4)
        assert after.tangential.bias == pytest.approx(before.tangential.bias, abs=0.02)


def _turned(scene: Scene) -> Scene:
    """The scene turned by a quarter and shifted."""
    shift, turn = (100.0, -50.0, 0.0), np.pi / 2
    truth = replace(scene.truth, box=transform_boxes(scene.truth.box, turn, shift))
    found = replace(scene.detections, box=transform_boxes(scene.detections.box, turn, shift))
    return replace(scene, ego=np.tile([*shift, turn], (scene.frames, 1)), truth=truth, detections=found)


def test_the_floor_is_the_operating_point(scenes: list[Scene], refit: Profile) -> None:
    floor = {"car": 9.0, "pedestrian": 4.5}
    higher = fit_profile(scenes[:3], CLASSES, DT, SENSOR, "high", "", "", floor)
    for name in CLASSES:
        assert higher.classes[name].score.floor == floor[name]
        assert higher.classes[name].miss.later[0] > refit.classes[name].miss.later[0]


def test_a_class_with_too_little_data_is_left_out(scenes: list[Scene]) -> None:
    classes = (*CLASSES, "cyclist")
    assert list(fit_profile(scenes[:2], classes, DT, SENSOR, "two", "", "").classes) == list(CLASSES)
    with pytest.raises(DataError, match=r"car 0, pedestrian 0; expected at least 100 of one class"):
        fitted(empty_scenes()[:1])


def test_velocities_that_are_zero_everywhere_are_unknown(scenes: list[Scene]) -> None:
    still = [replace(one, detections=replace(one.detections, velocity=0 * one.detections.velocity)) for one in scenes]
    assert fitted(still[:1]).classes["car"].velocity is None
    assert fitted(scenes[:1]).classes["car"].velocity == pytest.approx(0.3, rel=0.05)


def test_a_perfect_detector_can_be_fitted() -> None:
    car = fitted(detected(empty_scenes()[:1], profile1("clean"), seed=0)).classes["car"]
    assert car.radial.s0 + car.radial.s1 < 0.002
    assert (car.heading.scale, car.heading.flip, car.z) == (0.0, 0.0, (0.0, 0.0))
    assert car.false_positives is None
    assert max(car.miss.first[0], car.miss.later[0]) < -2.0


def test_known_visibility_is_used(scenes: list[Scene]) -> None:
    hidden = replace(scenes[0], visible=np.zeros(len(scenes[0].truth.box)))
    assert (collect([hidden], CLASSES, SENSOR)["car"][0].feature[:, 4] == 1).all()
    assert not (collect(scenes[:1], CLASSES, SENSOR)["car"][0].feature[:, 4] == 1).all()


def test_text_is_read_back_equal(refit: Profile, tmp_path: Path) -> None:
    names = {"truck": "car", 'a "quoted" one': "car"}
    odd = refit.classes["car"].model_copy(update={"velocity": None, "false_positives": None})
    odd = odd.model_copy(update={"miss": odd.miss.model_copy(update={"memory": False})})
    changed = refit.model_copy(
        update={"classes": {**refit.classes, "e-scooter": odd}, "alike": names, "summary": 'naïve "x" \\ y'}
    )
    for profile in (refit, changed, *map(load_profile, profile_names(1))):
        path = tmp_path / "profile.toml"
        path.write_text(profile_text(profile), encoding="utf-8")
        assert load_profile(str(path)) == profile


def test_text_is_rounded_and_explained(refit: Profile) -> None:
    text = profile_text(refit)
    assert re.search(r"\d\.\d{3,}", text)
    assert not re.search(r"\d\.\d{5,}", text)
    assert "# the same, and: undetected in the frame before" in text
