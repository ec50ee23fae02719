"""The files of a submission: which they are, what is refused among them, and the digest over all of them."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from ..errors import SubmissionError
from ..files import file_digest, file_kind

FOLDERS = ("__pycache__", ".git")  # what tools leave behind: no part of a submission
MOST_BYTES = 2 << 30  # of all files together
MOST_FILES = 10_000
MOST_DEPTH = 32  # of folders in each other


def files_of(folder: Path) -> list[Path]:
    """Files of the submission in ``folder``, sorted by name; what lies in FOLDERS is not part of it.

    Nothing is opened. Raises SubmissionError, naming the file, for links, FIFOs, sockets and devices, for a file with
    the name of one of FOLDERS, for a name that is no text, and for more than MOST_FILES or MOST_BYTES.
    """
    found: list[Path] = []
    size = 0
    for entry in _entries(folder, 0):
        size += entry.stat(follow_symlinks=False).st_size
        found.append(Path(entry.path))
        if len(found) > MOST_FILES:
            raise SubmissionError(
                f"{folder}: more than {MOST_FILES} files, expected at most so many: leave out what the agent does not "
                "need, such as data and environments"
            )
        if size > MOST_BYTES:
            raise SubmissionError(
                f"{folder}: its files have {size / 2**30:.1f} GiB or more ({entry.name} among them), expected at most "
                f"{MOST_BYTES >> 30} GiB: leave out what the agent does not need"
            )
    return sorted(found)


def digest_of(folder: Path, files: Iterable[Path], networks: Mapping[str, str] | None = None) -> str:
    """Hex sha256 over names and contents of ``files`` of ``folder``; SubmissionError for one that cannot be read.

    ``networks``: names and hex sha256 of weights that lie elsewhere. Theirs begin with a slash, as no name of a file
    of the folder does.
    """
    total = hashlib.sha256()
    for path in files:
        try:
            content = file_digest(path, MOST_BYTES)
        except OSError as error:
            raise SubmissionError(f"{path}: cannot be read: {error.strerror or error}") from None
        total.update(f"{path.relative_to(folder).as_posix()}\0{content}\n".encode())
    for name, content in sorted((networks or {}).items()):
        total.update(f"/networks/{name}\0{content}\n".encode())
    return total.hexdigest()


def _entries(folder: Path, depth: int) -> Iterator[os.DirEntry[str]]:
    """Regular files below ``folder``, each looked at before it is used."""
    if depth > MOST_DEPTH:
        raise SubmissionError(f"{folder}: folders are nested deeper than {MOST_DEPTH} levels, expected at most so many")
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if _is_folder(entry):
                    yield from _entries(Path(entry.path), depth + 1)
                elif entry.name not in FOLDERS or not entry.is_dir(follow_symlinks=False):
                    yield entry
    except OSError as error:
        raise SubmissionError(f"{error.filename or folder}: cannot be read: {error.strerror or error}") from None


def _is_folder(entry: os.DirEntry[str]) -> bool:
    """Whether it is a folder of the submission; raises SubmissionError for what a submission cannot hold."""
    try:
        entry.name.encode()
    except UnicodeEncodeError:
        shown = ascii(entry.path.encode(errors="surrogateescape"))[1:]
        raise SubmissionError(f"{shown}: its name is not UTF-8, expected one that is: rename it") from None
    kind = file_kind(entry.stat(follow_symlinks=False).st_mode)
    if kind == "link":
        to = "folder" if Path(entry.path).is_dir() else "file"
        raise SubmissionError(
            f"{entry.path} is a link to a {to}; a submission holds its files itself: copy what it links to"
        )
    if kind not in ("", "folder"):
        raise SubmissionError(f"{entry.path} is a {kind}, expected files and folders only: remove it")
    if kind == "" and entry.name in FOLDERS:
        raise SubmissionError(
            f"{entry.path} is a file, and only a folder may have this name: remove it, or copy the submission without "
            "it (a git worktree or submodule has such a file)"
        )
    return kind == "folder" and entry.name not in FOLDERS
