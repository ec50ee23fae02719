"""What commands write: complete or not at all, and refused before the work rather than after it."""

from __future__ import annotations

import contextlib
import os
import secrets
from pathlib import Path

from ..errors import MtpBenchError


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


def write_text(path: Path, text: str) -> None:
    """Write a file: it appears complete or not at all. Raises MtpBenchError where that fails."""
    require_file(path)
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    try:
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(path)
    except OSError as error:
        raise MtpBenchError(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        with contextlib.suppress(OSError):  # after an interruption too
            temporary.unlink(missing_ok=True)


def _require_access(path: Path, folder: Path) -> None:
    if not os.access(folder, os.W_OK | os.X_OK):
        raise MtpBenchError(f"cannot write {path}: no permission to write in {folder}")
