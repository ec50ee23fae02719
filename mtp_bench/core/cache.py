"""Results that the cache keeps, as JSON that no other user could have written."""

import hashlib
import json
import os
import stat
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

from .bundle import bundled
from .errors import MtpBenchError
from .files import cache_root, file_digest, whole_file

_NUMBERS_OF = ("numpy", "scipy", "pydantic", "jinja2")  # packages


def kept(name: str, key_of: Callable[[], str], make: Callable[[], Any]) -> Any:
    """Return the JSON that the cache keeps as ``name``, else make and keep it.

    ``key_of``: digest of all that it depends on; empty if it must not be kept. What is
    kept counts only with the same key and with its own digest, and if no other user may
    write to its file and folder.
    """
    path = cache_root() / name
    key = key_of()
    with suppress(OSError, ValueError):  # missing, or not what was written
        if key and _is_private(path.parent) and _is_private(path):
            digest, text = path.read_text(encoding="utf-8").split("\n", 1)
            if digest == _digest(name, key, text):
                return json.loads(text)
    text = json.dumps(make())
    # a file may have changed since it was read
    if key and key == key_of():
        with suppress(OSError, MtpBenchError):
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            with whole_file(path) as part:
                part.touch(mode=0o600)
                content = f"{_digest(name, key, text)}\n{text}"
                part.write_text(content, encoding="utf-8")
    return json.loads(text)


def files_digest(paths: Iterable[Path]) -> str:
    """Return the hex sha256 over names and contents of files, in their order.

    Raises OSError if one cannot be read.
    """
    contents = [file_digest(p) if p.is_file() else "" for p in paths]
    return _digest(*map(str, paths), *contents)


def library_digest() -> str:
    """Return the digest of code, cards and baselines, and of what computes numbers.

    Raises OSError if a file cannot be read.
    """
    folders = Path(__file__).parents[1], bundled("envs"), bundled("baselines")
    paths = []
    for folder in folders:
        for path in folder.rglob("*"):
            if "__pycache__" not in path.parts:
                paths.append(path)
    versions = map(version, _NUMBERS_OF)
    return _digest(files_digest(sorted(paths)), sys.version, *versions)


def _digest(*texts: str) -> str:
    return hashlib.sha256(repr(texts).encode()).hexdigest()


def _is_private(path: Path) -> bool:
    """Return True if only this user may write a file or folder, not a link."""
    status = path.lstat()
    user = getattr(os, "geteuid", lambda: status.st_uid)()
    is_link = stat.S_ISLNK(status.st_mode)
    return status.st_uid == user and not status.st_mode & 0o022 and not is_link
