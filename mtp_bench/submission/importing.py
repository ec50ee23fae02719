"""Import the code of a submission as a package of its own, from its sources alone.

The package is named after path and source code: two submissions may have the same file names, code that was edited is
imported anew, and modules of one folder import each other relatively (``from .model import Net``).

Compiled code in ``__pycache__`` would run in place of the sources, and no digest covers it: it is neither read nor
written.
"""

from __future__ import annotations

import hashlib
import importlib
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType

from ..errors import SubmissionError
from .contents import FOLDERS, digest_of, files_of

PREFIX = "mtp_submission_"


class _Source(SourceFileLoader):
    """Compiles the source at every import."""

    def get_code(self, fullname: str) -> CodeType:
        path = self.get_filename(fullname)
        return self.source_to_code(self.get_data(path), path)


class _Finder:
    """Finds the modules of all submissions, and leaves the others to those that follow."""

    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> ModuleSpec | None:
        if not name.startswith(PREFIX) or path is None:
            return None
        if any(part in FOLDERS for part in name.split(".")):
            raise ModuleNotFoundError(f"{name.rsplit('.', maxsplit=1)[-1]} is no part of a submission", name=name)
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Source(spec.loader.name, spec.loader.path)
            spec.cached = None
        return spec


def import_from(folder: Path, module: str, name: str) -> ModuleType:
    """Module ``module`` of the submission ``name`` in ``folder``; raises SubmissionError where that fails."""
    if _Finder not in sys.meta_path:
        sys.meta_path.insert(0, _Finder)
    package = _package(folder)
    importlib.invalidate_caches()
    try:
        return importlib.import_module(f"{package}.{module}")
    except (Exception, SystemExit) as error:
        hint = ""
        if isinstance(error, ModuleNotFoundError) and (folder / f"{error.name}.py").is_file():
            hint = f"; {error.name}.py is a file of the submission: write `from .{error.name} import ...`"
        raise SubmissionError(f"{name}: importing {module}.py failed: {type(error).__name__}: {error}{hint}") from error


def _package(folder: Path) -> str:
    """Name of the package of a folder with its code of today."""
    sources = [path for path in files_of(folder) if path.suffix == ".py"]
    package = PREFIX + hashlib.sha256(f"{folder} {digest_of(folder, sources)}".encode()).hexdigest()[:16]
    if package not in sys.modules:
        sys.modules[package] = ModuleType(package)
        sys.modules[package].__path__ = [str(folder)]
    return package
