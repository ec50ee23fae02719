"""Doubly linked lists of a table: the samples of a scene, the annotations of an instance."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import DataError
from ...types import Bools, Floats, Ints
from .fields import ints, text
from .json_stream import Record


class Tokens:
    """Numbers for the tokens of one table and of those that refer to it: each text is kept once."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._number: dict[str, int] = {}
        self._own = array("q")

    def add(self, record: Record) -> str:
        """Note the next record of the table; its token."""
        token = text(self.path, record, "token")
        self._own.append(self.refer(token))
        return token

    def refer(self, token: str) -> int:
        """Number of a token, -1 for an empty one."""
        return self._number.setdefault(token, len(self._number)) if token else -1

    def resolve(self) -> Rows:
        """The rows of the table, once all of it has been read; DataError for a token that two records share."""
        texts, own = list(self._number), ints(self._own)
        times = np.bincount(own[own >= 0], minlength=len(texts))
        if (own < 0).any() or (times > 1).any():
            token = "" if (own < 0).any() else texts[int(np.argmax(times > 1))]
            raise DataError(f"{self.path}: several records or none have the token {token!r}, expected one")
        row = np.full(len(texts) + 1, -1)  # the last: of number -1, no token
        row[own] = np.arange(len(own))
        return Rows(self.path, [texts[number] for number in own], texts, row)


@dataclass(frozen=True, eq=False)
class Rows:
    """Tokens of the rows of a table, and the row of each number of `Tokens`."""

    path: Path
    token: list[str]  # [R]
    _text: list[str]
    _row: Ints

    def of(self, reference: array[int], key: str, path: Path, owners: list[str], none: bool = False) -> Ints:
        """Rows that ``reference`` means; -1 for an empty one if there may be ``none``.

        Raises DataError, naming the field ``key`` of the file ``path``, where the table has no such record; ``owners``:
        tokens of the records that refer to it.
        """
        number = ints(reference)
        row = self._row[number]
        lost = (row < 0) & ((number >= 0) | (not none))
        if lost.any():
            at = int(np.argmax(lost))
            wanted = self._text[number[at]] if number[at] >= 0 else ""
            raise DataError(
                f"{path}, record {owners[at]!r}: {key} is {wanted!r}, but {self.path.name} has no such record"
            )
        return row


@dataclass(frozen=True, eq=False)
class Chains:
    """Linked rows of a table and the groups (of another one) that they make up."""

    rows: Rows
    previous: Ints  # [R] row, -1: none
    following: Ints  # [R]
    group: Ints  # [R]
    time: Floats  # [R]
    path: Path  # of the groups
    kind: str  # what a group is
    owner: list[str]  # [G] token of the group
    first: Ints  # [G] row
    last: Ints  # [G]
    count: Ints  # [G] rows that the group says it has

    def check(self) -> None:
        """Raise DataError unless each group is one chain from its first to its last row, forward in time."""
        row = np.arange(len(self.group))
        ahead, back = self.following >= 0, self.previous >= 0
        next_of, previous_of = self.following[ahead], self.previous[back]
        self._refuse(row[ahead], self.previous[next_of] != row[ahead], "its 'next' does not name it as 'prev'")
        self._refuse(row[back], self.following[previous_of] != row[back], "its 'prev' does not name it as 'next'")
        strays = self.group[next_of] != self.group[ahead]
        self._refuse(row[ahead], strays, f"its 'next' belongs to another {self.kind}")
        self._refuse(row[ahead], self.time[next_of] <= self.time[ahead], "its 'next' is not later")
        self._check_ends(np.bincount(self.group, minlength=len(self.owner)))

    def _check_ends(self, found: Ints) -> None:
        """First, last and number of rows of each group; one beginning means that there is no second chain."""
        group = np.arange(len(self.owner))
        begins = np.bincount(self.group[self.previous < 0], minlength=len(group))
        for end, link, name in ((self.first, self.previous, "first"), (self.last, self.following, "last")):
            wrong = (self.group[end] != group) | (link[end] >= 0)
            self._refuse_group(wrong, f"its {name} record is not the {name} of its chain in {self.rows.path.name}")
        self._refuse_group(begins > 1, f"its records in {self.rows.path.name} are not one chain")
        for at in np.flatnonzero(found != self.count)[:1]:
            raise DataError(
                f"{self.path}, record {self.owner[at]!r}: says that it has {self.count[at]} records in "
                f"{self.rows.path.name}, found {found[at]}"
            )

    def _refuse(self, row: Ints, wrong: Bools, what: str) -> None:
        if wrong.any():
            token = self.rows.token[int(row[np.argmax(wrong)])]
            raise DataError(f"{self.rows.path}, record {token!r}: broken chain, {what}")

    def _refuse_group(self, wrong: Bools, what: str) -> None:
        if wrong.any():
            raise DataError(f"{self.path}, record {self.owner[int(np.argmax(wrong))]!r}: broken chain, {what}")
