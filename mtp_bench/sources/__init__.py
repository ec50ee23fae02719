"""Sources of scenes: recorded logs in their official layouts and simulated traffic, as `mtp_bench.types.Scene`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path

from ..cards import Card, load_card
from ..errors import DataError, MtpBenchError, UnknownNameError
from ..types import Scene
from .base import ChangedScenes, Preparation, SourcePackage
from .base import SceneSource as SceneSource
from .dataset import DataCheck as DataCheck
from .dataset import Dataset as Dataset
from .dataset import DataStatus as DataStatus
from .images import CameraImage as CameraImage
from .simulated import detected as detected
from .tracks import find_tracks


def open_source(card: Card, data: str | Path | None = None) -> SceneSource:
    """The scenes that ``card`` names, found but not read yet.

    ``data`` is the data root; None stands for the environment variable MTP_BENCH_DATA, else the user data folder.
    Raises DataError when the root, a folder or the card's detector is missing.
    """
    source = _package(card).open(card, data)
    return source if card.detector is None else ChangedScenes(source, partial(detected, card=card))


def with_tracks(source: SceneSource, card: Card, data: str | Path | None, path: str | Path) -> SceneSource:
    """The scenes of ``source`` with the stored tracks of a foreign program; `sources.tracks` says in which forms.

    ``card`` and ``data``: what ``source`` was opened with. Raises DataError where ``path`` holds no tracks for it.
    """
    read = find_tracks(_package(card), card, data, path)
    return ChangedScenes(source, lambda scene: replace(scene, tracks=read(scene)))


def load_scenes(
    card: str | Card, data: str | Path | None = None, names: Iterable[str] | None = None
) -> Iterator[Scene]:
    """The scenes of an env, truth included, read one after the other as they are asked for.

    ``card``: an env id, the path of a card, or a card (`cards.with_split` chooses another split). ``data``: the data
    root, else that of MTP_BENCH_DATA. ``names``: those scenes alone. Raises UnknownNameError or DataError.
    """
    source = open_source(card if isinstance(card, Card) else load_card(card), data)
    if isinstance(names, str):
        raise MtpBenchError(f"names is the text {names!r}, expected a list: names=[{names!r}]")
    chosen = tuple(source.names if names is None else names)
    for name in chosen:
        if name not in source.names:
            raise UnknownNameError("scene", name, source.names)
    return (source.load(name) for name in chosen)


def with_map(
    scene: Scene, card: Card, data: str | Path | None = None, note: Callable[[str], object] = lambda text: None
) -> Scene:
    """``scene`` with the road that pictures of it show: of the map expansion of nuScenes, where it is there.

    A run, a score and a training read no map, for which this is apart from `SceneSource.load`. A map that is broken is
    left out, and ``note`` is told what is wrong with it.
    """
    try:
        return replace(scene, lanes=tuple(_package(card).lanes(card, data, scene)))
    except DataError as error:
        note(f"drawn without the road: {error}")
        return scene


def camera_images(
    scene: Scene, card: Card, data: str | Path | None = None, note: Callable[[str], object] = lambda text: None
) -> tuple[CameraImage, ...]:
    """The images of the cameras of a recording, in the order of frames; none where their files are not there.

    ``note`` is told where a table is broken that says what they show; there are none then.
    """
    try:
        return tuple(_package(card).images(card, data, scene))
    except DataError as error:
        note(f"drawn without images: {error}")
        return ()


def about(card: Card) -> Dataset:
    """What is known of the dataset that ``card`` needs, such as its licence; no data is looked for."""
    return _package(card).about(card)


def describe(card: Card, data: str | Path | None = None) -> DataStatus:
    """What ``card`` needs of a dataset, what of it was found, and how to get it; a missing root is no error here."""
    return _package(card).describe(card, data)


def prepare(
    card: Card,
    data: str | Path | None = None,
    scenes: int | None = None,
    workers: int = 1,
    started: Callable[[int], object] | None = None,
    progress: Callable[[str], object] | None = None,
) -> None:
    """Do now what is done once per machine: make simulated scenes, or the compact copy of nuScenes tables.

    Args:
        card: names the scenes.
        data: the data root, as for `open_source`.
        scenes: of simulated ones, the first so many; None: all. Those in the cache are not made again.
        workers: processes that make simulated scenes.
        started: is told how many pieces of work there are.
        progress: is told the name of each that is done.

    Raises DataError.
    """
    _package(card).prepare(card, data, Preparation(scenes, workers, started, progress))


def keep_private(card: Card) -> None:
    """Let nobody else on this machine read the simulated scenes of the card, or their names, which tell their seeds."""
    _package(card).keep_private(card)


def discard(card: Card) -> None:
    """Take the simulated scenes of the card's split out of the cache; of recorded scenes nothing is kept there."""
    _package(card).discard(card)


def _package(card: Card) -> SourcePackage:
    """The package of the card's source, which has the name of its section; imported when it is needed first."""
    package: SourcePackage = import_module(f".{card.source.name}", __name__).PACKAGE
    return package
