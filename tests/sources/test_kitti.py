"""KITTI source on a folder of a few lines: axes, poses, bad input, what is found and missing."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench import MTPEnv
from mtp_bench.cards import Card, with_detector, with_files, with_scenes
from mtp_bench.core import Scene
from mtp_bench.core.errors import UnknownNameError
from mtp_bench.running.reading import read_status
from mtp_bench.sources import describe, load_scenes, open_source
from mtp_bench.sources.files.save import save_scene
from mtp_bench.sources.kitti.files import VALIDATION, read_imu_to_camera, read_labels
from mtp_bench.sources.kitti.poses import FRAME_PERIOD
from tests.support.small_scenes import empty_action
from tests.support.source_files import card_of, write

QUARTER = np.pi / 2
SIX = 6  # frames of the small sequence
CAMERA_AHEAD = 1.5  # m, camera before the GPS/IMU unit
LABELS, OXTS, CALIB = "training/label_02/0000.txt", "training/oxts/0000.txt", "training/calib/0000.txt"
DETECTED = "detections/pointrcnn/Car/0000.txt"
SEQMAP = "evaluate_tracking.seqmap.val"


def kitti_card(classes: tuple[str, ...] = ("car", "pedestrian", "cyclist"), **source: Any) -> Card:
    return card_of("MTP-KITTI-v0", classes, 10 / source.get("stride", 1), **source)


def label(
    frame: int, object_id: int, kind: str, x: float, y: float, z: float, ry: float, size: str = "1.5 2 4"
) -> str:  # size: height width length
    return f"{frame} {object_id} {kind} 0 1 -1.5 10 20 30 40 {size} {x} {y} {z} {ry}"


def detection(frame: int, code: int, x: float, y: float, z: float, ry: float, size: str = "1.5,2,4") -> str:
    return f"{frame},{code},10,20,30,40,-0.5,{size},{x},{y},{z},{ry},-1.5"


def oxts(yaw: float = 0.0, east: float = 0.0, north: float = 0.0, up: float = 0.0) -> str:
    values = [49.0, 8.4, 110.0, 0.0, 0.0, yaw, north, east, 0.0, 0.0, up, *[0.0] * 19]
    return " ".join(str(value) for value in values)


CALIBRATION = f"""\
P2: 707 0 600 0 0 707 180 0 0 0 1 0
R_rect 1 0 0 0 1 0 0 0 1
Tr_velo_cam 0 -1 0 0 0 0 -1 0 1 0 0 0
Tr_imu_velo 1 0 0 {-CAMERA_AHEAD} 0 1 0 0 0 0 1 0
"""
PARKED = label(0, 7, "Car", 0, 1.65, 10, -QUARTER)


def make_root(tmp_path: Path) -> Path:
    """One sequence of six frames: the car stands, one parked car straight ahead."""
    folder = tmp_path / "kitti_tracking"
    write(folder / SEQMAP, f"0000 empty 000000 {SIX:06d}")
    write(folder / LABELS, PARKED)
    write(folder / CALIB, CALIBRATION)
    write(folder / OXTS, *[oxts()] * SIX)
    for kind in ("Car", "Pedestrian", "Cyclist"):
        write(folder / f"detections/pointrcnn/{kind}/0000.txt")
    return folder


def load(root: Path, **source: Any) -> Scene:
    return open_source(kitti_card(**source), root).load("0000")


@pytest.mark.parametrize("ego_motion", [True, False])
@pytest.mark.parametrize(("camera", "ry", "centre", "yaw"), [
    pytest.param((0, 1.65, 10), -QUARTER, (10, 0, -0.9), 0.0, id="ahead, driving away"),
    pytest.param((0, 1.65, 10), QUARTER, (10, 0, -0.9), -np.pi, id="ahead, coming towards us"),
    pytest.param((5, 1.65, 10), 0.0, (10, -5, -0.9), -QUARTER, id="right of us, heading to the right"),
    pytest.param((-5, 1.65, 10), np.pi, (10, 5, -0.9), QUARTER, id="left of us, heading to the left"),
    pytest.param((0, 0, 20), -QUARTER - 0.1, (20, 0, 0.75), 0.1, id="at camera height, turned slightly left"),
])  # fmt: skip
def test_axes(
    root: Path, ego_motion: bool, camera: tuple[float, ...], ry: float, centre: tuple[float, ...], yaw: float
) -> None:
    """The first frame of the world is the sensor frame: x forward, y left, z up; z is the centre of the box."""
    x, y, z = camera
    write(root / LABELS, label(0, 7, "Car", x, y, z, ry))
    write(root / DETECTED, detection(0, 2, x, y, z, ry))
    scene = load(root, ego_motion=ego_motion)
    for box in (scene.truth.box, scene.detections.box):
        np.testing.assert_allclose(box[0, :3], centre, atol=1e-12)
        assert np.exp(1j * box[0, 3]) == pytest.approx(np.exp(1j * yaw))
        np.testing.assert_array_equal(box[0, 4:], [4, 2, 1.5])


def test_driving_straight_leaves_a_parked_car_in_its_place(root: Path) -> None:
    """10 m/s to the north east for six frames: the parked car comes nearer, in the world it stays."""
    speed, heading = 10.0, 0.8
    write(root / OXTS, *[oxts(heading, speed * np.cos(heading), speed * np.sin(heading), up=0.5)] * SIX)
    travelled = speed * FRAME_PERIOD * np.arange(SIX)
    rise = 0.5 * FRAME_PERIOD * np.arange(SIX)
    labels = [label(t, 7, "Car", 2, 1.65 + rise[t], 20 - travelled[t], -QUARTER) for t in range(SIX)]
    write(root / LABELS, *labels)
    scene = load(root)
    np.testing.assert_allclose(scene.time, FRAME_PERIOD * np.arange(SIX))
    np.testing.assert_allclose(scene.ego, np.column_stack([travelled, np.zeros(SIX), rise, np.zeros(SIX)]), atol=1e-9)
    np.testing.assert_allclose(scene.truth.box, np.tile([20, -2, -0.9, 0, 4, 2, 1.5], (SIX, 1)), atol=1e-9)
    np.testing.assert_allclose(scene.truth.velocity[1:-1], 0, atol=1e-9)
    assert np.isnan(scene.truth.velocity[[0, -1]]).all()
    relative = load(root, ego_motion=False)
    np.testing.assert_array_equal(relative.ego, 0)
    np.testing.assert_allclose(relative.truth.box[:, 0], 20 - travelled, atol=1e-9)
    np.testing.assert_allclose(relative.truth.velocity[1:-1], np.tile([-speed, 0], (SIX - 2, 1)), atol=1e-9)


def test_turning_left_in_place(root: Path) -> None:
    """The unit turns left by 0.2 rad per frame about itself; the camera sits 1.5 m ahead and swings along."""
    turn = 0.2 * np.arange(SIX)
    write(root / OXTS, *[oxts(1.0 + angle) for angle in turn])
    # A parked car 10 m ahead of the first camera, seen from the turned one.
    ahead = (CAMERA_AHEAD + 10) * np.cos(turn) - CAMERA_AHEAD
    right = (CAMERA_AHEAD + 10) * np.sin(turn)
    labels = [label(t, 7, "Car", right[t], 1.65, ahead[t], -QUARTER + turn[t]) for t in range(SIX)]
    write(root / LABELS, *labels)
    scene = load(root)
    np.testing.assert_allclose(scene.ego[:, 3], turn, atol=1e-9)
    swing = [CAMERA_AHEAD * (np.cos(turn) - 1), CAMERA_AHEAD * np.sin(turn)]
    np.testing.assert_allclose(scene.ego[:, :2].T, swing, atol=1e-9)
    np.testing.assert_allclose(scene.truth.box, np.tile([10, 0, -0.9, 0, 4, 2, 1.5], (SIX, 1)), atol=1e-9)
    np.testing.assert_allclose(load(root, ego_motion=False).truth.box[:, 3], -turn, atol=1e-9)


@pytest.mark.parametrize("ego_motion", [True, False])
def test_a_tilted_unit_still_gives_a_level_world(root: Path, ego_motion: bool) -> None:
    """Nose up by 0.1 rad (pitch is positive downwards): what lies on the camera axis is higher up.

    Level ground at the height of the camera is seen 0.1 rad below its axis.
    """
    row = oxts().split()
    row[4] = "-0.1"
    write(root / OXTS, *[" ".join(row)] * SIX)
    write(root / LABELS, label(0, 7, "Car", 0, 0.75, 10, -QUARTER))
    scene = load(root, ego_motion=ego_motion)
    if ego_motion:
        np.testing.assert_allclose(scene.truth.box[0, :4], [10 * np.cos(0.1), 0, 10 * np.sin(0.1), 0], atol=1e-9)
    assert scene.image is not None
    u, v, depth = scene.image.projection[0] @ [10.0, 0.0, scene.image.height[0], 1.0]
    np.testing.assert_allclose([u / depth, v / depth], [600, 180 + 707 * np.tan(0.1)])


def test_odometry_replaces_the_gps_unit_where_it_is_given(root: Path) -> None:
    """Camera poses: one metre forward per frame; the GPS/IMU unit says that we stand."""
    rows = [f"1 0 0 0 0 1 0 0 0 0 1 {t}" for t in range(SIX)]
    write(root / "poses_orbslam3/0000.txt", *rows)
    np.testing.assert_allclose(load(root).ego, [[t, 0, 0, 0] for t in range(SIX)], atol=1e-12)


def test_regions_that_labels_do_not_care_about(root: Path) -> None:
    rows = [f"{t} -1 DontCare -1 -1 -10 {t} 20 {t + 50} 40 -1 -1 -1 -1000 -1000 -1000 -10" for t in (4, 1, 2, 2)]
    write(root / LABELS, PARKED, *rows)
    for stride, start, left in ((1, [0, 0, 1, 3, 3, 4, 4], [1, 2, 2, 4]), (2, [0, 0, 2, 3], [2, 2, 4])):
        image = load(root, stride=stride).image
        assert image is not None
        assert image.region_start.tolist() == start
        assert image.region.tolist() == [[x, 20.0, x + 50.0, 40.0] for x in left]
        assert len(image.projection) == len(image.height) == len(image.heading) == len(start) - 1


@pytest.mark.parametrize("stride", [1, 2])
def test_the_world_is_known_where_every_frame_has_its_own_frame_of_reference(root: Path, stride: int) -> None:
    write(root / OXTS, *[oxts(0.3 + 0.1 * t, 8.0, 2.0, up=0.4) for t in range(SIX)])
    compensated, own = load(root, stride=stride), load(root, stride=stride, ego_motion=False)
    assert compensated.world is None
    np.testing.assert_array_equal(own.world, compensated.ego)


def test_classes_neighbours_and_other_types(root: Path) -> None:
    kinds = ["Car", "Van", "Truck", "Pedestrian", "Person", "Person_sitting", "Cyclist", "Tram", "Misc"]
    rows = [label(2, i, kind, 0, 1, 10 + i, 0) for i, kind in enumerate(kinds)]
    write(root / LABELS, *rows, "2 -1 DontCare -1 -1 -10 1 2 3 4 -1000 -1000 -1000 -10 -1 -1 -1")
    truth = load(root).truth
    expected = [(0, 0, False), (1, 0, True), (3, 1, False), (4, 1, True), (5, 1, True), (6, 2, False)]
    got = list(zip(truth.object_id.tolist(), truth.class_id.tolist(), truth.neutral.tolist(), strict=True))
    assert got == expected
    np.testing.assert_array_equal(truth.eligible, ~truth.neutral)
    np.testing.assert_array_equal(truth.start, [0, 0, 0, 6, 6, 6, 6])
    only = open_source(kitti_card(classes=("cyclist", "car")), root).load("0000").truth
    assert (only.object_id.tolist(), only.class_id.tolist()) == ([0, 1, 6], [1, 1, 0])
    labels = read_labels(root / LABELS)  # all of it, for KITTI's own ignore rules
    assert labels.table["type"].tolist() == [*kinds, "DontCare"]
    assert np.isnan(labels.box[-1]).all()


def test_detections_are_sorted_by_frame_and_class(root: Path) -> None:
    write(root / DETECTED, detection(4, 2, 0, 1, 10, 0), detection(0, 2, 0, 1, 11, 0))
    write(root / "detections/pointrcnn/Pedestrian/0000.txt", detection(0, 1, 0, 1, 12, 0))
    detections = load(root).detections
    np.testing.assert_array_equal(detections.start, [0, 2, 2, 2, 2, 3, 3])
    assert detections.class_id.tolist() == [0, 1, 0]
    np.testing.assert_allclose(detections.box[:, 0], [11, 12, 10])
    np.testing.assert_array_equal(detections.score, -0.5)
    assert np.isnan(detections.velocity).all()


@pytest.mark.parametrize(("stride", "kept"), [(2, [0, 2, 4]), (3, [0, 3]), (4, [0, 4]), (5, [0, 5])])
def test_stride_keeps_every_nth_frame(root: Path, stride: int, kept: list[int]) -> None:
    write(root / OXTS, *[oxts(0, 10, 0)] * SIX)
    write(root / LABELS, *[label(t, 7, "Car", 0, 1, 30, -QUARTER) for t in range(SIX)])
    rows = [detection(t, 2, 0, 1, 30, 0) for t in range(SIX)]
    write(root / DETECTED, *rows, detection(1, 2, 0, 1, 30, 0, size="nan,1,1"))
    whole, scene = load(root), load(root, stride=stride)
    assert scene.frames == len(kept)
    np.testing.assert_array_equal(scene.time, whole.time[kept])
    np.testing.assert_array_equal(scene.ego, whole.ego[kept])
    np.testing.assert_array_equal(scene.truth.box, whole.truth.box[kept])
    np.testing.assert_array_equal(scene.truth.start, range(len(kept) + 1))
    np.testing.assert_array_equal(scene.detections.start, range(len(kept) + 1))
    np.testing.assert_allclose(scene.truth.velocity[1:-1], np.tile([10, 0], (max(len(kept) - 2, 0), 1)))
    assert scene.skipped == {}  # the bad row is in a frame that is left out


def test_velocity_needs_both_neighbours(root: Path) -> None:
    """Object 7 in frames 0 1 2 and 4, object 8 in frame 3: only (7, 1) has a frame before and after."""
    rows = [(0, 7, 10), (1, 7, 11), (2, 7, 13), (3, 8, 12), (4, 7, 17)]
    write(root / LABELS, *[label(t, i, "Car", 0, 1, z, 0) for t, i, z in rows])
    velocity = load(root).truth.velocity
    np.testing.assert_allclose(velocity[1], [3 / (2 * FRAME_PERIOD), 0], atol=1e-9)
    assert np.isnan(velocity[[0, 2, 3, 4]]).all()


@pytest.mark.parametrize(
    ("observe", "again"), [("detections", ""), ("truth", ""), ("truth", "scenes"), ("detections", "files")]
)
def test_a_shown_velocity_tells_nothing_of_the_next_frame(root: Path, observe: str, again: str, tmp_path: Path) -> None:
    """A car at 10, 11, 13, 16, 20 and 25 m: what is shown of its first frames stays where it turns back later."""

    def shown(places: tuple[float, ...]) -> list[dict[str, Any]]:
        write(root / LABELS, *[label(t, 7, "Car", 0, 1.65, x, -QUARTER) for t, x in enumerate(places)])
        card = kitti_card()
        scenes = list(load_scenes(card, root, ["0000"]))
        if again == "scenes":
            card = with_scenes(card, scenes)
        elif again == "files":
            save_scene(replace(scenes[0], image=None), tmp_path / str(places[-1]), card.task.classes)
            card = with_files(card, tmp_path / str(places[-1]))
        env = MTPEnv(with_detector(card, "clean"), data=str(root), observe=observe)
        first, _ = env.reset(options={"scene": "0000"})
        return [first, *(env.step(empty_action(env.task))[0] for _ in range(2))]

    ahead, back = shown((10, 11, 13, 16, 20, 25)), shown((10, 11, 13, 10, 9, 8))
    for one, other in zip(ahead, back, strict=True):
        for name, value in one.items():
            np.testing.assert_array_equal(value, other[name], err_msg=name)
    velocity = [seen["detection_velocity"][0, 0] for seen in ahead]
    np.testing.assert_allclose(velocity, np.array([0, 1, 2]) / FRAME_PERIOD, rtol=1e-5)


@pytest.mark.parametrize(("size", "z", "reason"), [
    ("nan,2,4", 10, "detection not finite"), ("1.5,2,4", np.inf, "detection not finite"),
    ("1.5,0,4", 10, "detection size not above 0"), ("1.5,2,-4", 10, "detection size not above 0"),
])  # fmt: skip
def test_detections_that_cannot_be_used_are_skipped_and_counted(root: Path, size: str, z: float, reason: str) -> None:
    good, bad = detection(1, 2, 0, 1, 10, 0), detection(1, 2, 0, 1, z, 0, size=size)
    write(root / DETECTED, good, bad, bad)
    scene = load(root)
    assert (scene.skipped, len(scene.detections.box)) == ({reason: 2}, 1)


def test_calibration_with_colons_and_long_names(root: Path) -> None:
    plain = read_imu_to_camera(root / CALIB)
    long = CALIBRATION.replace("R_rect", "R0_rect:").replace("velo_cam", "velo_to_cam:").replace("u_velo", "u_to_velo:")
    write(root / CALIB, long)
    np.testing.assert_array_equal(read_imu_to_camera(root / CALIB), plain)


def test_train_is_every_other_sequence(root: Path) -> None:
    for name in ("0003", "0002"):
        for file in (LABELS, OXTS, CALIB):
            shutil.copy(root / file, root / file.replace("0000", name))
        for kind in ("Car", "Pedestrian", "Cyclist"):
            write(root / f"detections/pointrcnn/{kind}/{name}.txt")
    source = open_source(kitti_card(split="train"), root)
    assert source.names == ("0002", "0003")
    assert source.load("0003").frames == SIX  # by the rows of the GPS/IMU file
    with pytest.raises(UnknownNameError, match="unknown scene '0000'"):
        source.load("0000")
    (root / SEQMAP).unlink()
    assert open_source(kitti_card(), root).names == VALIDATION
    assert open_source(kitti_card(split="train"), root).names == ("0000", "0002", "0003")


def test_status_lists_what_is_missing_and_what_is_wrong(root: Path, own_cache: Path) -> None:
    assert describe(kitti_card(), root).usable
    assert "has no detector 'other'; found: pointrcnn" in describe(kitti_card(detector="other"), root).missing[0]
    counts = [read_status(kitti_card(), root).counts for _ in range(2)]
    assert counts[0] == counts[1] != {}, "kept until a file changes"
    for content in ("[]", json.dumps({"counts": counts[0]})):
        for kept in (own_cache.parent / "counts").iterdir():
            kept.write_text(content)
        assert read_status(kitti_card(), root).counts == counts[0], "counted again where the cache is wrong"
    text, before = (root / LABELS).read_text(), (root / LABELS).stat()
    write(root / LABELS, "0 1 Car".ljust(len(text) - 1))
    os.utime(root / LABELS, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert (root / LABELS).stat().st_size == before.st_size
    status = read_status(kitti_card(), root)
    assert "line 1: 3 columns" in status.problems[0]
    assert not status.usable
    (root / OXTS).unlink()
    assert read_status(kitti_card(ego_motion=False), root).missing == [f"no file {root / OXTS}"]
