"""Files that appear complete or not at all, are refused before the work rather than after it, and read in bounds."""

from __future__ import annotations

import contextlib
import errno
import glob
import hashlib
import os
import secrets
import shutil
import stat
import struct
import tempfile
import tokenize
import unicodedata
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO
from urllib.parse import quote

from .errors import MtpBenchError

try:
    from lzma import LZMAError as _LzmaError
except ImportError:  # a Python that was built without it, which reads no such file at all
    _LzmaError = zlib.error  # type: ignore[assignment, misc]

ABSENT = "cannot be read: no such file"
ELSEWHERE = "choose another folder"  # what to do where nothing can be written
BROKEN_ARCHIVE = (  # what reading an NPZ file raises where bytes of it are other ones, or lacking
    OSError, TypeError, ValueError, LookupError, ArithmeticError, EOFError, MemoryError, RuntimeError, SyntaxError,
    struct.error, tokenize.TokenError, zipfile.BadZipFile, zlib.error, _LzmaError,
)  # fmt: skip
_PART = 1 << 20  # bytes that are hashed at once
_EARLIER = ".earlier"  # suffix of a folder that another one takes the place of just now
_FULL = (errno.ENOSPC, errno.EDQUOT)
_UNSEEN = ("Cc", "Cf", "Cs")  # categories of letters: controls, marks of format, halves of characters
_JOINERS = "\u200c\u200d"  # some scripts are written with them
_KINDS = {  # what stands where a file is expected
    stat.S_IFDIR: "folder", stat.S_IFIFO: "FIFO", stat.S_IFSOCK: "socket", stat.S_IFCHR: "device",
    stat.S_IFBLK: "device",
}  # fmt: skip


class WriteError(MtpBenchError, OSError):
    """A file or a folder could not be written; also an OSError, for those who can do without it.

    Made as ``WriteError(errno, strerror, filename)``, where ``filename`` is what the user asked for.
    """

    def __str__(self) -> str:
        return _unwritten(self, Path(self.filename))


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A path beside ``path`` to write to; it takes the place of ``path`` when the block ends without an error.

    It has the suffix of ``path``. After an error, or an interruption, ``path`` is as it was and nothing else is left.
    Raises WriteError, which names ``path``, where writing fails.
    """
    part = _beside(path)
    try:
        _require_ordinary(path)
        yield part
        part.replace(path)
    except OSError as error:
        if not _is_of(error, part, path):
            raise
        raise _write_error(error, path) from error
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


@contextlib.contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """A new folder beside ``path`` to fill; it takes the place of the folder ``path`` when the block ends well.

    A link stays, and the folder that it leads to is the one that is replaced. After an error, or an interruption, the
    earlier folder is as it was. Raises WriteError, which names ``path``, where writing fails.
    """
    path = _target(path)
    part = _beside(path)
    try:
        part.mkdir(parents=True)
        yield part
        _put_in_place(part, path)
    except OSError as error:
        if not _is_of(error, part, path):
            raise
        raise _write_error(error, path) from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


@contextlib.contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """A folder to fill, which becomes the new or empty ``folder`` when the block ends well; see `whole_folder`.

    Raises MtpBenchError where ``folder`` is a file, holds anything or cannot be replaced.
    """
    if folder.exists() and not folder.is_dir():
        raise MtpBenchError(f"{folder} is no folder: choose another name")
    if folder.exists() and any(folder.iterdir()):
        raise MtpBenchError(f"{folder} is not empty: choose another folder")
    if why := why_not_replaced(folder):
        raise MtpBenchError(why)
    require_folder(folder)
    with whole_folder(folder) as part:
        yield part


def why_not_replaced(folder: Path) -> str:
    """Why no other folder can take the place of ``folder``, in a sentence; empty where one can."""
    if not folder.exists():
        return ""
    if os.path.ismount(folder.resolve()):
        return f"{folder} is the root of a disk, which cannot be replaced: choose a folder on it"
    if Path.cwd().is_relative_to(folder.resolve()):
        return f"{folder} is the folder that you work in, which cannot be replaced: choose one in it"
    return ""


def remove_leftovers(*paths: Path) -> None:
    """Remove what writers of ``paths`` that were killed left beside them; nobody else may be writing them now.

    Where the earlier folder was already moved away and the new one was not there yet, the earlier one comes back.
    """
    for path in paths:
        target = _target(path)
        for left in {*_left_beside(path), *_left_beside(target)}:  # a file takes the place of a link, a folder does not
            if left.name.endswith(_EARLIER) and not target.exists():
                left.rename(target)
            elif left.is_dir() and not left.is_symlink():
                shutil.rmtree(left, ignore_errors=True)
            else:
                left.unlink(missing_ok=True)


@contextlib.contextmanager
def locked(path: Path, what: str) -> Iterator[None]:
    """Be the only process that writes ``what`` on this machine, by a lock on the file ``path``, which is made.

    The lock ends with its process, however that ends. Raises MtpBenchError, naming the process that holds it.
    """
    import fcntl  # not on Windows

    while True:
        with path.open("a+", encoding="ascii", errors="replace") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                file.seek(0)
                raise MtpBenchError(
                    f"{what} is being written by another process ({file.read(20).strip() or 'unknown'}): wait for it, "
                    "or end it"
                ) from None
            if not _is_at(path, file.fileno()):  # its holder removed it, just before this process got it
                continue
            file.truncate(0)
            file.write(f"{os.getpid()}\n")
            file.flush()
            yield
            return


def write_text(path: Path, text: str) -> None:
    """Write a text as a whole. Raises MtpBenchError where that fails."""
    require_file(path)
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8")


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file as a whole. Raises MtpBenchError where that fails."""
    require_file(path)
    with whole_file(path) as part:
        part.write_bytes(content)


def make_folder(folder: Path, advice: str = ELSEWHERE) -> None:
    """Make a folder and those above it, unless it is there. Raises MtpBenchError, with ``advice``, where that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MtpBenchError(_unwritten(error, folder, advice)) from None


def reason_of(error: OSError, path: Path) -> str:
    """Why ``path`` could not be written, in words; of a full disk also how much is free, and what to do."""
    if error.errno not in _FULL:
        return error.strerror or str(error)
    nearest = _nearest(path)
    free = f", {shutil.disk_usage(nearest).free / 2**20:.1f} MiB are free at {nearest}" if nearest.exists() else ""
    return f"{error.strerror}{free}: make room there, or choose another folder, and try again"


def read_bounded(path: Path, most: int, error: type[MtpBenchError], absent: str = ABSENT) -> str:
    """The text of a small file in UTF-8.

    Raises ``error``, naming the file, where there is none (``absent`` says so), where it is a FIFO, a device or
    another thing that could never end, where it has more than ``most`` bytes, and where it is no text.
    """
    try:
        with open_regular(path) as stream:
            content = stream.read(most + 1)
    except FileNotFoundError:
        raise error(f"{path}: {absent}") from None
    except OSError as cause:
        raise error(f"{path}: cannot be read: {cause.strerror or cause}") from None
    if len(content) > most:
        raise error(f"{path}: larger than {most >> 10} KiB, which is the most that is read of such a file")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as cause:
        raise error(f"{path}: no text in UTF-8: {cause.reason} at byte {cause.start}; save it as UTF-8") from None


def why_no_archive(error: Exception) -> str:
    """Why NumPy could not read a file, without its advice to trust what is in it."""
    said = str(error)
    return "it holds Python objects, which are never read" if "pickle" in said else said


def open_regular(path: Path, links: bool = True) -> BinaryIO:
    """A regular file, to be read; anything else is never opened, for that could wait for ever. Raises OSError.

    ``links``: a link to such a file is followed.
    """
    _require_regular(path.stat() if links else path.lstat(), path)
    stream = open(path, "rb", opener=_without_waiting if links else _without_links)  # noqa: SIM115  (a path has no opener)
    try:
        _require_regular(os.fstat(stream.fileno()), path)  # it may have been replaced meanwhile
    except OSError:
        stream.close()
        raise
    return stream


def kind_of(mode: int) -> str:
    """What a file is that is no regular one, of the ``st_mode`` of its state; "" for a regular file."""
    return "" if stat.S_ISREG(mode) else _KINDS.get(stat.S_IFMT(mode), "link")


def file_digest(path: Path, most: int | None = None) -> str:
    """Hex sha256 of the content of a regular file, which is read in parts.

    Raises OSError, also where it has more than ``most`` bytes: it may grow while it is read.
    """
    digest, size = hashlib.sha256(), 0
    with open_regular(path) as stream:
        while part := stream.read(_PART):
            digest.update(part)
            size += len(part)
            if most is not None and size > most:
                raise OSError(errno.EFBIG, f"it has more than {most} bytes, and may be growing")
    return digest.hexdigest()


def file_stem(name: str) -> str:
    """A scene's name, which may have a slash, as that of a file; one that begins with a dot would not be seen."""
    stem = quote(name, safe="")
    return f"%2E{stem[1:]}" if stem.startswith(".") else stem


def content_digest(path: Path) -> str:
    """Hex sha256 of a file, or of the names and contents of the files that lie in a folder; raises OSError."""
    if path.is_file():
        return file_digest(path)
    digest = hashlib.sha256()
    for file in sorted(each for each in path.iterdir() if each.is_file()):
        digest.update(os.fsencode(f"{file.name}|{file_digest(file)}\n"))  # a name may be no text
    return digest.hexdigest()


def clean_text(text: str, most: int) -> str:
    """``text`` in one line that can be stored and shown: at most ``most`` characters, none of them invisible.

    Controls, escapes, marks that turn the direction of writing and lone surrogates become U+FFFD, line ends blanks.
    """
    line = " ".join(text[: 4 * most].splitlines())
    clean = "".join("\ufffd" if unseen(letter) else letter for letter in line)
    return clean if len(clean) <= most else clean[: most - 1] + "…"


def unseen(letter: str) -> bool:
    """Whether a character is invisible: a control, an escape, a mark of direction, half of a character."""
    return unicodedata.category(letter) in _UNSEEN and letter not in _JOINERS


def require_file(path: Path) -> None:
    """Raise MtpBenchError unless a file can be written at ``path``."""
    if not path.name or path.is_dir():
        raise MtpBenchError(f"cannot write {str(path)!r}: it is a folder, expected the name of a file")
    if not path.parent.is_dir():
        raise MtpBenchError(f"cannot write {path}: there is no folder {path.parent}")
    _require_ordinary(path)
    _require_access(path, path.parent)


def require_folder(path: Path) -> None:
    """Raise MtpBenchError unless the folder ``path`` can be made or replaced."""
    nearest = _nearest(_target(path))
    if not nearest.is_dir():
        raise MtpBenchError(f"cannot write {path}: {nearest} is a file, expected a folder")
    _require_access(path, nearest)


def _require_ordinary(path: Path) -> None:
    """Raise MtpBenchError for a device, a pipe or a socket: a file in its place would take it from everybody."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise MtpBenchError(f"cannot write {path}: it is no ordinary file; choose another name")


def _nearest(path: Path) -> Path:
    """The nearest folder above ``path`` that is there."""
    nearest = path.absolute().parent
    while not nearest.exists():
        nearest = nearest.parent
    return nearest


def _unwritten(error: OSError, path: Path, advice: str = ELSEWHERE) -> str:
    """What is said where ``path`` could not be written, with ``advice`` unless the reason has its own."""
    said = f"cannot write {path}: {reason_of(error, path)}"
    return said if error.errno in _FULL else f"{said}; {advice}"


def _write_error(error: OSError, path: Path) -> WriteError:
    """The same error, said of ``path``: nobody knows the temporary name that it is written under."""
    return WriteError(error.errno, error.strerror or str(error) or type(error).__name__, str(path))


def _is_of(error: OSError, part: Path, path: Path) -> bool:
    """Whether an error is of writing ``path``, under the name ``part``; one that knows a descriptor alone is."""
    if not isinstance(error.filename, str | bytes | os.PathLike):
        return True
    named = Path(os.fsdecode(error.filename))
    return not {part, path}.isdisjoint([named, *named.parents])


def _is_at(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _require_regular(state: os.stat_result, path: Path) -> None:
    if kind := kind_of(state.st_mode):
        raise OSError(errno.EINVAL, f"it is a {kind}, expected a file", str(path))


def _without_links(path: str, flags: int) -> int:
    return _without_waiting(path, flags | getattr(os, "O_NOFOLLOW", 0))


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _beside(path: Path) -> Path:
    return path.with_name(f".{path.stem}.{os.getpid()}.{secrets.token_hex(4)}.part{path.suffix}")


def _left_beside(path: Path) -> Iterator[Path]:
    """What writers of ``path`` that were killed left, see `_beside` and `_put_in_place`."""
    return path.parent.glob(f".{glob.escape(path.stem)}.*.part{glob.escape(path.suffix)}*")


def _target(path: Path) -> Path:
    """Where a path leads that may be a link."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def _put_in_place(part: Path, folder: Path) -> None:
    """Replace a folder; the earlier one comes back if that fails."""
    if not folder.exists():
        part.rename(folder)
        return
    earlier = part.with_name(part.name + _EARLIER)
    folder.rename(earlier)
    try:
        part.rename(folder)
    except OSError:
        earlier.rename(folder)
        raise
    shutil.rmtree(earlier, ignore_errors=True)


def _require_access(path: Path, folder: Path) -> None:
    """Raise MtpBenchError unless ``path`` can be made in ``folder``: some refuse a file although they permit it."""
    if not os.access(folder, os.W_OK | os.X_OK):
        raise MtpBenchError(f"cannot write {path}: no permission to write in {folder}")
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise MtpBenchError(_unwritten(error, path)) from None
