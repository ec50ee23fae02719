"""JSON files that are larger than memory: a map of keys, whose values are read later."""

import gzip
import mmap
import os
import tempfile
import zlib
from pathlib import Path
from typing import Any, BinaryIO

import msgspec

from ..core import DataError, MissingDataError, open_regular
from .text import as_json, decode

MAX_BYTES = 16 << 30  # of a file, and of what a compressed one unpacks to


def read_keys(path: Path) -> dict[str, msgspec.Raw]:
    """Return the undecoded values of a JSON object by key; ``.gz`` is unpacked.

    They are views of the file, which the system loads and drops as needed. Raises
    DataError for a file that is missing, no JSON object, or above `MAX_BYTES`.
    """
    try:
        with open_regular(path) as stream:
            content = _unpacked(path, stream) if path.suffix == ".gz" else stream
            _require_size(path, os.fstat(content.fileno()).st_size)
            # the values are views of it, so it stays open as long as they are used
            mapped = mmap.mmap(content.fileno(), 0, access=mmap.ACCESS_READ)
    except FileNotFoundError:
        raise MissingDataError(f"no file {path}") from None
    except (OSError, ValueError, EOFError, zlib.error) as error:
        raise DataError(f"{path} cannot be read: {error}") from None
    return decode(_without_nan(mapped), dict[str, msgspec.Raw], path)


def _without_nan(mapped: mmap.mmap) -> Any:
    """Return the file, or a changed copy of it if it has numbers that are no JSON."""
    if mapped.find(b"NaN") < 0 and mapped.find(b"Infinity") < 0:
        return mapped
    return as_json(mapped[:])


def _unpacked(path: Path, stream: BinaryIO) -> BinaryIO:
    unpacked: Any = tempfile.TemporaryFile()  # noqa: SIM115 (the map outlives it)
    with gzip.GzipFile(fileobj=stream) as packed:
        while chunk := packed.read(1 << 24):
            _require_size(path, unpacked.tell() + len(chunk))
            unpacked.write(chunk)
    unpacked.flush()
    return unpacked  # type: ignore[no-any-return]


def _require_size(path: Path, size_bytes: int) -> None:
    if size_bytes > MAX_BYTES:
        raise DataError(f"{path}: above {MAX_BYTES >> 30} GiB unpacked, the limit")
