"""The compact copy of nuScenes in the cache: folders of files of arrays, and that of the tables of one version."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...core import (
    CACHE,
    DataError,
    Ints,
    cache_root,
    long_work,
    remove_damaged,
    whole_folder,
)
from ..cache import Arrays, read_arrays, write_arrays
from .layout import PREDICTION, table_paths
from .objects import TrueBoxes, read_annotations
from .tables import Keyframes, read_keyframes

FORMAT = 3  # of the arrays in the cache: a change gets a new number
_BYTES_PER_SECOND = (
    2.3e7  # of tables and detections, read and checked on a machine that is busy
)
INDEX, SAMPLES = "all.index", "all.samples"  # no scene has a dot in its name


@dataclass(frozen=True)
class CachedFolder:
    """A folder of files of arrays, which ``fill`` makes from ``sources`` once per machine."""

    prefix: str  # of its name
    sources: Mapping[str, Path]  # the files that it is made from, by what they are
    fill: Callable[[Path], None]  # writes the files of the folder
    path: Path

    @classmethod
    def of(
        cls, prefix: str, sources: Mapping[str, Path], fill: Callable[[Path], None]
    ) -> Self:
        """The folder for these files in their present state; raises DataError if one of them cannot be read."""
        return cls(prefix, sources, fill, _path(prefix, sources))

    def read(self, name: str) -> Arrays:
        """Arrays of the file ``name``; the folder is filled first if the file is missing or broken.

        Raises DataError if the sources are wrong or changed since the folder was opened, or if the cache cannot be
        written.
        """
        path = self.path / f"{name}.npz"
        arrays = read_arrays(path)
        return self._made(path) if arrays is None else arrays

    def _made(self, path: Path) -> Arrays:
        from filelock import FileLock

        names = [path.name for path in self.sources.values()]
        text = f"reading {names[0] if len(names) == 1 else self.prefix} of nuScenes, once per machine"
        try:
            seconds = (
                sum(path.stat().st_size for path in self.sources.values())
                / _BYTES_PER_SECOND
            )
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with (
                long_work(text, seconds),
                FileLock(self.path.with_name(f".{self.path.name}.lock")),
            ):
                arrays = read_arrays(
                    path
                )  # another process may have filled it meanwhile
                if arrays is None:
                    self._fill()
                    arrays = read_arrays(path)
        except OSError as error:
            got = f"the compact copy of nuScenes cannot be kept in {self.path.parent}: {error.strerror or error}"
            raise DataError(f"{got}; {CACHE} names another folder") from None
        if arrays is None:
            raise DataError(f"{path} cannot be read back after writing it")
        return arrays

    def _fill(self) -> None:
        if _path(self.prefix, self.sources) != self.path:
            changed = ", ".join(str(path) for path in self.sources.values())
            raise DataError(
                f"{changed}: changed since the scenes were opened; open them again"
            )
        remove_damaged(self.path)
        with whole_folder(self.path) as part:
            self.fill(part)


def _path(prefix: str, sources: Mapping[str, Path]) -> Path:
    """Path of the folder by the state of the files; programs can restore all of a state but its ``ctime``."""
    states = []
    for name, path in sorted(sources.items()):
        try:
            state = path.stat()
        except OSError as error:
            raise DataError(
                f"{path} cannot be read: {error.strerror or error}"
            ) from None
        states.append(
            [
                name,
                str(path.resolve()),
                state.st_size,
                state.st_ino,
                state.st_mtime_ns,
                state.st_ctime_ns,
            ]
        )
    digest = hashlib.sha256(
        json.dumps([FORMAT, *states]).encode("utf-8", "surrogatepass")
    ).hexdigest()[:16]
    return cache_root() / "nuscenes" / f"{prefix}-{digest}"


@dataclass(frozen=True, eq=False)
class TableStore:
    """The cached tables of one version."""

    version: str
    cache: CachedFolder
    scenes: tuple[str, ...]  # [S] names, sorted
    start: Ints  # [S + 1] first row of each scene among all samples
    targets: Ints | None  # [S] prediction targets; None without the list of targets

    def samples(self, scene: str) -> range:
        """Rows of the samples of a scene."""
        row = self.scenes.index(scene)
        return range(int(self.start[row]), int(self.start[row + 1]))

    def sample_tokens(self, scene: str) -> list[str]:
        """Tokens of the samples of a scene."""
        return [token.decode() for token in self.tokens[self.samples(scene)].tolist()]

    @cached_property
    def tokens(self) -> NDArray[np.bytes_]:
        """Tokens [N] of all samples."""
        return self.cache.read(SAMPLES)["token"]

    @property
    def row_of_token(self) -> dict[str, int]:
        """Row of each sample by its token."""
        return {token.decode(): row for row, token in enumerate(self.tokens.tolist())}


def open_tables(root: Path, version: str) -> TableStore:
    """The cached tables of ``version``, which are read first if they are not in the cache.

    Raises DataError naming the file, and the token, that is wrong.
    """
    sources = table_paths(root, version)
    if (root / PREDICTION).is_file():
        sources[PREDICTION] = root / PREDICTION
    cache = CachedFolder.of(version, sources, partial(_fill, sources))
    index = cache.read(INDEX)
    return TableStore(
        version,
        cache,
        tuple(index["scene"].tolist()),
        index["start"],
        index.get("targets"),
    )


def _fill(sources: dict[str, Path], folder: Path) -> None:
    keyframes = read_keyframes(sources)
    boxes = read_annotations(sources, sources.get(PREDICTION), keyframes)
    targets = []
    for index, name in enumerate(keyframes.scene):
        arrays = _scene_arrays(index, keyframes, boxes)
        write_arrays(folder / f"{name}.npz", arrays)
        targets.append(int(arrays["listed"].sum()))
    tokens = np.array([token.encode() for token in keyframes.token], dtype=np.bytes_)
    write_arrays(folder / f"{SAMPLES}.npz", {"token": tokens})
    listed = (
        {"targets": np.array(targets, dtype=np.int64)} if PREDICTION in sources else {}
    )
    index_arrays = {
        "scene": np.array(keyframes.scene, dtype=np.str_),
        "start": keyframes.start,
        **listed,
    }
    write_arrays(folder / f"{INDEX}.npz", index_arrays)


def _scene_arrays(index: int, keyframes: Keyframes, boxes: TrueBoxes) -> Arrays:
    """Arrays of a scene with F frames and R boxes; objects are numbered in the order of their tokens."""
    first, end = (int(row) for row in keyframes.start[index : index + 2])
    row = slice(*np.searchsorted(boxes.sample, [first, end]))
    instance, object_id = np.unique(boxes.instance[row], return_inverse=True)
    return {
        "time": keyframes.time[first:end],  # [F] microseconds
        "ego": keyframes.ego[first:end],  # [F, 4] x y z yaw
        "start": np.searchsorted(
            boxes.sample[row], np.arange(first, end + 1)
        ),  # [F + 1]
        "box": boxes.box[row],  # [R, 7]
        "class_id": boxes.class_id[row],  # [R] index into CLASSES
        "neutral": boxes.neutral[row],  # [R]
        "listed": boxes.listed[row],  # [R]
        "object_id": object_id,  # [R] index into instance
        "instance": np.char.decode(instance),  # [O] tokens
    }
