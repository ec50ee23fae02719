"""Cache of compiled kernels: one folder per kernel, a SHA-256 sum beside each file.

The folder's name holds a digest of what the compiled code depends on: Numba itself
looks at the kernel's own file alone, not at the files of the functions that it calls.
Numba does not notice a flipped bit in a file either and then crashes, so that sums are
compared before it loads anything.
"""

import hashlib
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, ModuleType

import llvmlite.binding
import numba

from ...core import cache_root

_SUM = ".sha256"


def cache_folder() -> Path:
    """Return the folder of all compiled kernels.

    NUMBA_CACHE_DIR names it; otherwise it is the folder of other files made once.
    """
    chosen_folder = os.environ.get("NUMBA_CACHE_DIR")
    if chosen_folder:
        # an agent's process works in another folder
        return Path(chosen_folder).absolute()
    return cache_root()


def folder_of(function: FunctionType, signature: str) -> Path:
    """Return the folder of a kernel, named by a digest.

    It is that of path, sources and constants, Python, Numba and the processor. The path
    is part of it since Numba keeps the code of each path apart: two installations do
    not share a folder.
    """
    dependencies = (
        sys.version,
        numba.__version__,
        llvmlite.__version__,
        llvmlite.binding.get_host_cpu_name(),
        function.__code__.co_filename,
        _sum_of(Path(__file__).with_name("compile.py")),  # options
        signature,
        sorted(_sources(function)),
    )
    digest = hashlib.sha256(repr(dependencies).encode()).hexdigest()
    return cache_folder() / f"kernels-{function.__name__}-{digest[:16]}"


def _sources(function: FunctionType) -> set[str]:
    """Return digests of files, and constants, that a function uses.

    Raises TypeError for other globals.
    """
    sources = {_sum_of(Path(function.__code__.co_filename))}
    for name in function.__code__.co_names:
        value = function.__globals__.get(name)
        value = getattr(value, "py_func", value)
        if isinstance(value, bool | int | float | str | tuple):
            sources.add(f"{name} = {value!r}")
        elif isinstance(value, FunctionType):
            sources |= _sources(value)
        elif isinstance(value, type) and issubclass(value, tuple):
            sources.add(_sum_of(Path(sys.modules[value.__module__].__file__ or "")))
        elif not isinstance(value, ModuleType | BuiltinFunctionType | type | None):
            raise TypeError(
                f"kernel {function.__qualname__} uses {name}, of type "
                f"{type(value).__name__}; expected a number, text, tuple, module or "
                "function, which the digest can hold"
            )
    return sources


def is_sound(folder: Path, source: str) -> bool:
    """Check that a folder holds both compiled files, sound and new.

    They agree with their sums and are not older than the source file.
    """
    files = _files(folder)
    source_time = Path(source).stat().st_mtime
    return len(files) == 2 and all(
        _agrees(file) and file.stat().st_mtime >= source_time for file in files
    )


def seal(folder: Path) -> None:
    """Write the sum of each file beside it."""
    for file in _files(folder):
        temporary = file.with_name(f"{file.name}{_SUM}.tmp")
        temporary.write_text(_sum_of(file), encoding="ascii")
        temporary.replace(f"{file}{_SUM}")


def clear(folder: Path) -> bool:
    """Delete the compiled files and return whether one was damaged.

    It did not agree with its sum. Folders in their place go too.
    """
    files = _files(folder)
    damaged = any(
        Path(f"{file}{_SUM}").exists() and not _agrees(file) for file in files
    )
    for subfolder in folder.iterdir():
        if subfolder.is_dir():
            shutil.rmtree(subfolder)
    return damaged


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Let one process at a time write to the folder."""
    from filelock import FileLock

    folder.mkdir(parents=True, exist_ok=True)
    with FileLock(folder / "lock"):
        yield


def _files(folder: Path) -> list[Path]:
    """List Numba's files: an index (.nbi) and the code (.nbc)."""
    return sorted(folder.glob("*/*.nb[ci]"))


def _agrees(file: Path) -> bool:
    try:
        return Path(f"{file}{_SUM}").read_text(encoding="ascii") == _sum_of(file)
    except (OSError, UnicodeDecodeError):
        return False


def _sum_of(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()
