"""Own scenes: files of a folder, or `Scene` objects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from urllib.parse import unquote

from ...cards import Card, FilesSource
from ...cards.own import folder_digest, split_folder
from ...errors import DataError, UnknownNameError
from ...types import Scene
from ..base import section_of
from ..motion import looking_back
from .archive import arrays_of, content_of, read_archive
from .columns import FORMS, TABLES
from .content import Content, scene_of
from .tables import read_tables
from .writing import require_plain_name

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
        for name in self.names:
            require_plain_name(name, f"{card.id}: ")

    def load(self, name: str) -> Scene:
        """Read one scene; DataError names the file, line and column that is wrong."""
        if name not in self._read:
            raise UnknownNameError("scene", name, self.names)
        scene = scene_of(self._read[name](), self.card)
        if self.card.velocity and self.section.traits.velocity_ahead:  # no agent is shown where an object will be
            return replace(scene, truth=looking_back(scene.truth, scene.time))
        return scene


def scene_paths(folder: Path) -> dict[str, Path]:
    """The NPZ file, or the sub-folder with tables, of each scene of a folder, by the scene's name.

    What begins with a dot is hidden. Raises DataError where two of them have one name.
    """
    seen = [path for path in folder.iterdir() if not path.name.startswith(".")]
    stems = [(path.stem, path) for path in seen if path.suffix == ".npz" and path.is_file()]
    stems += [(path.name, path) for path in seen if is_scene(path)]
    paths: dict[str, Path] = {}
    for stem, path in sorted(stems):
        name = unquote(stem)
        if name in paths:
            raise DataError(
                f"{folder} has the scene {name!r} as {paths[name].name} and {path.name}, expected one of them"
            )
        paths[name] = path
    return paths


def is_scene(folder: Path) -> bool:
    """Whether a table of a scene is in the folder."""
    return any((folder / f"{table}.{form}").is_file() for table in TABLES for form in FORMS)


def _readers(section: FilesSource, card: Card) -> dict[str, Callable[[], Content]]:
    """How each scene of the card's folder is read. Raises DataError where the folder is not the one it means."""
    if section.folder is None:
        raise DataError(
            f"{card.id}: its scenes were objects in memory, which are not here; give them again "
            "(cards.with_scenes), or name a folder of scenes with --files"
        )
    folder = split_folder(Path(section.folder), section.split)
    if not folder.is_dir():
        raise DataError(f"{card.id}: no folder {folder}, expected {EXPECTED}; name another one with --files")
    paths = scene_paths(folder)
    if not paths:
        itself = is_scene(folder)
        advice = f"; it is a scene itself: name the folder above, {folder.parent}" if itself else ""
        raise DataError(f"{folder} has no scene, expected {EXPECTED}{advice}")
    found = folder_digest(folder)
    if section.sha256 not in (None, found):
        raise DataError(
            f"{folder}: its files have the sha256 {found[:12]}, expected {str(section.sha256)[:12]}: they are not "
            f"those of {card.id}, or were changed after it was used; run the agent again"
        )
    rate = card.task.rate
    return {
        name: partial(read_archive, path) if path.is_file() else partial(read_tables, path, rate)
        for name, path in paths.items()
    }


def _held(scene: Scene, card: Card) -> Content:
    return content_of(arrays_of(scene, card.task.classes), scene.name, f"scene {scene.name!r}")
