"""Detections and tracks in the official submission form.

One Feather file, boxes in the ego frame of their sweep.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cards import Card
from ...core import (
    Bools,
    DataError,
    Detections,
    Floats,
    Ints,
    Scene,
    nearest,
)
from ..base import (
    DataRoot,
    ReadTracks,
    TrackForm,
    class_ids,
    detections_by_frame,
    section_of,
)
from ..motion import unknown_velocity
from ..stored_tracks import FEWER, with_stored
from ..tables import RowTable
from .files import (
    BOX,
    CATEGORIES,
    NEUTRAL,
    TIME,
    Argoverse2Source,
    Sweeps,
    log_folder,
    read_feather,
)


@dataclass(frozen=True, eq=False)
class LogBoxes:
    """Boxes of a log in frames and classes of a card, neutral ones included."""

    table: RowTable  # rows in the file
    frame: Ints  # [R]
    class_id: Ints  # [R] of the task
    box: Floats  # [R, 7] in the city less the origin
    within_reach: Bools  # [R] the centre is within reach of the ego


def read_detections(path: Path, sweeps: Sweeps, card: Card) -> Detections:
    """Read detections of a log within reach, without velocities.

    They are sorted by frame, then in the order of the file. Raises DataError for a cell
    that is wrong, and for a time at which the log has no sweep.
    """
    boxes = read_boxes(path, sweeps, card, "score", log=sweeps.folder.name)
    is_used = boxes.within_reach
    return detections_by_frame(
        len(sweeps.time),
        boxes.frame[is_used],
        boxes.box[is_used],
        boxes.class_id[is_used],
        boxes.table["score"][is_used],
    )


def read_tracks(path: Path, sweeps: Sweeps, card: Card, scene: Scene) -> Scene:
    """Return the scene with the tracks of its log within reach.

    Raises DataError as `read_detections`, and if the log has no tracks.
    """
    boxes = read_boxes(path, sweeps, card, "score", "track_id", scene.name)
    is_used = boxes.within_reach
    if not is_used.any():
        raise DataError(
            f"{path} has no tracks of log {scene.name}, expected those of each log "
            f"that is run; {FEWER}"
        )
    identity = boxes.table["track_id"]
    boxes.table.refuse_second_box(boxes.frame, identity, boxes.class_id)
    return with_stored(
        scene,
        boxes.frame[is_used],
        identity[is_used],
        boxes.class_id[is_used],
        boxes.box[is_used],
        boxes.table["score"][is_used],
        unknown_velocity(int(is_used.sum())),
    )


def read_boxes(
    path: Path, sweeps: Sweeps, card: Card, numbers: str, words: str = "", log: str = ""
) -> LogBoxes:
    """Read boxes with further columns ``numbers`` and ``words``.

    ``log``: read only its rows. Sweeps between frames, and classes outside the task,
    are left out. Raises DataError as `read_feather`, and for an unknown category or
    time.
    """
    table, stamp = read_feather(path, f"{BOX} {numbers}", f"category {words}", log)
    category_names = table["category"]

    def problem(row: int) -> str:
        name = str(category_names[row])
        advice = nearest(name.upper(), CATEGORIES)
        return f"{name!r} is not a category of Argoverse 2{advice}"

    table.refuse(~np.isin(category_names, list(CATEGORIES)), problem, "category")
    labels = [
        CATEGORIES[name].removeprefix(NEUTRAL) for name in category_names.tolist()
    ]
    class_id = class_ids(labels, card.task.classes)
    frame = sweeps.frame_of(table, stamp)
    is_used = (frame >= 0) & (class_id >= 0)
    table = table.select(is_used)
    frame = frame[is_used]
    box = sweeps.boxes(table, frame)
    distance_m = np.linalg.norm(box[:, :2] - sweeps.ego[frame, :2], axis=1)
    within_reach = distance_m <= section_of(card, Argoverse2Source).reach
    return LogBoxes(table, frame, class_id[is_used], box, within_reach)


def tracking_submission(
    card: Card,
    data: DataRoot,
    scene: Scene,
    frame: Ints,
    track_id: Ints,
    classes: NDArray[np.str_],
    box: Floats,
    score: Floats,
) -> dict[str, NDArray[Any]]:
    """Return columns of a tracking submission for boxes [R, 7] of a scene.

    ``classes`` [R]: names of the task's classes.
    """
    sweeps = _sweeps(card, data, scene)
    # reversed: of the categories of a class the first one stays
    category_of_class = {
        label: name for name, label in reversed(list(CATEGORIES.items()))
    }
    categories = [category_of_class[name] for name in classes.tolist()]
    place, rotation = sweeps.to_ego(frame, box)
    columns = np.hstack([place, box[:, 4:], rotation]).T
    return {
        "log_id": np.full(len(box), scene.name),
        TIME: sweeps.stamp[frame * sweeps.stride],
        "category": np.array(categories, dtype=np.str_),
        **dict(zip(BOX.split(), columns, strict=True)),
        "score": score,
        "track_id": track_id,
    }


def _sweeps(card: Card, data: DataRoot, scene: Scene) -> Sweeps:
    stride = section_of(card, Argoverse2Source).stride
    return Sweeps.read(log_folder(card, data, scene.name), stride)


def _open(card: Card, data: DataRoot, path: Path) -> ReadTracks:
    return lambda scene: read_tracks(path, _sweeps(card, data, scene), card, scene)


FORM = TrackForm(
    name="a .feather file in the form of Argoverse 2's tracking submission",
    fits=lambda path: path.is_file() and path.suffix == ".feather",
    open=_open,
)
