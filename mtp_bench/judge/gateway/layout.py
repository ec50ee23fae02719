"""The files that an agent's process sees: an allow-list, with the image of its submission.

Read-only: the interpreter and its standard library, the shared libraries of the system, installed packages, the
part of this library that agents use, the image of the submission, and the compiled kernels. Writable: a
temporary folder of bounded size. All other files of the machine do not exist for the process.

The image is a copy of the files that the digest of the submission covers: it cannot be changed after it was hashed.
"""

import importlib
import importlib.util
import os
import shutil
import sys
import sysconfig
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.util import Finalize
from pathlib import Path

from filelock import FileLock

from ...agent import Submission, digest_of, files_of
from ...core import (
    FULL_DISK,
    QUIET,
    VARIABLE as WEIGHTS,
    SubmissionError,
    WriteError,
    cache_root,
    file_digest,
    network_files,
    open_regular,
)
from ...running import PLAYERS, all_kernels
from ...sources import data_root

SUBMISSION, NETWORKS, KERNELS, TEMPORARY = (
    "/submission",
    "/networks",
    "/kernels",
    "/agent-scratch",
)
LIBRARY = (  # rooms of the package that agents use: not judge, sources, cards and training
    "__init__.py",
    "__init__.pyi",
    "core",
    "agent",
    "tracking",
    "prediction",
    "judge/gateway/child.py",
    "judge/gateway/wire.py",
    "judge/gateway/fork_server_main.py",
)
_MASKED = (  # files of /proc on the kernel, keys or the whole machine: empty for agents
    "kallsyms",
    "kcore",
    "keys",
    "key-users",
    "slabinfo",
    "vmallocinfo",
    "timer_list",
    "kpagecount",
    "kpageflags",
    "kpagecgroup",
    "vmstat",
    "sysrq-trigger",
    "pagetypeinfo",
    "kmsg",
)
MASKED = tuple(f"/proc/{name}" for name in _MASKED)
DEVICES = ("/dev/null", "/dev/zero", "/dev/urandom")
_SYSTEM = (
    "/lib",
    "/lib64",
    "/usr/lib",
    "/usr/lib64",
    "/usr/local/lib",
)  # shared libraries
LOADED = ("mtp_bench.agent", *PLAYERS)  # modules that a fork server imports
_THREADS = (
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)
_PASSED = ("LD_LIBRARY_PATH", "NUMBA_DISABLE_JIT", *_THREADS)


@dataclass(frozen=True)
class Image:
    """A submission as it runs."""

    source: Path  # the folder of the submission
    submission: Path  # a copy of it
    networks: Path  # weights of the networks that its manifest names, trained on this machine for this env
    weights: Mapping[str, str]  # name and hex sha256 of each file of `networks`
    digest: str  # hex sha256 over names and contents of both


_known: dict[tuple[object, ...], Image] = {}
_locks: list[FileLock] = []  # of the folders of images, held until this process ends
_IMAGE = "mtp_bench-image-"  # start of the names of these folders
_LOCK_SECONDS = 60.0  # within which a process has surely locked its new folder


def image_of(
    submission: Submission, env_id: str, weights_of: str | None = None
) -> Image:
    """The image of a submission for an env; made once per process, and again if a file has changed.

    ``weights_of``: another env whose weights serve here too. Raises SubmissionError for a folder without a submission.
    """
    files, networks = (
        files_of(submission.path),
        network_files(submission.networks, env_id, weights_of),
    )
    try:
        states = [
            (path, (s := path.lstat()).st_size, s.st_mtime_ns, s.st_ino)
            for path in (*files, *networks)
        ]
        key = (submission.path, *states)
        if key not in _known:
            _known[key] = _copy(submission.path, files, networks)
    except OSError as error:
        if error.errno in FULL_DISK:
            raise WriteError(
                error.errno,
                error.strerror,
                f"temporary files in {tempfile.gettempdir()}",
            ) from None
        path = error.filename or submission.path
        raise SubmissionError(
            f"{path}: cannot be read: {error.strerror or error}"
        ) from None
    return _known[key]


def _copy(source: Path, files: Sequence[Path], networks: Sequence[Path]) -> Image:
    root = _new_folder()
    folder, beside = root / "submission", root / "networks"
    places = {path: folder / path.relative_to(source) for path in files} | {
        p: beside / p.name for p in networks
    }
    for path in (folder, beside, *(place.parent for place in places.values())):
        path.mkdir(parents=True, exist_ok=True)
    for path, place in places.items():
        with open_regular(path, links=False) as original, place.open("wb") as copy:
            shutil.copyfileobj(original, copy)
    weights = {place.name: file_digest(place) for place in sorted(beside.iterdir())}
    return Image(
        source, folder, beside, weights, digest_of(folder, files_of(folder), weights)
    )


def _new_folder() -> Path:
    """A new folder for an image, locked and removed at the end of this process; removes those of killed processes.

    A lock shows that a process lives, also one whose pid is of another namespace.
    """
    root = Path(tempfile.mkdtemp(prefix=_IMAGE))
    Finalize(
        None, shutil.rmtree, (root, True), exitpriority=0
    )  # also at the end of a worker
    _locks.append(FileLock(root / "lock", timeout=0, thread_local=False))
    with suppress(OSError, NotImplementedError):  # not every file system has locks
        _locks[-1].acquire()
    own = root.stat()
    for folder in root.parent.glob(f"{_IMAGE}*"):
        with suppress(OSError, NotImplementedError):  # of another user, or locked
            state = folder.lstat()
            old = (
                state.st_uid == own.st_uid
                and state.st_mtime < own.st_mtime - _LOCK_SECONDS
            )
            if old and (folder / "lock").exists():
                with FileLock(folder / "lock", timeout=0):
                    shutil.rmtree(folder)
    return root


@dataclass(frozen=True)
class Layout:
    """Files of one agent's process."""

    shown: tuple[
        tuple[str, str], ...
    ]  # path here, path inside: read-only; a later one covers an earlier one
    links: tuple[
        tuple[str, str], ...
    ] = ()  # target of a symbolic link, its path inside
    covered: tuple[str, ...] = ()  # folders of `shown` of which only parts are shown
    masked: tuple[str, ...] = tuple(path for path in MASKED if Path(path).exists())


def layout_for(image: Image, data: str | None, own: Sequence[Path] = ()) -> Layout:
    """Files that the agent of ``image`` sees.

    ``own``: the user's files and folders of scenes, detections or tracks. Raises SubmissionError if they, the data or
    the cache of scenes are inside a folder that is shown.
    """
    links, shown = _interpreter_files()
    _add(shown, packages())
    package = library() / "mtp_bench"
    covered = [str(package)] if _inside(package, shown) else []
    parts = [package / part for part in LIBRARY]
    parts += [
        Path(importlib.util.cache_from_source(path))
        for path in parts
        if path.suffix == ".py"
    ]  # compiled once
    shown += [(str(path), str(path)) for path in parts if path.exists()]
    shown += [
        (str(folder), f"{KERNELS}/{folder.name}") for folder in compiled_kernels()
    ]
    shown += [(str(image.submission), SUBMISSION), (str(image.networks), NETWORKS)]
    _require_hidden([*(here for here, _ in shown), str(image.source)], data, own)
    return Layout(tuple(shown), _with_tmp(links, shown), tuple(covered))


def _with_tmp(
    links: Sequence[tuple[str, str]], shown: Sequence[tuple[str, str]]
) -> tuple[tuple[str, str], ...]:
    """``links``, and /tmp as another name of the temporary folder unless something is shown below /tmp."""
    below = any(there.startswith("/tmp/") for _, there in shown)
    return tuple(links) if below else (*links, (TEMPORARY.removeprefix("/"), "/tmp"))


def bare_layout() -> Layout:
    """The layout with the fewest files that the interpreter can start with, to try the sandbox."""
    links, shown = _interpreter_files()
    return Layout(tuple(shown), _with_tmp(links, shown))


def environment(
    isolated: bool, work: str = TEMPORARY, networks: str = NETWORKS
) -> dict[str, str]:
    """Environment variables of an agent's process: of the judge's own, only those that libraries need.

    ``isolated``: it is sandboxed; else ``work`` is its temporary folder and ``networks`` the folder of its weights.
    """
    cache = importlib.import_module("mtp_bench.tracking.kernels.cache")
    kernels = f"{work}/kernels" if isolated else str(cache.cache_folder())
    own = {
        "HOME": work,
        "TMPDIR": work,
        "LANG": "C.UTF-8",
        "USER": "agent",
        WEIGHTS: networks,
        QUIET: "1",
    }
    own |= {
        "NUMBA_CACHE_DIR": kernels,
        "PYTHONHASHSEED": "0",
    }  # else the order of a set differs between judges
    return {name: os.environ[name] for name in _PASSED if name in os.environ} | own


def interpreter() -> Path:
    """The interpreter, resolved from the link in a virtual environment."""
    return Path(getattr(sys, "_base_executable", None) or sys.executable).resolve()


def python() -> list[str]:
    """Command of an agent's interpreter, without modules of the user, the working folder or the site.

    Not ``-I``, which would ignore PYTHONHASHSEED in `environment`.
    """
    return [os.fspath(interpreter()), "-s", "-P", "-S", "-B"]


def library() -> Path:
    """The folder that contains ``mtp_bench``: site-packages or a checkout."""
    spec = importlib.util.find_spec(__name__.partition(".")[0])
    return Path(str(spec and spec.origin)).resolve().parent.parent


def child_script() -> str:
    """Return the path of the script that an agent's process runs, `child`."""
    return str(library() / "mtp_bench" / "judge" / "gateway" / "child.py")


def packages() -> tuple[str, ...]:
    """Folders of installed packages, in search order."""
    return tuple(
        entry
        for entry in sys.path
        if entry.endswith(("site-packages", "dist-packages"))
    )


def compiled_kernels() -> list[Path]:
    """Existing folders of the compiled kernels of this version."""
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return []
    return [kernel.folder for kernel in all_kernels() if kernel.folder.is_dir()]


def _interpreter_files() -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """Links, and what is shown, for the interpreter: shared libraries of the system, itself, its standard library."""
    links, shown = list[tuple[str, str]](), list[tuple[str, str]]()
    for path in map(Path, _SYSTEM):
        if path.is_symlink():
            links.append((str(path.readlink()), str(path)))
        elif path.is_dir():
            _add(shown, [str(path)])
    paths = sysconfig.get_paths()
    beside = [
        str(Path(prefix) / "lib") for prefix in (sys.base_prefix, sys.base_exec_prefix)
    ]  # with libpython
    own = dict.fromkeys([*beside, paths["stdlib"], paths["platstdlib"]])
    _add(shown, ["/etc/ld.so.cache", os.fspath(interpreter()), *own])
    return links, shown


def _add(shown: list[tuple[str, str]], paths: Iterable[str]) -> None:
    """Add existing paths that are not inside a folder that is shown already."""
    shown += [
        (path, path)
        for path in paths
        if Path(path).exists() and not _inside(Path(path), shown)
    ]


def _inside(path: Path, shown: Sequence[tuple[str, str]]) -> bool:
    return any(path.is_relative_to(there) for _, there in shown)


def _require_hidden(
    shown: Sequence[str], data: str | None, own: Sequence[Path]
) -> None:
    """Raise SubmissionError for a data root, a cache of scenes or own files inside a folder that is shown."""
    roots = {data_root(data)[0], data_root(None)[0]}
    below = {
        path for root in roots if root.is_dir() for path in root.iterdir()
    }  # a root may be of links
    seen = [(here, Path(here).resolve()) for here in shown]
    for secret in {path.resolve() for path in (*roots, *below, *own, cache_root())}:
        above = {secret, *secret.parents}
        for here, place in seen:
            if place in above and secret.exists():
                raise SubmissionError(
                    f"{secret} holds data inside {here}, which agents see: move the data elsewhere"
                )
