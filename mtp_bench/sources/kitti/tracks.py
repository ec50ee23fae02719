"""Tracks in the result form of the KITTI tracking benchmark: one text per sequence, boxes in camera axes.

A line is that of a label with a score behind it: ``frame id type truncated occluded alpha left top right bottom height
width length x y z rotation_y score``. AB3DMOT writes such files.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...cards import Card
from ...core import DataError, Floats, Ints, Scene
from ..base import DataRoot, ReadTracks, TrackForm, class_ids, section_of
from ..motion import unknown_velocity
from ..stored_tracks import FEWER, with_stored
from ..text import read_table
from .files import BOX_FIELDS, LABEL, RESULT, camera_fields, require_kinds, sensor_boxes
from .layout import TYPES, KittiSource
from .poses import Poses, read_poses
from .source import KittiTracking


def read_result(
    path: Path, scene: Scene, classes: Sequence[str], stride: int, poses: Poses | None
) -> Scene:
    """The scene of every ``stride``-th frame with its tracks; ``poses``: of all frames; None without a common frame.

    Rows of other classes and other frames are left out; in a file with the columns of a label, scores are NaN.
    DataError names the line that is wrong.
    """
    table = read_table(path, RESULT, text="type", optional="score")
    table.refuse_not_finite(LABEL.replace(" type", "") + " score" * table.has("score"))
    require_kinds(table)
    frame, object_id = table.whole("frame"), table.whole("id")
    class_id = class_ids(
        table.words["type"].tolist(), [TYPES[name][0] for name in classes]
    )
    used = (class_id >= 0) & (frame % stride == 0)
    last = (scene.frames - 1) * stride
    outside = used & ((frame < 0) | (frame > last))
    table.refuse(
        outside,
        lambda row: (
            f"frame {frame[row]}, but the last one of sequence {scene.name} is {last}"
        ),
    )
    table.refuse_degrees("rotation_y", used)
    for index in range(len(classes)):
        table.refuse_second_box(
            frame, object_id, np.flatnonzero(used & (class_id == index))
        )
    box = sensor_boxes(table.matrix(BOX_FIELDS)[used])
    box = box if poses is None else poses.to_world(box, frame[used])
    score = table.numbers.get("score", np.full(len(frame), np.nan))[used]
    velocity = unknown_velocity(len(box))
    return with_stored(
        scene,
        frame[used] // stride,
        object_id[used],
        class_id[used],
        box,
        score,
        velocity,
    )


def result_lines(
    frame: Ints,
    track_id: Ints,
    types: Sequence[str],
    box: Floats,
    score: Floats,
    poses: Poses | None,
) -> list[str]:
    """Lines of boxes [R, 7] in the scene's frame of reference, with -1 for the fields of the image."""
    fields = camera_fields(box if poses is None else poses.to_sensor(box, frame))
    return [
        f"{t} {i} {kind} -1 -1 -10 -1 -1 -1 -1 {' '.join(f'{value:.6f}' for value in row)} {s:.6f}"
        for t, i, kind, row, s in zip(
            frame, track_id, types, fields, score, strict=True
        )
    ]


def poses_of(card: Card, data: DataRoot, name: str) -> Poses | None:
    """Poses of all frames of a sequence; None if the card gives every frame in its own sensor frame."""
    return (
        read_poses(KittiTracking(card, data).root, name)
        if section_of(card, KittiSource).ego_motion
        else None
    )


def _open(card: Card, data: DataRoot, folder: Path) -> ReadTracks:
    stride = section_of(card, KittiSource).stride

    def read(scene: Scene) -> Scene:
        path = folder / f"{scene.name}.txt"
        if not path.is_file():
            raise DataError(
                f"no file {path}, expected tracks of each sequence that is run, or an empty file; {FEWER}"
            )
        return read_result(
            path, scene, card.task.classes, stride, poses_of(card, data, scene.name)
        )

    return read


FORM = TrackForm(
    "a folder with a KITTI tracking result <sequence>.txt for each scene",
    lambda path: path.is_dir() and any(path.glob("*.txt")),
    _open,
)
