"""Files that appear complete or not at all, and are refused before the work rather than after it."""

from __future__ import annotations

import contextlib
import hashlib
import os
import secrets
import shutil
import unicodedata
from collections.abc import Iterator
from pathlib import Path

from .errors import MtpBenchError

_UNSEEN = ("Cc", "Cf", "Cs")  # categories of letters: controls, marks of format, halves of characters
_JOINERS = "\u200c\u200d"  # some scripts are written with them


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A path beside ``path`` to write to; it takes the place of ``path`` when the block ends without an error.

    It has the suffix of ``path``. After an error, or an interruption, ``path`` is as it was and nothing else is left.
    Raises what writing raises.
    """
    part = _beside(path)
    try:
        yield part
        part.replace(path)
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


@contextlib.contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """A new folder beside ``path`` to fill; it takes the place of the folder ``path`` when the block ends well.

    After an error, or an interruption, the earlier folder is as it was. Raises what writing raises.
    """
    part = _beside(path)
    part.mkdir(parents=True)
    try:
        yield part
        _put_in_place(part, path)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def write_text(path: Path, text: str) -> None:
    """Write a text as a whole. Raises MtpBenchError where that fails."""
    require_file(path)
    try:
        with whole_file(path) as part:
            part.write_text(text, encoding="utf-8")
    except OSError as error:
        raise MtpBenchError(f"cannot write {path}: {error.strerror or error}") from None


def file_digest(path: Path) -> str:
    """Hex sha256 of the content of a file, which is read in parts. Raises OSError."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def require_file(path: Path) -> None:
    """Raise MtpBenchError unless a file can be written at ``path``."""
    if not path.name or path.is_dir():
        raise MtpBenchError(f"cannot write {str(path)!r}: it is a folder, expected the name of a file")
    if not path.parent.is_dir():
        raise MtpBenchError(f"cannot write {path}: there is no folder {path.parent}")
    _require_access(path, path.parent)


def require_folder(path: Path) -> None:
    """Raise MtpBenchError unless the folder ``path`` can be made or replaced."""
    nearest = path.absolute().parent
    while not nearest.exists():
        nearest = nearest.parent
    if not nearest.is_dir():
        raise MtpBenchError(f"cannot write {path}: {nearest} is a file, expected a folder")
    _require_access(path, nearest)


def _beside(path: Path) -> Path:
    return path.with_name(f".{path.stem}.{os.getpid()}.{secrets.token_hex(4)}.part{path.suffix}")


def _put_in_place(part: Path, folder: Path) -> None:
    """Replace a folder; the earlier one comes back if that fails."""
    if not folder.exists():
        part.rename(folder)
        return
    earlier = part.with_name(f"{part.name}.earlier")
    folder.rename(earlier)
    try:
        part.rename(folder)
    except OSError:
        earlier.rename(folder)
        raise
    shutil.rmtree(earlier, ignore_errors=True)


def _require_access(path: Path, folder: Path) -> None:
    if not os.access(folder, os.W_OK | os.X_OK):
        raise MtpBenchError(f"cannot write {path}: no permission to write in {folder}")


def clean_text(text: str, most: int) -> str:
    """``text`` in one line that can be stored and shown: at most ``most`` characters, none of them invisible.

    Controls, escapes, marks that turn the direction of writing and lone surrogates become U+FFFD, line ends blanks.
    """
    line = " ".join(text[: 4 * most].splitlines())
    clean = "".join(
        "\ufffd" if unicodedata.category(letter) in _UNSEEN and letter not in _JOINERS else letter for letter in line
    )
    return clean if len(clean) <= most else clean[: most - 1] + "…"
