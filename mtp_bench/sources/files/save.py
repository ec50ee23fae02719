"""Writing of own scenes as tables."""

import reprlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from ...core import (
    ID_LIMIT,
    DataError,
    Detections,
    MtpBenchError,
    Scene,
    Truth,
    file_stem,
    make_folder,
    require_known,
    require_replaceable,
    whole_folder,
)
from ..base import require_separate
from ..readers import MAX_WORD_LETTERS, write_table
from .columns import AREA, BOX_COLUMNS, FORMS, LABELS, TABLES
from .pictures import lane_columns

Columns = dict[str, NDArray[Any]]
TableForm = Literal["csv", "parquet"]
# longest quoted name: file names have at most 255 bytes, and writers add some
MAX_NAME_LETTERS = 200
# fields that tables do not have, with the value of a scene without them
_EMPTY: dict[str, Any] = {
    "image": None,
    "world": None,
    "recording": "",
    "truth_complete": True,
    "listed_targets": False,
    "tracks": None,
}
_ADVICE = "which would be lost: choose another folder, or move it away"


def save_scene(
    scene: Scene, folder: str | Path, classes: Sequence[str], form: TableForm = "csv"
) -> Path:
    """Write a scene as tables into a sub-folder, and return that.

    It is a sub-folder of ``folder``, named as the scene. ``classes``: names of its
    class ids, as ``task.classes`` of a card. Reading gives equal numbers to the last
    bit, but ids of objects that have names are written as these names and numbered anew
    when they are read. Raises DataError for a wrong scene, and MtpBenchError if it
    cannot be written or would replace other files.
    """
    require_known("form of a scene", form, FORMS)
    check_scene_name(scene.name)
    _require_storable(scene)
    tables = scene_tables(scene, classes)
    if scene.object_names:
        numbers = tables["truth"]["id"].tolist()
        tables["truth"]["id"] = np.array([scene.name_of(i) for i in numbers])
    if scene.lanes:
        tables["lanes"] = lane_columns(scene.lanes)
    if scene.annotated is not None:
        tables["annotated"] = {"frame": scene.annotated_frames}
    if scene.neutral_areas is not None:
        borders = scene.neutral_areas.T
        tables["neutral_areas"] = dict(zip(AREA, borders, strict=True))
    folder = Path(folder).expanduser()
    make_folder(folder)
    scene_folder = folder / file_stem(scene.name)
    _require_free(scene_folder)
    with whole_folder(scene_folder) as part_folder:
        for name, columns in tables.items():
            write_table(part_folder / f"{name}.{form}", columns)
    return scene_folder


def _require_storable(scene: Scene) -> None:
    """Raise MtpBenchError for a scene with fields that tables cannot hold."""
    filled: list[str] = []
    for name, empty in _EMPTY.items():
        value = getattr(scene, name)
        # the empty value of an array is None, and != would compare each number
        if isinstance(value, np.ndarray) or value != empty:
            filled.append(name)
    if filled:
        changes = ", ".join(f"{name}={_EMPTY[name]!r}" for name in filled)
        raise MtpBenchError(
            f"scene {scene.name!r} has {', '.join(filled)}, which tables cannot hold: "
            f"write it without, as dataclasses.replace(scene, {changes})"
        )


def _require_free(folder: Path) -> None:
    """Raise MtpBenchError if a folder for tables would replace other files."""
    require_replaceable(folder)
    if not folder.exists():
        return
    if not folder.is_dir():
        raise MtpBenchError(f"{folder} is a file, {_ADVICE}")
    names = (*TABLES, *LABELS, "lanes")
    tables = {f"{name}.{form}" for name in names for form in FORMS}
    other_files = {path.name for path in folder.iterdir()} - tables - {".DS_Store"}
    if other_files:
        raise MtpBenchError(f"{folder} has {min(other_files)!r}, {_ADVICE}")


def check_scene_name(name: object, where: str = "") -> None:
    """Raise DataError for a name of a scene that a file cannot have.

    ``where``: begin of the message.
    """
    is_text = isinstance(name, str) and name.encode("utf-8", "replace").decode() == name
    if not is_text or not 0 < len(quote(str(name), safe="")) <= MAX_NAME_LETTERS:
        raise DataError(
            f"{where}the name of a scene is {reprlib.repr(name)}, expected a text of 1 "
            f"to {MAX_NAME_LETTERS} characters, as written in the name of a file"
        )


def scene_tables(scene: Scene, classes: Sequence[str]) -> dict[str, Columns]:
    """Return the tables of a scene: ego, truth and, if it has some, detections.

    Raises DataError for rows that are not divided into frames, unknown classes and
    impossible object ids.
    """
    where = f"scene {scene.name!r}: "
    class_names = np.array(classes, dtype=np.str_)
    truth = scene.truth
    detections = scene.detections
    if not isinstance(truth, Truth):
        raise DataError(f"{where}truth is {type(truth).__name__}, expected Truth")
    if not isinstance(detections, Detections):
        raise DataError(
            f"{where}detections is {type(detections).__name__}, expected Detections; "
            "use one without rows for none"
        )
    _check_rows(f"{where}truth", truth, scene.frames, len(class_names))
    _check_rows(f"{where}detections", detections, scene.frames, len(class_names))
    _check_objects(scene, f"{where}truth")
    pose = dict(zip(("x", "y", "z", "yaw"), np.asarray(scene.ego).T, strict=True))
    frame = np.arange(scene.frames)
    columns = box_columns(truth, class_names)
    true_columns = {
        "frame": columns.pop("frame"),
        "id": np.asarray(truth.object_id),
        **columns,
        "eligible": np.asarray(truth.eligible).astype(np.int64),
        "neutral": np.asarray(truth.neutral).astype(np.int64),
    }
    if scene.visible is not None:
        true_columns["visible"] = scene.visible
    tables = {
        "ego": {"frame": frame, "time": np.asarray(scene.time), **pose},
        "truth": true_columns,
    }
    # without a table the detections are unknown, with an empty one there are none
    if scene.detector or len(detections.box):
        columns = box_columns(detections, class_names)
        tables["detections"] = {**columns, "score": detections.score}
    return tables


def box_columns(rows: Truth | Detections, class_names: NDArray[np.str_]) -> Columns:
    """Return the columns of boxes.

    ``class_names``: name of each class id.
    """
    return {
        "frame": rows.frame_of_rows,
        "class": class_names[np.asarray(rows.class_id, dtype=np.int64)],
        **dict(zip(BOX_COLUMNS, np.asarray(rows.box).T, strict=True)),
        **dict(zip(("vx", "vy"), np.asarray(rows.velocity).T, strict=True)),
    }


def _check_objects(scene: Scene, where: str) -> None:
    """Raise DataError for objects at one place, and for impossible ids and names."""
    object_ids = np.asarray(scene.truth.object_id)
    if not len(object_ids):
        raise DataError(f"{where} has no rows, expected one per object and frame")
    require_separate(scene.truth, where)
    if object_ids.dtype.kind not in "iu":
        raise DataError(
            f"{where}.object_id is {object_ids.dtype}, expected whole numbers; words "
            "become some by words, number = np.unique(ids, return_inverse=True) and "
            "object_names=dict(enumerate(words.tolist()))"
        )
    object_names: list[object] = []
    for object_id in np.unique(object_ids).tolist():
        name = scene.name_of(object_id)
        is_text = isinstance(name, str) and 0 < len(name.strip()) <= MAX_WORD_LETTERS
        if not is_text or name in object_names:
            raise DataError(
                f"scene {scene.name!r}: object_names of object {object_id} is "
                f"{name!r:.99}, expected 1 to {MAX_WORD_LETTERS} characters that name "
                "no other object"
            )
        object_names.append(name)
    if object_ids.min() < 0 or object_ids.max() > ID_LIMIT:
        raise DataError(
            f"{where}.object_id has {object_ids.min()} to {object_ids.max()}, "
            "expected whole "
            f"numbers from 0 to {ID_LIMIT}"
        )


def _check_rows(
    where: str, rows: Truth | Detections, frames: int, class_count: int
) -> None:
    """Raise DataError unless rows are divided into frames and have known classes."""
    row_start = np.asarray(rows.start)
    class_id = np.asarray(rows.class_id)
    for name, values in (("start", row_start), ("class_id", class_id)):
        if values.ndim != 1 or (len(values) and values.dtype.kind not in "iu"):
            raise DataError(
                f"{where}.{name} is {values.dtype} {list(values.shape)}, expected a "
                "row of whole numbers"
            )
    # slices, since ``start`` may be empty
    row_borders = (len(row_start) - 1, *row_start[:1], *row_start[-1:])
    if row_borders != (frames, 0, len(rows.box)) or (np.diff(row_start) < 0).any():
        raise DataError(
            f"{where}.start does not divide the {len(rows.box)} rows into {frames} "
            "frames"
        )
    if len(class_id) and (class_id.min() < 0 or class_id.max() >= class_count):
        raise DataError(
            f"{where}.class_id has {class_id.min()} to {class_id.max()}, expected "
            f"indices of {class_count} classes"
        )
