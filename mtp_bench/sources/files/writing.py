"""The one writer of own scenes: everything but stored tracks in an NPZ file, or what tables can hold in tables."""

from __future__ import annotations

import csv
import reprlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from ...errors import DataError, MtpBenchError, UnknownNameError
from ...files import file_stem, make_folder, require_replaceable, whole_file, whole_folder
from ...types import Scene
from .archive import arrays_of
from .columns import BOX, FORMS, TABLES

Form = Literal["npz", "csv", "parquet"]
Columns = dict[str, NDArray[Any]]
MOST_NAME = 200  # characters of a quoted name: files of 255 bytes are usual, and writers need some of them
_EMPTY: dict[str, Any] = {  # fields that no table has, and their value in a scene that tables can hold
    "image": None, "world": None, "lanes": (), "recording": "", "truth_complete": True, "listed_targets": False,
}  # fmt: skip


def save_scene(scene: Scene, folder: str | Path, classes: Sequence[str], form: Form = "npz") -> Path:
    """Write a scene into a folder of own scenes, and return the file or the sub-folder that it is in.

    ``classes``: the names of its class ids, as in ``task.classes`` of a card. ``form``: "npz" holds the whole scene
    but stored tracks; "csv" and "parquet" are tables that other programs read. What is read again is equal to the last
    bit.

    Raises DataError for a scene that is none, or whose name no file could have, MtpBenchError where it cannot be
    written, has stored tracks or what no table can hold, or where a folder that holds more than tables would be lost.
    """
    if form not in ("npz", *FORMS):
        raise UnknownNameError("form of a scene", str(form), ("npz", *FORMS))
    require_plain_name(scene.name)
    if scene.tracks is not None:
        raise MtpBenchError(
            f"scene {scene.name!r} has stored tracks, which have files of their own (`mtp-bench import tracks`): write "
            "it without them, as dataclasses.replace(scene, tracks=None)"
        )
    arrays, folder = arrays_of(scene, classes), Path(folder).expanduser()
    make_folder(folder)
    path = folder / (file_stem(scene.name) + (".npz" if form == "npz" else ""))
    if form == "npz":
        with whole_file(path) as part, part.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)
        return path
    _require_plain(scene)
    _require_tables_alone(path)
    with whole_folder(path) as part:
        for table, columns in _tables(arrays).items():
            write_table(part / f"{table}.{form}", columns)
    return path


def require_plain_name(name: object, where: str = "") -> None:
    """Raise DataError, which begins with ``where``, for the name of a scene that no file could have."""
    sound = isinstance(name, str) and name.encode("utf-8", "replace").decode() == name
    if not sound or not 0 < len(quote(str(name), safe="")) <= MOST_NAME:
        raise DataError(
            f"{where}a scene is called {reprlib.repr(name)}, expected a text of 1 to {MOST_NAME} characters, as they "
            "are written in the name of a file"
        )


def write_table(path: Path, columns: Columns) -> None:
    """Columns as CSV or, by the suffix, Parquet; NaN is an empty cell."""
    if path.suffix == ".parquet":
        try:
            import pyarrow
            from pyarrow import parquet
        except ImportError:
            raise MtpBenchError("Parquet needs pyarrow: pip install pyarrow, or write CSV") from None
        parquet.write_table(pyarrow.table({name: pyarrow.array(column) for name, column in columns.items()}), path)
        return
    shown = [["" if value != value else value for value in column.tolist()] for column in columns.values()]  # noqa: PLR0124
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*shown, strict=True))


def _require_plain(scene: Scene) -> None:
    values = {name: getattr(scene, name) for name in _EMPTY}
    held = [name for name, value in values.items() if isinstance(value, np.ndarray) or value != _EMPTY[name]]
    if held:
        raise MtpBenchError(f"scene {scene.name!r} has {', '.join(held)}, which no table can hold: write it as NPZ")


def _require_tables_alone(folder: Path) -> None:
    """Raise MtpBenchError unless ``folder`` is new, or holds tables of a scene and nothing else: it is replaced."""
    require_replaceable(folder)
    if folder.exists() and not folder.is_dir():
        raise MtpBenchError(f"{folder} is a file, which would be lost: choose another folder, or move it away")
    tables = {".DS_Store", *(f"{table}.{form}" for table in TABLES for form in FORMS)}
    other = sorted(path.name for path in folder.iterdir() if path.name not in tables) if folder.is_dir() else []
    if other:
        raise MtpBenchError(f"{folder} holds {other[0]!r}, which would be lost: choose another folder, or move it away")


def _tables(arrays: Columns) -> dict[str, Columns]:
    """The tables of a scene."""
    time = arrays["time"]
    ego = {"frame": np.arange(len(time)), "time": time}
    tables = {"ego": ego | dict(zip(("x", "y", "z", "yaw"), arrays["ego"].T, strict=True))}
    for table, further in (("truth", ("eligible", "neutral", "visible")), ("detections", ("score",))):
        if f"{table}_frame" not in arrays:
            continue
        columns: Columns = {"frame": arrays[f"{table}_frame"]}
        if table == "truth":
            columns["id"] = arrays["truth_id"]
        columns["class"] = arrays[f"{table}_class"]
        columns |= dict(zip(BOX, arrays[f"{table}_box"].T, strict=True))
        columns |= dict(zip(("vx", "vy"), arrays[f"{table}_velocity"].T, strict=True))
        for name in further:
            if f"{table}_{name}" in arrays:
                value = arrays[f"{table}_{name}"]
                columns[name] = value.astype(np.int64) if value.dtype == bool else value
        tables[table] = columns
    return tables
