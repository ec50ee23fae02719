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
from ..text import MOST_LETTERS
from .columns import BOX, FORMS, TABLES
from .pictures import lane_columns
from .table import write_table

TableForm = Literal["csv", "parquet"]
LONGEST_NAME = 200  # characters of a quoted name: files allow 255 bytes, and writers need some of them
_EMPTY: dict[
    str, Any
] = {  # fields that tables do not have, with the value of a scene without them
    "image": None,
    "world": None,
    "recording": "",
    "truth_complete": True,
    "listed_targets": False,
    "tracks": None,
}


def save_scene(
    scene: Scene, folder: str | Path, classes: Sequence[str], form: TableForm = "csv"
) -> Path:
    """Write a scene as tables into a sub-folder of a folder of own scenes, and return the sub-folder.

    ``classes``: names of its class ids, as ``task.classes`` of a card. Reading gives equal numbers to the last bit, but
    ids of objects that have names are written as these names and numbered anew when they are read.
    Raises DataError for a wrong scene, and MtpBenchError if it cannot be written or would replace other files.
    """
    require_known("form of a scene", form, FORMS)
    check_scene_name(scene.name)
    values = {name: getattr(scene, name) for name in _EMPTY}
    extra = [
        name
        for name, value in values.items()
        if isinstance(value, np.ndarray) or value != _EMPTY[name]
    ]
    if extra:
        without = f"dataclasses.replace(scene, {', '.join(f'{name}={_EMPTY[name]!r}' for name in extra)})"
        got = f"scene {scene.name!r} has {', '.join(extra)}, which tables cannot hold"
        raise MtpBenchError(f"{got}: write it without, as {without}")
    tables, folder = scene_tables(scene, classes), Path(folder).expanduser()
    if scene.object_names:
        tables["truth"]["id"] = np.array(
            [scene.name_of(number) for number in tables["truth"]["id"].tolist()]
        )
    if scene.lanes:
        tables["lanes"] = lane_columns(scene.lanes)
    make_folder(folder)
    path = folder / file_stem(scene.name)
    require_replaceable(path)
    if path.exists() and not path.is_dir():
        raise MtpBenchError(
            f"{path} is a file, which would be lost: choose another folder, or move it away"
        )
    ours = {
        ".DS_Store",
        *(f"{name}.{form}" for name in (*TABLES, "lanes") for form in FORMS),
    }
    other = (
        sorted(file.name for file in path.iterdir() if file.name not in ours)
        if path.is_dir()
        else []
    )
    if other:
        raise MtpBenchError(
            f"{path} has {other[0]!r}, which would be lost: choose another folder, or move it away"
        )
    with whole_folder(path) as part:
        for name, columns in tables.items():
            write_table(part / f"{name}.{form}", columns)
    return path


def check_scene_name(name: object, where: str = "") -> None:
    """Raise DataError, which begins with ``where``, for a name of a scene that a file cannot have."""
    sound = isinstance(name, str) and name.encode("utf-8", "replace").decode() == name
    if not sound or not 0 < len(quote(str(name), safe="")) <= LONGEST_NAME:
        expected = f"expected a text of 1 to {LONGEST_NAME} characters, as written in the name of a file"
        raise DataError(
            f"{where}the name of a scene is {reprlib.repr(name)}, {expected}"
        )


def scene_tables(
    scene: Scene, classes: Sequence[str]
) -> dict[str, dict[str, NDArray[Any]]]:
    """Tables of a scene: ego, truth and, if it has detections, detections; columns by name.

    Raises DataError for rows that are not divided into frames, unknown classes and impossible object ids.
    """
    names, of_scene = np.array(classes, dtype=np.str_), f"scene {scene.name!r}:"
    truth, detections = scene.truth, scene.detections
    for name, rows, kind in (
        ("truth", truth, Truth),
        ("detections", detections, Detections),
    ):
        where = f"{of_scene} {name}"
        if not isinstance(rows, kind):
            hint = "; use one without rows for none" if kind is Detections else ""
            raise DataError(
                f"{where} is {type(rows).__name__}, expected {kind.__name__}{hint}"
            )
        _check_rows(where, rows, scene.frames, len(names))
    number = np.asarray(truth.object_id)
    if not len(number):
        raise DataError(
            f"{of_scene} truth has no rows, expected one per object and frame"
        )
    require_separate(truth, f"{of_scene} truth")
    if number.dtype.kind not in "iu":
        raise DataError(
            f"{of_scene} truth.object_id is {number.dtype}, expected whole numbers; words become some by "
            "words, number = np.unique(ids, return_inverse=True) and object_names=dict(enumerate(words.tolist()))"
        )
    _check_names(scene, np.unique(number).tolist())
    if number.min() < 0 or number.max() > ID_LIMIT:
        got = f"{number.min()} to {number.max()}"
        raise DataError(
            f"{of_scene} truth.object_id has {got}, expected whole numbers from 0 to {ID_LIMIT}"
        )
    ego = dict(zip(("x", "y", "z", "yaw"), np.asarray(scene.ego).T, strict=True))
    tables = {
        "ego": {"frame": np.arange(scene.frames), "time": np.asarray(scene.time), **ego}
    }
    columns = box_columns(truth, names)
    tables["truth"] = {"frame": columns["frame"], "id": number, **columns}
    tables["truth"] |= {
        name: np.asarray(getattr(truth, name)).astype(np.int64)
        for name in ("eligible", "neutral")
    }
    if scene.visible is not None:
        tables["truth"]["visible"] = scene.visible
    if scene.detector or len(
        detections.box
    ):  # otherwise it has none, which differs from an empty frame
        tables["detections"] = {
            **box_columns(detections, names),
            "score": detections.score,
        }
    return tables


def box_columns(
    rows: Truth | Detections, names: NDArray[np.str_]
) -> dict[str, NDArray[Any]]:
    """Columns of boxes; ``names``: of the class ids."""
    return {
        "frame": rows.frame_of_rows,
        "class": names[np.asarray(rows.class_id, dtype=np.int64)],
        **dict(zip(BOX, np.asarray(rows.box).T, strict=True)),
        **dict(zip(("vx", "vy"), np.asarray(rows.velocity).T, strict=True)),
    }


def _check_names(scene: Scene, numbers: Sequence[int]) -> None:
    names = [scene.name_of(number) for number in numbers]
    for i, name in enumerate(names):
        if (
            not isinstance(name, str)
            or not 0 < len(name.strip()) <= MOST_LETTERS
            or name in names[:i]
        ):
            where, expected = (
                f"scene {scene.name!r}: object_names of object {numbers[i]}",
                f"1 to {MOST_LETTERS}",
            )
            raise DataError(
                f"{where} is {name!r:.99}, expected {expected} characters that name no other object"
            )


def _check_rows(
    where: str, rows: Truth | Detections, frames: int, classes: int
) -> None:
    start, class_id = np.asarray(rows.start), np.asarray(rows.class_id)
    for name, value in (("start", start), ("class_id", class_id)):
        if value.ndim != 1 or (len(value) and value.dtype.kind not in "iu"):
            raise DataError(
                f"{where}.{name} is {value.dtype} {list(value.shape)}, expected a row of whole numbers"
            )
    if (
        len(start) != frames + 1
        or start[0] != 0
        or start[-1] != len(rows.box)
        or (np.diff(start) < 0).any()
    ):
        raise DataError(
            f"{where}.start does not divide the {len(rows.box)} rows into {frames} frames"
        )
    if len(class_id) and (class_id.min() < 0 or class_id.max() >= classes):
        got = f"{class_id.min()} to {class_id.max()}"
        raise DataError(
            f"{where}.class_id has {got}, expected indices of {classes} classes"
        )
