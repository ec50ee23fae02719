"""Facts about a dataset, its folder on this machine, and the status of its files."""

import os
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from ..core import DataError, MissingDataError, toml_beside

VARIABLE = "MTP_BENCH_DATA"
DataRoot = str | Path | None  # None: from MTP_BENCH_DATA, else the user data folder


def data_root(data: DataRoot) -> tuple[Path, str]:
    """Return the data root and, for messages, where its name comes from.

    It is the argument, else MTP_BENCH_DATA, else the user data folder.
    """
    if data is not None:
        return Path(data).expanduser(), "given as data root"
    if os.environ.get(VARIABLE):
        return Path(os.environ[VARIABLE]).expanduser(), f"from {VARIABLE}"
    from platformdirs import user_data_path

    return user_data_path("mtp_bench", appauthor=False), "the user data folder"


@dataclass(frozen=True)
class Dataset:
    """Facts about a dataset, of ``dataset.toml`` in the package of its source."""

    name: str
    # folders of the data root that may hold its files, best first; the data root itself
    # may hold them, too
    folders: tuple[str, ...]
    layout: str
    licence: str
    citation: str
    how_to_get: str
    known_fault: str = ""  # a sentence without a full stop, beside the results
    # pattern of files -> note if there are none
    optional: Mapping[str, str] = field(default_factory=dict)
    # made by the library: there are no files to read and check
    generated: bool = False

    @classmethod
    def of(cls, module_file: str) -> Self:
        """Read the facts in ``dataset.toml`` beside a module."""
        content = toml_beside(module_file, "dataset.toml")
        return cls(**{**content, "folders": tuple(content["folders"])})

    def searched(self, data: DataRoot) -> tuple[Path, ...]:
        """Return the folders in which the dataset may lie, best first."""
        root, _ = data_root(data)
        return (*(root / folder for folder in self.folders), root)

    def find(self, data: DataRoot, holds: str) -> Path:
        """Return the folder that holds a file, a folder or a pattern.

        DataError names what was searched.
        """
        folders = self.searched(data)
        for folder in folders:
            if any(folder.glob(holds)):
                return folder
        names = ", ".join(map(str, folders))
        raise MissingDataError(
            f"no {self.name} data: {holds} is in none of {names} "
            f"({data_root(data)[1]}); name another root with --data or MTP_BENCH_DATA, "
            f"or get the data: {self.how_to_get}"
        )

    def status(self, data: DataRoot, holds: str) -> "DataStatus":
        """Return the status of the folder that has ``holds``, still to be completed.

        Without the folder the root is unknown.
        """
        try:
            root = self.find(data, holds)
        except DataError:
            return DataStatus(self, None, self.searched(data))
        status = DataStatus(self, root, (root,))
        for pattern, note in self.optional.items():
            if not any(root.glob(pattern)):
                status.notes.append(f"{pattern} is missing: {note}")
        return status


@dataclass
class DataStatus:
    """Folder of the data of a card, and what is missing or wrong in it."""

    about: Dataset
    root: Path | None  # None: not found
    searched: tuple[Path, ...]  # folders in which the root was looked for
    # files and folders that the card needs, one sentence each
    missing: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)  # on optional files
    # files that cannot be read, one sentence each
    problems: list[str] = field(default_factory=list)
    # scenes, frames and rows of the card that were read
    counts: Counter[str] = field(default_factory=Counter)

    @property
    def usable(self) -> bool:
        """True if every file that the card's scenes need is there and sound."""
        return self.root is not None and not self.missing and not self.problems

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Note a DataError of the block, once, in place of raising it."""
        try:
            yield
        except MissingDataError as error:
            if str(error) not in self.missing:
                self.missing.append(str(error))
        except DataError as error:
            if str(error) not in self.problems:
                self.problems.append(str(error))
