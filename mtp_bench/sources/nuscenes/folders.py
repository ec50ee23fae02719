"""Folders of the cache: named by the content of their source files, written as a whole or not at all."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

from ...errors import DataError
from ...files import whole_file
from ..cache import VARIABLE, cache_root
from .json_stream import Read

Content = TypeVar("Content")

FORMAT = 2  # of the arrays in the cache: a change gets a new number
INDEX = "index.json"
_CHUNK = 1 << 22  # bytes
_SETTLED = 2_000_000_000  # ns; a file that was changed just now may change again without a new time


def cache_folder() -> Path:
    """Where the compact copies of nuScenes are."""
    return cache_root() / "nuscenes"


def stamped_hash(path: Path) -> str | None:
    """sha256 of a file, if it was hashed before and is the same file in the same state."""
    stamp = _read_json(_stamp_path(path))
    return str(stamp["sha256"]) if stamp and _state(path).items() <= stamp.items() and "sha256" in stamp else None


def file_hash(path: Path, read: Read) -> str:
    """sha256 of a file, kept with its state, so that gigabytes are not hashed at every start.

    Raises DataError for a file that cannot be read.
    """
    known = stamped_hash(path)
    if known is not None:
        return known
    state, digest = _state(path), hashlib.sha256()
    with _readable(path), path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            digest.update(chunk)
            read(len(chunk))
    if time.time_ns() - max(state["mtime_ns"], state["ctime_ns"]) > _SETTLED:
        with suppress(OSError):  # it is hashed again next time
            _write_text(_stamp_path(path), json.dumps({**state, "path": str(path), "sha256": digest.hexdigest()}))
    return digest.hexdigest()


def file_size(path: Path) -> int:
    """Bytes of a file; DataError where it cannot be read."""
    return _state(path)["size"]


def joint_digest(hashes: Iterable[tuple[str, str]]) -> str:
    """Digest of files by what they are and their hashes."""
    content = json.dumps([FORMAT, *sorted(hashes)])
    return hashlib.sha256(content.encode()).hexdigest()[:16]


def read_index(folder: Path) -> dict[str, Any] | None:
    """The index of a folder of the cache; None where it is not there or not what was written."""
    index = _read_json(folder / INDEX)
    digest = index.pop("digest", None) if index else None
    return index if index and digest == _index_digest(index) else None


def write_index(folder: Path, content: dict[str, Any]) -> None:
    """Store the index of a folder with a hash of its content."""
    _write_text(folder / INDEX, json.dumps({**content, "digest": _index_digest(content)}, separators=(",", ":")))


def build(folder: Path, fill: Callable[[Path], None]) -> None:
    """Let ``fill`` write a folder, which is put in place as a whole; several processes may do so at once.

    Raises DataError where the cache cannot be written.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as beside:
            part = Path(beside, folder.name)
            part.mkdir()
            fill(part)
            _install(part, folder)
    except OSError as error:
        raise DataError(
            f"the compact copy of nuScenes cannot be kept in {folder.parent}: {error.strerror or error}; "
            f"{VARIABLE} names another folder"
        ) from None


def _install(part: Path, folder: Path) -> None:
    """A folder that is there has the same content, of another process that may be reading it, or it is broken.

    So its files are replaced one by one, the index last; the folder is there all the time.
    """
    if not folder.exists():
        with suppress(OSError):
            part.rename(folder)
            return
    for path in sorted(part.iterdir(), key=lambda path: path.name == INDEX):
        path.replace(folder / path.name)


def made(path: Path, read: Callable[[Path], Content | None], make: Callable[[], None]) -> Content:
    """What ``read`` finds at a path of the cache, which ``make`` writes first where it is not there or broken."""
    if (content := read(path)) is None:
        make()
        content = read(path)
    if content is None:
        raise DataError(f"{path} cannot be read back after writing it")
    return content


def refuse_changed(path: Path, folder: Path, what: str) -> None:
    """Raise DataError where a broken file of the cache cannot be built again: today ``what`` belongs in ``folder``."""
    if folder != path.parent:
        raise DataError(f"{path} is broken, and {what} changed since it was written: open the source again")


def _index_digest(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _stamp_path(path: Path) -> Path:
    name = hashlib.sha256(os.fsencode(path.resolve())).hexdigest()[:24]
    return cache_folder() / "stamps" / f"{name}.json"


def _state(path: Path) -> dict[str, int]:
    """What changes with a file's content; a program may restore the time of the content, but not that of the state."""
    with _readable(path):
        state = path.stat()
    return {
        "size": state.st_size, "mtime_ns": state.st_mtime_ns, "ctime_ns": state.st_ctime_ns,
        "inode": state.st_ino, "device": state.st_dev,
    }  # fmt: skip


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}") from None


def _read_json(path: Path) -> dict[str, Any] | None:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


def _write_text(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8")
