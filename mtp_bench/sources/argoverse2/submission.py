"""Detections and tracks in the official submission form: one Feather file, boxes in the ego frame of their sweep."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cards import Card
from ...errors import DataError, nearest
from ...types import Bools, Detections, Floats, Ints, Scene, starts_of_sorted
from ..base import DataRoot, ReadTracks, TrackForm, class_ids, section_of
from ..stored_tracks import FEWER, with_stored
from ..text import RowTable, repeated
from .feather import BOX, PLACE, ROTATION, SIZE, TIME, Sweeps, read_feather
from .layout import CATEGORIES, NEUTRAL, Argoverse2Source, log_folder


def read_detections(path: Path, sweeps: Sweeps, card: Card) -> Detections:
    """Detections of a log within reach, sorted by frame, otherwise in the order of the file; no velocities.

    Raises DataError for a cell that is wrong, and for a time at which the log has no sweep.
    """
    table, frame, class_id, box = _read(path, sweeps, card)
    order = np.argsort(frame, kind="stable")
    start, unknown = starts_of_sorted(frame[order], len(sweeps.time)), np.full((len(order), 2), np.nan)
    return Detections(start, box[order], unknown, class_id[order], table["score"][order])


def read_tracks(path: Path, sweeps: Sweeps, card: Card, scene: Scene) -> Scene:
    """The scene with the tracks of its log within reach; raises DataError as `read_detections`, or without any."""
    table, frame, class_id, box = _read(path, sweeps, card, "track_id")
    if not len(table):
        raise DataError(f"{path} has no tracks of log {scene.name}, expected those of each log that is run; {FEWER}")
    identity = table.words["track_id"]
    twice = repeated(frame, identity, class_id)
    table.refuse(twice, "a second box of this track in its sweep, expected one", "track_id")
    unknown = np.full((len(box), 2), np.nan)
    return with_stored(scene, frame, identity, class_id, box, table["score"], unknown)


def classes_of(table: RowTable, card: Card) -> tuple[Ints, Bools]:
    """Class [R] of each row in the task, -1 for others, and True [R] where it is neutral.

    Raises DataError for a word that is not an official category.
    """
    category, place = np.unique(table.words["category"], return_inverse=True)
    words = category.tolist()
    unknown = np.array([word not in CATEGORIES for word in words], dtype=bool)[place]

    def problem(row: int) -> str:
        got = words[place[row]]
        return f"{got!r} is not a category of Argoverse 2{nearest(got.upper(), CATEGORIES)}"

    table.refuse(unknown, problem, "category")
    names = [CATEGORIES[word] for word in words]
    class_id = class_ids([name.removeprefix(NEUTRAL) for name in names], card.task.classes)
    return class_id[place], np.array([name.startswith(NEUTRAL) for name in names], dtype=bool)[place]


def within_reach(box: Floats, frame: Ints, sweeps: Sweeps, card: Card) -> Bools:
    """True [R] for boxes whose centre is within the card's reach of the ego."""
    away = np.linalg.norm(box[:, :2] - sweeps.ego[frame, :2], axis=1)
    return np.asarray(away <= section_of(card, Argoverse2Source).reach)


def tracking_submission(
    card: Card, data: DataRoot, scene: Scene, frame: Ints, track_id: Ints, classes: NDArray[np.str_], box: Floats,
    score: Floats,
) -> dict[str, NDArray[Any]]:  # fmt: skip
    """Columns of a tracking submission for boxes [R, 7] of a scene; ``classes`` [R]: names of the task's classes."""
    sweeps = _sweeps(card, data, scene)
    category = {name: word for word, name in reversed(list(CATEGORIES.items()))}
    place, rotation = sweeps.to_ego(frame, box)
    return {
        "log_id": np.full(len(box), scene.name),
        TIME: sweeps.stamp[frame * sweeps.stride],
        "category": np.array([category[name] for name in classes.tolist()], dtype=np.str_),
        **dict(zip(f"{PLACE} {SIZE} {ROTATION}".split(), np.hstack([place, box[:, 4:], rotation]).T, strict=True)),
        "score": score,
        "track_id": track_id,
    }


def _read(path: Path, sweeps: Sweeps, card: Card, identity: str = "") -> tuple[RowTable, Ints, Ints, Floats]:
    """Rows of a log within reach in the frames and of the classes of the card, with frame, class and box of each."""
    table, stamp = read_feather(path, f"{BOX} score", f"category {identity}", sweeps.folder.name)
    frame, (class_id, _) = sweeps.frame_of(table, stamp), classes_of(table, card)
    used = (frame >= 0) & (class_id >= 0)
    table, frame, class_id = table.select(used), frame[used], class_id[used]
    box = sweeps.boxes(table, frame)
    near = within_reach(box, frame, sweeps, card)
    return table.select(near), frame[near], class_id[near], box[near]


def _sweeps(card: Card, data: DataRoot, scene: Scene) -> Sweeps:
    return Sweeps.read(log_folder(card, data, scene.name), section_of(card, Argoverse2Source).stride)


def _open(card: Card, data: DataRoot, path: Path) -> ReadTracks:
    return lambda scene: read_tracks(path, _sweeps(card, data, scene), card, scene)


FORM = TrackForm(
    "a .feather file in the form of Argoverse 2's tracking submission",
    lambda path: path.is_file() and path.suffix == ".feather",
    _open,
)
