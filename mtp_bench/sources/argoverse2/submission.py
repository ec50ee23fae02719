"""Detections and tracks in the official submission form: one Feather file, boxes in the ego frame of their sweep."""

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
    starts_of_sorted,
)
from ..base import DataRoot, ReadTracks, TrackForm, class_ids, section_of
from ..motion import unknown_velocity
from ..stored_tracks import FEWER, with_stored
from ..text import RowTable, repeated
from .feather import BOX, PLACE, ROTATION, SIZE, TIME, Sweeps, read_feather
from .layout import CATEGORIES, NEUTRAL, Argoverse2Source, log_folder


def read_detections(path: Path, sweeps: Sweeps, card: Card) -> Detections:
    """Detections of a log within reach, sorted by frame, otherwise in the order of the file; no velocities.

    Raises DataError for a cell that is wrong, and for a time at which the log has no sweep.
    """
    table, frame, class_id, box, near = read_boxes(
        path, sweeps, card, "score", log=sweeps.folder.name
    )
    row = np.argsort(frame, kind="stable")
    row = row[near[row]]
    start = starts_of_sorted(frame[row], len(sweeps.time))
    return Detections(
        start, box[row], unknown_velocity(len(row)), class_id[row], table["score"][row]
    )


def read_tracks(path: Path, sweeps: Sweeps, card: Card, scene: Scene) -> Scene:
    """The scene with the tracks of its log within reach; raises DataError as `read_detections`, or without any."""
    table, frame, class_id, box, near = read_boxes(
        path, sweeps, card, "score", "track_id", scene.name
    )
    if not near.any():
        raise DataError(
            f"{path} has no tracks of log {scene.name}, expected those of each log that is run; {FEWER}"
        )
    identity, velocity = table.words["track_id"], unknown_velocity(int(near.sum()))
    twice = repeated(frame, identity, class_id)
    table.refuse(
        twice, "a second box of this track in its sweep, expected one", "track_id"
    )
    return with_stored(
        scene,
        frame[near],
        identity[near],
        class_id[near],
        box[near],
        table["score"][near],
        velocity,
    )


def read_boxes(
    path: Path, sweeps: Sweeps, card: Card, numbers: str, words: str = "", log: str = ""
) -> tuple[RowTable, Ints, Ints, Floats, Bools]:
    """Boxes of a log in the frames and of the classes of ``card``, neutral ones too.

    Their rows in the file with the further columns ``numbers`` and ``words``, the frame [R] and the class [R] of each,
    the box [R, 7] in the city less the origin, and True [R] for those with their centre within reach of the ego.
    """
    table, stamp = read_feather(path, f"{BOX} {numbers}", f"category {words}", log)
    category = table.words["category"]

    def problem(row: int) -> str:
        got = str(category[row])
        return f"{got!r} is not a category of Argoverse 2{nearest(got.upper(), CATEGORIES)}"

    table.refuse(~np.isin(category, tuple(CATEGORIES)), problem, "category")
    kind, place = np.unique(category, return_inverse=True)
    names = [CATEGORIES[word].removeprefix(NEUTRAL) for word in kind.tolist()]
    frame, class_id = (
        sweeps.frame_of(table, stamp),
        class_ids(names, card.task.classes)[place],
    )
    used = (frame >= 0) & (class_id >= 0)
    table, frame = table.select(used), frame[used]
    box = sweeps.boxes(table, frame)
    away = np.linalg.norm(box[:, :2] - sweeps.ego[frame, :2], axis=1)
    return (
        table,
        frame,
        class_id[used],
        box,
        away <= section_of(card, Argoverse2Source).reach,
    )


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
    """Columns of a tracking submission for boxes [R, 7] of a scene; ``classes`` [R]: names of the task's classes."""
    sweeps = _sweeps(card, data, scene)
    category = {name: word for word, name in reversed(list(CATEGORIES.items()))}
    place, rotation = sweeps.to_ego(frame, box)
    return {
        "log_id": np.full(len(box), scene.name),
        TIME: sweeps.stamp[frame * sweeps.stride],
        "category": np.array(
            [category[name] for name in classes.tolist()], dtype=np.str_
        ),
        **dict(
            zip(
                f"{PLACE} {SIZE} {ROTATION}".split(),
                np.hstack([place, box[:, 4:], rotation]).T,
                strict=True,
            )
        ),
        "score": score,
        "track_id": track_id,
    }


def _sweeps(card: Card, data: DataRoot, scene: Scene) -> Sweeps:
    return Sweeps.read(
        log_folder(card, data, scene.name), section_of(card, Argoverse2Source).stride
    )


def _open(card: Card, data: DataRoot, path: Path) -> ReadTracks:
    return lambda scene: read_tracks(path, _sweeps(card, data, scene), card, scene)


FORM = TrackForm(
    "a .feather file in the form of Argoverse 2's tracking submission",
    lambda path: path.is_file() and path.suffix == ".feather",
    _open,
)
