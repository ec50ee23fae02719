"""The cache of what is made once per machine: where it is, and files of arrays that show when they are broken."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..files import BROKEN_ARCHIVE, whole_file

Arrays = dict[str, NDArray[Any]]

VARIABLE = "MTP_BENCH_CACHE"


def cache_root() -> Path:
    """The folder of everything that is made once: the one that MTP_BENCH_CACHE names, else the user cache folder."""
    if os.environ.get(VARIABLE):
        return Path(os.environ[VARIABLE]).expanduser()
    from platformdirs import user_cache_path

    return user_cache_path("mtp_bench", appauthor=False)


def content_hash(arrays: Arrays) -> str:
    """sha256 of the arrays' names, types, shapes and values, whatever their order."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape};".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def read_arrays(path: Path) -> Arrays | None:
    """Stored arrays; None where they are not there or not what was written."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            arrays: Arrays = {name: file[name] for name in file.files}
        digest = str(arrays.pop("digest"))
        return arrays if content_hash(arrays) == digest else None
    except BROKEN_ARCHIVE:
        return None


def write_arrays(path: Path, arrays: Arrays, brief: bool = False) -> None:
    """Store arrays with a hash of their content, as a whole or not at all. Raises OSError.

    ``brief``: they are kept for minutes alone, so that packing them would take longer than it is worth.
    """
    save = np.savez if brief else np.savez_compressed
    with whole_file(path) as part, part.open("wb") as file:
        save(file, allow_pickle=False, digest=np.array(content_hash(arrays)), **arrays)
