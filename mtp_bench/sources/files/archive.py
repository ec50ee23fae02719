"""A scene in one NPZ file: everything that a `Scene` holds but stored tracks, as named arrays."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from ...errors import DataError, nearest
from ...files import BROKEN_ARCHIVE, describe_read_error, open_regular
from ...types import ID_LIMIT, Detections, Scene, Truth
from .columns import ARRAYS, BOX, Array
from .content import Content, Rows
from .surroundings import Arrays, image_arrays, image_of, lane_arrays, lanes_of

MOST_BYTES = 1 << 30  # of the arrays of a scene
SAID: dict[str, type] = {  # fields of `Scene` that are no arrays, in the JSON of the array "said"
    "truth_complete": bool, "listed_targets": bool, "detector": str, "simulated": bool, "skipped": dict,
    "recording": str,
}  # fmt: skip
_SURROUND = ("world", "image_", "lane_")  # of these every number is known


def arrays_of(scene: Scene, classes: Sequence[str]) -> Arrays:
    """Everything that ``scene`` holds but stored tracks; ``classes``: the names of its class ids.

    Raises DataError where its rows are not divided into frames, have a class that has no name, or an object has a
    number that no object may have.
    """
    names = np.array([classes] if isinstance(classes, str) else classes, dtype=np.str_)
    truth, seen = scene.truth, scene.detections
    for table, rows, kind in (("truth", truth, Truth), ("detections", seen, Detections)):
        where = f"scene {scene.name!r}: {table}"
        if not isinstance(rows, kind):
            empty = "; one without rows stands for none" if kind is Detections else ""
            raise DataError(f"{where} is {type(rows).__name__}, expected {kind.__name__}{empty}")
        _require_rows(where, rows, scene.frames, len(names))
    _require_ids(scene)
    arrays: Arrays = {
        "time": scene.time,
        "ego": scene.ego,
        "truth_frame": truth.frame_of_rows,
        "truth_box": truth.box,
        "truth_class": names[np.asarray(truth.class_id, dtype=np.int64)],
        "truth_velocity": truth.velocity,
        "truth_id": truth.object_id,
        "truth_eligible": truth.eligible,
        "truth_neutral": truth.neutral,
        "said": np.array(json.dumps({name: getattr(scene, name) for name in SAID})),
    }
    if scene.detector or len(seen.box):  # else there are none: that nothing was detected is something else
        arrays |= {
            "detections_frame": seen.frame_of_rows,
            "detections_box": seen.box,
            "detections_class": names[np.asarray(seen.class_id, dtype=np.int64)],
            "detections_velocity": seen.velocity,
            "detections_score": seen.score,
        }
    if scene.visible is not None:
        arrays["truth_visible"] = scene.visible
    if scene.world is not None:
        arrays["world"] = scene.world
    if scene.image is not None:
        arrays |= image_arrays(scene.image, names)
    return {name: np.asarray(value) for name, value in (arrays | lane_arrays(scene.lanes)).items()}


def _require_rows(what: str, rows: Truth | Detections, frames: int, classes: int) -> None:
    start, class_id = np.asarray(rows.start), np.asarray(rows.class_id)
    for name, value in (("start", start), ("class_id", class_id)):
        if value.ndim != 1 or (len(value) and value.dtype.kind not in "iu"):
            raise DataError(f"{what}.{name} is {value.dtype} {list(value.shape)}, expected a row of whole numbers")
    if len(start) != frames + 1 or start[0] != 0 or start[-1] != len(rows.box) or (np.diff(start) < 0).any():
        raise DataError(f"{what}.start does not divide the {len(rows.box)} rows into {frames} frames")
    if len(class_id) and (class_id.min() < 0 or class_id.max() >= classes):
        raise DataError(
            f"{what}.class_id has {class_id.min()} to {class_id.max()}, expected places among {classes} classes"
        )


def _require_ids(scene: Scene) -> None:
    number = np.asarray(scene.truth.object_id)
    if len(number) and (number.min() < 0 or number.max() > ID_LIMIT):
        raise DataError(
            f"scene {scene.name!r}: truth.object_id has {number.min()} to {number.max()}, expected whole numbers from "
            f"0 to {ID_LIMIT}"
        )


def content_of(arrays: Arrays, name: str, where: str) -> Content:
    """The scene that ``arrays`` hold. Raises DataError for arrays that are lacking, unknown or of another shape."""
    _check(arrays, where)
    frames = len(arrays["time"])
    said = _said(arrays.get("said"), where)
    if "world" in arrays:
        said["world"] = arrays["world"]
    if any(key.startswith("image_") for key in arrays):
        said["image"] = image_of(arrays, frames, where)
    if "lane_of" in arrays:
        said["lanes"] = lanes_of(arrays, where)
    return Content(
        name=name,
        where=where,
        time=arrays["time"],
        ego=arrays.get("ego", np.zeros((frames, 4))),
        truth=_truth_rows(arrays, where),
        detections=_detection_rows(arrays, where) if "detections_frame" in arrays else None,
        said=said,
        image_classes=tuple(arrays["image_classes"].tolist()) if "image" in said else (),
    )


def read_archive(path: Path) -> Content:
    """The scene of an NPZ file, which has its name. Raises DataError for a file that is none, or too large."""
    try:
        with open_regular(path) as stream, np.load(stream, allow_pickle=False) as stored:
            if sum(entry.file_size for entry in stored.zip.infolist()) > MOST_BYTES:
                raise DataError(f"{path}: unpacks to more than {MOST_BYTES >> 20} MiB, expected at most so much")
            arrays: Arrays = {name: stored[name] for name in stored.files}
            plain = next((name for name, value in arrays.items() if not isinstance(value, np.ndarray)), None)
            if plain is not None:
                raise ValueError(f"{plain!r} in it is no array")
    except FileNotFoundError:
        raise DataError(f"no file {path}") from None
    except BROKEN_ARCHIVE as error:
        raise DataError(f"{path}: no NPZ file, or a broken one: {describe_read_error(error)}") from None
    return content_of(arrays, unquote(path.stem), str(path))


def _truth_rows(arrays: Arrays, where: str) -> Rows:
    count = len(arrays["truth_frame"])
    further = {
        "id": arrays["truth_id"],
        "eligible": arrays.get("truth_eligible", np.ones(count, dtype=bool)),
        "neutral": arrays.get("truth_neutral", np.zeros(count, dtype=bool)),
    }
    if "truth_visible" in arrays:
        further["visible"] = arrays["truth_visible"]
    return _rows(arrays, "truth", where, further)


def _detection_rows(arrays: Arrays, where: str) -> Rows:
    score = arrays.get("detections_score", np.ones(len(arrays["detections_frame"])))
    return _rows(arrays, "detections", where, {"score": score})


def _rows(arrays: Arrays, table: str, where: str, further: Arrays) -> Rows:
    array_of = {**dict.fromkeys(BOX, "box"), "vx": "velocity", "vy": "velocity"}

    def place(at: int, column: str) -> str:
        named = f"{table}_{array_of.get(column, column)}"
        return f"{where}, array {named!r}, row {at}" + (f" ({column})" if column in array_of else "")

    frame, box, kind = (arrays[f"{table}_{name}"] for name in ("frame", "box", "class"))
    return Rows(place, frame, box, arrays.get(f"{table}_velocity"), kind, further)


def _check(arrays: Arrays, where: str) -> None:
    """Raise DataError unless these are arrays of a scene, with the kinds and shapes that they have to have."""
    known = [array.name for array in ARRAYS]
    for name in arrays:
        if name not in known:
            raise DataError(f"{where}: unknown array {name!r}{nearest(name, known)}")
    seen = any(name.startswith("detections_") for name in arrays)
    sizes: dict[str, int] = {}
    for array in ARRAYS:
        if array.name in arrays:
            arrays[array.name] = _checked(array, arrays[array.name], sizes, where)
        elif array.needed and (seen or not array.name.startswith("detections_")):
            raise DataError(f"{where}: no array {array.name!r}: {array.meaning}")


def _checked(array: Array, value: NDArray[Any], sizes: dict[str, int], where: str) -> NDArray[Any]:
    """An array in the type that it is read as."""
    kinds = {"number": "fiu", "whole": "iu", "flag": "b", "text": "U"}[array.kind]
    if value.dtype.kind not in kinds:
        what = {"number": "numbers", "whole": "whole numbers", "flag": "true and false", "text": "texts"}[array.kind]
        raise DataError(f"{where}, array {array.name!r}: its type is {value.dtype}, expected {what}")
    if value.ndim == len(array.shape):
        for letter, size in zip(array.shape, value.shape, strict=True):
            if isinstance(letter, str):
                sizes.setdefault(letter, size)
    expected = tuple(sizes.get(letter, -1) if isinstance(letter, str) else letter for letter in array.shape)
    if value.shape != expected:
        letters = f"[{', '.join(map(str, array.shape))}]"
        sized = ", ".join(f"{letter} {sizes[letter]}" for letter in array.shape if letter in sizes)
        raise DataError(f"{where}, array {array.name!r}: its shape is {list(value.shape)}, expected {letters}, {sized}")
    if array.name.startswith(_SURROUND) and array.kind == "number" and not np.isfinite(value).all():
        raise DataError(f"{where}, array {array.name!r}: a number that is not finite")
    if array.kind == "number":
        return value if value.dtype in (np.float32, np.float64) else value.astype(np.float64)
    if array.kind != "whole":
        return value
    found = value.astype(np.int64)
    if not np.array_equal(found, value):
        raise DataError(f"{where}, array {array.name!r}: {value.max()}, expected whole numbers below 2**63")
    return found


def _said(text: NDArray[Any] | None, where: str) -> dict[str, Any]:
    """The fields of a scene that are no arrays."""
    if text is None:
        return {}
    try:
        said = json.loads(str(text))
    except (ValueError, RecursionError):
        said = None
    if not isinstance(said, dict) or any(type(value) is not SAID.get(name) for name, value in said.items()):
        raise DataError(f"{where}, array 'said': expected JSON with some of {', '.join(SAID)}")
    counts = said.get("skipped", {}).values()
    if not all(type(count) is int for count in counts):
        raise DataError(f"{where}, array 'said': skipped holds something else than counts")
    return said
