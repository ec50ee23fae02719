"""Takes from the process that calls it what an agent must not have; with the standard library alone.

It runs before numpy is imported: a user namespace can be made only while there is one thread. Every step is tried on
its own, because systems differ in what they allow; what worked is returned, for the record.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

# <sched.h>, <sys/mount.h>, <sys/prctl.h>
_USER, _NET, _MOUNTS, _PIDS, _IPC = 0x10000000, 0x40000000, 0x20000, 0x20000000, 0x8000000
_NAMESPACES = (_USER | _NET | _MOUNTS | _PIDS | _IPC, _USER | _NET | _PIDS | _IPC, _USER | _NET, _NET, _USER)
_NOSUID, _NODEV, _RECURSIVE, _PRIVATE = 2, 4, 0x4000, 0x40000
_MOUNT_SETATTR, _AT_FDCWD, _AT_RECURSIVE, _READ_ONLY = 442, -100, 0x8000, 1  # the same number on every processor
_PDEATHSIG, _DUMPABLE, _CAPBSET_DROP, _SUBREAPER, _NO_NEW_PRIVS = 1, 4, 24, 36, 38
_PROCESSES = 1024  # processes and threads


class _MountAttributes(ctypes.Structure):
    _fields_ = (
        ("attr_set", ctypes.c_uint64),
        ("attr_clr", ctypes.c_uint64),
        ("propagation", ctypes.c_uint64),
        ("userns_fd", ctypes.c_uint64),
    )


def hide_memory(hidden: bool) -> None:
    """Whether this process is closed to others of the same user; on Linux, elsewhere nothing happens."""
    _call("prctl", _DUMPABLE, 0 if hidden else 1, 0, 0, 0)


def separate() -> int:
    """Enter new namespaces, as many as the system allows; what was made, as a mask of the constants above."""
    _call("prctl", _PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    user, group = os.getuid(), os.getgid()
    made = next((flags for flags in _NAMESPACES if _call("unshare", flags)), 0)
    if made & _USER:
        for name, content in (
            ("setgroups", "deny"),
            ("uid_map", f"{user} {user} 1"),
            ("gid_map", f"{group} {group} 1"),
        ):
            with suppress(OSError):
                Path(f"/proc/self/{name}").write_text(content)
    return made


def first_process(made: int, tell: Callable[[int], object], descriptors: Iterable[int]) -> None:
    """Go on as the first process of the new process namespace: when it ends, all that it started end with it.

    The process that made the namespace stays outside, calls ``tell`` with the number of the new one, closes
    ``descriptors`` and ends as the new one ends. Without such a namespace this process goes on.
    """
    inner = os.fork() if made & _PIDS else 0
    if inner == 0:
        _call("prctl", _PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
        _call("prctl", _SUBREAPER, 1, 0, 0, 0)
        if made & _PIDS:
            os.setsid()  # the group of the process outside is out of its reach
        else:
            tell(os.getpid())
        return
    tell(inner)
    for descriptor in descriptors:
        os.close(descriptor)
    _, status = os.waitpid(inner, 0)
    if os.WIFSIGNALED(status):
        os.kill(os.getpid(), os.WTERMSIG(status))
    os._exit(os.waitstatus_to_exitcode(status) & 0xFF)


def hide_files(made: int, own: Mapping[str, int], hidden: Iterable[str]) -> bool:
    """Make the folders ``hidden`` empty and all files read-only; whether that worked.

    The folders ``own`` become empty too, with room for so many bytes, and can be written.
    """
    if not made & _MOUNTS:
        return False
    readonly = _MountAttributes(attr_set=_READ_ONLY)
    if not _mount("none", "/", "", _RECURSIVE | _PRIVATE):
        return False
    if not _call("syscall", _MOUNT_SETATTR, _AT_FDCWD, b"/", _AT_RECURSIVE, ctypes.byref(readonly), 32):
        return False
    _mount("proc", "/proc", "proc", _NOSUID | _NODEV)
    _mount("tmpfs", "/dev/shm", "tmpfs", _NOSUID | _NODEV, f"size={min(own.values())}")
    _mount("tmpfs", "/run", "tmpfs", _NOSUID | _NODEV, "size=4096")  # sockets of services
    done = [_mount("tmpfs", path, "tmpfs", _NOSUID | _NODEV | _READ_ONLY, "size=4096") for path in hidden]
    done += [_mount("tmpfs", path, "tmpfs", _NOSUID | _NODEV, f"size={size}") for path, size in own.items()]
    return all(done)


def restrict(made: int, memory: int, disk: int) -> None:
    """Drop all rights and set the limits of the system; nothing that follows can take them back."""
    import resource  # not on every system

    limits = {"AS": memory, "FSIZE": disk, "NOFILE": 1024, "CORE": 0}
    if made & _USER and os.getuid() != 0:  # elsewhere the user's other processes would count as well
        limits["NPROC"] = _PROCESSES
    for name, value in limits.items():
        kind = getattr(resource, f"RLIMIT_{name}")
        hard = resource.getrlimit(kind)[1]
        least = value if hard == resource.RLIM_INFINITY else min(value, hard)
        with suppress(OSError, ValueError):
            resource.setrlimit(kind, (least, least))
    for capability in range(64):
        _call("prctl", _CAPBSET_DROP, capability, 0, 0, 0)
    _drop_capabilities()
    _call("prctl", _NO_NEW_PRIVS, 1, 0, 0, 0)


def facts(made: int, files_hidden: bool) -> dict[str, bool]:
    """What of it this system allowed."""
    return {"network_cut": bool(made & _NET), "memory_hidden": bool(made & _USER), "files_hidden": files_hidden}


def _drop_capabilities() -> None:
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)  # version 3, this process
    _call("capset", ctypes.byref(header), ctypes.byref((ctypes.c_uint32 * 6)()))


def _mount(source: str, target: str, kind: str, flags: int, options: str = "") -> bool:
    return _call("mount", source.encode(), os.fsencode(target), kind.encode(), flags, options.encode())


def _call(name: str, *arguments: Any) -> bool:
    """Call a function of the C library on Linux; whether it is there and succeeded."""
    if not sys.platform.startswith("linux"):
        return False
    try:
        converted = [ctypes.c_ulong(value) if isinstance(value, int) else value for value in arguments]
        return int(getattr(ctypes.CDLL(None), name)(*converted)) == 0
    except (AttributeError, OSError):
        return False
