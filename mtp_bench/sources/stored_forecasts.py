"""Forecasts stored by other programs, read as `StoredForecasts`.

Each source has forms of its dataset. For every source: a folder with a ``.csv`` or
``.parquet`` for each scene, or one such file with a column ``scene``; a row per object
and sample, with the columns of `FORECASTS` and x1 y1 x2 y2 .. for the steps.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..core import DataError, Floats, Ints, Scene, file_stem
from .base import (
    DataRoot,
    ForecastForm,
    ReadForecasts,
    SourcePackage,
    StoredForecasts,
    class_ids,
    usual_sizes,
)
from .files.columns import BOX_COLUMNS, TRACKS
from .files.scene import find_table
from .readers import TableColumn, read_named_table
from .stored_tracks import checked_frames
from .tables import RowTable, repeated

MAX_STEPS = 100
MAX_PLACES = 1 << 26  # in the samples of a scene
_USUAL = "the usual size of the class"
_OPTIONAL = {"z": "half of `h`", "yaw": "0", "l": _USUAL, "w": _USUAL, "h": _USUAL}
_OF_TRACKS = {column.name: column for column in TRACKS}
_BOX = [_OF_TRACKS[name] for name in BOX_COLUMNS]
FORECASTS: tuple[TableColumn, ...] = (
    TableColumn(
        "scene", "name of the scene", "each scene needs its own file", text=True
    ),
    _OF_TRACKS["frame"],
    TableColumn(
        "object",
        "whole number that differs between the objects of a frame",
        "`id`; without either, each row is one object",
    ),
    replace(_OF_TRACKS["id"], without="no tracks"),
    _OF_TRACKS["class"],
    *(replace(column, without=_OPTIONAL.get(column.name, "")) for column in _BOX),
    TableColumn("confidence", "probability that the object is there, 0 to 1"),
    TableColumn(
        "mode",
        "number of the sample, a whole number",
        "numbered in the order of the rows",
    ),
    TableColumn("weight", "probability of the sample, above 0", "equal weights"),
)
_STEPS = [
    TableColumn(
        f"{axis}{step}",
        "m, place after so many periods",
        "a shorter forecast",
        gaps=True,
        finite=False,
    )
    for step in range(1, MAX_STEPS + 1)
    for axis in "xy"
]
# columns that are the same in all rows of an object
_OF_OBJECT = ("id", "class", *(column.name for column in _BOX), "confidence")


def forecast_forms(package: SourcePackage) -> dict[str, ForecastForm]:
    """Return the forms in which forecasts of a source are read, by name."""
    return {**package.forecasts, "table": ForecastForm(None, _open_tables)}


def read_forecast_table(
    table: RowTable, scene: Scene, classes: Sequence[str]
) -> StoredForecasts:
    """Return the forecasts in a table.

    DataError names the line that is wrong.
    """
    frame = checked_frames(table, scene, classes)
    weight = table.columns.get("weight", np.ones(len(table)))
    table.refuse(weight <= 0, "expected a probability above 0", "weight")
    path = table.matrix(" ".join(_step_columns(table)))
    path = path.reshape(len(table), path.shape[1] // 2, 2)
    identity = table.columns.get("id", np.full(len(table), ""))
    box = _boxes(table, classes)
    objects = [
        StoredForecast(
            frame=frame[rows[0]],
            where=table.where(rows[0]),
            class_name=table["class"][rows[0]],
            box=box[rows[0]],
            confidence=table["confidence"][rows[0]],
            path=path[rows],
            log_weight=np.log(weight[rows]),
            identity=identity[rows[0]],
        )
        for rows in _objects(table, frame)
    ]
    left_out = " ".join(name for name in _OPTIONAL if name not in table)
    notes = {}
    if left_out:
        notes[f"objects without {left_out}, for which defaults stand in"] = len(objects)
    return stack_forecasts(objects, notes, 0)


def _objects(table: RowTable, frame: Ints) -> Iterator[Ints]:
    """Return the rows [k] of each object, in the order of its samples."""
    mode: Ints = np.arange(len(table))
    number = mode
    if "object" in table:
        number = table.whole_numbers("object")
    elif "id" in table:
        number = np.unique(table["id"], return_inverse=True)[1].reshape(-1)
    if "mode" in table:
        mode = table.whole_numbers("mode")
        table.refuse(
            repeated(frame, number, mode),
            lambda row: f"a second row of sample {mode[row]} of its object",
            "mode",
        )
    order = np.lexsort([mode, number, frame])
    is_next = np.diff([frame[order], number[order]], axis=1).any(axis=0)
    objects = np.split(order, np.flatnonzero(is_next) + 1)
    first_row = np.concatenate([np.full(len(rows), rows[:1]) for rows in objects])
    for name in _OF_OBJECT:
        if name in table:
            values = table[name][order]
            is_other = np.zeros(len(order), dtype=bool)
            is_other[order] = values != table[name][first_row]
            problem = f"another {name} than in the first row of its object"
            table.refuse(is_other, problem, name)
    return filter(len, objects)


def _step_columns(table: RowTable) -> list[str]:
    """Return the names of the columns of places, x1 y1 x2 y2 .. without a hole."""
    names = [column.name for column in _STEPS]
    given = [name for name in names if name in table]
    expected = names[: max(2, len(given))]
    if given != expected:
        missing = next(name for name in expected if name not in table)
        raise DataError(
            f"{table.source}: no column {missing!r}, expected places x1 y1 x2 y2 .. "
            "for each step of the forecast"
        )
    return given


def _boxes(objects: RowTable, classes: Sequence[str]) -> Floats:
    """Return boxes [R, 7], with what the table lacks as `FORECASTS` says."""
    box = np.zeros((len(objects), 7))
    class_id = class_ids(objects["class"].tolist(), classes)
    box[:, 4:] = usual_sizes(classes)[class_id]
    for place, column in enumerate(_BOX):
        if column.name in objects:
            box[:, place] = objects[column.name]
    if "z" not in objects:
        box[:, 2] = box[:, 6] / 2
    return box


def _open_tables(card: Card, data: DataRoot, path: Path) -> ReadForecasts:
    columns = (*FORECASTS, *_STEPS)
    read = partial(read_named_table, columns=columns)
    if path.is_dir():
        return lambda scene: read_forecast_table(
            read(_table_of(path, scene)), scene, card.task.classes
        )
    table = read(path)
    if "scene" not in table:
        raise DataError(f"{path}: no column 'scene', expected one, or a folder")

    def read_scene(scene: Scene) -> StoredForecasts:
        rows = table["scene"] == scene.name
        if not rows.any():
            names = ", ".join(np.unique(table["scene"])[:3])
            raise missing_scene(path, scene.name, f"rows of {names} .., none")
        return read_forecast_table(table.select(rows), scene, card.task.classes)

    return read_scene


def _table_of(folder: Path, scene: Scene) -> Path:
    path = find_table(folder, file_stem(scene.name))
    if path is None:
        raise missing_scene(folder, scene.name, "no table .csv or .parquet")
    return path


def missing_scene(path: Path, scene: str, problem: str) -> DataError:
    """Return the error that a file lacks what is scored of a scene."""
    return DataError(
        f"{path}: {problem} for scene {scene!r}; --split names another split, "
        "--scenes N takes the first N scenes alone"
    )


class StoredForecast(NamedTuple):
    """Samples of an object of a file, in the terms of `StoredForecasts`."""

    frame: int
    where: str  # in the file, for errors
    class_name: str
    box: Sequence[float | None]  # [7]
    confidence: float | None
    path: Floats  # [k, S, 2], k = 0: no forecast
    log_weight: Floats  # [k]
    identity: str


def stack_forecasts(
    objects: Sequence[StoredForecast], notes: Mapping[str, int], others: int
) -> StoredForecasts:
    """Return the forecasts of all objects of a scene.

    Raises DataError for samples of different lengths, and too many.
    """

    def column(name: str, kind: type) -> NDArray[Any]:
        return np.array([getattr(item, name) for item in objects], kind)

    most = max((len(item.path) for item in objects), default=0)
    steps = max((item.path.shape[1] for item in objects), default=0)
    if len(objects) * most * steps > MAX_PLACES:
        raise DataError(
            f"{objects[0].where}: {len(objects)} objects of a scene with up to {most} "
            f"samples of {steps} steps are above {MAX_PLACES} places, the limit"
        )
    path = np.full((len(objects), most, steps, 2), np.nan)
    log_weight = np.full((len(objects), most), -np.inf)
    for row, item in enumerate(objects):
        samples = len(item.path)
        if samples == 0:
            continue
        expected = (len(item.log_weight), steps, 2)
        if item.path.shape != expected:
            raise DataError(
                f"{item.where}: samples of shape {item.path.shape}, expected "
                f"{expected}: as many as weights, with as many places as of other "
                "objects"
            )
        path[row, :samples] = item.path
        log_weight[row, :samples] = item.log_weight
    return StoredForecasts(
        frame=column("frame", np.int64),
        class_name=column("class_name", np.str_),
        box=column("box", np.float64).reshape(-1, 7),
        confidence=column("confidence", np.float64),
        path=path,
        log_weight=log_weight,
        identity=column("identity", np.str_),
        notes=notes,
        others=others,
    )
