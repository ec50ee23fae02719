"""Detection files of a card, cached per file and tables, and the scenes that they cover."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ...errors import DataError
from ...types import Bools, Detections, starts_of_sorted
from ..base import class_ids
from ..cache import Arrays, write_arrays
from .names import CLASSES, counted
from .store import INDEX, CachedFolder, TableStore
from .submission import no_match, read_submission

_HEAD = 1 << 16  # bytes of a file in which its first sample is looked for
_FIRST_SAMPLE = re.compile(rb'"results"\s*:\s*\{\s*"([^"\\]*)"')


@dataclass(frozen=True, eq=False)
class DetectionStore:
    """A detection file and its cache, which holds the boxes of samples in the tables."""

    path: Path
    cache: CachedFolder
    covered: Bools  # [N] samples of the tables that the file has

    def arrays(self, scene: str) -> Arrays:
        """Detections of a scene in the file, as arrays; the file must have at least one sample of it."""
        return self.cache.read(scene)


def open_detections(paths: Sequence[Path], tables: TableStore, names: Sequence[str]) -> tuple[DetectionStore, ...]:
    """Open the files that cover the scenes ``names``; a file is read whole the first time, and cached.

    All files are opened whose first sample is of one of the scenes or cannot be found, and then others until all scenes
    are covered. Raises DataError for an invalid file, naming the sample token, and if no file has samples of
    these tables.
    """
    wanted = np.zeros(tables.start[-1], dtype=bool)
    for name in names:
        wanted[tables.samples(name)] = True
    begins = {path: len(paths) == 1 or _begins_in(path, tables, wanted) for path in paths}
    stores: list[DetectionStore] = []
    for path in sorted(paths, key=lambda path: not begins[path]):
        covered = np.any([store.covered for store in stores], axis=0)
        if begins[path] or not np.all(covered | ~wanted):
            stores.append(_open(path, tables))
    if stores and not any(store.covered.any() for store in stores):
        indices = [store.cache.read(INDEX) for store in stores]
        raise DataError(
            "; ".join(
                no_match(store.path, int(index["samples"]), str(index["example"]), tables.version, "detections")
                for store, index in zip(stores, indices, strict=True)
            )
        )
    return tuple(stores)


def require_covered(
    stores: Sequence[DetectionStore],
    tables: TableStore,
    names: Sequence[str],
    splits: Mapping[str, Sequence[str]],
    split: str,
) -> None:
    """Raise DataError unless each frame of the scenes ``names`` of ``split`` is in exactly one of the files.

    ``splits``: the scenes of all splits, named in the error.
    """
    files = np.sum([store.covered for store in stores], axis=0)  # [N] that have the sample
    for name in names:
        rows = np.array(tables.samples(name))
        if (files[rows] > 1).any():
            row = int(rows[np.argmax(files[rows] > 1)])
            both = " and ".join(str(store.path) for store in stores if store.covered[row])
            token = tables.tokens[row].decode()
            raise DataError(f"{both} both have sample {token!r} of {name}; name one of them with --detections")
    covered = {scene for scene in tables.scenes if files[tables.samples(scene)].all()}
    lost = [name for name in names if name not in covered]
    if lost:
        first = tables.samples(lost[0])
        token = tables.tokens[first[int(np.argmin(files[first]))]].decode()
        whole = {other: scenes for other, scenes in splits.items() if other != split and covered.issuperset(scenes)}
        choice = f"wholly covered: {counted(whole)}; choose one with --split or split="
        raise DataError(
            f"{', '.join(str(store.path) for store in stores)}: no entry for sample {token!r} of {lost[0]}: detections "
            f"cover {len(names) - len(lost)} of the {len(names)} scenes of split {split!r}; "
            f"{choice if whole else 'no split is wholly covered'}"
        )


def scene_detections(stores: Sequence[DetectionStore], samples: range, name: str, classes: Sequence[str]) -> Detections:
    """Detections of the scene ``name`` (rows ``samples`` of the tables) from all files; other classes are dropped."""
    parts = [store.arrays(name) for store in stores if store.covered[samples].any()]
    frame, box, velocity, score, kind = (
        np.concatenate([part[key] for part in parts]) for key in ("frame", "box", "velocity", "score", "class_id")
    )
    class_id = class_ids(CLASSES, classes)[kind]
    used = np.flatnonzero(class_id >= 0)
    row = used[np.argsort(frame[used], kind="stable")]
    start = starts_of_sorted(frame[row], len(samples))
    return Detections(start, box[row], velocity[row], class_id[row], score[row])


def _begins_in(path: Path, tables: TableStore, wanted: Bools) -> bool:
    """True if the first sample of a file is a wanted one, or if no sample can be found at its beginning."""
    with path.open("rb") as file:
        found = _FIRST_SAMPLE.search(file.read(_HEAD))
    return found is None or bool(wanted[tables.tokens == found.group(1)].any())


def _open(path: Path, tables: TableStore) -> DetectionStore:
    cache = CachedFolder.of(tables.cache.path.name, {"detections": path}, partial(_fill, path, tables))
    return DetectionStore(path, cache, cache.read(INDEX)["covered"])


def _fill(path: Path, tables: TableStore, folder: Path) -> None:
    boxes = read_submission(path, tables.row_of_token)
    covered = np.zeros(tables.start[-1], dtype=bool)
    covered[boxes.covered] = True
    for name in tables.scenes:
        samples = tables.samples(name)
        if covered[samples].any():
            row = slice(*np.searchsorted(boxes.sample, [samples.start, samples.stop]))
            arrays = {
                "frame": boxes.sample[row] - samples.start, "box": boxes.box[row], "velocity": boxes.velocity[row],
                "class_id": boxes.class_id[row], "score": boxes.score[row],
            }  # fmt: skip
            write_arrays(folder / f"{name}.npz", arrays)
    index = {"covered": covered, "samples": np.array(boxes.samples), "example": np.array(boxes.example)}
    write_arrays(folder / f"{INDEX}.npz", index)
