"""Hits and misses of 3D tracking on KITTI, as AB3DMOT's evaluation defines them (Weng et al. 2020).

Per frame and class: Hungarian matching of 3D boxes with an IoU of at least 0.25. Not counted, neither for nor against a
tracker: truth that is truncated, heavily occluded or of a neighbour class; unmatched tracks that are at most 25 pixels
high in the image or lie in a DontCare region.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from mtp_bench.core import Bools, Floats, Ints, Scene
from mtp_bench.core.geometry import iou_3d
from mtp_bench.sources.kitti.files import KITTI_TYPES, BoxRows, read_detections, read_labels
from mtp_bench.sources.kitti.poses import read_poses
from mtp_bench.sources.kitti.source import NEIGHBOURS
from tests.support.plain_affinity import pairwise

LEAST_IOU = 0.25
MAX_OCCLUSION = 2
LEAST_HEIGHT = 25.0  # px
SCORE_THRESHOLD = {"car": 3.240738, "pedestrian": 2.683133, "cyclist": 3.645319}  # AB3DMOT's, of a track's mean


@dataclass(frozen=True, eq=False)
class TrackRows:
    """Output of a tracker over a scene, one row per track and frame, with the score of the detection taken last."""

    frame: Ints  # [R]
    track_id: Ints  # [R]
    class_id: Ints  # [R]
    box: Floats  # [R, 7]
    score: Floats  # [R]
    image_box: Floats  # [R, 4] of the detection taken last, px

    def keep(self, mask: Bools) -> "TrackRows":
        return TrackRows(**{name: rows[mask] for name, rows in vars(self).items()})

    def above(self, class_name: str) -> "TrackRows":
        """The tracks whose mean score reaches the threshold of a class."""
        ids, row = np.unique(self.track_id, return_inverse=True)
        mean = np.bincount(row, self.score) / np.bincount(row) if len(ids) else np.zeros(0)
        return self.keep(mean[row] >= SCORE_THRESHOLD[class_name])


@dataclass(frozen=True, eq=False)
class Annotations:
    """Labels of a scene in its frame of reference."""

    labels: BoxRows
    box: Floats  # [R, 7]; NaN for DontCare

    @property
    def hidden(self) -> Bools:
        """Rows that AB3DMOT's evaluation ignores: cut off at the border of the image, or occluded."""
        table = self.labels.table
        return np.asarray((table.whole_numbers("truncated") > 0) | (table.whole_numbers("occluded") > MAX_OCCLUSION))

    def ignored(self, class_name: str) -> Bools:
        """Rows that count neither as found nor as missed."""
        return np.isin(self.labels.table["type"], NEIGHBOURS[class_name]) | self.hidden


def read_annotations(root: Path, scene: Scene, ego_motion: bool) -> Annotations:
    """Labels of ``scene``, whose boxes are in the world if ``ego_motion``, else in each frame's own sensor frame."""
    labels = read_labels(root / f"training/label_02/{scene.name}.txt")
    box = labels.box
    if ego_motion:
        box = read_poses(root, scene.name).to_world(box, labels.frame)
    return Annotations(labels, box)


def detection_image_boxes(root: Path, scene: Scene, classes: tuple[str, ...]) -> Floats:
    """Image boxes [R, 4] of the detections of ``scene``, in their order."""
    parts = [
        read_detections(root / "detections/pointrcnn", scene.name, kind, code)
        for kind, code in (KITTI_TYPES[name] for name in classes)
    ]
    order = np.argsort(np.concatenate([part.frame for part in parts]), kind="stable")
    image_box = np.concatenate([part.table.matrix("left top right bottom") for part in parts])[order]
    np.testing.assert_array_equal(
        np.concatenate([part.table["score"] for part in parts])[order], scene.detections.score
    )
    return image_box


def count_scene(frames: int, truth: Annotations, tracks: TrackRows, class_name: str) -> Ints:
    """Of one class of a scene the number of true boxes, of misses and of false positives [3]."""
    kind, ignored = truth.labels.table["type"], truth.ignored(class_name)
    evaluated = np.isin(kind, (KITTI_TYPES[class_name][0], *NEIGHBOURS[class_name]))
    count = np.zeros(3, dtype=np.int64)
    for t in range(frames):
        now = np.flatnonzero(evaluated & (truth.labels.frame == t))
        here = tracks.keep(tracks.frame == t)
        column = matched_columns(truth.box[now], here.box)
        hit = column >= 0
        free = np.ones(len(here.frame), dtype=bool)
        free[column[hit]] = False
        areas = truth.labels.table.matrix("left top right bottom")[(kind == "DontCare") & (truth.labels.frame == t)]
        false = free & ~excused(here.image_box, areas)
        count += (~ignored[now]).sum(), (~hit & ~ignored[now]).sum(), false.sum()
    return count


def matched_columns(truth: Floats, tracks: Floats) -> Ints:
    """Track [M] matched to each true box, -1 for none: as many pairs as possible, of the largest total IoU."""
    column = np.full(len(truth), -1, dtype=np.int64)
    overlap = pairwise(iou_3d, truth, tracks)
    cost = np.where(overlap >= LEAST_IOU, 1.0 - overlap, 1e4)
    for i, j in zip(*linear_sum_assignment(cost), strict=True):
        if overlap[i, j] >= LEAST_IOU:
            column[i] = j
    return column


def excused(image_box: Floats, areas: Floats) -> Bools:
    """Rows whose image box [R, 4] is low, or more than half of it in one of the DontCare areas [A, 4]."""
    low = image_box[:, 3] - image_box[:, 1] <= LEAST_HEIGHT
    corner = np.maximum(image_box[:, None, :2], areas[None, :, :2])
    common = np.maximum(np.minimum(image_box[:, None, 2:], areas[None, :, 2:]) - corner, 0.0).prod(axis=2)
    size = (image_box[:, 2:] - image_box[:, :2]).prod(axis=1)
    return np.asarray(low | (common > 0.5 * size[:, None]).any(axis=1))
