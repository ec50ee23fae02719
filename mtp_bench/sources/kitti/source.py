"""KITTI tracking logs with stored detections or tracks, from the official folder layout.

Tracks come in the result form of the benchmark: one text per sequence, boxes in camera
axes. A line is that of a label with a score behind it: ``frame id type truncated
occluded alpha left top right bottom height width length x y z rotation_y score``.
AB3DMOT writes such files.
"""

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
from ..base import (
    DataRoot,
    ReadTracks,
    TrackForm,
    class_ids,
    detections_by_frame,
    no_detections,
    require_classes,
    require_rate,
    section_of,
    sorted_rows,
    stored_label,
)
from ..motion import central_velocity, unknown_velocity
from ..readers import read_table
from ..stored_tracks import FEWER, with_stored
from .files import (
    BOX_FIELDS,
    DATASET,
    KITTI_TYPES,
    LABELS,
    RENAME,
    RESULT,
    SEQUENCE_MAP,
    BoxRows,
    KittiSource,
    camera_fields,
    read_detections,
    read_labels,
    read_sequence_map,
    require_detector,
    require_kinds,
    sensor_boxes,
    split_names,
)
from .poses import FRAME_PERIOD, Poses, image_field, read_poses

RATE_HZ = 10.0  # nominal, see `poses.FRAME_PERIOD`
# Types that KITTI's own evaluation leaves out of account: their annotation overlaps
# with the class.
NEIGHBOURS = {
    "car": ("Van",),
    "pedestrian": ("Person", "Person_sitting"),
    "cyclist": (),
}


class KittiTracking:
    """Scenes of one split of KITTI tracking, with or without ego-motion compensation.

    Frames of reference: with compensation the world of `kitti.poses`; without it every
    frame is given in its own sensor frame (x forward, y left, z up) and the ego state
    is all zeros; `Scene.world` says where those frames are. Time is frame index x
    0.1036 s.
    """

    def __init__(self, card: Card, data: DataRoot = None) -> None:
        self.card = card
        self.section = section_of(card, KittiSource)
        self.root = DATASET.find(data, LABELS)
        require_classes(card, "KITTI", KITTI_TYPES)
        require_rate(card, "KITTI", RATE_HZ, self.section.stride)
        self.names = split_names(self.root, self.section.split)
        self._detections: Path | None = None
        if card.detector is None:
            self._detections = require_detector(self.root, card)

    def load(self, name: str) -> Scene:
        """Read one sequence, all its frames, also those without labels."""
        classes = self.card.task.classes
        ego_motion = self.section.ego_motion
        stride = self.section.stride
        poses = read_poses(self.root, name)
        length = len(poses.position)
        frame_counts = read_sequence_map(self.root / SEQUENCE_MAP)
        if frame_counts.get(name, length) != length:
            path = self.root / f"training/oxts/{name}.txt"
            raise DataError(
                f"{path} has {length} rows, expected one for each frame of the "
                f"sequence map{RENAME}"
            )
        frames = Frames(length, stride, poses if ego_motion else None)
        labels = read_labels(self.root / LABELS / f"{name}.txt")
        frames.check(labels)
        frame = np.arange(0, length, stride)
        scene_poses = Poses(poses.rotation[frame], poses.position[frame])
        ego = scene_poses.ego()
        region = frames.select(labels.frame, labels.table["type"] == "DontCare")
        image = image_field(
            self.root / f"training/calib/{name}.txt",
            scene_poses,
            ego_motion,
            labels.table.matrix("left top right bottom")[region],
            frames.starts(labels.frame[region]),
            classes,
        )
        scene = Scene(
            name=name,
            time=frame * FRAME_PERIOD,
            ego=ego,
            truth=truth_of(labels, classes, frames),
            detections=no_detections(len(frame)),
            image=image,
        )
        if self._detections is not None:
            detections, skipped = detections_of(self._detections, name, classes, frames)
            scene = replace(
                scene,
                detections=detections,
                detector=stored_label(self.section.detector),
                skipped=skipped,
            )
        if ego_motion:
            return scene
        return replace(scene, ego=np.zeros((len(frame), 4)), world=ego)


@dataclass(frozen=True)
class Frames:
    """Frames that a scene takes from its sequence, with their poses."""

    length: int  # frames of the sequence
    stride: int  # every n-th frame is taken
    poses: Poses | None  # None: every frame in its own sensor frame

    def select(self, frame: Ints, used: Bools) -> Ints:
        """Return the ``used`` rows in frames of the scene, sorted by frame."""
        return sorted_rows(frame, used & (frame % self.stride == 0))

    @property
    def count(self) -> int:
        """Number of frames of the scene."""
        return len(range(0, self.length, self.stride))

    def starts(self, frame: Ints) -> Ints:
        """Return the first row of each frame of the scene, and the number of rows.

        ``frame`` [R]: number in the sequence of each row, sorted.
        """
        return starts_of_sorted(frame // self.stride, self.count)

    def place(self, box: Floats, frame: Ints) -> Floats:
        """Return sensor boxes [R, 7] in the scene's frame of reference."""
        return self.poses.to_world(box, frame) if self.poses else box

    def check(self, rows: BoxRows) -> None:
        """Raise DataError for a row outside of the sequence."""
        is_outside = (rows.frame < 0) | (rows.frame >= self.length)
        problem = f"but the sequence has {self.length} frames{RENAME}"
        rows.table.refuse(is_outside, lambda row: f"frame {rows.frame[row]}, {problem}")


def truth_of(labels: BoxRows, classes: Sequence[str], frames: Frames) -> Truth:
    """Return the truth of a sequence: boxes of ``classes``, `NEIGHBOURS` as neutral."""
    kinds = labels.table["type"]
    class_id = np.full(len(labels.frame), -1)
    neutral = np.zeros(len(labels.frame), dtype=bool)
    for index, name in enumerate(classes):
        is_neighbour = np.isin(kinds, NEIGHBOURS[name])
        class_id[is_neighbour | (kinds == KITTI_TYPES[name][0])] = index
        neutral |= is_neighbour
    true_rows = frames.select(labels.frame, class_id >= 0)
    file_frame = labels.frame[true_rows]
    object_id = labels.table.whole_numbers("id")[true_rows]
    box = frames.place(labels.box[true_rows], file_frame)
    period_s = frames.stride * FRAME_PERIOD
    scene_frame = file_frame // frames.stride
    return Truth(
        start=frames.starts(file_frame),
        box=box,
        velocity=central_velocity(scene_frame, object_id, box[:, :2], period_s),
        class_id=class_id[true_rows],
        object_id=object_id,
        eligible=~neutral[true_rows],
        neutral=neutral[true_rows],
    )


def detections_of(
    folder: Path, name: str, classes: Sequence[str], frames: Frames
) -> tuple[Detections, dict[str, int]]:
    """Return the detections of all classes, and the counts of skipped rows.

    They are sorted by frame, class and place in the file.
    """
    frame_parts: list[Ints] = []
    box_parts: list[Floats] = []
    score_parts: list[Floats] = []
    skipped = Counter[str]()
    for class_name in classes:
        rows = read_detections(folder, name, *KITTI_TYPES[class_name])
        frames.check(rows)
        score = rows.table["score"]
        is_used = rows.frame % frames.stride == 0
        is_finite = np.isfinite(rows.box).all(axis=1) & np.isfinite(score)
        skipped["detection not finite"] += int((is_used & ~is_finite).sum())
        is_used &= is_finite
        frame_parts.append(rows.frame[is_used])
        box_parts.append(rows.box[is_used])
        score_parts.append(score[is_used])
    row_counts = [len(part) for part in frame_parts]
    frame = np.concatenate(frame_parts)
    detections = detections_by_frame(
        frames.count,
        frame // frames.stride,
        frames.place(np.concatenate(box_parts), frame),
        np.repeat(np.arange(len(classes)), row_counts),
        np.concatenate(score_parts),
    )
    return detections, dict(+skipped)


def read_result(
    path: Path, scene: Scene, classes: Sequence[str], stride: int, poses: Poses | None
) -> Scene:
    """Return the scene of every ``stride``-th frame with its tracks.

    ``poses``: of all frames; None without a common frame. Rows of other classes and
    other frames are left out; in a file with the columns of a label, scores are NaN.
    DataError names the line that is wrong.
    """
    table = read_table(path, RESULT, words="type", optional="score")
    require_kinds(table)
    kinds = [KITTI_TYPES[name][0] for name in classes]
    class_id = class_ids(table["type"].tolist(), kinds)
    is_used = (class_id >= 0) & (table.whole_numbers("frame") % stride == 0)
    table = table.select(is_used)
    class_id = class_id[is_used]
    frame = table.whole_numbers("frame")
    object_id = table.whole_numbers("id")
    last_frame = (scene.frames - 1) * stride
    problem = f"but the last one of sequence {scene.name} is {last_frame}"
    is_outside = (frame < 0) | (frame > last_frame)
    table.refuse(is_outside, lambda row: f"frame {frame[row]}, {problem}")
    table.refuse_degrees("rotation_y")
    table.refuse_second_box(frame, object_id, class_id)
    box = sensor_boxes(table.matrix(BOX_FIELDS))
    if poses is not None:
        box = poses.to_world(box, frame)
    track_score = table.columns.get("score", np.full(len(frame), np.nan))
    velocity = unknown_velocity(len(box))
    return with_stored(
        scene, frame // stride, object_id, class_id, box, track_score, velocity
    )


def result_lines(
    frame: Ints,
    track_id: Ints,
    types: Sequence[str],
    box: Floats,
    score: Floats,
    poses: Poses | None,
) -> list[str]:
    """Return lines of boxes [R, 7] in the scene's frame of reference.

    Truncation, occlusion, alpha and the rectangle in the image are unknown: -1, -10.
    """
    fields = camera_fields(box if poses is None else poses.to_sensor(box, frame))
    lines: list[str] = []
    for row, kind in enumerate(types):
        numbers = " ".join(f"{value:.6f}" for value in (*fields[row], score[row]))
        start = f"{frame[row]} {track_id[row]} {kind}"
        lines.append(f"{start} -1 -1 -10 -1 -1 -1 -1 {numbers}")
    return lines


def poses_of(card: Card, data: DataRoot, name: str) -> Poses | None:
    """Return the poses of all frames of a sequence.

    None if the card gives every frame in its own sensor frame.
    """
    if not section_of(card, KittiSource).ego_motion:
        return None
    return read_poses(KittiTracking(card, data).root, name)


def _open(card: Card, data: DataRoot, folder: Path) -> ReadTracks:
    stride = section_of(card, KittiSource).stride

    def read_tracks(scene: Scene) -> Scene:
        path = folder / f"{scene.name}.txt"
        if not path.is_file():
            raise DataError(
                f"no file {path}, expected tracks of each sequence that is run, or an "
                f"empty file; {FEWER}"
            )
        poses = poses_of(card, data, scene.name)
        return read_result(path, scene, card.task.classes, stride, poses)

    return read_tracks


FORM = TrackForm(
    name="a folder with a KITTI tracking result <sequence>.txt for each scene",
    fits=lambda path: path.is_dir() and any(path.glob("*.txt")),
    open=_open,
)
