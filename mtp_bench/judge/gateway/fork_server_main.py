"""Fork server of one submission: it loads the library once and forks per scene.

Started as ``python child.py fork-server SETUP SOCKET`` inside a sandbox of bubblewrap,
with capabilities over that sandbox alone and a socket to the judge. It imports the
library, nothing of the submission. Each fork gets namespaces, a temporary folder and a
/proc of its own, drops all capabilities, installs the system call filter, and only then
reads which agent it runs. So all agents start from the same state, and what one leaves
behind ends with its namespaces.
"""

import base64
import ctypes
import gc
import importlib
import itertools
import json
import os
import resource
import socket
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

READY = b"ready"
FORKED = b"forked"
_MAX_REQUEST_BYTES = 1 << 20
_MAX_DESCRIPTORS = 8  # of a request: five pipes and the control groups
_MAX_OPEN_FILES = 1024  # of a process
# pid, net, ipc, uts, mnt of <sched.h>
_NEW_NAMESPACES = 0x20000000 | 0x40000000 | 0x8000000 | 0x4000000 | 0x20000
_NEW_CGROUP_NAMESPACE = 0x2000000
# <sys/mount.h>; MOUNT_ATTR_RDONLY, _NOSUID and _NODEV have the same values
_READ_ONLY = 1
_NOSUID = 2
_NODEV = 4
_NOEXEC = 8
_BIND = 0x1000
_RECURSIVE = 0x4000
_PRIVATE = 0x40000
_MOUNT_SETATTR = 442  # number of the call
_AT_FDCWD = -100
# options of prctl
_SECCOMP = 22
_CAPBSET_DROP = 24
_NO_NEW_PRIVS = 38
_FILTER_MODE = 2
_libc = ctypes.CDLL(None, use_errno=True)


class _MountAttributes(ctypes.Structure):
    _fields_ = tuple(
        (name, ctypes.c_uint64)
        for name in ("attr_set", "attr_clr", "propagation", "userns_fd")
    )


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("steps", ctypes.c_char_p))


def main(child: Any, setup: dict[str, Any], descriptor: int) -> None:
    """Load the library, then fork for every request of the judge.

    ``child``: the module `child`, which is the script that runs. ``descriptor``: number
    of the socket's file descriptor.
    """
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (_MAX_OPEN_FILES, _MAX_OPEN_FILES))
    except ValueError:
        _, allowed = resource.getrlimit(resource.RLIMIT_NOFILE)
        raise SystemExit(
            f"{allowed} open files are allowed, expected {_MAX_OPEN_FILES}: raise the "
            f"limit with `ulimit -Hn {_MAX_OPEN_FILES}`"
        ) from None
    # a number below the limit, so that forks close it
    judge = socket.socket(fileno=os.dup(descriptor))
    os.close(descriptor)
    gc.disable()
    child.prepare(setup)
    for name in setup["modules"]:
        module = importlib.import_module(name)
        for member in getattr(module, "__all__", ()):  # a facade imports when used
            getattr(module, member)
    compiler = sys.modules.get("mtp_bench.tracking.kernels.compile")
    for kernel in compiler.KERNELS if compiler else ():
        kernel.compile()
    _require_no_shared_memory()
    gc.freeze()  # forks share these objects: collecting would copy their pages
    gc.enable()
    judge.send(READY)
    while True:
        text, descriptors, *_ = socket.recv_fds(
            judge, _MAX_REQUEST_BYTES, _MAX_DESCRIPTORS
        )
        if not text:
            return
        if os.fork() == 0:
            _exit_after_fork(child, json.loads(text), descriptors, judge)
        for number in descriptors:
            os.close(number)
        with suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass


def _exit_after_fork(
    child: Any, request: dict[str, Any], descriptors: list[int], judge: socket.socket
) -> None:
    """Run the fork and exit, also after an error."""
    code = 1
    try:
        _run_fork(child, request, descriptors, judge)
        code = 0
    except BaseException as error:
        with suppress(OSError):
            os.write(2, f"{type(error).__name__}: {error}\n".encode())
    finally:
        os._exit(code)


def _run_fork(
    child: Any, request: dict[str, Any], descriptors: list[int], judge: socket.socket
) -> None:
    """Fork again into new namespaces.

    The inner process runs the agent, the outer one reports its exit code.
    """
    stdin, orders, answers, log, exit_report, *groups = descriptors
    child.end_with(None)
    _call("unshare", _NEW_NAMESPACES)
    agent = os.fork()
    if agent:  # this is the outer process
        _close_all_but(exit_report)
        _, status = os.waitpid(agent, 0)
        report = {"ended": os.waitstatus_to_exitcode(status)}
        os.write(exit_report, json.dumps(report).encode())
        return
    for descriptor, number in ((stdin, 0), (log, 1), (log, 2)):
        os.dup2(descriptor, number)
    for group in groups:
        os.write(group, b"0")  # this process
    # after it joined: the names of the groups contain the judge's pid
    _call("unshare", _NEW_CGROUP_NAMESPACE)
    _enter_sandbox(child, request)
    judge.send(FORKED)  # the kernel adds the pid of this process, as the judge sees it
    _close_all_but(0, 1, 2, orders, answers)
    import numpy as np

    # anew, else forks draw the same numbers; the standard library does it itself
    np.random.seed()  # noqa: NPY002
    sys.argv[1:] = [str(orders), str(answers)]
    child.main(orders, answers)


def _enter_sandbox(child: Any, request: dict[str, Any]) -> None:
    """Seal the fork: own mounts, no capabilities, the filter."""
    child.end_with(None)
    os.setsid()
    child.join_new_keyring()
    _mount("none", "/", "", _RECURSIVE | _PRIVATE)
    _mount(
        "tmpfs",
        request["temporary"],
        "tmpfs",
        _NOSUID | _NODEV,
        f"size={request['space']}",
    )
    _mount("proc", "/proc", "proc", _NOSUID | _NODEV | _NOEXEC)
    for path in request["masked"]:
        _mount("/dev/null", path, "", _BIND | _RECURSIVE)
        _restrict_mount(path, _NOSUID | _READ_ONLY)
    _restrict_mount("/proc", _READ_ONLY)
    _drop_capabilities()
    program = base64.b64decode(request["filter"])  # 8 bytes per step
    _call(
        "prctl",
        _SECCOMP,
        _FILTER_MODE,
        ctypes.byref(_Program(len(program) // 8, program)),
        0,
        0,
    )
    os.chdir(request["temporary"])


def _mount(source: str, target: str, kind: str, flags: int, options: str = "") -> None:
    _call(
        "mount",
        os.fsencode(source),
        os.fsencode(target),
        kind.encode(),
        flags,
        options.encode(),
    )


def _restrict_mount(path: str, flags: int) -> None:
    attributes = _MountAttributes(attr_set=flags)
    _call(
        "syscall",
        _MOUNT_SETATTR,
        _AT_FDCWD,
        path.encode(),
        0,
        ctypes.byref(attributes),
        ctypes.sizeof(attributes),
    )


def _drop_capabilities() -> None:
    for capability in range(64):  # there are fewer
        _libc.prctl(_CAPBSET_DROP, capability, 0, 0, 0)
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)  # version 3, this process
    no_capabilities = (ctypes.c_uint32 * 6)()
    _call("capset", ctypes.byref(header), ctypes.byref(no_capabilities))
    _call("prctl", _NO_NEW_PRIVS, 1, 0, 0, 0)


def _call(name: str, *arguments: Any) -> None:
    """Call a function of the C library.

    Raises OSError where it fails.
    """
    converted: list[Any] = []
    for value in arguments:
        is_number = isinstance(value, int)
        converted.append(ctypes.c_ulong(value) if is_number else value)
    if getattr(_libc, name)(*converted) != 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{name}: {os.strerror(number)}", str(arguments[:3]))


def _require_no_shared_memory() -> None:
    """Refuse writable memory that forks would share.

    One agent could leave data there for the next.
    """
    for line in Path("/proc/self/maps").read_text().splitlines():
        permissions = line.split()[1]
        if permissions[1] == "w" and permissions[3] == "s":
            raise SystemExit(f"shared memory: {line}")


def _close_all_but(*descriptors: int) -> None:
    """Close all other descriptors, without /proc/self/fd, which a new /proc replaces."""
    bounds = [-1, *sorted(descriptors), _MAX_OPEN_FILES]
    for low, high in itertools.pairwise(bounds):
        if low + 1 < high:  # an empty range would close all of them
            os.closerange(low + 1, high)
