"""The page of a leaderboard and its parts on disk."""

from __future__ import annotations

from pathlib import Path

from ...errors import MtpBenchError
from ...files import describe_write_error, require_folder, whole_folder, write_text
from .page import BoardFiles

SUFFIX = ".parts"  # of the folder beside a page
_MARK = "overview.json"  # in every such folder


def parts_folder(page: Path) -> Path:
    """The folder of the parts of ``page``."""
    return page.with_name(page.stem + SUFFIX)


def require_parts(page: Path) -> None:
    """Raise MtpBenchError unless the folder of the parts can be written, and holds nothing else than earlier ones."""
    folder = parts_folder(page)
    require_folder(folder)
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise MtpBenchError(f"cannot write {folder}: it is no folder of its own: remove it")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / _MARK).is_file():
        raise MtpBenchError(
            f"cannot write {folder}: it holds other files than parts of a page; write the page elsewhere"
        )


def write_board(page: Path, files: BoardFiles) -> None:
    """Write a page and its parts; earlier parts go. Raises MtpBenchError where that fails."""
    require_parts(page)
    folder = parts_folder(page)
    try:
        with whole_folder(folder) as part:
            for name, text in files.parts.items():
                path = part / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise MtpBenchError(f"cannot write {folder}: {describe_write_error(error, folder)}") from None
    write_text(page, files.page)
