"""Large JSON files, read record by record: only the record at hand is in memory, not the file."""

from __future__ import annotations

import codecs
import re
import reprlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import ijson
import numpy as np

from ...errors import DataError
from ..text import read_json

Item = TypeVar("Item")
Record = dict[str, Any]
Read = Callable[[int], object]  # is told the number of bytes each time some were read

_CHUNK = 1 << 14  # bytes: ijson is slower with more at once
_DEEPEST = 1000  # lists and objects in each other: the parser keeps a path for each of them
_STEP = np.array([(letter in b"[{") - (letter in b"]}") for letter in range(256)], dtype=np.int8)  # of the depth
_NAN = re.compile(rb'(?<![\w"])NaN(?![\w"])')
_BRIEF = reprlib.Repr()  # short for long numbers, texts and lists, and for deeply nested ones
_BRIEF.maxstring = _BRIEF.maxother = 80


def unwatched(size: int) -> None:
    """A `Read` for small files: nobody is told."""


def brief(value: Any) -> str:
    """A value of a file for messages, shortened."""
    return _BRIEF.repr(value)


def read_records(path: Path, read: Read) -> Iterator[Record]:
    """Records of a file that holds a list of objects; NaN are None. DataError names the file and what is wrong."""
    return _records(path, read, b"[", "item", str(path))


def read_entries(path: Path, key: str, read: Read) -> Iterator[tuple[str, Any]]:
    """Entries of the object that the file has under ``key``; NaN are None. DataError as for `read_records`."""
    entry = None
    for entry in _parsed(path, read, b"{", lambda file: ijson.kvitems(file, key, use_float=True, buf_size=_CHUNK)):
        yield entry
    if entry is None and key not in read_json(path):
        raise DataError(f"{path} has no {key!r}")


def read_list(path: Path, key: str, read: Read) -> Iterator[Record]:
    """Records of the list that the object of a file has under ``key``; none without it. DataError as above."""
    return _records(path, read, b"{", f"{key}.item", f"{path}, {key}")


def _records(path: Path, read: Read, start: bytes, prefix: str, where: str) -> Iterator[Record]:
    for record in _parsed(path, read, start, lambda file: ijson.items(file, prefix, use_float=True, buf_size=_CHUNK)):
        if not isinstance(record, dict):
            raise DataError(f"{where}: got {brief(record)!r}, expected a record")
        yield record


def _parsed(path: Path, read: Read, start: bytes, parse: Callable[[_Strict], Iterable[Item]]) -> Iterator[Item]:
    """What ``parse`` finds in a file that begins with the bracket ``start``."""
    try:
        with path.open("rb") as file:
            head = file.peek()
            if head.startswith(codecs.BOM_UTF8):  # some editors write it
                file.seek(len(codecs.BOM_UTF8))
            if head.removeprefix(codecs.BOM_UTF8).lstrip()[:1] != start:
                raise DataError(f"{path}: got {brief(head[:20])}, expected a text that begins with {start.decode()!r}")
            yield from parse(_Strict(path, file, read))
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror}") from None
    except ijson.JSONError as error:
        cut = "; the file ends here: is it cut off?" if "premature EOF" in str(error) else ""
        raise DataError(f"{path} cannot be read as JSON: {' '.join(str(error).split())}{cut}") from None


class _Strict:
    """A file with null in place of NaN, which detection files have for unknown velocities and strict JSON has not.

    Brackets in texts are counted too: no text of a data set has a thousand of them.
    """

    def __init__(self, path: Path, file: BinaryIO, read: Read) -> None:
        self._path, self._file, self._read = path, file, read
        self._depth = 0

    def read(self, size: int) -> bytes:
        """The next bytes, some more than ``size`` where a NaN would be cut in two."""
        chunk = self._file.read(size)
        while chunk.endswith((b"N", b"Na")) and (more := self._file.read(2)):
            chunk += more
        self._read(len(chunk))
        self._descend(chunk)
        return _NAN.sub(b"null", chunk) if b"NaN" in chunk else chunk

    def _descend(self, chunk: bytes) -> None:
        """Raise DataError where lists and objects are nested so deeply that their paths would fill the memory."""
        opened = chunk.count(b"[") + chunk.count(b"{")
        if self._depth + opened > _DEEPEST:
            step = _STEP[np.frombuffer(chunk, dtype=np.uint8)]
            if self._depth + int(step.cumsum(dtype=np.int32).max()) > _DEEPEST:
                raise DataError(f"{self._path} cannot be read as JSON: nested deeper than {_DEEPEST} levels")
        self._depth += opened - chunk.count(b"]") - chunk.count(b"}")
