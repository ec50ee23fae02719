"""The arrays that nuscenes_devkit.py writes, as rows to compare."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float64]
Indices = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Rows:
    """Boxes of a scene, in any order."""

    frame: Indices  # [n]
    kind: Indices  # [n] index into the card's classes
    value: Numbers  # [n, 7 or 8] x y z yaw l w h, and the score of detections


FIELDS = ("frame", "kind", "value")


class Export:
    """One version of the tables as the devkit reads it, scene by scene and of the given classes only.

    ``beside`` has the classes that ours gives to categories without a detection class.
    """

    def __init__(self, path: Path, version: str, classes: tuple[str, ...], beside: dict[str, str]) -> None:
        with np.load(path) as arrays:
            prefix = f"{version}/"
            self.arrays = {key.removeprefix(prefix): arrays[key] for key in arrays.files if key.startswith(prefix)}
        self.classes = classes
        self.beside = beside
        self.class_of = official_classes(path)
        self.scenes: list[str] = self.arrays["scene"].tolist()

    def samples(self, scene: str) -> tuple[Indices, Numbers]:
        """Time stamps [F] in microseconds and ego poses [F, 4], by frame."""
        row = self._of("sample", scene)
        row = row[np.argsort(self.arrays["sample"][row, 1])]
        return self.arrays["time"][row], self.arrays["ego"][row]

    def truth(self, scene: str, listed: bool) -> tuple[Rows, Indices, Bools]:
        """Annotations, their instances [n], and which have no detection class; ``listed``: of targets only."""
        rows, instance, beside = self._annotations(scene)
        keep = rows.kind >= 0
        if listed:
            keep &= np.isin(instance, self.arrays["target_instance"][self._of("target", scene)])
            beside &= False
        at = np.flatnonzero(keep)
        return Rows(rows.frame[at], rows.kind[at], rows.value[at]), instance[at], beside[at]

    def detections(self, detector: str, scene: str) -> Rows:
        """Detections of a detector, from all its files."""
        parts = [self._detections(file, scene) for file in self._files(detector)]
        frame, kind, value = (np.concatenate([getattr(part, name) for part in parts]) for name in FIELDS)
        return Rows(frame, kind, value)

    def targets(self, scene: str) -> tuple[Rows, Numbers, Numbers, Numbers]:
        """Listed targets with their boxes, futures [n, T, 2], pasts [n, P, 2], the latest first, and speeds [n]."""
        row = self._of("target", scene)
        rows = self._boxes(scene, self.arrays["target"][row, 1], self.arrays["target_instance"][row])
        return rows, self.arrays["future"][row], self.arrays["past"][row], self.arrays["speed"][row]

    def challenge(self, split: str, scene: str) -> Rows:
        """Annotation boxes of the targets that the challenge's split has in the tables."""
        row = self._of(f"split_{split}", scene)
        place = self.arrays[f"split_{split}"][row]
        return self._boxes(scene, place[:, 1], place[:, 2])

    def challenge_scenes(self, split: str) -> list[str]:
        """Scenes of the tables with targets of the challenge's split."""
        return [self.scenes[i] for i in np.unique(self.arrays[f"split_{split}"][:, 0])]

    def challenge_splits(self) -> list[str]:
        """Names of the challenge's splits."""
        return [key.removeprefix("split_") for key in self.arrays if key.startswith("split_")]

    def detection_scenes(self, detector: str) -> list[str]:
        """Scenes of the tables that a detector has detections of."""
        tables = [self.arrays[f"detections/{file}/row"] for file in self._files(detector)]
        return [self.scenes[i] for i in np.unique(np.concatenate(tables)[:, 0])]

    def _files(self, detector: str) -> list[str]:
        keys = [key.split("/") for key in self.arrays if key.startswith(f"detections/{detector}")]
        return sorted({file for _, file, _ in keys})

    def _detections(self, file: str, scene: str) -> Rows:
        part = {name: self.arrays[f"detections/{file}/{name}"] for name in ("row", "box", "score", "class")}
        row = self._of(f"detections/{file}/row", scene)
        kind = self._kinds(part["class"][row].tolist())
        row, kind = row[kind >= 0], kind[kind >= 0]
        return Rows(part["row"][row, 1], kind, np.column_stack([part["box"][row], part["score"][row]]))

    def _annotations(self, scene: str) -> tuple[Rows, Indices, Bools]:
        """Annotations of all classes, -1 for those that the card has not, their instances, and which have no class."""
        row = self._of("truth", scene)
        category = self.arrays["truth_category"][row].tolist()
        kind = self._kinds(self.class_of[name] or self.beside.get(name, "") for name in category)
        beside = np.array([not self.class_of[name] for name in category])
        rows = Rows(self.arrays["truth"][row, 1], kind, self.arrays["truth_box"][row])
        return rows, self.arrays["truth_instance"][row], beside

    def _boxes(self, scene: str, frame: Indices, instance: Indices) -> Rows:
        """The annotations of instances in frames."""
        rows, instances, _ = self._annotations(scene)
        place = {key: i for i, key in enumerate(zip(rows.frame.tolist(), instances.tolist(), strict=True))}
        keys = zip(frame.tolist(), instance.tolist(), strict=True)
        at = np.array([place[key] for key in keys], dtype=np.int64)
        return Rows(rows.frame[at], rows.kind[at], rows.value[at])

    def _of(self, table: str, scene: str) -> Indices:
        """Rows of a table whose first column is the scene."""
        return np.flatnonzero(self.arrays[table][:, 0] == self.scenes.index(scene))

    def _kinds(self, names: Iterable[str]) -> Indices:
        """Index of each class name, -1 for the others."""
        order = {name: i for i, name in enumerate(self.classes)}
        return np.array([order.get(name, -1) for name in names], dtype=np.int64)


def packages(path: Path) -> list[str]:
    """Names and versions of the packages that the export was made with."""
    with np.load(path) as arrays:
        return [str(text) for text in arrays["versions"]]


def official_scenes(path: Path) -> dict[str, list[str]]:
    """Scene names of each split of the prediction challenge, in its order."""
    prefix = "challenge/"
    with np.load(path) as arrays:
        return {key.removeprefix(prefix): arrays[key].tolist() for key in arrays.files if key.startswith(prefix)}


def official_classes(path: Path) -> dict[str, str]:
    """Detection class of each category, empty where there is none."""
    with np.load(path) as arrays:
        return {str(category): str(name) for category, name in arrays["classes"]}
