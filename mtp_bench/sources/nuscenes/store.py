"""The tables of one version as a compact cache: one file of arrays per scene, and an index."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..cache import Arrays, read_arrays, write_arrays
from . import folders
from .annotations import Annotations, read_annotations
from .layout import PREDICTION, prediction_path, table_paths
from .tables import Keyframes, read_keyframes
from .work import Work, no_work

SAMPLES = "all.samples"  # file of the sample tokens of all scenes; no scene has a dot in its name


@dataclass(frozen=True)
class Tables:
    """The tables of one version, found but not read; ``prediction``: the list of targets, where it is there."""

    version: str
    paths: Mapping[str, Path]
    prediction: Path | None

    @property
    def sources(self) -> dict[str, Path]:
        """All files by what they are."""
        own = {f"{name}.json": path for name, path in self.paths.items()}
        return own if self.prediction is None else {**own, PREDICTION: self.prediction}

    @property
    def known_folder(self) -> Path | None:
        """The cache of the tables, if its name is known without hashing them."""
        hashes = [(name, folders.stamped_hash(path)) for name, path in self.sources.items()]
        known = [(name, found) for name, found in hashes if found is not None]
        return self._folder(folders.joint_digest(known)) if len(known) == len(hashes) else None

    @property
    def bytes_left(self) -> int:
        """Bytes to read before the cache can be used, at most."""
        size = sum(folders.file_size(path) for path in self.sources.values())
        folder = self.known_folder
        if folder is None:
            hashed = sum(
                folders.file_size(path) for path in self.sources.values() if folders.stamped_hash(path) is None
            )
            return size + hashed
        return 0 if folders.read_index(folder) else size

    def open(self, work: Work) -> TableStore:
        """The cache, built first where it is not there; DataError names the file and token that is wrong."""
        folder = self.hashed_folder(work)
        return TableStore(self, folder, folders.made(folder, folders.read_index, lambda: self.build(folder, work)))

    def hashed_folder(self, work: Work) -> Path:
        """The cache of the tables as they are now."""
        hashes = ((name, folders.file_hash(path, work.on(path.name))) for name, path in self.sources.items())
        return self._folder(folders.joint_digest(hashes))

    def build(self, folder: Path, work: Work) -> None:
        """Read the tables and write the cache."""
        keyframes = read_keyframes(self.paths, work.on(self.version))
        boxes = read_annotations(self.paths, self.prediction, keyframes, work.on(self.version))
        folders.build(folder, lambda part: _fill(part, keyframes, boxes, self.prediction is not None))

    def _folder(self, digest: str) -> Path:
        return folders.cache_folder() / f"{self.version}-{digest}"


def find_tables(root: Path, version: str) -> Tables:
    """The tables of ``version``; raises DataError where the version or a table is missing."""
    return Tables(version, table_paths(root, version), prediction_path(root))


@dataclass(frozen=True)
class TableStore:
    """The cached tables of one version."""

    tables: Tables
    folder: Path
    index: Mapping[str, Any]
    # scenes: frames, boxes, objects and targets (None: no list) of each; instances and boxes of all categories

    def arrays(self, name: str) -> Arrays:
        """Arrays of a scene, or of `SAMPLES`; a broken file is built again, if the tables are still the same."""
        path = self.folder / f"{name}.npz"

        def build_again() -> None:
            folders.refuse_changed(path, self.tables.hashed_folder(no_work()), f"the tables of {self.tables.version}")
            self.tables.build(self.folder, no_work())

        return folders.made(path, read_arrays, build_again)


def _fill(folder: Path, keyframes: Keyframes, boxes: Annotations, has_list: bool) -> None:
    scenes: dict[str, dict[str, Any]] = {}
    for index, name in enumerate(keyframes.scene):
        arrays = _scene_arrays(index, keyframes, boxes)
        write_arrays(folder / f"{name}.npz", arrays)
        scenes[name] = {
            "frames": len(arrays["time"]),
            "boxes": len(arrays["box"]),
            "objects": len(arrays["instance"]),
            "targets": int(arrays["listed"].sum()) if has_list else None,
        }
    tokens = np.array(keyframes.token, dtype=np.str_)
    write_arrays(folder / f"{SAMPLES}.npz", {"token": tokens, "start": keyframes.start})
    folders.write_index(folder, {"scenes": scenes, "instances": len(boxes.token), "boxes": boxes.boxes})


def _scene_arrays(index: int, keyframes: Keyframes, boxes: Annotations) -> Arrays:
    """What is kept of a scene.

    Objects are numbered in the order of their tokens, which depends on nothing but the objects.
    """
    first, end = (int(row) for row in keyframes.start[index : index + 2])
    row = slice(*np.searchsorted(boxes.sample, [first, end]))
    instance, inverse = np.unique(boxes.instance[row], return_inverse=True)
    token = np.array([boxes.token[i] for i in instance], dtype=np.str_)
    order = np.argsort(token)
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.arange(len(order))
    return {
        "sample": np.array(keyframes.token[first:end], dtype=np.str_),  # [F] tokens
        "time": keyframes.time[first:end],  # [F] microseconds
        "ego": keyframes.ego[first:end],  # [F, 4] x y z yaw
        "start": np.searchsorted(boxes.sample[row], np.arange(first, end + 1)),  # [F + 1]
        "box": boxes.box[row],  # [R, 7]
        "class_id": boxes.class_id[row],  # [R] index into CLASSES
        "neutral": boxes.neutral[row],  # [R]
        "listed": boxes.listed[row],  # [R]
        "object_id": number[inverse],  # [R] index into instance
        "instance": token[order],  # [O] tokens
    }
