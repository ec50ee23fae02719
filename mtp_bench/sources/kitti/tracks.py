"""Tracks in the result form of the KITTI tracking benchmark.

One text per sequence, boxes in camera axes. A line is that of a label with a score
behind it: ``frame id type truncated occluded alpha left top right bottom height width
length x y z rotation_y score``. AB3DMOT writes such files.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...cards import Card
from ...core import DataError, Floats, Ints, Scene
from ..base import DataRoot, ReadTracks, TrackForm, class_ids, section_of
from ..motion import unknown_velocity
from ..readers import read_table
from ..stored_tracks import FEWER, with_stored
from .files import BOX_FIELDS, RESULT, camera_fields, require_kinds, sensor_boxes
from .layout import TYPES, KittiSource
from .poses import Poses, read_poses
from .source import KittiTracking


def read_result(
    path: Path, scene: Scene, classes: Sequence[str], stride: int, poses: Poses | None
) -> Scene:
    """Return the scene of every ``stride``-th frame with its tracks.

    ``poses``: poses of all frames; None without a common frame. Rows of other classes
    and other frames are left out; in a file with the columns of a label, scores are
    NaN. DataError names the line that is wrong.
    """
    table = read_table(path, RESULT, words="type", optional="score")
    require_kinds(table)
    kinds = [TYPES[name][0] for name in classes]
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

    Fields of the image are -1.
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
    "a folder with a KITTI tracking result <sequence>.txt for each scene",
    lambda path: path.is_dir() and any(path.glob("*.txt")),
    _open,
)
