"""KITTI source: what images confirm, what agents may know, splits, and what is found and missing."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench import MTPEnv
from mtp_bench.cards import with_detector, with_files, with_scenes
from mtp_bench.core import Scene
from mtp_bench.core.errors import UnknownNameError
from mtp_bench.running.reading import read_status
from mtp_bench.sources import describe, load_scenes, open_source
from mtp_bench.sources.files.save import save_scene
from mtp_bench.sources.kitti.files import VALIDATION, read_imu_to_camera, read_labels
from tests.support.drawn_recordings import small_recording
from tests.support.layouts import CALIBRATION, CODES, KITTI, KITTI_PERIOD, kitti_card, write_kitti
from tests.support.small_scenes import empty_action
from tests.support.source_files import write

LABELS, OXTS, CALIB = "training/label_02/0000.txt", "training/oxts/0000.txt", "training/calib/0000.txt"
DETECTED = "detections/pointrcnn/Car/0000.txt"
SEQMAP = "evaluate_tracking.seqmap.val"


def make_root(tmp_path: Path) -> Path:
    """One sequence of six frames with a car."""
    return write_kitti(tmp_path, small_recording(KITTI, 6))


def load(root: Path, **source: Any) -> Scene:
    return open_source(kitti_card(**source), root).load("0000")


def add(path: Path, *lines: str) -> None:
    write(path, *path.read_text().splitlines(), *lines)


@pytest.mark.parametrize("ego_motion", [True, False])
def test_a_tilted_unit_still_gives_a_level_world(ego_motion: bool, tmp_path: Path) -> None:
    """Nose up by 0.1 rad: level ground at the height of the camera is seen 0.1 rad below its axis."""
    recording = small_recording(KITTI, 6)
    recording.pose[:, 4] = -0.1  # pitch is positive downwards
    scene = load(write_kitti(tmp_path, recording), ego_motion=ego_motion)
    assert scene.image is not None
    u, v, depth = scene.image.projection[0] @ [10.0, 0.0, scene.image.height[0], 1.0]
    np.testing.assert_allclose([u / depth, v / depth], [600, 180 + 707 * np.tan(0.1)])


def test_regions_that_labels_do_not_care_about(root: Path) -> None:
    rows = [f"{t} -1 DontCare -1 -1 -10 {t} 20 {t + 50} 40 -1 -1 -1 -1000 -1000 -1000 -10" for t in (4, 1, 2, 2)]
    add(root / LABELS, *rows)
    for stride, start, left in ((1, [0, 0, 1, 3, 3, 4, 4], [1, 2, 2, 4]), (2, [0, 0, 2, 3], [2, 2, 4])):
        image = load(root, stride=stride).image
        assert image is not None
        assert image.region_start.tolist() == start
        assert image.region.tolist() == [[x, 20.0, x + 50.0, 40.0] for x in left]
        assert len(image.projection) == len(image.height) == len(image.heading) == len(start) - 1
    assert np.isnan(read_labels(root / LABELS).box[-4:]).all()


@pytest.mark.parametrize(
    ("observe", "again"), [("detections", ""), ("truth", ""), ("truth", "scenes"), ("detections", "files")]
)
def test_a_shown_velocity_tells_nothing_of_the_next_frame(observe: str, again: str, tmp_path: Path) -> None:
    """A car at 10, 11, 13, 16, 20 and 25 m: what is shown of its first frames stays where it turns back later."""

    def shown(places: tuple[float, ...]) -> list[dict[str, Any]]:
        recording = small_recording(KITTI, 6)
        for row, x in zip(recording.truth, places, strict=True):
            row.box[0] = x
        root = write_kitti(tmp_path / str(places[-1]), recording)
        card = kitti_card()
        scenes = list(load_scenes(card, root, ["0000"]))
        if again == "scenes":
            card = with_scenes(card, scenes)
        elif again == "files":
            save_scene(replace(scenes[0], image=None), tmp_path / f"own {places[-1]}", card.task.classes)
            card = with_files(card, tmp_path / f"own {places[-1]}")
        env = MTPEnv(with_detector(card, "clean"), data=str(root), observe=observe)
        first, _ = env.reset(options={"scene": "0000"})
        return [first, *(env.step(empty_action(env.task))[0] for _ in range(2))]

    ahead, back = shown((10, 11, 13, 16, 20, 25)), shown((10, 11, 13, 10, 9, 8))
    for one, other in zip(ahead, back, strict=True):
        for name, value in one.items():
            np.testing.assert_array_equal(value, other[name], err_msg=name)
    velocity = [seen["detection_velocity"][0, 0] for seen in ahead]
    np.testing.assert_allclose(velocity, np.array([0, 1, 2]) / KITTI_PERIOD, rtol=1e-5)


@pytest.mark.parametrize(("column", "cell", "reason"), [
    (7, "nan", "detection not finite"), (12, "inf", "detection not finite"), (8, "0", "detection size not above 0"),
    (9, "-4", "detection size not above 0"),
])  # fmt: skip
def test_detections_that_cannot_be_used_are_skipped_and_counted(
    column: int, cell: str, reason: str, root: Path
) -> None:
    cells = (root / DETECTED).read_text().splitlines()[1].split(",")
    cells[column] = cell
    add(root / DETECTED, *[",".join(cells)] * 2)
    scene = load(root)
    assert (scene.skipped, len(scene.detections.box)) == ({reason: 2}, 6)
    assert load(root, stride=2).skipped == {}, "they are in frame 1"


def test_calibration_with_colons_and_long_names(root: Path) -> None:
    plain = read_imu_to_camera(root / CALIB)
    long = CALIBRATION.replace("R_rect", "R0_rect:").replace("velo_cam", "velo_to_cam:").replace("u_velo", "u_to_velo:")
    write(root / CALIB, long)
    np.testing.assert_array_equal(read_imu_to_camera(root / CALIB), plain)


def test_train_is_every_other_sequence(root: Path) -> None:
    for name in ("0003", "0002"):
        for file in (LABELS, OXTS, CALIB, *(f"detections/pointrcnn/{kind}/0000.txt" for kind in CODES)):
            shutil.copy(root / file, root / file.replace("0000", name))
    source = open_source(kitti_card(split="train"), root)
    assert source.names == ("0002", "0003")
    assert source.load("0003").frames == 6  # by the rows of the GPS/IMU file
    with pytest.raises(UnknownNameError, match="unknown scene '0000'"):
        source.load("0000")
    (root / SEQMAP).unlink()
    assert open_source(kitti_card(), root).names == VALIDATION
    assert open_source(kitti_card(split="train"), root).names == ("0000", "0002", "0003")


def test_status_lists_what_is_missing_and_what_is_wrong(root: Path, own_cache: Path) -> None:
    assert describe(kitti_card(), root).usable
    assert "has no detector 'other'; found: pointrcnn" in describe(kitti_card(detector="other"), root).missing[0]
    counts = [read_status(kitti_card(), str(root)).counts for _ in range(2)]
    assert counts[0] == counts[1] != {}, "kept until a file changes"
    for content in ("[]", json.dumps({"counts": counts[0]})):
        for kept in (own_cache.parent / "counts").iterdir():
            kept.write_text(content)
        assert read_status(kitti_card(), str(root)).counts == counts[0], "counted again where the cache is wrong"
    text, before = (root / LABELS).read_text(), (root / LABELS).stat()
    write(root / LABELS, "0 1 Car".ljust(len(text) - 1))
    os.utime(root / LABELS, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert (root / LABELS).stat().st_size == before.st_size
    status = read_status(kitti_card(), str(root))
    assert "line 1: 3 columns" in status.problems[0]
    assert not status.usable
    (root / OXTS).unlink()
    assert read_status(kitti_card(ego_motion=False), str(root)).missing == [f"no file {root / OXTS}"]
