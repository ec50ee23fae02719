"""Sources of scenes: recorded logs in their official layouts and simulated traffic, as `mtp_bench.types.Scene`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..cards import Card, HighwaySource
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
    if isinstance(card.source, HighwaySource):
        from .highway.source import HighwayTraffic

        return HighwayTraffic(card)
    from .kitti import KittiTracking

    return KittiTracking(card, data)


def describe(card: Card, data: str | Path | None = None) -> DataStatus:
    """What ``card`` needs of a dataset, what of it was found, and how to get it; a missing root is no error here."""
    if isinstance(card.source, HighwaySource):
        from .highway.status import highway_status

        return highway_status(card)
    from .kitti_status import kitti_status

    return kitti_status(card, data)


def generate(
    card: Card,
    scenes: int | None = None,
    workers: int = 1,
    started: Callable[[int], object] | None = None,
    progress: Callable[[str], object] | None = None,
) -> None:
    """Make the first ``scenes`` scenes (None: all) of a simulated source that are not cached; recorded ones are there.

    ``started`` is told how many there are to make, ``progress`` the name of each that is done.
    """
    if isinstance(card.source, HighwaySource):
        from .highway.source import HighwayTraffic

        source = HighwayTraffic(card)
        source.generate(source.names[:scenes], workers, started, progress)
