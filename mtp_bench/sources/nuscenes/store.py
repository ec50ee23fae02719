"""The compact copy of nuScenes in the cache: folders of files of arrays.

One folder has the tables of one version.
"""

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
    CACHE_VARIABLE,
    DataError,
    Floats,
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

FORMAT = 4  # of the arrays in the cache: a change gets a new number
# speed at which a busy machine reads and checks tables and detections
_BYTES_PER_SECOND = 2.3e7
# no scene has a dot in its name
INDEX = "all.index"
SAMPLES = "all.samples"


@dataclass(frozen=True)
class CachedFolder:
    """A folder of files of arrays, made from ``sources`` once per machine."""

    prefix: str  # beginning of its name
    sources: Mapping[str, Path]  # the files that it is made from, by what they are
    fill: Callable[[Path], None]  # writes the files of the folder
    path: Path

    @classmethod
    def of(
        cls, prefix: str, sources: Mapping[str, Path], fill: Callable[[Path], None]
    ) -> Self:
        """Find the folder for these files in their present state.

        Raises DataError if one of them cannot be read.
        """
        return cls(prefix, sources, fill, _path(prefix, sources))

    def read(self, name: str) -> Arrays:
        """Read the arrays of the file ``name``.

        The folder is filled first if the file is missing or broken.
        Raises DataError if the sources are wrong or changed since the folder was
        opened, or if the cache cannot be written.
        """
        path = self.path / f"{name}.npz"
        arrays = read_arrays(path)
        if arrays is not None:
            return arrays
        try:
            arrays = self._make(path)
        except OSError as error:
            raise DataError(
                f"the compact copy of nuScenes cannot be kept in {self.path.parent}: "
                f"{error.strerror or error}; {CACHE_VARIABLE} names another folder"
            ) from None
        if arrays is None:
            raise DataError(f"{path} cannot be read back after writing it")
        return arrays

    def _make(self, path: Path) -> Arrays | None:
        """Fill the folder, and read the arrays of one of its files."""
        from filelock import FileLock

        source_files = list(self.sources.values())
        work_name = source_files[0].name if len(source_files) == 1 else self.prefix
        work_text = f"reading {work_name} of nuScenes, once per machine"
        expected_seconds = (
            sum(file.stat().st_size for file in source_files) / _BYTES_PER_SECOND
        )
        self.path.parent.mkdir(parents=True, exist_ok=True)
        lock = FileLock(self.path.with_name(f".{self.path.name}.lock"))
        with long_work(work_text, expected_seconds), lock:
            arrays = read_arrays(path)  # another process may have filled it meanwhile
            if arrays is None:
                self._fill()
                arrays = read_arrays(path)
        return arrays

    def _fill(self) -> None:
        if _path(self.prefix, self.sources) != self.path:
            files = ", ".join(str(path) for path in self.sources.values())
            raise DataError(
                f"{files}: changed since the scenes were opened; open them again"
            )
        remove_damaged(self.path)
        with whole_folder(self.path) as part_folder:
            self.fill(part_folder)


def _path(prefix: str, sources: Mapping[str, Path]) -> Path:
    """Return the path of the folder, named by a digest of the state of the files.

    A state is path, size, inode and times. A program can restore the time of a changed
    file (``mtime``), but not its ``ctime``.
    """
    states: list[list[str | int]] = []
    for name, path in sorted(sources.items()):
        try:
            state = path.stat()
        except OSError as error:
            raise DataError(
                f"{path} cannot be read: {error.strerror or error}"
            ) from None
        change_times = [state.st_mtime_ns, state.st_ctime_ns]
        file_state = [state.st_size, state.st_ino, *change_times]
        states.append([name, str(path.resolve()), *file_state])
    text = json.dumps([FORMAT, *states])
    digest = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:16]
    return cache_root() / "nuscenes" / f"{prefix}-{digest}"


@dataclass(frozen=True, eq=False)
class TableStore:
    """The cached tables of one version."""

    version: str
    cache: CachedFolder
    scenes: tuple[str, ...]  # [S] names, sorted
    start: Ints  # [S + 1] first row of each scene among all samples
    targets: Ints | None  # [S] number of prediction targets; None without their list

    def samples(self, scene: str) -> range:
        """Return the rows of the samples of a scene."""
        row = self.scenes.index(scene)
        return range(int(self.start[row]), int(self.start[row + 1]))

    def rows_of(self, scene: str, sample: Ints) -> slice:
        """Return the rows of a scene in a table sorted by ``sample`` [R]."""
        samples = self.samples(scene)
        return slice(*np.searchsorted(sample, [samples.start, samples.stop]))

    def sample_tokens(self, scene: str) -> list[str]:
        """Return the tokens of the samples of a scene."""
        return [token.decode() for token in self.tokens[self.samples(scene)].tolist()]

    @cached_property
    def tokens(self) -> NDArray[np.bytes_]:
        """Tokens [N] of all samples."""
        return self.cache.read(SAMPLES)["token"]

    @cached_property
    def to_lidar(self) -> Floats:
        """Transforms [N, 3, 4] from the global frame to the lidar at each sample."""
        return self.cache.read(SAMPLES)["to_lidar"]

    @cached_property
    def row_of_token(self) -> dict[str, int]:
        """Row of each sample by its token."""
        return {token.decode(): row for row, token in enumerate(self.tokens.tolist())}


def open_tables(root: Path, version: str) -> TableStore:
    """Open the cached tables of ``version``, which are read first if needed.

    Raises DataError naming the file, and the token, that is wrong.
    """
    sources = table_paths(root, version)
    if (root / PREDICTION).is_file():
        sources[PREDICTION] = root / PREDICTION
    cache = CachedFolder.of(version, sources, partial(_fill_tables, sources))
    index = cache.read(INDEX)
    scenes = tuple(index["scene"].tolist())
    return TableStore(version, cache, scenes, index["start"], index.get("targets"))


def _fill_tables(sources: Mapping[str, Path], folder: Path) -> None:
    keyframes = read_keyframes(sources)
    boxes = read_annotations(sources, sources.get(PREDICTION), keyframes)
    targets: list[int] = []
    for index, name in enumerate(keyframes.scene):
        arrays = _scene_arrays(index, keyframes, boxes)
        write_arrays(folder / f"{name}.npz", arrays)
        targets.append(int(arrays["listed"].sum()))
    tokens = np.array([token.encode() for token in keyframes.token], dtype=np.bytes_)
    samples = {"token": tokens, "to_lidar": keyframes.to_lidar}
    write_arrays(folder / f"{SAMPLES}.npz", samples)
    index_arrays: Arrays = {
        "scene": np.array(keyframes.scene, dtype=np.str_),
        "start": keyframes.start,
    }
    if PREDICTION in sources:
        index_arrays["targets"] = np.array(targets, dtype=np.int64)
    write_arrays(folder / f"{INDEX}.npz", index_arrays)


def _scene_arrays(index: int, keyframes: Keyframes, boxes: TrueBoxes) -> Arrays:
    """Return the arrays of a scene with F frames and R boxes.

    Objects are numbered in the order of their tokens.
    """
    first, end = keyframes.start[index : index + 2].tolist()
    rows = slice(*np.searchsorted(boxes.sample, [first, end]))
    instance, object_id = np.unique(boxes.instance[rows], return_inverse=True)
    frames = np.arange(first, end + 1)
    return {
        "time": keyframes.time[first:end],  # [F] microseconds
        "ego": keyframes.ego[first:end],  # [F, 4] x y z yaw
        "start": np.searchsorted(boxes.sample[rows], frames),  # [F + 1]
        "box": boxes.box[rows],  # [R, 7]
        "class_id": boxes.class_id[rows],  # [R] index into CLASSES
        "neutral": boxes.neutral[rows],  # [R]
        "listed": boxes.listed[rows],  # [R]
        "object_id": object_id,  # [R] index into instance
        "instance": np.char.decode(instance),  # [O] tokens
    }
