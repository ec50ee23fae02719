"""A round: all records of a folder, each checked as far as it can be, with what that needs found for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..submission.manifest import MANIFEST
from .attestation import LEVELS, Level, SignedLevel, read_level
from .record import Record
from .seal import Sealed
from .trust import Trust


@dataclass(frozen=True)
class Round:
    """What is asked of every record."""

    rerun: bool = False
    seals: Mapping[str, Sealed] = field(default_factory=dict)  # by env; with hidden scenes ranks simulated envs
    submissions: Path | None = None  # folder of submissions by their names
    submission: Path | None = None  # the one to run, whatever its name
    stated_limits: bool = False  # run again under the limits that a record states
    no_sandbox: bool = False  # run again also where nothing holds an agent
    only_hidden: bool = False  # what a signed level shows to have been run again is run on hidden scenes alone

    def sealed(self, record: Record) -> Sealed | None:
        """The hidden scenes that a record is run on; None: none."""
        return self.seals.get(record.env.id) if self.rerun else None

    def folder(self, record: Record) -> Path | None:
        """Where the submission of a record is; None: it is the baseline of that name."""
        if self.submission is not None or self.submissions is None:
            return self.submission
        folder = self.submissions / record.submission.name
        return folder if (folder / MANIFEST).is_file() else None

    def aim(self, record: Record) -> Level:
        """The level that a record can reach."""
        if not self.rerun:
            return "re-scored"
        return "re-run" if self.sealed(record) is None else "hidden"

    def shown(self, path: Path, record: Record, trust: Trust) -> SignedLevel | None:
        """The signed level that saves running a record again; None: there is none, or it is not to count."""
        signed, _ = read_level(path, record, trust) if self.only_hidden else (None, "")
        return signed if signed is not None and LEVELS.index(signed.level) >= LEVELS.index("re-run") else None

    def done(self, path: Path, record: Record, trust: Trust) -> SignedLevel | None:
        """The signed level of a record that has what is aimed at, on the same seal; None: it is still to be done."""
        signed, _ = read_level(path, record, trust)
        sealed = self.sealed(record)
        if signed is None or LEVELS.index(signed.level) < LEVELS.index(self.aim(record)):
            return None
        if sealed is not None and (signed.hidden is None or signed.hidden.commitment != sealed.commitment):
            return None
        return signed
