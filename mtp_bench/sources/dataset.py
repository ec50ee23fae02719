"""Facts about a dataset, its folder on this machine, and the status of its files."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from ..errors import DataError

Read = TypeVar("Read")
VARIABLE = "MTP_BENCH_DATA"


def data_root(data: str | Path | None) -> tuple[Path, str]:
    """The data root and, for messages, where its name comes from.

    It is the given one, else that of MTP_BENCH_DATA, else the user data folder.
    """
    if data is not None:
        return Path(data).expanduser(), "given as data root"
    if os.environ.get(VARIABLE):
        return Path(os.environ[VARIABLE]).expanduser(), f"from {VARIABLE}"
    from platformdirs import user_data_path

    return user_data_path("mtp_bench", appauthor=False), "the user data folder"


@dataclass(frozen=True)
class DataCheck:
    """A count over the files beside the known total of the dataset."""

    what: str
    found: int
    expected: int

    @property
    def ok(self) -> bool:
        """True if the count is the known total."""
        return self.found == self.expected


@dataclass(frozen=True)
class Dataset:
    """Facts about a dataset, of the file ``dataset.toml`` in the package of its source."""

    name: str
    folders: tuple[str, ...]  # of the data root in which it may lie, best first; the data root may be that folder, too
    layout: str
    licence: str
    citation: str
    how_to_get: str
    optional: Mapping[str, str] = field(default_factory=dict)  # pattern of files -> note if there are none
    generated: bool = False  # made by the library: there are no files to read and check
    totals: Mapping[str, Any] = field(default_factory=dict)  # known counts, for a source's ``inspect``

    @classmethod
    def of(cls, module: str) -> Dataset:
        """The facts in ``dataset.toml`` beside the file ``module``."""
        content = tomllib.loads(Path(module).with_name("dataset.toml").read_text(encoding="utf-8"))
        return cls(**{**content, "folders": tuple(content["folders"])})

    def searched(self, data: str | Path | None) -> tuple[Path, ...]:
        """Folders in which the dataset may lie, best first."""
        root, _ = data_root(data)
        return (*(root / folder for folder in self.folders), root)

    def find(self, data: str | Path | None, holds: str, others: Sequence[str] = ()) -> Path:
        """The folder that holds the folder ``holds``, which may be a pattern.

        Raises DataError that names the folders that were searched, and which of ``others`` are there instead.
        """
        folders = self.searched(data)
        for folder in folders:
            if any(path.is_dir() for path in folder.glob(holds)):
                return folder
        there = [Path(other).name for other in others if any((folder / other).is_dir() for folder in folders)]
        raise DataError(
            f"no {self.name} data: {holds} is in none of {', '.join(map(str, folders))} ({data_root(data)[1]})"
            + (f"; found there: {', '.join(there)}" if there else "")
            + f"; name another root with --data or MTP_BENCH_DATA, or get the data: {self.how_to_get}"
        )

    def status(self, data: str | Path | None, holds: str) -> DataStatus:
        """Status of the folder that has a folder ``holds``, still to be completed; without it the root is unknown."""
        try:
            root = self.find(data, holds)
        except DataError:
            return DataStatus(self, None, self.searched(data))
        absent = [(pattern, note) for pattern, note in self.optional.items() if not any(root.glob(pattern))]
        return DataStatus(self, root, (root,), notes=[f"{pattern} is missing: {note}" for pattern, note in absent])


@dataclass
class DataStatus:
    """Files that a card needs of a dataset and those that were found; names are relative to the root."""

    about: Dataset
    root: Path | None  # None: not found
    searched: tuple[Path, ...]  # folders in which the root was looked for
    missing: list[str] = field(default_factory=list)  # files and folders that the card needs
    notes: list[str] = field(default_factory=list)  # on optional files
    problems: list[str] = field(default_factory=list)  # files that cannot be read, one sentence each
    checks: list[DataCheck] = field(default_factory=list)

    @property
    def usable(self) -> bool:
        """True if the card's scenes can be read: every needed file is there and sound."""
        return self.root is not None and not self.missing and not self.problems

    @property
    def verified(self) -> bool:
        """True if the data is usable and every count is the known total."""
        return self.usable and all(check.ok for check in self.checks)

    @property
    def folder(self) -> Path:
        """The root, of a dataset that was found."""
        assert self.root is not None
        return self.root

    def require(self, *names: str) -> None:
        """Note which of these files are missing."""
        self.missing += [name for name in names if not (self.folder / name).is_file()]

    def require_all(self, folder: str, names: Sequence[str]) -> None:
        """Note which of the files ``names`` of ``folder`` are missing; the folder alone if all of them are."""
        absent = [f"{folder}/{name}" for name in names if not (self.folder / folder / name).is_file()]
        self.missing += [f"{folder}/"] if len(absent) == len(names) else absent

    def attempt(self, read: Callable[[Path], Read], name: str) -> Read | None:
        """Result of ``read`` on a file; None if the file is absent, or wrong, which is noted as a problem."""
        path = self.folder / name
        if not path.is_file():
            return None
        try:
            return read(path)
        except DataError as error:
            self.add_problem(error)
            return None

    def note_detector(self, advice: str) -> None:
        """Note ``advice`` on running without stored detections, if those are missing."""
        if advice and any("/det" in f"/{name}" for name in self.missing):
            self.notes.append(advice.removeprefix("; "))

    def add_problem(self, error: DataError) -> None:
        """Note the message of an error, once."""
        if str(error) not in self.problems:
            self.problems.append(str(error))

    def count(self, counts: Mapping[str, int], totals: Mapping[str, int]) -> None:
        """Check the ``counts`` that have a known total."""
        self.checks += [DataCheck(what, counts[what], total) for what, total in totals.items() if what in counts]
