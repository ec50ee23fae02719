"""What every source of scenes offers, and the record of what was found of a dataset."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from ..types import Detections, Scene


class SceneSource(Protocol):
    """Named scenes that are read one by one."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the scenes, in the order of the split."""
        ...

    def load(self, name: str) -> Scene:
        """Read one scene; DataError names the file and line that is wrong, UnknownNameError a name not in the split."""
        ...


def no_detections(frames: int) -> Detections:
    """The record of a scene of ``frames`` frames in which nothing is detected."""
    none = np.zeros(0, dtype=np.int64)
    start = np.zeros(frames + 1, dtype=np.int64)
    return Detections(start, np.zeros((0, 7)), np.zeros((0, 2)), none, np.zeros(0))


@dataclass(frozen=True)
class DataCheck:
    """A count over the files beside the total that the dataset is known to have."""

    what: str
    found: int
    expected: int

    @property
    def ok(self) -> bool:
        """True if the count is the known total."""
        return self.found == self.expected


@dataclass(frozen=True)
class DataStatus:
    """What a card needs of a dataset and what of it was found."""

    dataset: str
    root: Path | None  # None: not found
    searched: tuple[Path, ...]  # folders that were looked at for the root
    layout: str  # the expected tree, to be shown as it is
    missing: tuple[str, ...]  # files and folders that the card needs, relative to the root
    notes: tuple[str, ...]  # what is absent but optional
    problems: tuple[str, ...]  # files that cannot be read, one sentence each
    checks: tuple[DataCheck, ...]
    licence: str
    citation: str
    how_to_get: str
    generated: bool = False  # made by the library: there are no files to read and check

    @property
    def usable(self) -> bool:
        """True if the card's scenes can be read: everything needed is there and sound."""
        return self.root is not None and not self.missing and not self.problems

    @property
    def verified(self) -> bool:
        """True if the data is usable and every count is the known total."""
        return self.usable and all(check.ok for check in self.checks)
