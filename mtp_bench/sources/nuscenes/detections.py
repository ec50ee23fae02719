"""Detection files of a card, cached per file and tables, and the scenes that they cover."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import DataError
from ...types import Detections, Ints, starts_of_sorted
from ..base import class_ids
from ..cache import Arrays, read_arrays, write_arrays
from . import folders
from .classes import CLASSES
from .detection_file import DetectedBoxes, no_match, read_detections
from .splits import counted
from .store import SAMPLES, TableStore
from .work import Work, no_work


@dataclass(frozen=True)
class DetectionStore:
    """A detection file and its cache: the boxes of the samples that the tables have."""

    path: Path
    digest: str  # sha256 of the file
    tables: TableStore
    folder: Path
    index: Mapping[str, Any]  # samples: in the file; example: a token of it; scenes: the frames of each that it has

    @property
    def frames(self) -> Mapping[str, list[int]]:
        """Frames of each scene that the file has."""
        found: Mapping[str, list[int]] = self.index["scenes"]
        return found

    def arrays(self, name: str) -> Arrays:
        """Arrays of a scene that the file has; a broken file of the cache is built again, if this one is the same."""
        path = self.folder / f"{name}.npz"

        def build_again() -> None:
            digest = folders.file_hash(self.path, no_work().on(self.path.name))
            folders.refuse_changed(path, _folder(self.tables.folder, digest), str(self.path))
            _build(self.path, self.folder, self.tables, no_work())

        return folders.made(path, read_arrays, build_again)


def bytes_left(paths: Sequence[Path], tables: Path | None) -> int:
    """Bytes to read before these files can be used; ``tables``: the cache of the tables, where it is known."""
    left = 0
    for path in paths:
        known, size = folders.stamped_hash(path), folders.file_size(path)
        built = known is not None and tables is not None and folders.read_index(_folder(tables, known)) is not None
        left += (known is None) * size + (not built) * size
    return left


def open_detections(paths: Sequence[Path], tables: TableStore, work: Work) -> tuple[DetectionStore, ...]:
    """The caches of these files, built first where they are not there.

    Raises DataError for a file that is wrong, naming the sample token, and where no file has samples of these tables.
    """
    stores = tuple(_open(path, tables, work) for path in paths)
    if stores and not any(store.frames for store in stores):
        said = [
            no_match(store.path, store.index["samples"], store.index["example"], tables.tables.version, "detections")
            for store in stores
        ]
        raise DataError("; ".join(said))
    return stores


def require_covered(
    stores: Sequence[DetectionStore], names: Sequence[str], splits: Mapping[str, Sequence[str]], split: str
) -> None:
    """Raise DataError unless each frame of the scenes ``names`` of ``split`` is in one of the files, and only in one.

    ``splits``: the scenes of all splits, named in the error.
    """
    for name in names:
        _refuse_shared(stores, name)
    lost = {name: frame for name in names if (frame := _first_lost(stores, name)) is not None}
    if not lost:
        return
    name, frame = next(iter(lost.items()))
    token = str(stores[0].tables.arrays(name)["sample"][frame])
    whole = {
        other: scenes
        for other, scenes in splits.items()
        if other != split and all(_first_lost(stores, scene) is None for scene in scenes)
    }
    files = ", ".join(str(store.path) for store in stores)
    hint = (
        f"wholly covered: {counted(whole)}; choose one with --split or split="
        if whole
        else "no split is wholly covered"
    )
    raise DataError(
        f"{files}: no entry for sample {token!r} of {name}: detections cover {len(names) - len(lost)} of the "
        f"{len(names)} scenes of split {split!r}; {hint}"
    )


def scene_detections(stores: Sequence[DetectionStore], name: str, frames: int, classes: Sequence[str]) -> Detections:
    """Detections of a scene of ``frames`` frames from all files that have some of it; other classes are dropped."""
    parts = [store.arrays(name) for store in stores if name in store.frames]
    frame, box, velocity, score, kind = (
        np.concatenate([part[key] for part in parts]) for key in ("frame", "box", "velocity", "score", "class_id")
    )
    class_id = class_ids(CLASSES, classes)[kind]
    used = np.flatnonzero(class_id >= 0)
    row = used[np.argsort(frame[used], kind="stable")]
    start = starts_of_sorted(frame[row], frames)
    return Detections(start, box[row], velocity[row], class_id[row], score[row])


def _open(path: Path, tables: TableStore, work: Work) -> DetectionStore:
    digest = folders.file_hash(path, work.on(path.name))
    folder = _folder(tables.folder, digest)
    index = folders.made(folder, folders.read_index, lambda: _build(path, folder, tables, work))
    return DetectionStore(path, digest, tables, folder, index)


def _folder(tables: Path, digest: str) -> Path:
    return folders.cache_folder() / f"{tables.name}-{folders.joint_digest([('detections', digest)])}"


def _build(path: Path, folder: Path, tables: TableStore, work: Work) -> None:
    samples = tables.arrays(SAMPLES)
    row = {str(token): at for at, token in enumerate(samples["token"])}
    boxes = read_detections(path, row, work.on(path.name))
    names = tuple(tables.index["scenes"])
    folders.build(folder, lambda part: _fill(part, boxes, names, samples["start"]))


def _fill(folder: Path, boxes: DetectedBoxes, names: Sequence[str], start: Ints) -> None:
    """Write the scenes ``names`` [S], whose samples begin at ``start`` [S + 1]."""
    scenes: dict[str, list[int]] = {}
    for index, name in enumerate(names):
        own = start[index : index + 2]
        covered = boxes.covered[slice(*np.searchsorted(boxes.covered, own))]
        if not len(covered):
            continue
        row = slice(*np.searchsorted(boxes.sample, own))
        arrays = {
            "frame": boxes.sample[row] - own[0], "box": boxes.box[row], "velocity": boxes.velocity[row],
            "class_id": boxes.class_id[row], "score": boxes.score[row],
        }  # fmt: skip
        write_arrays(folder / f"{name}.npz", arrays)
        scenes[name] = (covered - own[0]).tolist()
    folders.write_index(folder, {"samples": boxes.samples, "example": boxes.example, "scenes": scenes})


def _refuse_shared(stores: Sequence[DetectionStore], name: str) -> None:
    """Raise DataError where two files have the same sample."""
    owner: dict[int, DetectionStore] = {}
    for store in stores:
        for frame in store.frames.get(name, ()):
            if frame in owner:
                token = str(store.tables.arrays(name)["sample"][frame])
                raise DataError(
                    f"{store.path} and {owner[frame].path} both have sample {token!r} of {name}; "
                    "name one of them with --detections"
                )
            owner[frame] = store


def _first_lost(stores: Sequence[DetectionStore], name: str) -> int | None:
    """The first frame of a scene that no file has; None if there is none."""
    covered = {frame for store in stores for frame in store.frames.get(name, ())}
    frames = range(stores[0].tables.index["scenes"][name]["frames"])
    return next((frame for frame in frames if frame not in covered), None)
