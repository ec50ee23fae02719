"""Scenes from their tables, and the checks of own scenes."""

import os
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from ...cards import Card, FilesSource, instead_of_stored
from ...core import (
    ID_LIMIT,
    Bools,
    DataError,
    Floats,
    Ints,
    Scene,
    Truth,
    class_hint,
    closest,
    other_spelling,
    starts_of_sorted,
)
from ..base import (
    CameraImage,
    class_ids,
    detections_by_frame,
    names_by_number,
    no_detections,
    section_of,
    sorted_rows,
    stored_label,
)
from ..motion import backward_velocity, unknown_velocity
from ..readers import read_named_table
from ..tables import RowTable
from .columns import (
    AREA,
    BOX_COLUMNS,
    COLUMNS,
    FORMS,
    LABELS,
    PICTURES,
    TABLES,
    check_frames,
    check_objects,
    check_ranges,
    frame_index,
    scene_frames,
)
from .pictures import images_of, lanes_of
from .save import scene_tables

# file names so similar are taken for misspelt: `detection` and `lane`, not
# `detections_old`
_MIN_SIMILARITY = 0.85


def read_scene(folder: Path, card: Card) -> Scene:
    """Read the scene that the tables in ``folder`` hold.

    The name of the folder is that of the scene. Rows of classes outside the task are
    skipped. Raises DataError that names the file, the line and the column that is
    wrong.
    """
    _refuse_misspelt(folder)
    tables = _read_tables(folder, TABLES)
    if "truth" not in tables:
        raise DataError(
            f"{folder}: no table truth.csv or truth.parquet, which the score needs"
        )
    if not len(tables["truth"]):
        raise DataError(
            f"{tables['truth'].source} has no rows, expected one per object and frame"
        )
    frame_numbers, time = scene_frames(str(folder), tables, card.task.rate)
    ego = np.zeros((len(time), 4))
    if "ego" in tables:
        for index, column in enumerate(("x", "y", "z", "yaw")):
            if column in tables["ego"]:
                ego[:, index] = tables["ego"][column]
    check_frames(time, ego, card, str(folder))
    scene = _true_scene(folder, tables["truth"], frame_numbers, time, ego, card)
    scene = replace(scene, **_beside_boxes(folder, frame_numbers))
    has_detections = "detections" in tables
    if has_detections and card.detector is None:
        scene = _with_detections(scene, tables["detections"], frame_numbers, card)
    return _for_card(scene, card, str(folder), has_detections)


def _beside_boxes(folder: Path, frame_numbers: Ints) -> dict[str, Any]:
    """Return fields of a scene from its tables of lanes and labels.

    ``frame_numbers`` [F] of the scene.
    """
    changes: dict[str, Any] = {}
    tables = _read_tables(folder, ("lanes", *LABELS))
    if "lanes" in tables:
        changes["lanes"] = lanes_of(tables["lanes"])
    if "annotated" in tables:
        annotated = np.zeros(len(frame_numbers), dtype=bool)
        annotated[frame_index(tables["annotated"], frame_numbers)] = True
        changes["annotated"] = annotated
    if "neutral_areas" in tables:
        areas = tables["neutral_areas"]
        check_ranges(areas)
        for low, high in (("x_min", "x_max"), ("y_min", "y_max")):
            areas.refuse(areas[low] >= areas[high], f"expected less than {high}", low)
        changes["neutral_areas"] = areas.matrix(" ".join(AREA))
    return changes


def read_images(folder: Path, card: Card) -> tuple[CameraImage, ...]:
    """Return the camera images of the scene in ``folder``.

    Empty without their table. Raises DataError as `read_scene`.
    """
    images = _read_tables(folder, ["images"])
    if not images:
        return ()
    # an ego table defines the frames alone
    tables = _read_tables(folder, ["ego"]) or _read_tables(folder, TABLES)
    frame_numbers, _ = scene_frames(str(folder), tables, card.task.rate)
    return images_of(images["images"], folder, frame_numbers)


def checked_scene(scene: Scene, card: Card) -> Scene:
    """Check a user's `Scene` object, and fit it to ``card``.

    Its class ids index the classes of the task. Raises DataError for impossible values.
    """
    where = f"scene {scene.name!r}"
    tables = scene_tables(scene, card.task.classes)
    check_frames(np.asarray(scene.time), np.asarray(scene.ego), card, where)
    for name in ("truth", "detections"):
        if name not in tables:
            continue
        columns = tables[name]
        row_numbers = np.arange(len(columns["frame"]))
        table = RowTable(f"{where}: {name}", "row", row_numbers, columns)
        for column in columns:
            if column in ("frame", "id", "class"):
                continue
            table.refuse_coarse(np.asarray(columns[column]), column)
            columns[column] = np.asarray(columns[column], dtype=np.float64)
        check_ranges(table, positive_sizes=name == "truth")
        if name == "truth":
            check_objects(table, columns["frame"], columns["id"], card.task.classes)
    areas = scene.neutral_areas
    if areas is not None and (
        areas.shape != (len(areas), len(AREA))
        or not (areas[:, :2] < areas[:, 2:]).all()
    ):
        raise DataError(f"{where}: neutral_areas, expected rows of {', '.join(AREA)}")
    return _for_card(scene, card, where, "detections" in tables)


def find_table(folder: Path, name: str) -> Path | None:
    """Return the file of a table.

    None without one, DataError if there are two.
    """
    paths = [folder / f"{name}.{form}" for form in FORMS]
    existing = [path for path in paths if os.path.lexists(path)]
    if len(existing) > 1:
        raise DataError(
            f"{folder} has {existing[0].name} and {existing[1].name}, expected only "
            "one of them"
        )
    return existing[0] if existing else None


def _read_tables(folder: Path, names: Iterable[str]) -> dict[str, RowTable]:
    """Read those of the tables ``names`` that the folder has."""
    tables: dict[str, RowTable] = {}
    for name in names:
        path = find_table(folder, name)
        if path is not None:
            tables[name] = read_named_table(path, COLUMNS[name])
    return tables


def _refuse_misspelt(folder: Path) -> None:
    """Raise DataError for nearly the name of a missing table (``detection.csv``)."""
    names = (*TABLES, *LABELS, *PICTURES)
    missing = [name for name in names if find_table(folder, name) is None]
    for path in sorted(folder.iterdir()):
        form = path.suffix.lower().removeprefix(".")
        name = closest(path.stem, missing, _MIN_SIMILARITY)
        if form in FORMS and name:
            raise DataError(f"{path} is not a known table; did you mean {name}.{form}?")


def _for_card(scene: Scene, card: Card, where: str, has_detections: bool) -> Scene:
    """Return the scene with the truth and the detections that the card states.

    The truth may be incomplete. Detections are those of the files, or left out for a
    simulated detector.
    """
    if not card.source.traits.truth_complete:
        scene = replace(scene, truth_complete=False)
    if card.detector is None:
        if not has_detections:
            raise DataError(f"{where}: no detections{instead_of_stored(card)}")
        label = stored_label(section_of(card, FilesSource).detector)
        return replace(scene, detector=scene.detector or label)
    if not scene.truth_complete:
        raise DataError(
            f"{where}: its truth has prediction targets only, so a simulated detector "
            "would miss all other objects; use the detections of the files"
        )
    # the detector is simulated later, and then sets these fields
    no_rows = no_detections(scene.frames)
    return replace(scene, detections=no_rows, detector="", simulated=False)


def _true_scene(
    folder: Path,
    table: RowTable,
    frame_numbers: Ints,
    time: Floats,
    ego: Floats,
    card: Card,
) -> Scene:
    """Return the scene without detections, from the table of its truth.

    ``frame_numbers`` [F] of its frames, ``time`` [F] s, ``ego`` [F, 4].
    """
    classes = card.task.classes
    frames = len(time)
    frame = frame_index(table, frame_numbers)
    used_rows, skipped = _usable_rows(table, frame, "truth", classes)
    object_id = ids_of(table)
    check_objects(table, frame, object_id, classes)
    table = table.select(used_rows)
    frame = frame[used_rows]
    object_id = object_id[used_rows]
    box = boxes_of(table)
    if "vx" in table:
        velocity = velocities_of(table)
    else:
        period_s = 1 / card.task.rate
        velocity = backward_velocity(frame, object_id, box[:, :2], time, period_s)
    truth = Truth(
        start=starts_of_sorted(frame, frames),
        box=box,
        velocity=velocity,
        class_id=class_ids_of(table, classes),
        object_id=object_id,
        eligible=table.columns.get("eligible", np.ones(len(table))) == 1,
        neutral=table.columns.get("neutral", np.zeros(len(table))) == 1,
    )
    return Scene(
        name=unquote(folder.name),
        time=time,
        ego=ego,
        truth=truth,
        detections=no_detections(frames),
        visible=table.columns.get("visible"),
        skipped=skipped,
        object_names=names_by_number(object_id, table["id"]),
    )


def _with_detections(
    scene: Scene, table: RowTable, frame_numbers: Ints, card: Card
) -> Scene:
    """Return the scene with the detections of a table.

    ``frame_numbers`` [F] of its frames.
    """
    classes = card.task.classes
    frame = frame_index(table, frame_numbers)
    used_rows, skipped = _usable_rows(table, frame, "detections", classes)
    table = table.select(used_rows)
    detections = detections_by_frame(
        scene.frames,
        frame[used_rows],
        boxes_of(table),
        class_ids_of(table, classes),
        scores_of(table),
        velocities_of(table),
    )
    return replace(scene, detections=detections, skipped=scene.skipped | skipped)


def _usable_rows(
    table: RowTable, frame: Ints, name: str, classes: Collection[str]
) -> tuple[Ints, dict[str, int]]:
    """Return the rows of ``classes`` and the counts of skipped rows.

    All rows are checked. The rows are sorted by frame and otherwise in their order.
    """
    check_ranges(table, positive_sizes=name == "truth")
    is_used, skipped = of_classes(table, name, classes)
    return sorted_rows(frame, is_used), skipped


def of_classes(
    table: RowTable, name: str, classes: Collection[str]
) -> tuple[Bools, dict[str, int]]:
    """Mask the rows [R] of ``classes``, and count the others by reason.

    ``name`` of the table, for errors: DataError for a class that is spelt otherwise,
    and if no row is left.
    """
    require_spelling(table, classes)
    class_names = table["class"]
    is_used = np.isin(class_names, list(classes))
    if len(class_names) and not is_used.any():
        first_name = str(class_names[0])
        problem = (
            f"{first_name!r}, and no other row of the {name} has a class of the task"
        )
        general_advice = "`mtp-bench envs` shows the classes of each environment"
        raise DataError(
            f"{table.where(0, 'class')}: {problem}, one of {', '.join(classes)}; "
            f"{class_hint(first_name, classes) or general_advice}"
        )
    skipped: dict[str, int] = {}
    other_kinds, counts = np.unique(class_names[~is_used], return_counts=True)
    for other_kind, count in zip(other_kinds.tolist(), counts.tolist(), strict=True):
        reason = f"{name} of class {other_kind!r}, which the task does not have"
        if hint := class_hint(other_kind, classes):
            reason += f": {hint}"
        skipped[reason] = count
    return is_used, skipped


def require_spelling(table: RowTable, classes: Collection[str]) -> None:
    """Raise DataError for a class of the task that is spelt otherwise."""
    names, index = np.unique(table["class"], return_inverse=True)
    meant = np.array([other_spelling(name, classes) for name in names.tolist()])[index]
    table.refuse(
        meant != "",
        lambda row: (
            f"{str(table['class'][row])!r} is not a class of the task; "
            f"did you mean {str(meant[row])!r}?"
        ),
        "class",
    )


def boxes_of(table: RowTable) -> Floats:
    """Return boxes [R, 7].

    Without z they stand on the ground.
    """
    columns = {"z": table["h"] / 2, **table.columns}
    return np.column_stack([columns[name] for name in BOX_COLUMNS])


def velocities_of(table: RowTable) -> Floats:
    """Return velocities [R, 2].

    NaN if the table has none.
    """
    if "vx" in table:
        return table.matrix("vx vy")
    return unknown_velocity(len(table))


def scores_of(table: RowTable) -> Floats:
    """Return scores [R].

    1 if the table has none.
    """
    return table.columns.get("score", np.ones(len(table)))


def class_ids_of(table: RowTable, classes: Sequence[str]) -> Ints:
    """Return the index [R] of each row's class among ``classes``, else -1."""
    names, index = np.unique(table["class"], return_inverse=True)
    return class_ids(names.tolist(), classes)[index]


def ids_of(table: RowTable) -> Ints:
    """Return the number [R] of the object in each row.

    If one id is not a whole number from 0 to `ID_LIMIT`, all count as words: each gets
    its index among the sorted ones.
    """
    words = table["id"]
    with suppress(ValueError, OverflowError):
        object_numbers = words.astype(np.int64)
        is_in_range = (object_numbers >= 0).all() and (object_numbers <= ID_LIMIT).all()
        # otherwise 1 and 01 would be one object
        if is_in_range and np.array_equal(object_numbers.astype(np.str_), words):
            return object_numbers
    return np.unique(words, return_inverse=True)[1]
