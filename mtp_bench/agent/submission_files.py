"""Files of a submission: list, digest, import of the code, and a new folder.

Code is imported as a package named after path and source: two submissions may have the
same file names, edited code is imported anew, and modules of one folder import each
other relatively (``from .model import Net``). Compiled code in
``__pycache__`` would run in place of the sources, and no digest covers it: it is
neither read nor written.
"""

import hashlib
import importlib
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType

from ..core import (
    SubmissionError,
    baseline_names,
    file_digest,
    file_kind,
    require_folder,
    whole_folder,
)
from .manifest import MANIFEST, MAX_NAME, NAME_RULE, is_name

SKIPPED_FOLDERS = ("__pycache__", ".git")  # made by tools: not part of a submission
MOST_BYTES = 2 << 30  # of all files together
MOST_FILES = 10_000
MOST_DEPTH = 32  # of nested folders
PREFIX = "mtp_submission_"
TEMPLATE = Path(__file__).parent / "template"
FILES = (MANIFEST, "agent.py.txt", "README.md")  # of the template; it is no module


def files_of(folder: Path) -> list[Path]:
    """List the files of the submission in ``folder``, sorted by name.

    Those in SKIPPED_FOLDERS are left out. No file is opened. Raises SubmissionError, naming the
    file, for links, FIFOs, sockets and devices, for a file with the name of one of
    SKIPPED_FOLDERS, for a name that is not UTF-8, and for more than MOST_FILES or MOST_BYTES.
    """
    paths: list[Path] = []
    size = 0
    for entry in _entries(folder, 0):
        size += entry.stat(follow_symlinks=False).st_size
        paths.append(Path(entry.path))
        if len(paths) > MOST_FILES:
            raise SubmissionError(
                f"{folder}: more than {MOST_FILES} files, the limit: leave out files "
                "that the agent does not need, such as data and environments"
            )
        if size > MOST_BYTES:
            raise SubmissionError(
                f"{folder}: its files have {size / 2**30:.1f} GiB or more "
                f"({entry.name} among them), expected at most {MOST_BYTES >> 30} GiB: "
                "leave out files that the agent does not need"
            )
    return sorted(paths)


def digest_of(
    folder: Path, files: Iterable[Path], networks: Mapping[str, str] | None = None
) -> str:
    """Return the hex sha256 over names and contents of ``files``.

    Raises SubmissionError for an unreadable one.
    ``networks``: names and hex sha256 of weights elsewhere; unlike those of files here,
    their names get a slash.
    """
    total = hashlib.sha256()
    for path in files:
        try:
            content = file_digest(path, MOST_BYTES)
        except OSError as error:
            raise SubmissionError(
                f"{path}: cannot be read: {error.strerror or error}"
            ) from None
        total.update(f"{path.relative_to(folder).as_posix()}\0{content}\n".encode())
    for name, content in sorted((networks or {}).items()):
        total.update(f"/networks/{name}\0{content}\n".encode())
    return total.hexdigest()


def import_from(folder: Path, module: str, name: str) -> ModuleType:
    """Import ``module`` of the submission ``name`` in ``folder``.

    Raises SubmissionError if the import fails.
    """
    if _Finder not in sys.meta_path:
        sys.meta_path.insert(0, _Finder)
    sources = [path for path in files_of(folder) if path.suffix == ".py"]
    source = f"{folder} {digest_of(folder, sources)}"
    package = PREFIX + hashlib.sha256(source.encode()).hexdigest()[:16]
    if package not in sys.modules:
        sys.modules[package] = ModuleType(package)
        sys.modules[package].__path__ = [str(folder)]
    importlib.invalidate_caches()
    try:
        return importlib.import_module(f"{package}.{module}")
    except (Exception, SystemExit) as error:
        hint = ""
        if (
            isinstance(error, ModuleNotFoundError)
            and (folder / f"{error.name}.py").is_file()
        ):
            hint = (
                f"; {error.name}.py is a file of the submission: "
                f"write `from .{error.name} import ...`"
            )
        raise SubmissionError(
            f"{name}: importing {module}.py failed: "
            f"{type(error).__name__}: {error}{hint}"
        ) from error


def new_submission(name: str, parent: Path) -> Path:
    """Make the folder ``parent / name`` with the template under this name.

    Raises SubmissionError for a wrong or a baseline's name and an existing folder,
    MtpBenchError where writing fails.
    """
    if not is_name(name):
        similar = re.sub(r"[^a-z0-9_-]+", "-", name.lower()).strip("-_")[:MAX_NAME]
        if not is_name(similar):
            similar = f"my-{similar or 'agent'}"
        raise SubmissionError(
            f"{name!r} is not a name for a submission: {NAME_RULE}; "
            f"choose another, such as {similar!r}"
        )
    if name in baseline_names():
        raise SubmissionError(
            f"{name!r} is the name of a baseline, which commands would take instead: "
            "choose another"
        )
    folder = parent / name
    if folder.exists() or folder.is_symlink():
        raise SubmissionError(
            f"{folder} exists already, expected a new folder: "
            "choose another name, or remove it"
        )
    require_folder(folder)
    with whole_folder(folder) as part:
        for file in FILES:
            text = (TEMPLATE / file).read_text(encoding="utf-8")
            (part / file.removesuffix(".txt")).write_text(
                re.sub(r"\bNAME\b", name, text), encoding="utf-8"
            )
    return folder


class _SourceLoader(SourceFileLoader):
    """Loader that compiles the source at every import."""

    def get_code(self, fullname: str) -> CodeType:
        path = self.get_filename(fullname)
        return self.source_to_code(self.get_data(path), path)


class _Finder:
    """Finder of the Python modules of submissions, for ``sys.meta_path``."""

    @staticmethod
    def find_spec(
        name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if not name.startswith(PREFIX) or path is None:
            return None
        if any(part in SKIPPED_FOLDERS for part in name.split(".")):
            raise ModuleNotFoundError(
                f"{name.rsplit('.', maxsplit=1)[-1]} is not part of a submission",
                name=name,
            )
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _SourceLoader(spec.loader.name, spec.loader.path)
            spec.cached = None
        return spec


def _entries(folder: Path, depth: int) -> Iterator[os.DirEntry[str]]:
    """Yield regular files below ``folder``, each checked before it is used."""
    if depth > MOST_DEPTH:
        raise SubmissionError(
            f"{folder}: folders are nested deeper than {MOST_DEPTH} levels, the limit"
        )
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if _is_entered(entry):
                    yield from _entries(Path(entry.path), depth + 1)
                elif entry.name not in SKIPPED_FOLDERS or not entry.is_dir(
                    follow_symlinks=False
                ):
                    yield entry
    except OSError as error:
        raise SubmissionError(
            f"{error.filename or folder}: cannot be read: {error.strerror or error}"
        ) from None


def _is_entered(entry: os.DirEntry[str]) -> bool:
    """Return True for a folder whose files belong to the submission.

    False for a file, or a folder that is left out. Raises SubmissionError for an entry
    that a submission cannot hold, such as a link.
    """
    try:
        entry.name.encode()
    except UnicodeEncodeError:
        # [1:] leaves out the b of bytes
        shown = ascii(entry.path.encode(errors="surrogateescape"))[1:]
        raise SubmissionError(f"{shown}: its name is not UTF-8: rename it") from None
    # "" for a regular file
    kind = file_kind(entry.stat(follow_symlinks=False).st_mode)
    if kind == "link":
        target = "folder" if Path(entry.path).is_dir() else "file"
        raise SubmissionError(
            f"{entry.path} is a link to a {target}; "
            f"a submission holds its files itself: copy the {target}"
        )
    if kind not in ("", "folder"):
        raise SubmissionError(
            f"{entry.path} is a {kind}, expected files and folders only: remove it"
        )
    if kind == "" and entry.name in SKIPPED_FOLDERS:
        raise SubmissionError(
            f"{entry.path} is a file, and only a folder may have this name: remove it, "
            "or copy the submission without it (a git worktree or submodule has such a "
            "file)"
        )
    return kind == "folder" and entry.name not in SKIPPED_FOLDERS
