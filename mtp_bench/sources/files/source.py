"""Own scenes: files of a folder, or `Scene` objects."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from urllib.parse import unquote

from ...cards import Card, FilesSource
from ...cards.own import folder_digest, split_folder
from ...errors import DataError, UnknownNameError
from ...types import Scene
from ..base import section_of
from .archive import arrays_of, content_of, read_archive
from .columns import FORMS, TABLES
from .content import Content, scene_of
from .tables import read_tables

EXPECTED = "NPZ files of one scene each, or a sub-folder for each scene with the tables truth, detections and ego"


class OwnScenes:
    """Scenes of a card with the source ``files``, in the frame of reference that they are written in.

    Names are those of the files and sub-folders, sorted; of `Scene` objects their own, in their order.
    """

    def __init__(self, card: Card, data: object = None) -> None:
        """``data``: no data root is needed. Raises DataError where there are no scenes, or others than the card's."""
        self.card = card
        self.section = section_of(card, FilesSource)
        if self.section.scenes is None:
            self._read = _readers(self.section, card)
        else:
            self._read = {scene.name: partial(_held, scene, card) for scene in self.section.scenes}
        if not self._read:
            raise DataError(f"{card.id}: no scene in the list, expected at least one")
        self.names = tuple(self._read)

    def load(self, name: str) -> Scene:
        """Read one scene; DataError names the file, line and column that is wrong."""
        if name not in self._read:
            raise UnknownNameError("scene", name, self.names)
        return scene_of(self._read[name](), self.card)


def scene_paths(folder: Path) -> dict[str, Path]:
    """The NPZ file, or the sub-folder with tables, of each scene of a folder, by the file's name.

    Raises DataError where a scene is there in both forms.
    """
    tables = [f"{table}.{form}" for table in TABLES for form in FORMS]
    archives = {path.stem: path for path in folder.glob("*.npz") if path.is_file() and not path.name.startswith(".")}
    folders = {path.name: path for path in folder.iterdir() if any((path / name).is_file() for name in tables)}
    both = sorted(archives.keys() & folders.keys())
    if both:
        raise DataError(
            f"{folder} has the scene {both[0]!r} as {both[0]}.npz and as a sub-folder, expected one of them"
        )
    return dict(sorted((archives | folders).items()))


def _readers(section: FilesSource, card: Card) -> dict[str, Callable[[], Content]]:
    """How each scene of the card's folder is read. Raises DataError where the folder is not the one it means."""
    if section.folder is None:
        raise DataError(
            f"{card.id}: its scenes were objects in memory, which are not here; give them again "
            "(Card.with_scenes), or name a folder of scenes with --files"
        )
    folder = split_folder(Path(section.folder), section.split)
    if not folder.is_dir():
        raise DataError(f"{card.id}: no folder {folder}, expected {EXPECTED}; name another one with --files")
    paths = scene_paths(folder)
    if not paths:
        raise DataError(f"{folder} has no scene; expected {EXPECTED}")
    found = folder_digest(folder)
    if section.sha256 not in (None, found):
        raise DataError(
            f"{folder}: its files have the sha256 {found[:12]}, expected {str(section.sha256)[:12]}: they are not "
            f"those of {card.id}, or were changed after it was used; run the agent again"
        )
    rate = card.task.rate
    return {
        name: partial(read_archive, path) if path.suffix == ".npz" else partial(read_tables, path, rate)
        for name, path in ((unquote(stem), path) for stem, path in paths.items())
    }


def _held(scene: Scene, card: Card) -> Content:
    return content_of(arrays_of(scene, card.task.classes), scene.name, f"scene {scene.name!r}")
