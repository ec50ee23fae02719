"""No simple rule tells false positives and duplicates of a simulated detector from detections of true objects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from mtp_bench.detector import Profile1
from mtp_bench.detector.sight import Sensor
from mtp_bench.detector.simulate import simulate
from mtp_bench.types import Bools, Detections, Floats, Ints, Truth
from tests.support.detector_scenes import grid_truth
from tests.support.model1_scenes import profile1

SENSOR = Sensor(reach=60.0, field_of_view=2 * np.pi)
CLASSES = ("car", "truck", "pedestrian")
SIZES = np.array([[4.5, 1.9, 1.6], [9.0, 2.5, 3.0], [0.9, 0.8, 1.75]])
FRAMES, OBJECTS = 120, 60
KIND = np.arange(OBJECTS) % 6  # half of the objects are cars, a third are trucks, the rest pedestrians
KIND = np.where(KIND < 3, 0, np.where(KIND < 5, 1, 2))


def _traffic() -> tuple[Truth, Floats]:
    """Objects on flat ground 1.7 m below the sensor, which drives slowly; half of them stand."""
    rng = np.random.default_rng(7)
    velocity = rng.normal(0, 1.0, (OBJECTS, 2)) * (np.arange(OBJECTS) % 2)[:, None]
    box = np.zeros((FRAMES, OBJECTS, 7))
    box[..., :2] = rng.uniform(-40, 40, (OBJECTS, 2)) + 0.5 * np.arange(FRAMES)[:, None, None] * velocity * 0.2
    box[..., 3] = rng.uniform(-np.pi, np.pi, OBJECTS)
    box[..., 4:] = SIZES[KIND] * rng.normal(1, 0.1, (OBJECTS, 3))
    box[..., 2] = box[..., 6] / 2 - 1.7
    ego = np.zeros((FRAMES, 4))
    ego[:, 0] = 0.1 * np.arange(FRAMES)
    return grid_truth(box, velocity, KIND), ego


def _simulated(profile: Profile1) -> Detections:
    return simulate(*_traffic(), CLASSES, profile, SENSOR, 4, profile.dt)


def _with(profile: Profile1, duplicates: float, false: bool) -> Profile1:
    """The profile with so many duplicates, and with as many false positives as in an average scene or none."""
    classes = {}
    for name, noise in profile.classes.items():
        assert noise.false_positives is not None
        law = noise.false_positives.model_copy(update={"dispersion": 1.0}) if false else None
        classes[name] = noise.model_copy(update={"duplicates": duplicates, "false_positives": law})
    return profile.model_copy(update={"classes": classes})


@dataclass(frozen=True)
class Seen:
    found: Detections
    false: Bools  # [R]

    @property
    def frame(self) -> Ints:
        return self.found.frame_of_rows

    @property
    def numbers(self) -> Floats:
        """All that a row says in numbers ``[R, 9]``: box, score, underside."""
        box = self.found.box
        return np.column_stack([box, self.found.score, box[:, 2] - box[:, 6] / 2])


def _told_apart(more: Detections, fewer: Detections) -> Seen:
    """Which rows of ``more`` are not in ``fewer``."""
    known = {row.tobytes() for row in fewer.box}
    return Seen(more, np.array([row.tobytes() not in known for row in more.box]))


@pytest.fixture(scope="module", params=["nuscenes_megvii", "nuscenes_centerpoint"])
def profile(request: pytest.FixtureRequest) -> Profile1:
    return profile1(request.param)


@pytest.fixture(scope="module")
def scene(profile: Profile1) -> Seen:
    seen = _told_apart(_simulated(_with(profile, 0.0, True)), _simulated(_with(profile, 0.0, False)))
    assert seen.false.sum() > 200
    return seen


@pytest.fixture(scope="module")
def doubled(profile: Profile1) -> Seen:
    seen = _told_apart(_simulated(_with(profile, 0.2, False)), _simulated(_with(profile, 0.0, False)))
    assert seen.false.sum() > 200
    return seen


def _repeated(seen: Seen, column: int) -> Bools:
    """Whether a row's number is exactly that of another row of the same or the previous frame ``[R]``."""
    frame, value = seen.frame, seen.numbers[:, column]
    again = np.zeros(len(value), dtype=bool)
    for t in range(FRAMES):
        here, near = frame == t, (frame == t) | (frame == t - 1)
        value_of, count = np.unique(value[near], return_counts=True)
        again[here] = np.isin(value[here], value_of[count > 1])
    return again


@pytest.mark.parametrize("column", range(9), ids=["x", "y", "z", "yaw", "l", "w", "h", "score", "underside"])
class TestNoNumberRepeats:
    """A real detector estimates every number anew. (The least size of a side may be hit twice.)"""

    def test_in_false_positives(self, column: int, scene: Seen) -> None:
        again = _repeated(scene, column)
        assert again[scene.false].mean() <= again[~scene.false].mean() + 0.002

    def test_in_duplicates(self, column: int, doubled: Seen) -> None:
        again = _repeated(doubled, column)
        assert again[doubled.false].mean() <= again[~doubled.false].mean() + 0.002
        vehicle = doubled.found.class_id < 2
        assert not again[vehicle].any()


def test_undersides_of_false_positives_scatter_as_those_of_true_objects(scene: Seen) -> None:
    vehicle = scene.found.class_id < 2
    underside = scene.numbers[:, 8]
    false, true = underside[vehicle & scene.false], underside[vehicle & ~scene.false]
    _, count = np.unique(np.round(false, 6), return_counts=True)
    assert count.max() <= 2
    assert np.std(false) == pytest.approx(np.std(true), rel=0.2)
    assert np.median(false) == pytest.approx(np.median(true), abs=0.03)


def test_classes_of_false_positives_are_those_of_true_objects(scene: Seen) -> None:
    false = scene.found.class_id[scene.false]
    assert set(false.tolist()) == {0, 1, 2}
    trucks = (false == 1).sum() / (false < 2).sum()
    assert trucks == pytest.approx(0.4, abs=0.12)  # as 20 of the 50 vehicles


@pytest.mark.parametrize("class_id", [0, 1])
def test_sizes_of_false_positives_are_those_of_true_objects_of_their_class(class_id: int, scene: Seen) -> None:
    size = scene.found.box[scene.false & (scene.found.class_id == class_id), 4:]
    np.testing.assert_allclose(np.median(size, axis=0), SIZES[class_id], rtol=0.12)


def test_all_scores_differ_and_none_is_at_the_floor(profile: Profile1) -> None:
    found = _simulated(_with(profile, 0.1, True))
    assert len(np.unique(found.score)) == len(found.score)
    for class_id, name in enumerate(CLASSES):
        score, law = found.score[found.class_id == class_id], profile.noise(name).score
        assert score.min() > law.floor
        assert law.ceiling is None or score.max() < law.ceiling


def test_a_false_positive_that_stays_is_estimated_anew(scene: Seen) -> None:
    """Followed over frames: a box within 1 m in the next frame, at another place to the last digit."""
    frame, box = scene.frame, scene.found.box
    rows = np.flatnonzero(scene.false)
    moved = []
    for row in rows:
        following = rows[frame[rows] == frame[row] + 1]
        off = np.hypot(*(box[following, :2] - box[row, :2]).T)
        moved += off[off < 1.0].tolist()
    assert len(moved) > 40
    assert min(moved) > 1e-6
    assert np.median(moved) > 0.03


def test_duplicates_err_on_their_own_beside_the_same_object(doubled: Seen) -> None:
    """In heading, size, height and velocity, as much as true detections differ from each other over frames."""
    frame, box = doubled.frame, doubled.found.box
    second = np.flatnonzero(doubled.false & (doubled.found.class_id < 2))
    differ, beside = [], []
    for row in second:
        others = np.flatnonzero((frame == frame[row]) & ~doubled.false)
        off = np.hypot(*(box[others, :2] - box[row, :2]).T)
        differ.append(box[row] - box[others[off.argmin()]])
        beside.append(off.min())
    assert np.median(beside) < 0.4
    spread = np.median(np.abs(np.array(differ)), axis=0)
    assert (spread[[2, 3, 4, 5, 6]] > 0.02).all()
    original = doubled.found.velocity
    assert len(np.unique(original[:, 0])) == len(original)
