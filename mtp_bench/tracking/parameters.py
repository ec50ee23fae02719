"""Parameters of trackers per detector and class: TOML files in ``detectors/``, one per detector."""

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
    """Content of a detector's file; None if it has none."""
    path = FOLDER / f"{name}.toml"
    return tomllib.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


def detector_names() -> tuple[str, ...]:
    """Names of the detectors with a file."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def family_of(detector: str) -> str:
    """Name of a detector without its variant: "kitti_pointrcnn" of "kitti_pointrcnn-hard"."""
    return detector.split("-", maxsplit=1)[0]


def recommended_parameters(task: Task) -> tuple[ClassParameters, ...]:
    """Parameters of each class of the task: those of its card, else those of its detector.

    A class without parameters takes those of a similar one, see `similar_class`. Raises UnknownNameError for a detector
    without parameters, and for a class that looks misspelt.
    """
    if not task.tracker:
        return detector_parameters(task.detector, task.classes)
    table = {name: ClassParameters(**row) for name, row in task.tracker.items()}
    return _of_classes(table, task.classes, f"[tracker] of {task.env_id}")


def detector_parameters(
    detector: str, classes: Sequence[str]
) -> tuple[ClassParameters, ...]:
    """Parameters of each class for a detector or a variant of it; raises as `recommended_parameters`."""
    table = _tracker_table(family_of(detector))
    if not table:
        known = [name for name in detector_names() if _tracker_table(name)]
        raise UnknownNameError(
            "detector",
            detector,
            known,
            "pass `parameters`, or give the card a [tracker] table",
        )
    return _of_classes(table, classes, f"detector {detector!r}")


def score_thresholds(task: Task) -> dict[str, float]:
    """The least detection score per class for the task's detector; classes without a threshold are missing."""
    content = read_detector(family_of(task.detector)) or {}
    return {
        name: least
        for name, least in content.get("min_detection_score", {}).items()
        if name in task.classes
    }


def _tracker_table(name: str) -> dict[str, ClassParameters]:
    """Parameters by class in the file of a detector, on top of those of ``tracker_like``; empty without any."""
    content = read_detector(name) or {}
    like = _tracker_table(content["tracker_like"]) if "tracker_like" in content else {}
    return like | {
        class_name: ClassParameters(**row)
        for class_name, row in content.get("tracker", {}).items()
    }


def _of_classes(
    table: Mapping[str, ClassParameters], classes: Iterable[str], where: str
) -> tuple[ClassParameters, ...]:
    parameters = []
    for name in classes:
        similar = similar_class(name, table)
        if similar is None:
            raise UnknownNameError(
                f"class for {where}", name, table, "pass `parameters` for your own"
            )
        parameters.append(table[similar])
    return tuple(parameters)
