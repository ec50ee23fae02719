"""Stored tracks of foreign programs, as `mtp_bench.types.StoredTracks` of the scenes that they are of.

====================== =================================================================================
a ``.json`` file       nuScenes: the official submission to the tracking task
a folder of ``.txt``   KITTI: a file of the tracking benchmark's result form for each sequence, as AB3DMOT writes
a folder of tables     every source: a ``.csv`` or ``.parquet`` for each scene, see `table`
====================== =================================================================================
"""

from __future__ import annotations

from pathlib import Path

from ...cards import Card
from ...errors import DataError
from ..base import DataRoot, ReadTracks, SourcePackage, TrackForm
from .table import TABLE


def find_tracks(package: SourcePackage, card: Card, data: DataRoot, path: str | Path) -> ReadTracks:
    """What reads the tracks at ``path`` for scenes of ``card``, by the form that they have.

    Raises DataError where there is nothing at ``path``, or nothing in a form that the card's source knows.
    """
    where = Path(path).expanduser().absolute()
    if not where.exists():
        raise DataError(f"no file or folder {where}, expected stored tracks")
    forms: list[TrackForm] = [TABLE] if package.tracks is None else [package.tracks, TABLE]
    for form in forms:
        if form.fits(where):
            return form.open(card, data, where)
    known = " or ".join(form.name for form in forms)
    raise DataError(f"{where} holds no stored tracks that fit {card.id}, expected {known}")
