"""KITTI source on the real recordings: known counts, detections of others, and where images show boxes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mtp_bench.cards import load_card, with_detections, with_split
from mtp_bench.core import Ints, Scene
from mtp_bench.scoring import evaluated, find_targets
from mtp_bench.sources import camera_images, load_scenes, open_source
from mtp_bench.sources.kitti.files import VALIDATION, read_labels
from mtp_bench.viz.photo import projected
from tests.support.camera_images import write_image
from tests.support.source_files import write

pytestmark = pytest.mark.data


CARD = load_card("MTP-KITTI-v0")


@pytest.fixture(scope="module")
def scenes(data_root: Path) -> dict[str, Scene]:
    source = open_source(CARD, data_root)
    return {name: source.load(name) for name in source.names}


def test_counts_of_the_benchmark(data_root: Path, scenes: dict[str, Scene]) -> None:
    assert (tuple(scenes), sum(scene.frames for scene in scenes.values())) == (VALIDATION, 3908)
    for class_id, (boxes, tracks) in enumerate([(9550, 190), (10124, 142), (1409, 28)]):
        own = [s.truth.object_id[(s.truth.class_id == class_id) & s.truth.eligible] for s in scenes.values()]
        assert (sum(len(ids) for ids in own), sum(len(np.unique(ids)) for ids in own)) == (boxes, tracks)
    assert all(scene.skipped == {} for scene in scenes.values())
    train = open_source(with_split(CARD, "train"), data_root)
    assert (len(train.names), sum(train.load(name).frames for name in train.names)) == (10, 8008 - 3908)


def evaluated_boxes(scene: Scene) -> tuple[Ints, Ints]:
    """Boxes of each class, vans and the like left out, and how many of them no label could confirm."""
    kept, seen = ~scene.truth.neutral, evaluated(scene).truth
    hidden = kept & seen.neutral
    return np.bincount(scene.truth.class_id[kept], minlength=3), np.bincount(seen.class_id[hidden], minlength=3)


def test_true_boxes_that_no_label_could_confirm(scenes: dict[str, Scene]) -> None:
    counts = np.sum([evaluated_boxes(scene) for scene in scenes.values()], axis=0)
    assert counts.tolist() == [[9550, 10124, 1409], [1867, 2052, 196]]


# targets with everything counted and without what no label could confirm; the share of the latter that moves
TARGETS = {
    "MTP-KITTI-v0": (14757, 11928, 0.710),
    "MTP-KITTI-noego-v0": (14757, 11923, 0.710),
    "MTP-KITTI-5Hz-v0": (5309, 4254, 0.734),
}


@pytest.mark.parametrize(("env", "want"), TARGETS.items(), ids=TARGETS.keys())
def test_targets_and_those_that_move(data_root: Path, env: str, want: tuple[int, int, float]) -> None:
    card = load_card(env)
    source = open_source(card, data_root)
    every, kept, moving = 0, 0, 0
    for name in source.names:
        scene = source.load(name)
        targets = find_targets(scene, card)
        every += len(find_targets(replace(scene, image=None), card))
        kept, moving = kept + len(targets), moving + int(targets.moving.sum())
    assert (every, kept) == want[:2]
    assert moving / kept == pytest.approx(want[2], abs=0.001)


def test_detections_of_kittis_text_are_those_of_the_original(tmp_path: Path, data_root: Path) -> None:
    """AB3DMOT's folders from elsewhere, and the same rows in the columns of the benchmark."""
    stored = data_root / "kitti_tracking" / "detections" / "pointrcnn"
    rows = []
    for code, kind in ((1, "Pedestrian"), (2, "Car"), (3, "Cyclist")):
        for line in (stored / kind / "0012.txt").read_text().splitlines():
            frame, told, *image, score, h, w, l, x, y, z, yaw, alpha = line.split(",")
            assert int(told) == code
            rows.append(" ".join([frame, "-1", kind, "0", "0", alpha, *image, h, w, l, x, y, z, yaw, score]))
    write(tmp_path / "mine" / "0012.txt", *rows)
    card = load_card("MTP-KITTI-v0")
    (original,) = load_scenes(card, data_root, ["0012"])
    digests = {card.digest}
    for folder in (stored, tmp_path / "mine"):
        other = with_detections(card, folder)
        (scene,) = load_scenes(other, data_root, ["0012"])
        for name in ("start", "box", "score", "class_id"):
            found, expected = (getattr(one.detections, name) for one in (scene, original))
            np.testing.assert_array_equal(found, expected)
        assert scene.detector == f"pointrcnn-{folder.name}, stored detections"
        digests.add(other.digest)
    assert len(digests) == 3


# ---- camera images
def linked(data: Path, real: Path, name: str, frames: range) -> Path:
    """A data root with the real KITTI behind links, and plain images of some frames of a sequence."""
    root, source = data / "kitti_tracking", real / "kitti_tracking"
    (root / "training").mkdir(parents=True)
    for path in source.iterdir():
        if path.name != "training":
            (root / path.name).symlink_to(path)
    for path in (source / "training").iterdir():
        if path.name != "image_02":
            (root / "training" / path.name).symlink_to(path)
    for t in frames:
        write_image(root / f"training/image_02/{name}/{t:06d}.png", (1242, 375))
    return data


@pytest.mark.parametrize("env_id", ["MTP-KITTI-v0", "MTP-KITTI-noego-v0"])
def test_boxes_lie_where_the_labels_have_them(env_id: str, data_root: Path, tmp_path: Path) -> None:
    data, card = linked(tmp_path / "root", data_root, "0006", range(20, 60)), load_card(env_id)
    (scene,) = load_scenes(card, data, ["0006"])
    images = {image.frame: image for image in camera_images(scene, card, data)}
    stride = round(10 / card.task.rate)
    assert sorted(images) == [t for t in range(scene.frames) if 20 <= t * stride < 60]
    assert all(image.path.stem == f"{t * stride:06d}" for t, image in images.items())
    labels = read_labels(data_root / "kitti_tracking/training/label_02/0006.txt")
    gaps = []
    for t, image in images.items():
        rows = scene.truth.rows(t)
        for object_id, box in zip(scene.truth.object_id[rows], scene.truth.box[rows], strict=True):
            (at,) = np.flatnonzero((labels.frame == t * stride) & (labels.table["id"] == object_id))
            edges = projected(image.projection, box).reshape(-1, 2)
            gaps.append(
                np.concatenate([edges.min(axis=0), edges.max(axis=0)])
                - labels.table.matrix("left top right bottom")[at]
            )
    assert len(gaps) > 20
    assert np.median(np.abs(gaps)) < 4.0, "pixels"
