"""Scenes from their tables, and the checks of own scenes."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from ...cards import Card, FilesSource, instead_of_stored
from ...core import (
    ID_LIMIT,
    NO_ROWS,
    DataError,
    Detections,
    Floats,
    Ints,
    Scene,
    Truth,
    class_hint,
    closest,
    starts_of_sorted,
)
from ..base import CameraImage, class_ids, names_by_number, no_detections, section_of
from ..motion import backward_velocity, unknown_velocity
from ..text import RowTable
from .checks import check_boxes, check_frames, check_objects, frame_index, scene_frames
from .columns import BOX, FORMS, PICTURES, TABLES
from .pictures import images_of, lanes_of
from .save import scene_tables
from .table import read_table

_SIMILAR = 0.85  # of file names: `detection` and `lane`, not `detections_old`


def read_scene(folder: Path, card: Card) -> Scene:
    """The scene with the tables in ``folder``, which has its name; rows of classes outside the task are skipped.

    Raises DataError that names the file, the line and the column that is wrong.
    """
    _refuse_misspelt(folder)
    tables = _read_tables(folder, (*TABLES, "lanes"))
    if "truth" not in tables:
        raise DataError(
            f"{folder}: no table truth.csv or truth.parquet, which the score needs"
        )
    if not len(tables["truth"]):
        raise DataError(
            f"{tables['truth'].source} has no rows, expected one per object and frame"
        )
    lanes = lanes_of(tables.pop("lanes")) if "lanes" in tables else ()
    number, time = scene_frames(str(folder), tables, card.task.rate)
    ego = np.zeros((len(time), 4))
    for i, column in enumerate(("x", "y", "z", "yaw")):
        if "ego" in tables and tables["ego"].has(column):
            ego[:, i] = tables["ego"].numbers[column]
    check_frames(time, ego, card, str(folder))
    index = frame_index(tables["truth"], number)
    scene = replace(
        _true_scene(unquote(folder.name), tables["truth"], index, time, ego, card),
        lanes=lanes,
    )
    if "detections" not in tables:
        return _for_card(scene, card, str(folder), detected=False)
    if card.detector is None:
        index = frame_index(tables["detections"], number)
        scene = replace(
            scene,
            detections=_detections(
                tables["detections"], index, len(time), card, scene.skipped
            ),
        )
    return _for_card(scene, card, str(folder), detected=True)


def read_images(folder: Path, card: Card) -> tuple[CameraImage, ...]:
    """The camera images of the scene in ``folder``; none without a table of them. Raises DataError as `read_scene`."""
    images = _read_tables(folder, ["images"])
    if not images:
        return ()
    tables = _read_tables(folder, ["ego"]) or _read_tables(
        folder, TABLES
    )  # the rows of an ego table are the frames
    number, _ = scene_frames(str(folder), tables, card.task.rate)
    return images_of(images["images"], folder, number)


def checked_scene(scene: Scene, card: Card) -> Scene:
    """A `Scene` object for ``card``, whose classes its class ids index; raises DataError for impossible values."""
    where = f"scene {scene.name!r}"
    columns = scene_tables(scene, card.task.classes)
    check_frames(np.asarray(scene.time), np.asarray(scene.ego), card, where)
    for name in ("truth", "detections"):
        if name in columns:
            words = {"class": columns[name].pop("class")}
            rows = np.arange(len(words["class"]))
            numbers: dict[str, Floats] = {
                key: np.asarray(own, dtype=np.float64)
                for key, own in columns[name].items()
            }
            table = RowTable(f"{where}: {name}", "row", rows, numbers, words)
            check_boxes(table, table.whole("frame"), scene.frames, name == "truth")
            if name == "truth":
                check_objects(
                    table, table.whole("frame"), table.whole("id"), card.task.classes
                )
    return _for_card(scene, card, where, detected="detections" in columns)


def find_table(folder: Path, name: str) -> Path | None:
    """The file of a table; None without one. Raises DataError if there are two."""
    paths = [
        path for form in FORMS if os.path.lexists(path := folder / f"{name}.{form}")
    ]
    if len(paths) > 1:
        raise DataError(
            f"{folder} has {paths[0].name} and {paths[1].name}, expected only one of them"
        )
    return paths[0] if paths else None


def _read_tables(folder: Path, names: Iterable[str]) -> dict[str, RowTable]:
    """Tables of the folder by name; of ``names``, those that it has."""
    paths = {name: find_table(folder, name) for name in names}
    return {
        name: read_table(path, name) for name, path in paths.items() if path is not None
    }


def _refuse_misspelt(folder: Path) -> None:
    """Raise DataError for a file with nearly the name of a missing table (``detection.csv``)."""
    missing = [
        name for name in (*TABLES, *PICTURES) if find_table(folder, name) is None
    ]
    for path in sorted(folder.iterdir()):
        form = path.suffix.lower().removeprefix(".")
        meant = closest(path.stem, missing, _SIMILAR)
        if form in FORMS and meant:
            raise DataError(
                f"{path} is not a known table; did you mean {meant}.{form}?"
            )


def _for_card(scene: Scene, card: Card, where: str, detected: bool) -> Scene:
    """The scene as the card says: its truth is complete or not, its detections are stored or to be simulated."""
    if not card.source.traits.truth_complete:
        scene = replace(scene, truth_complete=False)
    if card.detector is None and not detected:
        raise DataError(f"{where}: no detections{instead_of_stored(card)}")
    if card.detector is None:
        return replace(
            scene,
            detector=scene.detector
            or f"{section_of(card, FilesSource).detector}, stored detections",
        )
    if not scene.truth_complete:
        got = "its truth has prediction targets only, so a simulated detector would miss all other objects"
        raise DataError(f"{where}: {got}; use the detections of the files")
    return replace(
        scene, detections=no_detections(scene.frames), detector="", simulated=False
    )


def _true_scene(
    name: str, table: RowTable, frame: Ints, time: Floats, ego: Floats, card: Card
) -> Scene:
    """Scene without detections, from the table of its truth."""
    skipped: dict[str, int] = {}
    row = _usable_rows(table, frame, len(time), "truth", card.task.classes, skipped)
    number = ids_of(table)
    check_objects(table, frame, number, card.task.classes)
    frame, number, box = frame[row], number[row], boxes_of(table)[row]
    backward = backward_velocity(frame, number, box[:, :2], time, 1 / card.task.rate)
    velocity = velocities_of(table)[row] if table.has("vx") else backward
    class_id = class_ids_of(table, card.task.classes)[row]
    eligible = table.numbers.get("eligible", np.ones(len(table)))[row] == 1
    neutral = table.numbers.get("neutral", np.zeros(len(table)))[row] == 1
    truth = Truth(
        starts_of_sorted(frame, len(time)),
        box,
        velocity,
        class_id,
        number,
        eligible,
        neutral,
    )
    none, names = (
        no_detections(len(time)),
        names_by_number(number, table.words["id"][row]),
    )
    visible = table.numbers["visible"][row] if table.has("visible") else None
    return Scene(
        name,
        time,
        ego,
        truth,
        none,
        visible=visible,
        skipped=skipped,
        object_names=names,
    )


def _detections(
    table: RowTable, frame: Ints, frames: int, card: Card, skipped: dict[str, int]
) -> Detections:
    row = _usable_rows(table, frame, frames, "detections", card.task.classes, skipped)
    start, class_id = (
        starts_of_sorted(frame[row], frames),
        class_ids_of(table, card.task.classes)[row],
    )
    return Detections(
        start,
        boxes_of(table)[row],
        velocities_of(table)[row],
        class_id,
        scores_of(table)[row],
    )


def _usable_rows(
    table: RowTable,
    frame: Ints,
    frames: int,
    name: str,
    classes: Sequence[str],
    skipped: dict[str, int],
) -> Ints:
    """Rows of ``classes``, sorted by frame and otherwise in their order; all rows are checked."""
    check_boxes(table, frame, frames, name == "truth")
    kind = table.words["class"]
    used = np.isin(kind, classes)
    others, count = (
        column.tolist() for column in np.unique(kind[~used], return_counts=True)
    )
    if others and not used.any():
        first = str(kind[0])
        advice = (
            class_hint(first, classes)
            or "`mtp-bench envs` shows the classes of each environment"
        )
        got = f"{first!r}, and no other row of the {name} has a class of the task"
        raise DataError(
            f"{table.where(0, 'class')}: {got}, one of {', '.join(classes)}; {advice}"
        )
    for other, number in zip(others, count, strict=True):
        parts = (
            f"{name} of class {other!r}, which the task does not have",
            class_hint(other, classes),
        )
        skipped[": ".join(filter(None, parts))] = number
    row = np.flatnonzero(used)
    return row[np.argsort(frame[row], kind="stable")]


def boxes_of(table: RowTable) -> Floats:
    """Boxes ``[R, 7]``; without z they stand on the ground."""
    columns = {"z": table["h"] / 2, **table.numbers}
    return np.column_stack([columns[name] for name in BOX])


def velocities_of(table: RowTable) -> Floats:
    """Velocities ``[R, 2]``; NaN if the table has none."""
    return table.matrix("vx vy") if table.has("vx") else unknown_velocity(len(table))


def scores_of(table: RowTable) -> Floats:
    """Scores ``[R]``; 1 if the table has none."""
    return table.numbers.get("score", np.ones(len(table)))


def class_ids_of(table: RowTable, classes: Sequence[str]) -> Ints:
    """Index of each row's class among ``classes`` ``[R]``, -1 for another class."""
    names, index = np.unique(table.words["class"], return_inverse=True)
    return class_ids(names.tolist(), classes)[index]


def ids_of(table: RowTable) -> Ints:
    """Numbers of the objects ``[R]``: those of the table, or indices of the sorted words.

    If one id is not a whole number from 0 to `ID_LIMIT`, all are words.
    """
    words = table.words["id"]
    try:
        number = words.astype(np.int64) if len(words) else NO_ROWS
        fits = not ((number < 0) | (number > ID_LIMIT)).any()
        if fits and np.array_equal(
            number.astype(np.str_), words
        ):  # otherwise 1 and 01 would be one object
            return number
    except (ValueError, OverflowError):
        pass
    return np.unique(words, return_inverse=True)[1]
