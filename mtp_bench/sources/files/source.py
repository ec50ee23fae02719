"""The source of own scenes, and its status for ``mtp-bench data``."""

from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

from ...cards import Card, FilesSource, own_digest, split_folder
from ...core import DataError, MissingDataError, Scene
from ..base import CameraImage, section_of
from ..dataset import Dataset, DataStatus
from ..motion import looking_back
from .columns import TABLES
from .save import check_scene_name
from .scene import checked_scene, find_table, read_images, read_scene

EXPECTED = "a sub-folder for each scene with the tables truth, detections and ego"
DATASET = Dataset.of(__file__)


class OwnScenes:
    """Scenes of a card with the source ``files``, in the frame of reference of the files.

    Scenes of a folder are sorted by name; `Scene` objects keep their order.
    """

    def __init__(self, card: Card, data: object = None) -> None:
        """``data``: not needed. Raises DataError for a missing folder, no scene, or other files than the card's."""
        self.card = card
        self.section = section_of(card, FilesSource)
        self._scenes = {scene.name: scene for scene in self.section.scenes or ()}
        self._folders = (
            _card_folder(self.section, card) if self.section.scenes is None else {}
        )
        self.names = (*self._folders, *self._scenes)
        if not self.names:
            raise DataError(f"{card.id}: no scene in the list, expected at least one")
        for name in self.names:
            check_scene_name(name, f"{card.id}: ")

    def load(self, name: str) -> Scene:
        """Read one scene; DataError names the file, line and column that is wrong."""
        if name in self._scenes:
            scene = checked_scene(self._scenes[name], self.card)
        else:
            scene = read_scene(self._folders[name], self.card)
        if (
            self.card.velocity and self.section.traits.velocity_ahead
        ):  # agents must not see future positions
            return replace(
                scene,
                truth=looking_back(scene.truth, scene.time, 1 / self.card.task.rate),
            )
        return scene

    def images(self, name: str) -> tuple[CameraImage, ...]:
        """The camera images of a scene in a folder; none for a `Scene` object."""
        return (
            read_images(self._folders[name], self.card) if name in self._folders else ()
        )


def scene_folders(folder: Path) -> dict[str, Path]:
    """Sub-folders with tables by the name of their scene, sorted; names that begin with a dot are hidden.

    Raises DataError if two sub-folders have the same name.
    """
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        name = unquote(path.name)
        if path.name.startswith(".") or not is_scene(path):
            continue
        if name in found:
            raise DataError(
                f"{folder} has the scene {name!r} as {found[name].name} and {path.name}, expected one"
            )
        found[name] = path
    return found


def is_scene(folder: Path) -> bool:
    """True if the folder has a table of a scene."""
    return any(find_table(folder, name) for name in TABLES)


def _card_folder(section: FilesSource, card: Card) -> dict[str, Path]:
    """Names and folders of the card's scenes; raises DataError if the folder is not the card's."""
    if section.folder is None:
        advice = "give them again (cards.with_scenes), or name a folder of scenes with --files"
        raise DataError(
            f"{card.id}: its scenes were objects in memory, which are not stored; {advice}"
        )
    folder = split_folder(Path(section.folder), section.split)
    if not folder.is_dir():
        raise MissingDataError(
            f"{card.id}: no folder {folder}, expected {EXPECTED}; name another one with --files"
        )
    folders = scene_folders(folder)
    if not folders:
        advice = (
            f"; it is a scene itself: name the folder above, {folder.parent}"
            if is_scene(folder)
            else ""
        )
        raise MissingDataError(f"{folder} has no scene, expected {EXPECTED}{advice}")
    digest = own_digest(folder, card.lanes is not None)
    if section.sha256 not in (None, digest):
        raise DataError(
            f"{folder}: its files have the sha256 {digest[:12]}, expected {str(section.sha256)[:12]}: they are not "
            f"those of {card.id}, or changed after a run with this card; run the agent again"
        )
    return dict(sorted(folders.items()))


def files_status(card: Card, data: object = None) -> DataStatus:
    """The folder of the card's scenes."""
    section = section_of(card, FilesSource)
    folder = split_folder(Path(section.folder or ""), section.split)
    there = section.scenes is not None or (
        section.folder is not None and folder.is_dir()
    )
    return DataStatus(DATASET, folder if there else None, (folder,))
