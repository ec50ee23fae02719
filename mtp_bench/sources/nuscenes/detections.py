"""Detection files of a card, cached per file and tables, and the scenes that they cover."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ...errors import DataError
from ...types import Bools, Detections, starts_of_sorted
from ..base import class_ids
from ..cache import write_arrays
from .layout import CLASSES
from .store import INDEX, CachedFolder, TableStore
from .submission import no_match, read_submission


@dataclass(frozen=True, eq=False)
class DetectionStore:
    """A detection file and its cache, which holds the boxes of samples in the tables."""

    path: Path
    cache: CachedFolder
    covered: Bools  # [N] samples of the tables that the file has


def open_detections(paths: Sequence[Path], tables: TableStore, names: Sequence[str]) -> tuple[DetectionStore, ...]:
    """Open files, the smallest first, until they cover the scenes ``names``; a file is read whole once, and cached.

    Raises DataError for an invalid file, naming the sample token, if no file has samples of these tables, and unless
    each frame of the scenes is in exactly one of the files.
    """
    wanted = np.concatenate([np.array(tables.samples(name)) for name in names])
    stores: list[DetectionStore] = []
    files = np.zeros(tables.start[-1], dtype=np.int64)  # [N] that have the sample
    for path in sorted(paths, key=lambda path: (path.stat().st_size, path)):
        if not files[wanted].all():
            stores.append(_open(path, tables))
            files += stores[-1].covered
    if not stores:
        return ()
    if not files.any():
        every = [(store.path, store.cache.read(INDEX)) for store in stores]
        told = [no_match(path, int(i["samples"]), str(i["example"]), tables.version, "detections") for path, i in every]
        raise DataError("; ".join(told))
    wrong = wanted[files[wanted] != 1]
    if len(wrong):
        holders = sorted(str(store.path) for store in stores if store.covered[wrong[0]])
        scene = tables.scenes[int(np.searchsorted(tables.start, wrong[0], side="right")) - 1]
        sample = f"sample {tables.tokens[wrong[0]].decode()!r} of {scene}"
        if holders:
            raise DataError(f"{' and '.join(holders)} both have {sample}; name one of them with --detections")
        covered = sum(bool(files[tables.samples(name)].all()) for name in names)
        raise DataError(
            f"{', '.join(str(store.path) for store in stores)}: no entry for {sample}: detections cover {covered} of "
            f"the {len(names)} scenes; choose another split with --split or split="
        )
    return tuple(stores)


def scene_detections(stores: Sequence[DetectionStore], samples: range, name: str, classes: Sequence[str]) -> Detections:
    """Detections of the scene ``name`` (rows ``samples`` of the tables) from all files; other classes are dropped."""
    parts = [store.cache.read(name) for store in stores if store.covered[samples].any()]
    frame, box, velocity, score, kind = (
        np.concatenate([part[key] for part in parts]) for key in ("frame", "box", "velocity", "score", "class_id")
    )
    class_id = class_ids(CLASSES, classes)[kind]
    used = np.flatnonzero(class_id >= 0)
    row = used[np.argsort(frame[used], kind="stable")]
    start = starts_of_sorted(frame[row], len(samples))
    return Detections(start, box[row], velocity[row], class_id[row], score[row])


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
