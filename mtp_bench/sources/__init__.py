"""Sources of scenes: recorded logs in their official layouts, read into `mtp_bench.types.Scene`."""

from __future__ import annotations

from pathlib import Path

from ..cards import Card
from .base import DataCheck as DataCheck
from .base import DataStatus as DataStatus
from .base import SceneSource as SceneSource


def open_source(card: Card, data: str | Path | None = None) -> SceneSource:
    """The scenes that ``card`` names, found but not read yet.

    ``data`` is the data root; None stands for the environment variable MTP_BENCH_DATA, else the user data folder.
    Raises DataError when the root, a folder or the card's detector is missing.
    """
    from .kitti import KittiTracking

    return KittiTracking(card, data)


def describe(card: Card, data: str | Path | None = None) -> DataStatus:
    """What ``card`` needs of a dataset, what of it was found, and how to get it; a missing root is no error here."""
    from .kitti_status import kitti_status

    return kitti_status(card, data)
