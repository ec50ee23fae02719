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
    """Scenes of a card with the source ``files``, in the files' frame of reference.

    Scenes of a folder are sorted by name; `Scene` objects keep their order.
    """

    def __init__(self, card: Card, data: object = None) -> None:
        """Find the scenes.

        ``data`` is not needed. Raises DataError for a missing folder, no scene, or
        other files than the card's.
        """
        self.card = card
        self.section = section_of(card, FilesSource)
        self._scenes: dict[str, Scene] = {}
        self._folders: dict[str, Path] = {}
        if self.section.scenes is None:
            self._folders = _card_folders(self.section, card)
        else:
            self._scenes = {scene.name: scene for scene in self.section.scenes}
        self.names = (*self._folders, *self._scenes)
        if not self.names:
            raise DataError(f"{card.id}: no scene in the list, expected at least one")
        for name in self.names:
            check_scene_name(name, f"{card.id}: ")

    def load(self, name: str) -> Scene:
        """Read one scene.

        DataError names the file, line and column that is wrong.
        """
        if name in self._scenes:
            scene = checked_scene(self._scenes[name], self.card)
        else:
            scene = read_scene(self._folders[name], self.card)
        # agents must not see future positions
        if self.card.velocity and self.section.traits.velocity_ahead:
            period_s = 1 / self.card.task.rate
            truth = looking_back(scene.truth, scene.time, period_s)
            scene = replace(scene, truth=truth)
        return scene

    def images(self, name: str) -> tuple[CameraImage, ...]:
        """Return the camera images of a scene in a folder.

        Empty for a `Scene` object.
        """
        if name not in self._folders:
            return ()
        return read_images(self._folders[name], self.card)


def scene_folders(folder: Path) -> dict[str, Path]:
    """Return the sub-folders with tables by the name of their scene, sorted.

    Names that begin with a dot are hidden. Raises DataError if two sub-folders have the
    same name.
    """
    folders: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        name = unquote(path.name)
        if path.name.startswith(".") or not is_scene(path):
            continue
        if name in folders:
            raise DataError(
                f"{folder} has the scene {name!r} as {folders[name].name} and "
                f"{path.name}, expected one"
            )
        folders[name] = path
    return dict(sorted(folders.items()))


def is_scene(folder: Path) -> bool:
    """Return True if the folder has a table of a scene."""
    return any(find_table(folder, name) for name in TABLES)


def _card_folders(section: FilesSource, card: Card) -> dict[str, Path]:
    """Return names and folders of the scenes.

    Raises DataError if they are not the card's.
    """
    if section.folder is None:
        raise DataError(
            f"{card.id}: its scenes were objects in memory, which are not stored; give "
            "them again (cards.with_scenes), or name a folder of scenes with --files"
        )
    folder = split_folder(Path(section.folder), section.split)
    if not folder.is_dir():
        raise MissingDataError(
            f"{card.id}: no folder {folder}, expected {EXPECTED}; name another one "
            "with --files"
        )
    folders = scene_folders(folder)
    if not folders:
        message = f"{folder} has no scene, expected {EXPECTED}"
        if is_scene(folder):
            advice = f"name the folder above, {folder.parent}"
            message += f"; it is a scene itself: {advice}"
        raise MissingDataError(message)
    digest = own_digest(folder, card.lanes is not None)
    if section.sha256 not in (None, digest):
        raise DataError(
            f"{folder}: its files have the sha256 {digest[:12]}, expected "
            f"{str(section.sha256)[:12]}: they are not those of {card.id}, or changed "
            "after a run with this card; run the agent again"
        )
    return folders


def files_status(card: Card, data: object = None) -> DataStatus:
    """Return the status of the folder of the card's scenes."""
    section = section_of(card, FilesSource)
    folder = split_folder(Path(section.folder or ""), section.split)
    has_folder = section.folder is not None and folder.is_dir()
    if section.scenes is None and not has_folder:
        return DataStatus(DATASET, root=None, searched=(folder,))
    return DataStatus(DATASET, root=folder, searched=(folder,))
