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
class Dataset:
    """Facts about a dataset, of the file ``dataset.toml`` in the package of its source."""

    name: str
    folders: tuple[
        str, ...
    ]  # of the data root in which it may lie, best first; the data root may be that folder, too
    layout: str
    licence: str
    citation: str
    how_to_get: str
    optional: Mapping[str, str] = field(
        default_factory=dict
    )  # pattern of files -> note if there are none
    generated: bool = False  # made by the library: there are no files to read and check

    @classmethod
    def of(cls, module: str) -> Self:
        """The facts in ``dataset.toml`` beside the file ``module``."""
        content = toml_beside(module, "dataset.toml")
        return cls(**{**content, "folders": tuple(content["folders"])})

    def searched(self, data: DataRoot) -> tuple[Path, ...]:
        """Folders in which the dataset may lie, best first."""
        root, _ = data_root(data)
        return (*(root / folder for folder in self.folders), root)

    def find(self, data: DataRoot, holds: str) -> Path:
        """The folder that holds the file or folder ``holds``, or a pattern; DataError names what was searched."""
        folders = self.searched(data)
        for folder in folders:
            if any(folder.glob(holds)):
                return folder
        raise MissingDataError(
            f"no {self.name} data: {holds} is in none of {', '.join(map(str, folders))} ({data_root(data)[1]})"
            f"; name another root with --data or MTP_BENCH_DATA, or get the data: {self.how_to_get}"
        )

    def status(self, data: DataRoot, holds: str) -> "DataStatus":
        """Status of the folder that has ``holds``, still to be completed; without it the root is unknown."""
        try:
            root = self.find(data, holds)
        except DataError:
            return DataStatus(self, None, self.searched(data))
        absent = [
            (pattern, note)
            for pattern, note in self.optional.items()
            if not any(root.glob(pattern))
        ]
        return DataStatus(
            self,
            root,
            (root,),
            notes=[f"{pattern} is missing: {note}" for pattern, note in absent],
        )


@dataclass
class DataStatus:
    """Folder of the data of a card, and what is missing or wrong in it."""

    about: Dataset
    root: Path | None  # None: not found
    searched: tuple[Path, ...]  # folders in which the root was looked for
    missing: list[str] = field(
        default_factory=list
    )  # files and folders that the card needs, one sentence each
    notes: list[str] = field(default_factory=list)  # on optional files
    problems: list[str] = field(
        default_factory=list
    )  # files that cannot be read, one sentence each
    counts: Counter[str] = field(
        default_factory=Counter
    )  # scenes, frames and rows of the card that were read

    @property
    def usable(self) -> bool:
        """True if the card's scenes can be read: every needed file is there and sound."""
        return self.root is not None and not self.missing and not self.problems

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Note a DataError of the block, once, in place of raising it."""
        try:
            yield
        except DataError as error:
            lines = (
                self.missing if isinstance(error, MissingDataError) else self.problems
            )
            if str(error) not in lines:
                lines.append(str(error))
