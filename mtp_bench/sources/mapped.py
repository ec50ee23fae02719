"""JSON files that are larger than memory: a map of keys, whose values are read later."""

import codecs
import gzip
import mmap
import os
import tempfile
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import IO

import msgspec

from ..core import DataError, open_regular
from .text import as_json, decode, reading

MAX_BYTES = 16 << 30  # of a file, and of what a compressed one unpacks to
_CHUNK_BYTES = 1 << 24


def read_keys(path: Path) -> dict[str, msgspec.Raw]:
    """Return the undecoded values of a JSON object by key; ``.gz`` is unpacked.

    Of an object with a key ``results``, they are those under it. They are views of the
    file, which the system loads and drops as needed. Raises DataError for a file that
    is missing, no such JSON, or above `MAX_BYTES`.
    """
    with reading(path, "JSON"), open_regular(path) as stream:
        if path.suffix == ".gz":
            packed = gzip.GzipFile(fileobj=stream)
            mapped = _copied(path, iter(partial(packed.read, _CHUNK_BYTES), b""))
        else:
            mapped = _mapped(path, stream)
        try:
            return _keys(path, mapped)
        except DataError:
            return _keys(path, _copied(path, map(as_json, _pieces(mapped))))


def _keys(path: Path, mapped: mmap.mmap) -> dict[str, msgspec.Raw]:
    values = decode(mapped, dict[str, msgspec.Raw], path)
    if "results" in values:
        return decode(values["results"], dict[str, msgspec.Raw], path)
    return values


def _mapped(path: Path, stream: IO[bytes]) -> mmap.mmap:
    """Return the content of a file, which may be closed then."""
    stream.flush()
    _require_size(path, os.fstat(stream.fileno()).st_size)
    return mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)


def _copied(path: Path, chunks: Iterable[bytes]) -> mmap.mmap:
    """Return the content of a temporary file of ``chunks``."""
    with tempfile.TemporaryFile() as copy:
        for chunk in chunks:
            _require_size(path, copy.tell() + len(chunk))
            copy.write(chunk)
        return _mapped(path, copy)


def _pieces(mapped: mmap.mmap) -> Iterator[bytes]:
    """Yield a file in pieces that end at a comma, which is in no number."""
    start = 0
    if mapped[: len(codecs.BOM_UTF8)] == codecs.BOM_UTF8:
        start = len(codecs.BOM_UTF8)
    while start < len(mapped):
        end = mapped.find(b",", start + _CHUNK_BYTES) + 1 or len(mapped)
        yield mapped[start:end]
        start = end


def _require_size(path: Path, size_bytes: int) -> None:
    if size_bytes > MAX_BYTES:
        raise DataError(f"{path}: above {MAX_BYTES >> 30} GiB unpacked, the limit")
