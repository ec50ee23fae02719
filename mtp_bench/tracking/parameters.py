"""Parameters of trackers per detector and class.

They are TOML files in ``detectors/``, one per detector.
"""

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

from ..core import Task, UnknownNameError, similar_class

FOLDER = Path(__file__).with_name("detectors")
Affinity = Literal["giou_3d", "iou_3d", "center_distance"]
Assignment = Literal["hungarian", "greedy"]


@dataclass(frozen=True)
class ClassParameters:
    """Association and life cycle of the tracks of one class."""

    assignment: Assignment
    affinity: Affinity
    gate: float  # smallest affinity that may match; of distances the largest, m
    min_hits: int  # a track is output from this many detections on
    max_age: int  # a track ends after this many frames without a detection


@cache
def read_detector(name: str) -> Mapping[str, Any] | None:
    """Read a detector's file.

    None if it has none.
    """
    path = FOLDER / f"{name}.toml"
    return tomllib.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


def detector_names() -> tuple[str, ...]:
    """Return the names of the detectors with a file."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def family_of(detector: str) -> str:
    """Return the detector's name without its variant.

    It is "kitti_pointrcnn" for "kitti_pointrcnn-iid".
    """
    return detector.split("-", maxsplit=1)[0]


def recommended_parameters(task: Task) -> tuple[ClassParameters, ...]:
    """Return the parameters of each class of the task.

    The card may state them; otherwise they belong to the detector. A class without
    parameters takes those of a similar one, see `similar_class`. Raises
    UnknownNameError for a detector without parameters, and for a class that looks
    misspelt.
    """
    if not task.tracker:
        return detector_parameters(task.detector, task.classes)
    table = {name: ClassParameters(**row) for name, row in task.tracker.items()}
    return _of_classes(table, task.classes, f"[tracker] of {task.env_id}")


def detector_parameters(
    detector: str, classes: Sequence[str]
) -> tuple[ClassParameters, ...]:
    """Return the parameters of each class for a detector.

    Variants of a detector share them. Raises as `recommended_parameters`.
    """
    table = _tracker_table(family_of(detector))
    if not table:
        names = [name for name in detector_names() if _tracker_table(name)]
        cure = "pass `parameters`, or give the card a [tracker] table"
        raise UnknownNameError("detector", detector, names, cure)
    return _of_classes(table, classes, f"detector {detector!r}")


def score_thresholds(task: Task) -> dict[str, float]:
    """Return the least detection score per class for the task's detector.

    Classes without a threshold are missing.
    """
    content = read_detector(family_of(task.detector)) or {}
    thresholds = content.get("min_detection_score", {})
    return {name: thresholds[name] for name in thresholds if name in task.classes}


def _tracker_table(detector: str) -> dict[str, ClassParameters]:
    """Return the parameters by class in the file of a detector.

    The file's own parameters override those of the detector ``tracker_like``. Empty if
    the file has neither.
    """
    content = read_detector(detector) or {}
    table: dict[str, ClassParameters] = {}
    if "tracker_like" in content:
        table |= _tracker_table(content["tracker_like"])
    for class_name, row in content.get("tracker", {}).items():
        table[class_name] = ClassParameters(**row)
    return table


def _of_classes(
    table: Mapping[str, ClassParameters], classes: Iterable[str], where: str
) -> tuple[ClassParameters, ...]:
    """Return the parameters of each class, or of one similar to it.

    ``where``: source of the table, for the error.
    """
    parameters = []
    for class_name in classes:
        similar = similar_class(class_name, table)
        if similar is None:
            cure = "pass `parameters` for your own"
            raise UnknownNameError(f"class for {where}", class_name, table, cure)
        parameters.append(table[similar])
    return tuple(parameters)
