"""Opening of a card's source: recordings in official layouts, own scenes, traffic."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

from ..cards import SOURCES, Card, load_card
from ..core import DataError, MtpBenchError, Scene, long_work, require_known
from .annotation import as_annotated
from .base import (
    CameraImage,
    ChangedScenes,
    DataRoot,
    SceneSource,
    SourcePackage,
    usable,
)
from .dataset import DataStatus
from .detector_errors import perturbed
from .simulated import detected
from .stored_tracks import find_tracks

Note = Callable[[str], object]


@dataclass(frozen=True)
class _DrivenScenes:
    """Names of the scenes of a closed loop, whose content each agent changes."""

    env_id: str
    names: tuple[str, ...]

    def load(self, name: str) -> Scene:
        """Raise DataError: the scene exists once an agent has driven in it."""
        raise DataError(
            f"{self.env_id} has no scene {name!r} before an agent drives in it: run "
            "one, and open its run"
        )


def open_source(card: Card, data: DataRoot = None) -> SceneSource:
    """Find the scenes that ``card`` names, without reading them.

    ``data`` is the data root; None stands for the environment variable MTP_BENCH_DATA,
    else the user data folder. Raises DataError when the root, a folder or the card's
    detector is missing.
    """
    with long_work(f"opening {card.id}"):
        source = package_of(card).open(card, data)
    if card.drive is not None:  # a closed loop: driving makes the scenes
        return _DrivenScenes(card.id, source.names)

    def complete(scene: Scene) -> Scene:
        scene = as_annotated(perturbed(detected(usable(scene), card), card), card)
        if card.lanes is None:
            return scene
        return _with_lanes(scene, card, data)

    return ChangedScenes(source, complete)


def with_tracks(
    source: SceneSource, card: Card, data: DataRoot, path: str | Path
) -> SceneSource:
    """Return the scenes of a source with the stored tracks of another program.

    ``path``: tracks in a form that `sources.stored_tracks` lists. ``card`` and
    ``data``: those that ``source`` was opened with. Raises DataError if ``path`` holds
    no tracks for the card.
    """
    card.require_same_scenes(
        "which takes no stored tracks",
        "they are of other scenes than those that agents drive in",
    )
    if card.perturb is not None:
        raise DataError(
            "stored tracks are of the detections as recorded, and `perturb` does not "
            "change them: leave it out"
        )
    read_tracks = find_tracks(package_of(card), card, data, path)
    return ChangedScenes(source, lambda scene: usable(read_tracks(scene)))


def load_scenes(
    card: str | Card, data: DataRoot = None, names: Iterable[str] | None = None
) -> Iterator[Scene]:
    """Read the scenes of an env, ground truth included, as they are asked for.

    ``card``: an env id, the path of a card, or a card (`with_split` chooses another
    split). ``data``: the data root, else that of MTP_BENCH_DATA. ``names``: only those
    scenes. Raises UnknownNameError or DataError.
    """
    source = open_source(card if isinstance(card, Card) else load_card(card), data)
    if isinstance(names, str):
        raise MtpBenchError(
            f"names is the text {names!r}, expected a list: names=[{names!r}]"
        )
    chosen_names = tuple(source.names if names is None else names)
    for name in chosen_names:
        require_known("scene", name, source.names)
    return map(source.load, chosen_names)


def with_map(
    scene: Scene, card: Card, data: DataRoot = None, note: Note = lambda text: None
) -> Scene:
    """Return the scene with the road for pictures of it, if there is a map.

    Runs, scores and trainings read no map, so `SceneSource.load` leaves it out. A
    broken one is a message to ``note``.
    """
    try:
        return replace(scene, lanes=tuple(package_of(card).lanes(card, data, scene)))
    except DataError as error:
        note(f"drawn without the road: {error}")
        return scene


def camera_images(
    scene: Scene, card: Card, data: DataRoot = None, note: Note = lambda text: None
) -> tuple[CameraImage, ...]:
    """Return the camera images whose files are there, in the order of frames.

    A broken table is a message to ``note``, and there are no images.
    """
    try:
        return tuple(package_of(card).images(card, data, scene))
    except DataError as error:
        note(f"drawn without images: {error}")
        return ()


def describe(card: Card, data: DataRoot = None) -> DataStatus:
    """Find the data that ``card`` needs, and what stops its source from opening.

    No scene is read.
    """
    status = package_of(card).locate(card, data)
    if status.root is not None:
        with status.noted():
            open_source(card, data)
    return status


def prepare(
    card: Card, data: DataRoot = None, scenes: int | None = None, workers: int = 1
) -> None:
    """Do the work that is done once per machine.

    Simulate scenes, or make the compact copy of nuScenes tables. ``scenes``: number of
    simulated scenes to make, None for all; those in the cache are not made again.
    ``workers``: processes that simulate. Raises DataError.
    """
    if card.drive is not None:  # scenes are made while they are driven
        return
    with long_work(f"preparing scenes of {card.id}, once per machine") as work:
        count, names = package_of(card).prepare(card, data, scenes, workers)
        work.started(count)
        # each name comes when its piece of work is done
        for name in names:
            work.done(name)


def _with_lanes(scene: Scene, card: Card, data: DataRoot) -> Scene:
    """Return the scene with its road map.

    Raises DataError if it has none.
    """
    lanes = tuple(package_of(card).lanes(card, data, scene))
    if not lanes:
        raise DataError(
            f"scene {scene.name!r} has no lanes, which {card.id} shows to agents: get "
            "the map (`mtp-bench data` says from where), or add a table lanes to own "
            "scenes"
        )
    return replace(scene, lanes=lanes)


def package_of(card: Card) -> SourcePackage:
    """Import the package of the card's source, named as its section."""
    is_traffic = SOURCES[card.source.name].startswith("mtp_bench.traffic.")
    room = "traffic" if is_traffic else "sources"
    module = import_module(f"mtp_bench.{room}.{card.source.name}")
    package: SourcePackage = module.PACKAGE
    return package
