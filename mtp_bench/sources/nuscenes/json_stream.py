"""Large JSON files, read record by record: only the record at hand is in memory, not the file.

Values are those of Python's ``json``, which writes and reads NaN: detection files have it for unknown velocities, and
parsers of strict JSON refuse it.
"""

from __future__ import annotations

import codecs
import json
import re
import reprlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

from ...errors import DataError

Record = dict[str, Any]
Read = Callable[[int], object]  # is told the number of bytes each time some were read

_CHUNK = 1 << 20  # bytes
_SPACE = re.compile(r"[ \t\n\r]*")
_DECODER = json.JSONDecoder()
_NUMBER_REST = 3  # characters after the 1 of 1e+9: with fewer in memory a number may be cut in two
_BRIEF = reprlib.Repr()  # short for long numbers, texts and lists, and for deeply nested ones
_BRIEF.maxstring = _BRIEF.maxother = 80
_AT_THE_END = 32  # characters: longer than any literal or escape that the end of a chunk may cut in two


def brief(value: Any) -> str:
    """A value of a file for messages, shortened."""
    return _BRIEF.repr(value)


def read_records(path: Path, read: Read) -> Iterator[Record]:
    """Records of a file that holds a list of objects; DataError names the file and the position that is wrong."""
    with _opened(path) as file:
        text = _Text(path, file, read)
        text.take("[", "a list of records")
        for _ in text.items("]"):
            record = text.value()
            if not isinstance(record, dict):
                text.refuse(f"got {brief(record)!r}, expected a record")
            yield record
        text.finish()


def read_entries(path: Path, key: str, read: Read) -> Iterator[tuple[str, Any]]:
    """Entries of the object that the file has under ``key``; DataError as for `read_records`."""
    with _opened(path) as file:
        text = _Text(path, file, read)
        text.take("{", f"an object with {key!r}")
        found = False
        for _ in text.items("}"):
            if text.key() == key:
                if found:
                    text.refuse(f"a second {key!r}, expected one")
                found = True
                text.take("{", f"an object under {key!r}")
                for _ in text.items("}"):
                    yield text.key(), text.value()
            else:
                text.value()
        text.finish()
        if not found:
            raise DataError(f"{path} has no {key!r}")


def _opened(path: Path) -> BinaryIO:
    try:
        return path.open("rb")
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror}") from None


class _Text:
    """The part of a JSON text that is in memory, and the place in it."""

    def __init__(self, path: Path, file: BinaryIO, read: Read) -> None:
        self._path, self._file, self._read = path, file, read
        self._bytes = codecs.getincrementaldecoder("utf-8-sig")()  # some editors write a byte order mark
        self._text, self._at, self._before = "", 0, 0  # characters before the text in memory
        self._ended = False

    def items(self, end: str) -> Iterator[None]:
        """Comes back before each item of a list or object, up to the bracket ``end``."""
        if self._next() == end:
            self._at += 1
            return
        while True:
            yield
            mark = self._next()
            if mark not in (",", end):
                self.refuse(f"expected ',' or {end!r}")
            self._at += 1
            if mark == end:
                return

    def take(self, mark: str, what: str) -> None:
        """Go past ``mark``."""
        if self._next() != mark:
            self.refuse(f"expected {what}")
        self._at += 1

    def key(self) -> str:
        """The key of an entry."""
        key = self.value()
        if not isinstance(key, str):
            self.refuse(f"got {brief(key)!r}, expected a key")
        self.take(":", "':'")
        return key

    def value(self) -> Any:
        """The next value."""
        self._next()
        while True:
            try:
                value, end = _DECODER.raw_decode(self._text, self._at)
            except json.JSONDecodeError as error:
                cut = error.msg.startswith("Unterminated") or error.pos > len(self._text) - _AT_THE_END
                if not (cut and self._more()):
                    self._at = min(error.pos, len(self._text))
                    self.refuse(error.msg, error.msg.startswith("Unterminated"))
            except RecursionError:
                self.refuse("nested too deeply")
            except ValueError:
                self.refuse("a number with too many digits")
            else:
                if end + _NUMBER_REST <= len(self._text) or not self._more():
                    self._at = end
                    return value

    def finish(self) -> None:
        """Nothing but blanks may follow."""
        if self._next():
            self.refuse("expected the end of the file")

    def refuse(self, what: str, cut: bool = False) -> NoReturn:
        """Raise DataError for this place; ``cut``: only the end of the file can be the cause."""
        end = "; the file ends here: is it cut off?" if cut or (self._ended and self._at >= len(self._text)) else ""
        raise DataError(f"{self._path}, character {self._before + self._at}: {what}{end}")

    def _next(self) -> str:
        """The next character that is not blank; empty at the end of the file."""
        while True:
            blank = _SPACE.match(self._text, self._at)
            self._at = blank.end() if blank else self._at
            if self._at < len(self._text):
                return self._text[self._at]
            if not self._more():
                return ""

    def _more(self) -> bool:
        """Read on, twice as far for a value that still does not end; False at the end of the file."""
        rest = len(self._text) - self._at
        chunk = b"" if self._ended else self._file.read(max(_CHUNK, rest))
        self._read(len(chunk))
        if not chunk:
            self._ended = True
            return False
        try:
            added = self._bytes.decode(chunk)
        except UnicodeDecodeError as error:
            raise DataError(f"{self._path} cannot be read as text: {error}") from None
        self._before += self._at
        self._text, self._at = self._text[self._at :] + added, 0
        return True
