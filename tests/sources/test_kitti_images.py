"""Camera images of KITTI: which frame they are of, and that boxes lie in them where the labels have them."""

from pathlib import Path

import numpy as np
import pytest

from mtp_bench import load_card
from mtp_bench.sources import camera_images, load_scenes
from mtp_bench.sources.kitti.files import read_labels
from mtp_bench.viz.photo import projected
from tests.support.camera_images import write_image


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


@pytest.mark.data
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
            (at,) = np.flatnonzero((labels.frame == t * stride) & (labels.object_id == object_id))
            edges = projected(image.projection, box).reshape(-1, 2)
            gaps.append(np.concatenate([edges.min(axis=0), edges.max(axis=0)]) - labels.image_box[at])
    assert len(gaps) > 20
    assert np.median(np.abs(gaps)) < 4.0, "pixels"
