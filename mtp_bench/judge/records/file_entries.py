"""Entries of the board for forecasts that were read from a file: never ranked."""

from pathlib import Path

from ...core import Section
from ...scoring import Interval
from .fields import Count, FileName, Name, NotNegative, Sha256, Share
from .storage import read_as


class FileEntry(Section):
    """A scored file of forecasts, without verification."""

    env: FileName
    name: Name
    bADE: NotNegative  # noqa: N815
    interval: Interval
    sha256: Sha256  # of the file of forecasts
    form: Name  # the layout of that file
    modes: Count  # forecasts per object
    horizon_s: NotNegative
    least_confidence: Share  # of an object in the file
    definitions: Name


def read_file_entries(folder: Path) -> list[FileEntry]:
    """Read the entries in ``folder``, sorted by environment and name.

    A missing folder holds none. Raises RecordError for a broken file.
    """
    entries = [read_as(FileEntry, path) for path in folder.glob("*.json")]
    return sorted(entries, key=lambda entry: (entry.env, entry.name))
