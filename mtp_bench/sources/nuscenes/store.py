"""The tables of one version as a compact cache: one file of arrays per scene, and an index."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...types import Ints
from ..cache import Arrays, write_arrays
from .folders import CachedFolder
from .layout import PREDICTION, TABLES, prediction_path, table_paths
from .objects import Annotations, read_annotations
from .tables import Keyframes, read_keyframes

Note = Callable[[str], object]  # is told the name of a file or folder before it is read

INDEX, SAMPLES = "all.index", "all.samples"  # no scene has a dot in its name


@dataclass(frozen=True, eq=False)
class TableStore:
    """The cached tables of one version."""

    version: str
    cache: CachedFolder
    scenes: tuple[str, ...]  # [S] names, sorted
    start: Ints  # [S + 1] first row of each scene among all samples
    targets: Ints | None  # [S] prediction targets; None without the list of targets
    instances: int  # of all categories
    boxes: int  # of all categories

    def arrays(self, scene: str) -> Arrays:
        """Arrays of a scene, see `_scene_arrays`."""
        return self.cache.read(scene)

    def samples(self, scene: str) -> range:
        """Rows of the samples of a scene."""
        row = self.scenes.index(scene)
        return range(int(self.start[row]), int(self.start[row + 1]))

    @cached_property
    def tokens(self) -> NDArray[np.bytes_]:
        """Tokens [N] of all samples."""
        tokens: NDArray[np.bytes_] = self.cache.read(SAMPLES)["token"]
        return tokens

    @property
    def row_of_token(self) -> dict[str, int]:
        """Row of each sample by its token."""
        return {token.decode(): row for row, token in enumerate(self.tokens.tolist())}


def open_tables(root: Path, version: str, note: Note = lambda name: None) -> TableStore:
    """The cached tables of ``version``, which are read first if they are not in the cache.

    ``note`` is told the name of the version before. Raises DataError naming the file, and the token, that is wrong.
    """
    sources = table_paths(root, version)
    prediction = prediction_path(root)
    if prediction is not None:
        sources[PREDICTION] = prediction
    cache = CachedFolder.of(version, sources, partial(_fill, sources, version, note))
    index = cache.read(INDEX)
    return TableStore(
        version=version,
        cache=cache,
        scenes=tuple(index["scene"].tolist()),
        start=index["start"],
        targets=index.get("targets"),
        instances=int(index["instances"]),
        boxes=int(index["boxes"]),
    )


def _fill(sources: dict[str, Path], version: str, note: Note, folder: Path) -> None:
    note(version)
    paths = {name: sources[name] for name in TABLES}
    keyframes = read_keyframes(paths)
    boxes = read_annotations(paths, sources.get(PREDICTION), keyframes)
    targets = []
    for index, name in enumerate(keyframes.scene):
        arrays = _scene_arrays(index, keyframes, boxes)
        write_arrays(folder / f"{name}.npz", arrays)
        targets.append(int(arrays["listed"].sum()))
    tokens = np.array([token.encode() for token in keyframes.token], dtype=np.bytes_)
    write_arrays(folder / f"{SAMPLES}.npz", {"token": tokens})
    listed = {"targets": np.array(targets, dtype=np.int64)} if PREDICTION in sources else {}
    numbers = {"instances": np.array(len(boxes.token)), "boxes": np.array(boxes.boxes)}
    index_arrays = {"scene": np.array(keyframes.scene, dtype=np.str_), "start": keyframes.start, **numbers, **listed}
    write_arrays(folder / f"{INDEX}.npz", index_arrays)


def _scene_arrays(index: int, keyframes: Keyframes, boxes: Annotations) -> Arrays:
    """Arrays of a scene with F frames, R boxes and O objects.

    Objects are numbered in the order of their tokens, which depends on the objects alone.
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
