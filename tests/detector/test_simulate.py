"""The simulated detector as a whole: determinism, order of rows, rigid motions, scenes without noise or objects."""

import hashlib

import numpy as np
import pytest

from mtp_bench.core import Detections, Floats, Truth
from mtp_bench.core.geometry import transform_boxes
from mtp_bench.detector import Profile, load_profile, profile_names
from mtp_bench.detector.simulation import simulate
from mtp_bench.detector.visibility import Sensor, covered
from tests.support.detector_scenes import cars, traffic

SENSOR = Sensor(reach=50.0, field_of_view=np.pi)
TRAFFIC = ("car", "truck", "pedestrian")
DT = 0.1
MEGVII = load_profile("nuscenes_megvii")


def simulated(profile: Profile, seed: int = 0, scene: tuple[Truth, Floats] | None = None) -> Detections:
    return simulate(*(scene or traffic()), TRAFFIC, profile, SENSOR, seed, DT)


@pytest.mark.parametrize("name", [name for name in profile_names() if name != "wildtrack_mvdet"])  # people only
def test_equal_arguments_give_equal_detections_and_another_seed_others(name: str) -> None:
    first, again, other = (vars(simulated(load_profile(name), seed)) for seed in (3, 3, 4))
    for detections, same in ((again, True), (other, name == "clean")):
        assert all(np.array_equal(first[key], detections[key], equal_nan=True) for key in first) == same
    assert len(first["box"]) > 50


@pytest.mark.parametrize(("name", "digest"), [
    ("nuscenes_megvii", "b527f661df94"), ("kitti_pointrcnn_raw", "d669c01054f0"),
    ("nuscenes_centerpoint", "77bfba59ce0b"),
])  # fmt: skip
def test_detections_are_those_of_all_machines_and_processes(name: str, digest: str) -> None:
    columns = vars(simulated(load_profile(name), 2**63 + 5)).values()
    assert hashlib.sha256(b"".join(np.round(value, 6).tobytes() for value in columns)).hexdigest()[:12] == digest


def test_without_noise_the_detections_are_the_covered_true_boxes() -> None:
    truth, ego = traffic()
    found, inside = simulated(load_profile("clean")), covered(truth, ego, SENSOR)
    assert 50 < inside.sum() < len(inside)
    true, detected = (np.column_stack([part.box, part.velocity, part.class_id]) for part in (truth, found))
    for t in range(len(ego)):
        rows = true[truth.rows(t)][inside[truth.rows(t)]]
        np.testing.assert_allclose(detected[found.rows(t)], rows[np.argsort(rows[:, 0])], atol=1e-12)
    assert (found.score == 1.0).all()


def test_rows_of_a_frame_are_by_score_and_do_not_show_the_object() -> None:
    found = simulated(MEGVII)
    order = np.lexsort((found.box[:, 0], -found.score, found.frame_of_rows))
    np.testing.assert_array_equal(order, np.arange(len(found.score)))


@pytest.mark.parametrize(("yaw", "shift"), [(0.0, (100.0, -50.0, 3.0)), (1.2, (0.0, 0.0, 0.0))])
def test_detections_move_with_the_world(yaw: float, shift: tuple[float, float, float]) -> None:
    """Errors, families and ground do; only headings of free false positives are even over the world's."""
    truth, ego = traffic()
    classes = {name: noise.model_copy(update={"free": None}) for name, noise in MEGVII.classes.items()}
    profile = MEGVII.model_copy(update={"classes": classes})
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    moved = {"box": transform_boxes(truth.box, yaw, shift), "velocity": truth.velocity @ turn}
    moved_ego = np.column_stack([ego[:, :2] @ turn + shift[:2], ego[:, 2] + shift[2], ego[:, 3] + yaw])
    first = simulated(profile, 1)
    second = simulated(profile, 1, (Truth(**{**vars(truth), **moved}), moved_ego))
    np.testing.assert_array_equal(second.start, first.start)
    expected = transform_boxes(first.box, yaw, shift)
    np.testing.assert_allclose(second.box[:, [0, 1, 2, 4, 5, 6]], expected[:, [0, 1, 2, 4, 5, 6]], atol=1e-6)
    np.testing.assert_allclose(np.cos(second.box[:, 3] - expected[:, 3]), 1.0, atol=1e-9)
    np.testing.assert_allclose(second.velocity, first.velocity @ turn, atol=1e-6)
    np.testing.assert_allclose(second.score, first.score, atol=1e-6)


@pytest.mark.parametrize("frames", [0, 1, 3])
def test_a_scene_without_objects_can_be_simulated(frames: int) -> None:
    scene = cars(frames, 0), np.zeros((frames, 4))
    assert simulated(MEGVII, 0, scene).frames == frames
    clean = simulated(load_profile("clean"), 0, scene)
    assert (clean.start.tolist(), clean.box.shape) == ([0] * (frames + 1), (0, 7))
