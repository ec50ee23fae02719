"""Camera images beside an event: which camera is chosen, where its boxes are, and what happens to broken files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from mtp_bench.core import Floats
from mtp_bench.sources import CameraImage
from mtp_bench.viz.drawing.canvas import PAPER
from mtp_bench.viz.drawing.report import SIZE, report, save_report
from mtp_bench.viz.focus import Focus
from mtp_bench.viz.palette import ROLES, Color
from mtp_bench.viz.photo import CAPTION, GAP, HEIGHT, photo_of, projected
from mtp_bench.viz.run_replay import Replay
from tests.support.camera_images import GREY, PIXELS, write_image
from tests.support.focus_scenes import EVENT, crowd

BOX = np.array([10.0, 0.0, 0.75, 0.0, 4.0, 2.0, 1.5])  # 10 m ahead of a camera at the origin


def looking(yaw: float = 0.0, x: float = 0.0, y: float = 0.0, z: float = 0.75) -> Floats:
    """The projection [3, 4] of a level camera at a place, with a focal length of 1000 pixels."""
    ahead, right = np.array([np.cos(yaw), np.sin(yaw), 0.0]), np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    turn = np.stack([right, [0.0, 0.0, -1.0], ahead])
    lens = np.array([[1000.0, 0.0, PIXELS[0] / 2], [0.0, 1000.0, PIXELS[1] / 2], [0.0, 0.0, 1.0]])
    return np.asarray(lens @ np.column_stack([turn, -turn @ [x, y, z]]))


@pytest.fixture
def seen(tmp_path: Path) -> Replay:
    """The crowd with two cameras: BEHIND sees the event 12 m ahead of it, FAR from 30 m; AWAY looks elsewhere."""
    run = crowd(ahead=12.0)
    cameras = {"AWAY": looking(np.pi, -10.0), "FAR": looking(0.0, -30.0), "BEHIND": looking(0.0, -10.0)}
    images = []
    for t in range(run.frames):
        for name, projection in cameras.items():
            path = tmp_path / f"{name}-{t}.jpg"
            write_image(path)
            images.append(CameraImage(t, name, path, PIXELS, projection))
    return replace(run, images=tuple(images))


def event(run: Replay) -> Focus:
    return Focus(run, run.incident("ids-0"))


def near(image: Image.Image, color: Color, tolerance: int = 30) -> int:
    pixels: NDArray[np.int64] = np.asarray(image.convert("RGB")).astype(np.int64)
    return int((np.abs(pixels - np.array(color)).max(axis=-1) < tolerance).sum())


# ---- boxes in an image
def test_a_box_ahead_is_twelve_edges() -> None:
    edges = projected(looking(), BOX)
    assert edges.shape == (12, 2, 2)
    low, high = edges.reshape(-1, 2).min(axis=0), edges.reshape(-1, 2).max(axis=0)
    np.testing.assert_allclose(low, [800 - 1000 / 8, 450 - 750 / 8])  # its rear is 8 m away, 1 m to each side
    np.testing.assert_allclose(high, [800 + 1000 / 8, 450 + 750 / 8])


@pytest.mark.parametrize(
    ("x", "count"),
    [pytest.param(-10.0, 0, id="behind"), pytest.param(1.0, 8, id="around the camera: no rear"), (10.0, 12)],
)
def test_what_is_behind_the_camera_is_cut_off(x: float, count: int) -> None:
    box = BOX.copy()
    box[0] = x
    edges = projected(looking(), box)
    assert len(edges) == count
    assert np.isfinite(edges).all()


# ---- which camera
def test_the_camera_that_sees_most_of_it_is_chosen(seen: Replay) -> None:
    photo = photo_of(event(seen))
    assert photo is not None
    assert photo.image.camera == "BEHIND"
    assert [role for role, _ in photo.edges] == ["truth", "before", "now", "detection"]
    car = seen.scene.truth.box[event(seen).rows[EVENT]]
    np.testing.assert_allclose(photo.middle[0], 800, atol=1e-6)
    assert photo.extent == pytest.approx(1000 * car[5] / (car[0] - car[4] / 2 + 10))


# ---- drawings
def test_the_row_shows_the_image_and_the_boxes(seen: Replay) -> None:
    row = report(event(seen)).crop((0, SIZE[1], SIZE[0], SIZE[1] + HEIGHT))
    assert near(row, GREY, 4) > 0.7 * SIZE[0] * HEIGHT
    for role in ("truth", "before"):  # the track now lies under the true box
        assert near(row, ROLES[role]) > 50, role
    whole = round((HEIGHT - CAPTION) * PIXELS[0] / PIXELS[1])
    assert near(row.crop((whole, CAPTION, whole + GAP, HEIGHT)), PAPER, 1) == GAP * (HEIGHT - CAPTION)


@pytest.mark.parametrize("content", [b"", b"no image", b"\xff\xd8\xff\xe0 cut off"], ids=["empty", "text", "cut off"])
def test_a_broken_image_is_named_and_the_rest_is_drawn(content: bytes, seen: Replay, tmp_path: Path) -> None:
    photo = photo_of(event(seen))
    assert photo is not None
    photo.image.path.write_bytes(content)
    save_report(tmp_path / "a.png", event(seen))
    assert (tmp_path / "a.png").is_file()
