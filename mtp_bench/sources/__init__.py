"""Sources of scenes: recorded logs in their official layouts and simulated traffic, as `mtp_bench.types.Scene`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..cards import Card, HighwaySource, Mot3dSource, NuScenesSource, WildtrackSource
from .base import DataCheck as DataCheck
from .base import DataStatus as DataStatus
from .base import SceneSource as SceneSource
from .simulated import SimulatedDetections as SimulatedDetections
from .simulated import detected as detected


def open_source(card: Card, data: str | Path | None = None) -> SceneSource:
    """The scenes that ``card`` names, found but not read yet.

    ``data`` is the data root; None stands for the environment variable MTP_BENCH_DATA, else the user data folder.
    Raises DataError when the root, a folder or the card's detector is missing.
    """
    source = _scenes(card, data)
    return source if card.detector is None else SimulatedDetections(source, card)


def _scenes(card: Card, data: str | Path | None) -> SceneSource:
    match card.source:
        case HighwaySource():
            from .highway.source import HighwayTraffic

            return HighwayTraffic(card)
        case NuScenesSource():
            from .nuscenes.source import NuScenes

            return NuScenes(card, data)
        case WildtrackSource():
            from .wildtrack.source import Wildtrack

            return Wildtrack(card, data)
        case Mot3dSource():
            from .mot3d.source import Mot3d

            return Mot3d(card, data)
        case _:
            from .kitti.source import KittiTracking

            return KittiTracking(card, data)


def describe(card: Card, data: str | Path | None = None) -> DataStatus:
    """What ``card`` needs of a dataset, what of it was found, and how to get it; a missing root is no error here."""
    match card.source:
        case HighwaySource():
            from .highway.status import highway_status

            return highway_status(card)
        case NuScenesSource():
            from .nuscenes.status import nuscenes_status

            return nuscenes_status(card, data)
        case WildtrackSource():
            from .wildtrack.status import wildtrack_status

            return wildtrack_status(card, data)
        case Mot3dSource():
            from .mot3d.status import mot3d_status

            return mot3d_status(card, data)
        case _:
            from .kitti.status import kitti_status

            return kitti_status(card, data)


def prepare(
    card: Card,
    data: str | Path | None = None,
    scenes: int | None = None,
    workers: int = 1,
    started: Callable[[int], object] | None = None,
    progress: Callable[[str], object] | None = None,
) -> None:
    """Do now what is done once per machine: make simulated scenes, or the compact copy of nuScenes tables.

    Simulated scenes: the first ``scenes`` (None: all) that are not cached, over ``workers`` processes. ``started`` is
    told how many pieces of work there are, ``progress`` the name of each that is done. Raises DataError.
    """
    if isinstance(card.source, HighwaySource):
        from .highway.source import HighwayTraffic

        source = HighwayTraffic(card)
        source.generate(source.names[:scenes], workers, started, progress)
    if isinstance(card.source, NuScenesSource):
        from .nuscenes.source import prepare_nuscenes

        prepare_nuscenes(card, data, started, progress)


def discard(card: Card) -> None:
    """Take the simulated scenes of the card's split out of the cache; of recorded scenes nothing is kept there."""
    if isinstance(card.source, HighwaySource):
        from .highway.source import HighwayTraffic

        HighwayTraffic(card).discard()
