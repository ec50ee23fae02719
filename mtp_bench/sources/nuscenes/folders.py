"""Folders of the cache, named by the state of the files that they are made from, and written as a whole."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ...errors import DataError
from ...files import whole_folder
from ..cache import VARIABLE, Arrays, cache_root, read_arrays

FORMAT = 3  # of the arrays in the cache: a change gets a new number


@dataclass(frozen=True)
class CachedFolder:
    """A folder of files of arrays, which ``fill`` makes from ``sources`` once per machine."""

    prefix: str  # of its name
    sources: Mapping[str, Path]  # the files that it is made from, by what they are
    fill: Callable[[Path], None]  # writes the files of the folder
    path: Path

    @classmethod
    def of(cls, prefix: str, sources: Mapping[str, Path], fill: Callable[[Path], None]) -> CachedFolder:
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

        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with FileLock(self.path.with_name(f".{self.path.name}.lock")):
                arrays = read_arrays(path)  # another process may have filled it meanwhile
                if arrays is None:
                    self._fill()
                    arrays = read_arrays(path)
        except OSError as error:
            raise DataError(
                f"the compact copy of nuScenes cannot be kept in {self.path.parent}: {error.strerror or error}; "
                f"{VARIABLE} names another folder"
            ) from None
        if arrays is None:
            raise DataError(f"{path} cannot be read back after writing it")
        return arrays

    def _fill(self) -> None:
        if _path(self.prefix, self.sources) != self.path:
            changed = ", ".join(str(path) for path in self.sources.values())
            raise DataError(f"{changed}: changed since the scenes were opened; open them again")
        with whole_folder(self.path) as part:
            self.fill(part)


def _path(prefix: str, sources: Mapping[str, Path]) -> Path:
    """The state of a file changes with its content; programs can restore all of it but the second time."""
    states = []
    for name, path in sorted(sources.items()):
        try:
            state = path.stat()
        except OSError as error:
            raise DataError(f"{path} cannot be read: {error.strerror or error}") from None
        times = [state.st_mtime_ns, state.st_ctime_ns]
        states.append([name, str(path.resolve()), state.st_size, state.st_ino, *times])
    digest = hashlib.sha256(json.dumps([FORMAT, *states]).encode("utf-8", "surrogatepass")).hexdigest()[:16]
    return cache_root() / "nuscenes" / f"{prefix}-{digest}"
