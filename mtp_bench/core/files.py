"""Atomic writes, early checks of them, bounded reads, and the folder of the cache."""

import contextlib
import errno
import glob
import hashlib
import os
import secrets
import shutil
import stat
import tempfile
import tomllib
import unicodedata
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import quote

from .errors import MtpBenchError
from .notice import say_once

CACHE_VARIABLE = "MTP_BENCH_CACHE"  # environment variable
ABSENT = "cannot be read: no such file"
_CHUNK_BYTES = 1 << 20  # hashed at once
FULL_DISK = (errno.ENOSPC, errno.EDQUOT)
# Unicode categories: controls, format marks, surrogates
_INVISIBLE = ("Cc", "Cf", "Cs")
_JOINERS = "\u200c\u200d"  # invisible, but several scripts need them
_FILE_KINDS = {
    stat.S_IFREG: "",
    stat.S_IFDIR: "folder",
    stat.S_IFIFO: "FIFO",
    stat.S_IFSOCK: "socket",
    stat.S_IFCHR: "device",
    stat.S_IFBLK: "device",
}


class WriteError(MtpBenchError, OSError):
    """A failure to write a file or folder.

    Also an OSError, so that optional writes can be skipped.
    Constructed as ``WriteError(errno, strerror, filename)`` with the name that the user
    asked for.
    """

    def __str__(self) -> str:
        text = f"cannot write {self.filename}: {describe_write_error(self)}"
        if self.errno in FULL_DISK:
            return text
        return f"{text}; choose another folder"


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path that replaces ``path`` if the block succeeds.

    It has the suffix of ``path``. After an error or interruption ``path`` is unchanged,
    without temporary files. Raises WriteError naming ``path``.
    """
    part = _temporary(path)
    try:
        with _naming(path, part):
            _require_ordinary(path)
            yield part
            part.replace(path)
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


@contextlib.contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Yield a new folder that replaces ``path`` if the block succeeds.

    A symbolic link is followed and kept. After an error or an interruption the earlier
    folder is unchanged. Raises WriteError naming ``path`` if writing fails, and
    MtpBenchError if the folder cannot be replaced.
    """
    path = _target(path)
    require_replaceable(path)
    part = _temporary(path)
    earlier = part.with_suffix(".earlier")
    try:
        with _naming(path, part):
            part.mkdir(parents=True)
            yield part
            if path.exists():
                path.rename(earlier)
            part.rename(path)
    finally:
        if earlier.exists() and not path.exists():
            earlier.rename(path)
        shutil.rmtree(earlier, ignore_errors=True)
        shutil.rmtree(part, ignore_errors=True)


@contextlib.contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Yield a folder to fill, as `whole_folder`.

    Raises MtpBenchError if ``path`` is a file or a folder that is not empty.
    """
    if path.exists() and not path.is_dir():
        raise MtpBenchError(f"{path} is not a folder: choose another name")
    if path.exists() and any(path.iterdir()):
        raise MtpBenchError(f"{path} is not empty: choose another folder")
    require_folder(path)
    with whole_folder(path) as part:
        yield part


def require_replaceable(folder: Path) -> None:
    """Raise MtpBenchError for a mount point and the working directory."""
    if not folder.exists():
        return
    path = folder.resolve()
    if os.path.ismount(path) or Path.cwd().is_relative_to(path):
        raise MtpBenchError(
            f"{folder} is the root of a disk or the working folder: "
            "choose a folder inside it"
        )


def remove_leftovers(*paths: Path) -> None:
    """Remove temporary files that killed writers of ``paths`` left.

    No other process may be writing them.
    """
    # `whole_folder` writes beside the target of a link
    for path in {*paths, *map(_target, paths)}:
        stem = glob.escape(path.stem)
        suffix = glob.escape(path.suffix)
        for leftover in path.parent.glob(f".{stem}.*.part{suffix}"):
            if leftover.is_dir() and not leftover.is_symlink():
                shutil.rmtree(leftover, ignore_errors=True)
            else:
                leftover.unlink(missing_ok=True)


@contextlib.contextmanager
def locked(path: Path, target: str) -> Iterator[None]:
    """Hold the lock file ``path`` while ``target`` is written.

    Raises MtpBenchError if another process holds it. The lock ends with the process,
    even when it is killed.
    """
    from filelock import FileLock, Timeout

    lock = FileLock(path)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise MtpBenchError(
            f"{target} is being written by another process: wait for it, or end it"
        ) from None
    try:
        yield
    finally:
        lock.release()


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 file atomically.

    Raises MtpBenchError if that fails.
    """
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically.

    Raises MtpBenchError if that fails.
    """
    require_file(path)
    with whole_file(path) as part:
        part.write_bytes(content)


def make_folder(folder: Path) -> None:
    """Create a folder and its parents unless it exists.

    Raises WriteError if that fails.
    """
    with _naming(folder):
        folder.mkdir(parents=True, exist_ok=True)


def describe_write_error(error: OSError) -> str:
    """Return the reason of a failure to write."""
    reason = str(error.strerror or error)
    if error.errno in FULL_DISK:
        reason += ": make room there, or choose another folder, and try again"
    return reason


def read_bounded(
    path: Path, max_bytes: int, error: type[MtpBenchError], absent: str = ABSENT
) -> str:
    """Read the text of a small UTF-8 file.

    Raises ``error`` naming the file if it is missing (described by ``absent``), is not
    a regular file, has more than ``max_bytes`` bytes or is not valid UTF-8.
    """
    try:
        with open_regular(path) as stream:
            content = stream.read(max_bytes + 1)
    except FileNotFoundError:
        raise error(f"{path}: {absent}") from None
    except OSError as cause:
        raise error(f"{path}: cannot be read: {cause.strerror or cause}") from None
    if len(content) > max_bytes:
        raise error(
            f"{path}: larger than {max_bytes >> 10} KiB, the limit for such a file"
        )
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as cause:
        raise error(
            f"{path}: not valid UTF-8: {cause.reason} at byte {cause.start}; "
            "save it as UTF-8"
        ) from None


def toml_beside(module: str, name: str) -> dict[str, Any]:
    """Read a TOML file that ships beside the file ``module``."""
    return tomllib.loads(Path(module).with_name(name).read_text(encoding="utf-8"))


def open_regular(path: Path, links: bool = True) -> BinaryIO:
    """Open a regular file for reading.

    Raises OSError for a FIFO, a device and others whose reading may never end.
    ``links``: follow a symbolic link to a regular file.
    """
    flags = getattr(os, "O_NONBLOCK", 0)  # opening a FIFO would wait for a writer
    if not links:
        flags |= getattr(os, "O_NOFOLLOW", 0)
    _require_regular(path.stat(follow_symlinks=links), path)
    # pathlib has no opener
    stream = open(path, "rb", opener=lambda name, mode: os.open(name, mode | flags))  # noqa: SIM115
    try:
        # it may have been replaced meanwhile
        _require_regular(os.fstat(stream.fileno()), path)
    except OSError:
        stream.close()
        raise
    return stream


def file_kind(mode: int) -> str:
    """Name the kind of a file from ``st_mode``: "folder", "FIFO", ...

    It is empty for a regular file.
    """
    return _FILE_KINDS.get(stat.S_IFMT(mode), "link")


def file_digest(path: Path, max_bytes: int | None = None) -> str:
    """Return the hex sha256 of a regular file.

    Raises OSError, also for more than ``max_bytes`` bytes.
    """
    digest = hashlib.sha256()
    size = 0
    with open_regular(path) as stream:
        while chunk := stream.read(_CHUNK_BYTES):
            digest.update(chunk)
            size += len(chunk)
            if max_bytes is not None and size > max_bytes:
                raise OSError(
                    errno.EFBIG,
                    f"it has more than {max_bytes} bytes, and may be growing",
                )
    return digest.hexdigest()


def cache_root() -> Path:
    """Return the folder of files made once per machine.

    MTP_BENCH_CACHE names it; otherwise it is the user's cache folder.
    """
    if os.environ.get(CACHE_VARIABLE):
        return Path(os.environ[CACHE_VARIABLE]).expanduser()
    from platformdirs import user_cache_path

    return user_cache_path("mtp_bench", appauthor=False)


def remove_damaged(path: Path) -> None:
    """Delete ``path`` of the cache and tell the user.

    Do nothing if it does not exist.
    """
    if not os.path.lexists(path):
        return
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()
    say_once(f"{path} was damaged and is made anew")


def file_stem(name: str) -> str:
    """Return the name of a scene as a file name.

    The name may contain a slash.
    """
    stem = quote(name, safe="")
    return f"%2E{stem[1:]}" if stem.startswith(".") else stem  # never hidden


def clean_text(text: str, max_length: int) -> str:
    """Return ``text`` as one line that is safe to print.

    Controls, escapes, direction marks and lone surrogates become U+FFFD, line ends
    become blanks.
    """
    line = " ".join(text[: 4 * max_length].splitlines())  # not all of a huge text
    clean = "".join("\ufffd" if unseen(letter) else letter for letter in line)
    if len(clean) > max_length:
        clean = clean[: max_length - 1] + "…"
    return clean


def unseen(letter: str) -> bool:
    """Return True for an invisible character.

    These are controls, escapes, direction marks and lone surrogates.
    """
    return unicodedata.category(letter) in _INVISIBLE and letter not in _JOINERS


def require_file(path: Path) -> None:
    """Raise MtpBenchError unless a file can be written at ``path``."""
    if not path.name or path.is_dir():
        raise MtpBenchError(
            f"cannot write {str(path)!r}: it is a folder, expected the name of a file"
        )
    if not path.parent.is_dir():
        raise MtpBenchError(f"cannot write {path}: there is no folder {path.parent}")
    _require_ordinary(path)
    with _naming(path):
        tempfile.TemporaryFile(dir=path.parent).close()


def require_folder(path: Path) -> None:
    """Raise MtpBenchError unless the folder ``path`` can be created or replaced."""
    above = next(
        parent for parent in _target(path).absolute().parents if parent.exists()
    )
    if not above.is_dir():
        raise MtpBenchError(
            f"cannot write {path}: {above} is a file, expected a folder"
        )
    with _naming(path):
        tempfile.TemporaryFile(dir=above).close()


@contextlib.contextmanager
def _naming(path: Path, part: Path | None = None) -> Iterator[None]:
    """Turn an OSError about ``path`` or its ``part`` into a WriteError.

    It names ``path``, not the temporary ``part``.
    """
    try:
        yield
    except OSError as error:
        name = error.filename
        # an error about a descriptor has no name
        if part is not None and isinstance(name, str | os.PathLike):
            file = Path(name)
            if {part, path}.isdisjoint([file, *file.parents]):
                raise  # about a file that has nothing to do with ``path``
        reason = error.strerror or str(error) or type(error).__name__
        raise WriteError(error.errno, reason, str(path)) from error


def _require_ordinary(path: Path) -> None:
    """Raise MtpBenchError for an existing device, pipe or socket."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise MtpBenchError(
            f"cannot write {path}: it is not an ordinary file; choose another name"
        )


def _require_regular(state: os.stat_result, path: Path) -> None:
    if kind := file_kind(state.st_mode):
        raise OSError(errno.EINVAL, f"it is a {kind}, expected a file", str(path))


def _temporary(path: Path) -> Path:
    token = f"{os.getpid()}.{secrets.token_hex(4)}"
    return path.with_name(f".{path.stem}.{token}.part{path.suffix}")


def _target(path: Path) -> Path:
    """Return the target of a symbolic link, else ``path``."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path
