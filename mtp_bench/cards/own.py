"""Own scenes in a card: a folder of files, or `Scene` objects, and what stands for their content in its digest."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import CardError, DataError
from ..files import file_digest
from ..types import Scene
from .sections import FilesSource

if TYPE_CHECKING:
    from .card import Card

_TABLES = tuple(f"*/{table}.{form}" for table in ("truth", "detections", "ego") for form in ("csv", "parquet"))
SCENES = ("*.npz", *_TABLES)  # the files of a folder that hold scenes
TEXTS = ("*.txt", "*/*.txt")  # that hold detections


def with_files(card: Card, folder: str | Path) -> FilesSource:
    """The source of a card whose scenes are the files of ``folder``; see `Card.with_files`."""
    path = Path(folder).expanduser().absolute()
    if not path.is_dir():
        raise DataError(f"no folder {path}, expected one with scenes: NPZ files, or sub-folders with tables")
    return _section(card).model_copy(update={"folder": str(path), "sha256": folder_digest(path)})


def with_scenes(card: Card, scenes: Sequence[Scene]) -> FilesSource:
    """The source of a card whose scenes are ``scenes``; see `Card.with_scenes`."""
    for scene in scenes:
        if not isinstance(scene, Scene):
            raise CardError(f"scenes holds {type(scene).__name__}, expected Scene objects only, or names only")
    names = [scene.name for scene in scenes]
    twice = next((name for i, name in enumerate(names) if name in names[:i]), None)
    if twice is not None:
        raise CardError(f"two scenes are called {twice!r}, expected a name of its own for each")
    return _section(card).model_copy(update={"scenes": tuple(scenes), "sha256": scenes_digest(scenes)})


def located(section: FilesSource, beside: Path) -> FilesSource:
    """The section of a card file in the folder ``beside``: where its scenes are, and what they hold if they are there.

    A card that states the ``sha256`` of its scenes keeps it: other files are refused when they are opened.
    """
    folder = (beside.absolute() / Path(section.folder or "").expanduser()).resolve()
    known = section.sha256 or (folder_digest(split_folder(folder, section.split)) if folder.is_dir() else None)
    return section.model_copy(update={"folder": str(folder), "sha256": known})


def split_folder(folder: Path, split: str) -> Path:
    """Where the scenes of a split are: in the sub-folder of its name; those of "all" in the folder itself."""
    return folder if split == "all" else folder / split


def folder_digest(folder: Path, patterns: Sequence[str] = SCENES) -> str:
    """Hex sha256 over the names and contents of the files of a folder that match the patterns.

    Raises DataError where one cannot be read.
    """
    digest = hashlib.sha256()
    found = {path for pattern in patterns for path in folder.glob(pattern) if not _hidden(path.relative_to(folder))}
    for path in sorted(found):
        try:
            content = known_digest(path)
        except OSError as error:
            raise DataError(f"{path}: cannot be read: {error.strerror or error}") from None
        digest.update(f"{path.relative_to(folder).as_posix()}\0{content};".encode("utf-8", "surrogateescape"))
    return digest.hexdigest()


def plain_name(name: str) -> str:
    """A name, such as that of a file, as the name of a detector: with hyphens for what is not allowed there."""
    return re.sub(r"[^A-Za-z0-9_.-]", "-", name).lstrip("_.-") or "own"


def known_digest(path: Path) -> str:
    """Hex sha256 of a file, which is read once per process and state. Raises OSError."""
    state = path.stat()
    return _digest(path, state.st_size, state.st_mtime_ns, state.st_ctime_ns)


def scenes_digest(scenes: Sequence[Scene]) -> str:
    """Hex sha256 over everything that ``scenes`` hold, in their order."""
    digest = hashlib.sha256()
    for scene in scenes:
        _add(digest, scene)
    return digest.hexdigest()


def _hidden(path: Path) -> bool:
    return any(part.startswith(".") for part in path.parts)


def _section(card: Card) -> FilesSource:
    """The section that keeps what ``card`` says of detections and frames of reference."""
    traits = card.source.traits
    return FilesSource(
        name="files",
        detector=plain_name(card.detector_name),
        velocity=card.velocity,
        ego_motion=traits.common_frame,
        ego=traits.has_ego,
        view=traits.view,
        velocity_ahead=traits.velocity_ahead or None,
        places_only=traits.places_only or None,
        bounded_by_truth=traits.bounded_by_truth or None,
    )


@cache
def _digest(path: Path, *state: int) -> str:
    return file_digest(path)


def _add(digest: Any, value: Any) -> None:
    """Add a value of a record to a digest: its fields, its numbers, or what it is written as."""
    if is_dataclass(value):
        for field in fields(value):
            digest.update(f"{field.name}:".encode())
            _add(digest, getattr(value, field.name))
    elif isinstance(value, tuple):
        digest.update(f"{len(value)}(".encode())
        for part in value:
            _add(digest, part)
    elif isinstance(value, np.ndarray):
        if value.dtype.hasobject:  # whose bytes are places in memory
            raise CardError("a scene has an array of objects, expected numbers")
        array = np.ascontiguousarray(value)
        digest.update(f"{array.dtype.str} {array.shape};".encode())
        digest.update(array.tobytes())
    else:
        digest.update(f"{value!r};".encode())
