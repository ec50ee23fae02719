"""Camera images of nuScenes: where they show things, and that tables of them are read once, and for no run."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.sources import CameraImage, camera_images
from mtp_bench.sources.nuscenes import pictures
from tests.support.camera_images import CAMERAS, PIXELS, read, write_cameras
from tests.support.nuscenes_root import VERSION, nuscenes_card, scene, write_json


@pytest.fixture
def seen(data: Path) -> Path:
    write_cameras(data)
    return data


def images(data: Path, notes: list[str] | None = None, name: str = "scene-0003") -> tuple[CameraImage, ...]:
    told: list[str] = [] if notes is None else notes
    return camera_images(scene(data, name), nuscenes_card(), data, told.append)


def pixel(image: CameraImage, *place: float) -> list[float]:
    """Pixel and distance of a place of the world."""
    u, v, far = image.projection @ np.array([*place, 1.0])
    return [float(u / far), float(v / far), float(far)]


def test_a_place_of_the_world_is_where_the_camera_sees_it(seen: Path) -> None:
    found = {(image.frame, image.camera): image for image in images(seen)}
    assert set(found) == {(t, camera) for t in range(4) for camera in CAMERAS}
    front, back = found[0, "CAM_FRONT"], found[0, "CAM_BACK"]  # the ego is at (0, 0, 0.5) and heads along y
    np.testing.assert_allclose(pixel(front, 0.0, 10.0, 2.0), [800.0, 450.0, 10.0], atol=1e-6)
    np.testing.assert_allclose(pixel(front, 1.0, 10.0, 1.0), [900.0, 550.0, 10.0], atol=1e-6)  # right and below
    np.testing.assert_allclose(pixel(back, 1.0, -10.0, 2.0), [700.0, 450.0, 10.0], atol=1e-6)  # left, looking back
    assert pixel(back, 0.0, 10.0, 2.0)[2] < 0
    later = found[3, "CAM_FRONT"]  # 6 m on
    np.testing.assert_allclose(pixel(later, 1.0, 16.0, 2.0), [900.0, 450.0, 10.0], atol=1e-6)
    assert front.size == PIXELS
    assert all(image.path.is_file() for image in found.values())


def test_images_that_are_not_there_are_left_out(seen: Path) -> None:
    for image in images(seen)[1:]:
        image.path.unlink()
    (only,) = images(seen)
    assert (only.frame, only.camera, len(images(seen, name="scene-0001"))) == (0, "CAM_BACK", 8)


def test_the_tables_are_read_once(seen: Path, own_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    images(seen)
    assert len(list(own_cache.glob("*-cameras*/*.npz"))) == 3

    monkeypatch.delattr(pictures, "_read_cameras")
    assert len(images(seen, name="scene-0301")) == 8


BROKEN: dict[str, tuple[str, dict[str, Any], str]] = {
    "a focal length of 0": (
        "calibrated_sensor",
        {"camera_intrinsic": [[1000.0, 0.0, 800.0], [0.0, 0.0, 450.0], [0.0, 0.0, 1.0]]},
        "record 'CAM_BACK-1': the focal lengths are [1000.0, 0.0] pixels, expected numbers above 0",
    ),
    "no intrinsic matrix": ("calibrated_sensor", {"camera_intrinsic": []}, "camera_intrinsic"),
    "a rotation": ("calibrated_sensor", {"rotation": [2.0, 0.0, 0.0, 0.0]}, "rotation"),
    "a file elsewhere": ("sample_data", {"filename": "samples/../../x.jpg"}, "expected a file below samples/"),
    "no file": ("sample_data", {"filename": None}, "filename"),
    "a width": ("sample_data", {"width": "wide"}, "width"),
    "a pose": ("sample_data", {"ego_pose_token": "nowhere"}, "has no record 'nowhere'"),
}


@pytest.mark.parametrize(("table", "change", "text"), BROKEN.values(), ids=BROKEN)
def test_a_broken_table_leaves_them_out_with_a_note(table: str, change: dict[str, Any], text: str, seen: Path) -> None:
    path = seen / "nuscenes" / VERSION / f"{table}.json"
    *others, last = read(path)  # of CAM_BACK
    write_json(path, [*others, {**last, **change}])
    notes: list[str] = []
    assert images(seen, notes) == ()
    (note,) = notes
    assert note.startswith("drawn without images: ")
    assert text in note
