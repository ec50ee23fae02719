"""KITTI tracking logs with stored detections, from the official folder layout."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...cards import Card
from ...core import (
    Bools,
    DataError,
    Detections,
    Floats,
    Ints,
    Scene,
    Truth,
    starts_of_sorted,
)
from ..base import DataRoot, no_detections, require_classes, require_rate, section_of
from ..motion import central_velocity, unknown_velocity
from .files import (
    DetectionRows,
    LabelRows,
    read_detections,
    read_labels,
    read_sequence_map,
)
from .layout import (
    DATASET,
    LABELS,
    RENAME,
    SEQUENCE_MAP,
    TYPES,
    KittiSource,
    require_detector,
    split_names,
)
from .poses import FRAME_PERIOD, Poses, image_field, read_poses

# Types that KITTI's own evaluation leaves out of account: their annotation overlaps with the class.
NEIGHBOURS = {
    "car": ("Van",),
    "pedestrian": ("Person", "Person_sitting"),
    "cyclist": (),
}


class KittiTracking:
    """Scenes of one split of the KITTI tracking benchmark, with or without ego-motion compensation.

    Frames of reference: with compensation the world of `kitti.poses`; without it every frame is given in its own
    sensor frame (x forward, y left, z up) and the ego state is all zeros; `Scene.world` says where those frames are.
    Time is frame index x 0.1036 s.
    """

    def __init__(self, card: Card, data: DataRoot = None) -> None:
        self.card = card
        self.section = section_of(card, KittiSource)
        self.root = DATASET.find(data, LABELS)
        require_classes(card, "KITTI", TYPES)
        require_rate(card, "KITTI", 10.0, self.section.stride)
        self.names = split_names(self.root, self.section.split)
        self._detections = (
            require_detector(self.root, card) if card.detector is None else None
        )

    def load(self, name: str) -> Scene:
        """Read one sequence; all its frames count, also those without labels or detections."""
        section, classes = self.section, self.card.task.classes
        poses = read_poses(self.root, name)
        length = len(poses.position)
        if read_sequence_map(self.root / SEQUENCE_MAP).get(name, length) != length:
            path = self.root / f"training/oxts/{name}.txt"
            raise DataError(
                f"{path} has {length} rows, expected one for each frame of the sequence map{RENAME}"
            )
        frames = Frames(length, section.stride, poses if section.ego_motion else None)
        kept = np.arange(0, length, section.stride)
        labels = read_labels(self.root / LABELS / f"{name}.txt")
        frames.check(labels)
        detections, skipped, label = no_detections(len(kept)), dict[str, int](), ""
        if self._detections is not None:
            label = f"{section.detector}, stored detections"
            detections, skipped = detections_of(self._detections, name, classes, frames)
        calibration = self.root / f"training/calib/{name}.txt"
        of_scene = Poses(poses.rotation[kept], poses.position[kept])
        region = frames.select(labels.frame, labels.type == "DontCare")
        regions = labels.image_box[region], frames.starts(labels.frame[region])
        image = image_field(
            calibration, of_scene, section.ego_motion, *regions, classes
        )
        time, truth, ego = (
            kept * FRAME_PERIOD,
            truth_of(labels, classes, frames),
            of_scene.ego(),
        )
        scene = Scene(
            name,
            time,
            ego,
            truth,
            detections,
            detector=label,
            skipped=skipped,
            image=image,
        )
        return (
            scene
            if section.ego_motion
            else replace(scene, ego=np.zeros((len(kept), 4)), world=ego)
        )


@dataclass(frozen=True)
class Frames:
    """The frames of a scene among those of the sequence, and their poses."""

    length: int  # of the sequence
    stride: int
    poses: Poses | None  # None: every frame in its own sensor frame

    def select(self, frame: Ints, keep: Bools) -> Ints:
        """Indices of the rows to keep in frames of the scene, sorted by frame, otherwise in their order."""
        row = np.flatnonzero(keep & (frame % self.stride == 0))
        return row[np.argsort(frame[row], kind="stable")]

    def starts(self, frame: Ints) -> Ints:
        """First row of each frame of the scene, and the number of rows."""
        return starts_of_sorted(frame // self.stride, -(-self.length // self.stride))

    def place(self, box: Floats, frame: Ints) -> Floats:
        """Boxes in the frame of reference of the scene."""
        return self.poses.to_world(box, frame) if self.poses else box

    def check(self, rows: LabelRows | DetectionRows) -> None:
        """Raise DataError for a row outside of the sequence."""
        outside = (rows.frame < 0) | (rows.frame >= self.length)
        problem = f"but the sequence has {self.length} frames{RENAME}"
        rows.table.refuse(outside, lambda row: f"frame {rows.frame[row]}, {problem}")


def truth_of(labels: LabelRows, classes: Sequence[str], frames: Frames) -> Truth:
    """The truth of a sequence: boxes of ``classes``, and as neutral those of `NEIGHBOURS`."""
    class_id = np.full(len(labels.frame), -1)
    neutral = np.zeros(len(labels.frame), dtype=bool)
    for index, name in enumerate(classes):
        beside = np.isin(labels.type, NEIGHBOURS[name])
        class_id[beside | (labels.type == TYPES[name][0])] = index
        neutral |= beside
    row = frames.select(labels.frame, class_id >= 0)
    frame, object_id = labels.frame[row], labels.object_id[row]
    box, neutral = frames.place(labels.box[row], frame), neutral[row]
    velocity = central_velocity(
        frame // frames.stride, object_id, box[:, :2], frames.stride * FRAME_PERIOD
    )
    return Truth(
        frames.starts(frame), box, velocity, class_id[row], object_id, ~neutral, neutral
    )


def detections_of(
    folder: Path, name: str, classes: Sequence[str], frames: Frames
) -> tuple[Detections, dict[str, int]]:
    """Detections of all classes, sorted by frame, class and place in the file; and the counts of skipped rows."""
    parts: list[tuple[Ints, Floats, Floats, Ints]] = []
    skipped = Counter[str]()
    for index, class_name in enumerate(classes):
        kind, code = TYPES[class_name]
        rows = read_detections(folder, name, kind, code)
        frames.check(rows)
        row = frames.select(rows.frame, np.ones(len(rows.frame), dtype=bool))
        finite = np.isfinite(rows.box[row]).all(axis=1) & np.isfinite(rows.score[row])
        skipped["detection not finite"] += int((~finite).sum())
        row = row[finite]
        parts.append(
            (rows.frame[row], rows.box[row], rows.score[row], np.full(len(row), index))
        )
    frame, box, score, class_id = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    order = np.argsort(frame, kind="stable")
    frame = frame[order]
    box, velocity = frames.place(box[order], frame), unknown_velocity(len(frame))
    return Detections(
        frames.starts(frame), box, velocity, class_id[order], score[order]
    ), dict(+skipped)
