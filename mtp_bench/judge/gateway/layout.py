"""Files that an agent's process sees: an allow-list, with its submission's image.

Read-only: the interpreter and its standard library, the shared libraries of the system,
installed packages, the part of this library that agents use, the image of the
submission, and the compiled kernels. Writable: a temporary folder of bounded size. All
other files of the machine do not exist for the process.

The image is a copy of the files that the digest of the submission covers: it cannot be
changed after it was hashed.
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
    QUIET_VARIABLE,
    WEIGHTS_VARIABLE,
    SubmissionError,
    WriteError,
    cache_root,
    file_digest,
    network_files,
    open_regular,
)
from ...running import PLAYER_ROOMS, all_kernels
from ...sources import data_root

SUBMISSION = "/submission"
NETWORKS = "/networks"
KERNELS = "/kernels"
TEMPORARY = "/agent-scratch"
# parts of the package that agents use: not judge, sources, cards and training
LIBRARY = (
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
# files of /proc on the kernel, keys or the whole machine: empty for agents
_MASKED = (
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
# folders of shared libraries
_SYSTEM = ("/lib", "/lib64", "/usr/lib", "/usr/lib64", "/usr/local/lib")
LOADED = ("mtp_bench.agent", *PLAYER_ROOMS)  # modules that a fork server imports
_THREADS = (
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)
# variables of the judge that an agent keeps
_PASSED = ("LD_LIBRARY_PATH", "NUMBA_DISABLE_JIT", *_THREADS)


@dataclass(frozen=True)
class Image:
    """A submission as it runs."""

    source: Path  # the folder of the submission
    submission: Path  # a copy of it
    # weights of the networks that its manifest names, trained here for this env
    networks: Path
    weights: Mapping[str, str]  # name and hex sha256 of each file of `networks`
    digest: str  # hex sha256 over names and contents of both


_images: dict[tuple[object, ...], Image] = {}
_locks: list[FileLock] = []  # of the folders of images, held until this process ends
_IMAGE = "mtp_bench-image-"  # start of the names of these folders
_LOCK_SECONDS = 60.0  # within which a process has surely locked its new folder


def image_of(
    submission: Submission, env_id: str, weights_of: str | None = None
) -> Image:
    """Return the copy of files and weights that the agent sees in an env.

    The judge makes it once, and again if a file has changed. ``weights_of``:
    another env whose weights the agent may use, too. Raises SubmissionError for a
    folder without a submission.
    """
    files = files_of(submission.path)
    networks = network_files(submission.networks, env_id, weights_of)
    try:
        key = (submission.path, *map(_file_state, [*files, *networks]))
        if key not in _images:
            _images[key] = _copy(submission.path, files, networks)
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
    return _images[key]


def _file_state(path: Path) -> tuple[Path, int, int, int]:
    state = path.lstat()
    return path, state.st_size, state.st_mtime_ns, state.st_ino


def _copy(source: Path, files: Sequence[Path], networks: Sequence[Path]) -> Image:
    root = _new_folder()
    folder = root / "submission"
    weights_folder = root / "networks"
    copies = {path: folder / path.relative_to(source) for path in files}
    copies |= {path: weights_folder / path.name for path in networks}
    folder.mkdir()
    weights_folder.mkdir()
    for path, copy in copies.items():
        copy.parent.mkdir(parents=True, exist_ok=True)
        with open_regular(path, links=False) as original, copy.open("wb") as stream:
            shutil.copyfileobj(original, stream)
    weights = {
        path.name: file_digest(path) for path in sorted(weights_folder.iterdir())
    }
    digest = digest_of(folder, files_of(folder), weights)
    return Image(source, folder, weights_folder, weights, digest)


def _new_folder() -> Path:
    """Make a locked folder for an image.

    Also remove the folders of killed processes. A lock shows that a process lives, also
    one whose pid is of another namespace.
    """
    root = Path(tempfile.mkdtemp(prefix=_IMAGE))
    # removed at the end of this process, also of a worker, in spite of errors
    Finalize(None, shutil.rmtree, (root, True), exitpriority=0)
    _locks.append(FileLock(root / "lock", timeout=0, thread_local=False))
    with suppress(OSError, NotImplementedError):  # not every file system has locks
        _locks[-1].acquire()
    new_state = root.stat()
    for folder in root.parent.glob(f"{_IMAGE}*"):
        with suppress(OSError, NotImplementedError):  # of another user, or locked
            state = folder.lstat()
            same_user = state.st_uid == new_state.st_uid
            is_older = state.st_mtime < new_state.st_mtime - _LOCK_SECONDS
            if same_user and is_older and (folder / "lock").exists():
                with FileLock(folder / "lock", timeout=0):
                    shutil.rmtree(folder)
    return root


@dataclass(frozen=True)
class Layout:
    """Files of one agent's process."""

    # path here, path inside: read-only; a later one covers an earlier one
    shown: tuple[tuple[str, str], ...]
    # target of a symbolic link, its path inside
    links: tuple[tuple[str, str], ...] = ()
    covered: tuple[str, ...] = ()  # folders of `shown` of which only parts are shown
    masked: tuple[str, ...] = tuple(path for path in MASKED if Path(path).exists())


def layout_for(image: Image, data: str | None, own: Sequence[Path] = ()) -> Layout:
    """List the files that the agent of ``image`` sees.

    ``own``: the user's files and folders of scenes, detections or tracks. Raises
    SubmissionError if they, the data or the cache of scenes are inside a folder that is
    shown.
    """
    links, shown = _interpreter_files()
    _add(shown, packages())
    package = library() / "mtp_bench"
    covered = [str(package)] if _inside(package, shown) else []
    parts = [package / part for part in LIBRARY]
    scripts = [path for path in parts if path.suffix == ".py"]
    # their compiled forms, so that no agent compiles them again
    parts += [Path(importlib.util.cache_from_source(path)) for path in scripts]
    shown += [(str(path), str(path)) for path in parts if path.exists()]
    shown += [
        (str(folder), f"{KERNELS}/{folder.name}") for folder in compiled_kernels()
    ]
    shown += [(str(image.submission), SUBMISSION), (str(image.networks), NETWORKS)]
    _require_hidden([*(path for path, _ in shown), str(image.source)], data, own)
    return Layout(tuple(shown), _with_tmp(links, shown), tuple(covered))


def _with_tmp(
    links: Sequence[tuple[str, str]], shown: Sequence[tuple[str, str]]
) -> tuple[tuple[str, str], ...]:
    """Add /tmp as another name of the temporary folder to ``links``.

    Unless something is shown below /tmp.
    """
    if any(inside.startswith("/tmp/") for _, inside in shown):
        return tuple(links)
    return (*links, (TEMPORARY.removeprefix("/"), "/tmp"))


def bare_layout() -> Layout:
    """Return the layout with the fewest files that the interpreter starts with.

    It is for trying the sandbox.
    """
    links, shown = _interpreter_files()
    return Layout(tuple(shown), _with_tmp(links, shown))


def environment(
    isolated: bool, work: str = TEMPORARY, networks: str = NETWORKS
) -> dict[str, str]:
    """Return the environment variables of an agent's process.

    It takes over only those variables of the judge that libraries need.

    ``isolated``: it is sandboxed; else ``work`` is its temporary folder and
    ``networks`` the folder of its weights.
    """
    cache = importlib.import_module("mtp_bench.tracking.kernels.cache")
    kernels = f"{work}/kernels" if isolated else str(cache.cache_folder())
    variables = {name: os.environ[name] for name in _PASSED if name in os.environ}
    return variables | {
        "HOME": work,
        "TMPDIR": work,
        "LANG": "C.UTF-8",
        "USER": "agent",
        WEIGHTS_VARIABLE: networks,
        QUIET_VARIABLE: "1",
        "NUMBA_CACHE_DIR": kernels,
        # else the order of a set differs between judges
        "PYTHONHASHSEED": "0",
    }


def interpreter() -> Path:
    """Return the interpreter, resolved from the link in a virtual environment."""
    return Path(getattr(sys, "_base_executable", None) or sys.executable).resolve()


def python() -> list[str]:
    """Return the command of an agent's interpreter.

    It has no modules of the user, the working folder or the site. Not ``-I``, which
    would ignore PYTHONHASHSEED in `environment`.
    """
    return [os.fspath(interpreter()), "-s", "-P", "-S", "-B"]


def library() -> Path:
    """Return the folder that contains ``mtp_bench``: site-packages or a checkout."""
    package = importlib.util.find_spec(__name__.partition(".")[0])
    assert package is not None  # it is running
    return Path(str(package.origin)).resolve().parent.parent


def child_script() -> str:
    """Return the path of the script that an agent's process runs, `child`."""
    return str(library() / "mtp_bench" / "judge" / "gateway" / "child.py")


def packages() -> tuple[str, ...]:
    """Return the folders of installed packages, in search order."""
    names = ("site-packages", "dist-packages")
    return tuple(entry for entry in sys.path if entry.endswith(names))


def compiled_kernels() -> list[Path]:
    """Return the existing folders of the compiled kernels of this version."""
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return []
    return [kernel.folder for kernel in all_kernels() if kernel.folder.is_dir()]


def _interpreter_files() -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """Return the links, and what is shown, for the interpreter.

    These are shared libraries of the system, itself and its standard library.
    """
    links: list[tuple[str, str]] = []
    shown: list[tuple[str, str]] = []
    for path in map(Path, _SYSTEM):
        if path.is_symlink():
            links.append((str(path.readlink()), str(path)))
        elif path.is_dir():
            _add(shown, [str(path)])
    paths = sysconfig.get_paths()
    files = ["/etc/ld.so.cache", os.fspath(interpreter())]
    # with libpython
    files += [f"{prefix}/lib" for prefix in (sys.base_prefix, sys.base_exec_prefix)]
    _add(shown, dict.fromkeys([*files, paths["stdlib"], paths["platstdlib"]]))
    return links, shown


def _add(shown: list[tuple[str, str]], paths: Iterable[str]) -> None:
    """Add existing paths to ``shown``, but for those inside others."""
    shown += [
        (path, path)
        for path in paths
        if Path(path).exists() and not _inside(Path(path), shown)
    ]


def _inside(path: Path, shown: Sequence[tuple[str, str]]) -> bool:
    return any(path.is_relative_to(inside) for _, inside in shown)


def _require_hidden(
    shown: Sequence[str], data: str | None, own: Sequence[Path]
) -> None:
    """Raise SubmissionError for data inside a folder that is shown.

    Data are a data root, a cache of scenes and own files.
    """
    roots = {data_root(data)[0], data_root(None)[0]}
    secrets = {*roots, *own, cache_root()}
    for root in roots:
        if root.is_dir():  # its entries may be links to other disks
            secrets |= {*root.iterdir()}
    shown_at = {Path(path).resolve(): path for path in shown}
    for secret in {path.resolve() for path in secrets}:
        for folder in (secret, *secret.parents):
            if folder in shown_at and secret.exists():
                raise SubmissionError(
                    f"{secret} holds data inside {shown_at[folder]}, which agents see: "
                    "move the data elsewhere"
                )
