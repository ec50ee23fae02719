"""Digests of own scenes and own detections, for the digest of a card."""

import hashlib
import re
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..core import CardError, DataError, Scene, file_digest
from .source import FilesSource

FORMS = ("csv", "parquet")
_TABLES = ("truth", "detections", "ego", "annotated", "neutral_areas")
SCENES = tuple(f"*/{table}.{form}" for table in _TABLES for form in FORMS)
ROADS = tuple(f"*/lanes.{form}" for form in FORMS)
# files of a folder that hold detections or forecasts
_PATTERNS = ("*.txt", "*/*.txt", *(f"*.{form}" for form in FORMS))


def resolve_folder(section: FilesSource, base: Path, lanes: bool) -> FilesSource:
    """Return the section with absolute path and digest.

    The path is relative to ``base``. There is no digest if the folder does not exist. A
    ``sha256`` that the card states is kept, so other files are refused when they are
    opened.
    """
    folder = (base.absolute() / Path(section.folder or "").expanduser()).resolve()
    digest = section.sha256
    if digest is None and folder.is_dir():
        digest = own_digest(split_folder(folder, section.split), lanes)
    return section.model_copy(update={"folder": str(folder), "sha256": digest})


def split_folder(folder: Path, split: str) -> Path:
    """Return the folder of the scenes of a split.

    A split is the sub-folder of its name, and "all" is the folder itself.
    """
    return folder if split == "all" else folder / split


def own_digest(folder: Path, lanes: bool) -> str:
    """Return the digest of a folder of own scenes.

    ``lanes``: also of their tables of lanes, which agents then see.
    """
    patterns = SCENES + ROADS if lanes else SCENES
    return folder_digest(folder, patterns)


def folder_digest(folder: Path, patterns: Sequence[str]) -> str:
    """Return the hex sha256 over matching files of a folder.

    Names and contents are hashed; hidden files are skipped. Raises DataError if a file
    cannot be read.
    """
    digest = hashlib.sha256()
    for path in sorted({path for pattern in patterns for path in folder.glob(pattern)}):
        name = path.relative_to(folder)
        if any(part.startswith(".") for part in name.parts):
            continue
        try:
            content = cached_digest(path)
        except OSError as error:
            raise DataError(
                f"{path}: cannot be read: {error.strerror or error}"
            ) from None
        entry = f"{name.as_posix()}\0{content};"
        digest.update(entry.encode("utf-8", "surrogateescape"))
    return digest.hexdigest()


def plain_name(name: str) -> str:
    """Return ``name`` as the name of a detector.

    Hyphens replace characters that are not allowed there.
    """
    return re.sub(r"[^A-Za-z0-9_.-]", "-", name).lstrip("_.-") or "own"


def path_digest(path: Path) -> str:
    """Return the hex sha256 of a file, or over the texts and tables of a folder.

    Raises OSError or DataError as `cached_digest` and `folder_digest`.
    """
    return folder_digest(path, _PATTERNS) if path.is_dir() else cached_digest(path)


def cached_digest(path: Path) -> str:
    """Return the hex sha256 of a file, or raise OSError.

    The file is read once per process unless its size or times change.
    """
    state = path.stat()
    return _digest(path, state.st_size, state.st_mtime_ns, state.st_ctime_ns)


def scenes_digest(scenes: Sequence[Scene]) -> str:
    """Return the hex sha256 over ``scenes``.

    Fields that a comparison leaves out, such as names of objects, do not count.
    """
    digest = hashlib.sha256()
    for scene in scenes:
        _add(digest, scene)
    return digest.hexdigest()


@cache
def _digest(path: Path, *state: int) -> str:  # the state is for the cache alone
    return file_digest(path)


def _add(digest: Any, value: Any) -> None:
    """Add a value of a record to a digest, field by field.

    Arrays have their dtype and shape there.
    """
    if is_dataclass(value):
        for field in fields(value):
            if not field.compare:
                continue
            digest.update(f"{field.name}:".encode())
            _add(digest, getattr(value, field.name))
    elif isinstance(value, tuple):
        digest.update(f"{len(value)}(".encode())
        for part in value:
            _add(digest, part)
    elif isinstance(value, np.ndarray):
        if value.dtype.hasobject:  # its bytes would be addresses
            raise CardError("a scene has an array of objects, expected numbers")
        array = np.ascontiguousarray(value)
        digest.update(f"{array.dtype.str} {array.shape};".encode())
        digest.update(array.tobytes())
    else:
        digest.update(f"{value!r};".encode())
