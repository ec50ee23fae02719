"""Cache of compiled kernels: one folder per kernel, with a SHA-256 sum beside each file.

The folder's name holds a digest of what the compiled code depends on: Numba itself looks at the kernel's own file
alone, not at the files of the functions that it calls. Numba does not notice a flipped bit in a file either and then
crashes, so that sums are compared before it loads anything.
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

_SUM = ".sha256"


def cache_folder() -> Path:
    """Folder of all compiled kernels: the one in NUMBA_CACHE_DIR, else the user's cache folder."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    if given:
        return Path(given).absolute()  # an agent's process works in another folder
    from platformdirs import user_cache_path

    return user_cache_path("mtp_bench", appauthor=False)


def folder_of(function: FunctionType, signature: str) -> Path:
    """Folder of a kernel, named by a digest of its path, sources and constants, Python, Numba and the processor.

    The path is part of it since Numba keeps the code of each path apart: two installations do not share a folder.
    """
    versions = (
        sys.version,
        numba.__version__,
        llvmlite.__version__,
        llvmlite.binding.get_host_cpu_name(),
    )
    options = _sum_of(Path(__file__).with_name("compile.py"))
    digest = hashlib.sha256(
        repr(
            (
                *versions,
                function.__code__.co_filename,
                options,
                signature,
                sorted(_sources(function)),
            )
        ).encode()
    )
    return cache_folder() / f"kernels-{function.__name__}-{digest.hexdigest()[:16]}"


def _sources(function: FunctionType) -> set[str]:
    """Digests of the files, and values of the constants, that a function depends on; TypeError for other globals."""
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
            got = f"kernel {function.__qualname__} uses {name}, of type {type(value).__name__}"
            raise TypeError(
                f"{got}; expected a number, text, tuple, module or function, which the digest can hold"
            )
    return sources


def is_sound(folder: Path, source: str) -> bool:
    """True if the folder holds both compiled files, which agree with their sums and are newer than the source file."""
    files = _files(folder)
    newest = Path(source).stat().st_mtime
    return len(files) == 2 and all(
        _agrees(file) and file.stat().st_mtime >= newest for file in files
    )


def seal(folder: Path) -> None:
    """Write the sum of each file beside it."""
    for file in _files(folder):
        partial = file.with_name(f"{file.name}{_SUM}.tmp")
        partial.write_text(_sum_of(file), encoding="ascii")
        partial.replace(f"{file}{_SUM}")


def clear(folder: Path) -> bool:
    """Delete the compiled files, also folders in their place; True if one of them did not agree with its sum."""
    files = _files(folder)
    damaged = any(
        Path(f"{file}{_SUM}").exists() and not _agrees(file) for file in files
    )
    for below in folder.iterdir():
        if below.is_dir():
            shutil.rmtree(below)
    return damaged


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Let one process at a time write to the folder."""
    from filelock import FileLock

    folder.mkdir(parents=True, exist_ok=True)
    with FileLock(folder / "lock"):
        yield


def _files(folder: Path) -> list[Path]:
    """Files of Numba: an index (.nbi) and the code (.nbc)."""
    return sorted(folder.glob("*/*.nb[ci]"))


def _agrees(file: Path) -> bool:
    try:
        return Path(f"{file}{_SUM}").read_text(encoding="ascii") == _sum_of(file)
    except (OSError, UnicodeDecodeError):
        return False


def _sum_of(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()
