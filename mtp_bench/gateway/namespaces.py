"""Shuts a process in by calls of the system of our own, where bubblewrap is not installed; the same result.

Started as ``python namespaces.py PLAN COMMAND...`` by `launch`, with the standard library alone: a user namespace can
be made only while there is one thread. It makes new namespaces and a new root that holds what the plan shows, drops all
rights, sets the filter of system calls and becomes COMMAND, as the first process of its namespace: when it ends, all
that it started end with it. Any step that fails ends it.
"""

from __future__ import annotations

import base64
import ctypes
import json
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

# <sched.h>, <sys/mount.h>, <sys/prctl.h>
NEW = {
    "user": 0x10000000, "pid": 0x20000000, "net": 0x40000000, "ipc": 0x8000000, "uts": 0x4000000, "mnt": 0x20000,
    "cgroup": 0x2000000,
}  # fmt: skip
_NOSUID, _NODEV, _NOEXEC, _BIND, _RECURSIVE, _PRIVATE = 2, 4, 8, 0x1000, 0x4000, 0x40000
_DETACH = 2
_AT_FDCWD, _AT_RECURSIVE, _READ_ONLY = -100, 0x8000, 1
_MOUNT_SETATTR, _PIVOT_ROOT = 442, {"x86_64": 155, "aarch64": 41}
PDEATHSIG, _SECCOMP, _CAPBSET_DROP, _NO_NEW_PRIVS = 1, 22, 24, 38
_FILTER_MODE = 2
_BASE = "/tmp"
_libc = ctypes.CDLL(None, use_errno=True)


class _MountAttributes(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_uint64) for name in ("attr_set", "attr_clr", "propagation", "userns_fd"))


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("steps", ctypes.c_char_p))


def main() -> None:
    """Shut this process in and become the command."""
    plan, command = json.loads(sys.argv[1]), sys.argv[2:]
    _enter(plan["uid"])
    inner = os.fork()
    if inner:
        _stay_outside(plan, inner)
    call("prctl", PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    os.setsid()
    os.close(plan["told"])
    call("sethostname", b"agent", 5)
    _make_root(plan)
    drop_rights()
    set_filter(base64.b64decode(plan["filter"]))
    os.chdir(plan["work"])
    os.execv(command[0], command)


def _enter(uid: int) -> None:
    user, group = os.getuid(), os.getgid()
    call("unshare", sum(NEW.values()))
    for name, content in (("setgroups", "deny"), ("uid_map", f"{uid} {user} 1"), ("gid_map", f"{uid} {group} 1")):
        Path(f"/proc/self/{name}").write_text(content)


def _stay_outside(plan: dict[str, Any], inner: int) -> None:
    """Tell the number of the process inside, hold nothing of it, and end as it ends."""
    os.write(plan["told"], json.dumps({"child-pid": inner}).encode())
    for descriptor in (plan["told"], *plan["held"]):
        os.close(descriptor)
    _, status = os.waitpid(inner, 0)
    os._exit(128 + os.WTERMSIG(status) if os.WIFSIGNALED(status) else os.WEXITSTATUS(status))


def _make_root(plan: dict[str, Any]) -> None:
    """A root that holds what the plan shows and nothing else."""
    mount("none", "/", "", _RECURSIVE | _PRIVATE)
    mount("tmpfs", _BASE, "tmpfs", _NOSUID | _NODEV)
    for name in ("old", "new"):
        Path(_BASE, name).mkdir()
    _pivot(_BASE, f"{_BASE}/old")
    mount("tmpfs", "/new", "tmpfs", _NOSUID | _NODEV, "size=1048576,mode=755")
    for text, there in plan["links"]:
        os.makedirs(os.path.dirname(f"/new{there}"), exist_ok=True)  # noqa: PTH103, PTH120
        os.symlink(text, f"/new{there}")  # noqa: PTH211
    for folder, size in plan["private"].items():  # first: what is shown may lie below
        os.makedirs(f"/new{folder}", exist_ok=True)  # noqa: PTH103
        mount("tmpfs", f"/new{folder}", "tmpfs", _NOSUID | _NODEV, f"size={size}")
    covered = set(plan["covered"])
    for here, there in plan["shown"]:
        for folder in [folder for folder in covered if there.startswith(f"{folder}/")]:
            mount("tmpfs", f"/new{folder}", "tmpfs", _NOSUID | _NODEV, "size=65536,mode=755")
            covered.discard(folder)
        show(f"/old{here}", f"/new{there}", _NODEV)
    for device in plan["devices"]:
        show(f"/old{device}", f"/new{device}", 0, read_only=False)
    Path("/new/proc").mkdir()
    mount("proc", "/new/proc", "proc", _NOSUID | _NODEV | _NOEXEC)
    for path in plan["masked"]:
        show("/old/dev/null", f"/new{path}", 0)
    for folder in ("/new", "/new/proc", *(f"/new{folder}" for folder in plan["covered"])):
        attributes(folder, _READ_ONLY, recursive=False)
    call("umount2", b"/old", _DETACH)
    os.chdir("/new")
    _pivot(".", ".")
    call("umount2", b".", _DETACH)
    os.chdir("/")


def show(here: str, there: str, flags: int, read_only: bool = True) -> None:
    """Mount a file or folder at another place, without what runs as another user."""
    if os.path.isdir(here):  # noqa: PTH112
        os.makedirs(there, exist_ok=True)  # noqa: PTH103
    else:
        os.makedirs(os.path.dirname(there), exist_ok=True)  # noqa: PTH103, PTH120
        with suppress(FileExistsError):
            os.close(os.open(there, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644))
    mount(here, there, "", _BIND | _RECURSIVE)
    attributes(there, _NOSUID | flags | (_READ_ONLY if read_only else 0), recursive=True)


def attributes(path: str, flags: int, recursive: bool) -> None:
    """Flags of a mount; MOUNT_ATTR_RDONLY, _NOSUID and _NODEV have the values of MS_RDONLY and so on."""
    wanted = _MountAttributes(attr_set=flags)
    how = _AT_RECURSIVE if recursive else 0
    call("syscall", _MOUNT_SETATTR, _AT_FDCWD, path.encode(), how, ctypes.byref(wanted), ctypes.sizeof(wanted))


def _pivot(new: str, old: str) -> None:
    os.chdir(new)
    call("syscall", _PIVOT_ROOT[os.uname().machine], b"." if new != old else new.encode(), old.encode())


def drop_rights() -> None:
    """Give up all capabilities, for good."""
    for capability in range(64):  # there are fewer
        _libc.prctl(_CAPBSET_DROP, capability, 0, 0, 0)
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)  # version 3, this process
    call("capset", ctypes.byref(header), ctypes.byref((ctypes.c_uint32 * 6)()))
    call("prctl", _NO_NEW_PRIVS, 1, 0, 0, 0)


def set_filter(program: bytes) -> None:
    """Set the filter of system calls; nothing takes it back."""
    call("prctl", _SECCOMP, _FILTER_MODE, ctypes.byref(_Program(len(program) // 8, program)), 0, 0)


def mount(source: str, target: str, kind: str, flags: int, options: str = "") -> None:
    """A mount; ``flags`` as MS_* of <sys/mount.h>."""
    call("mount", os.fsencode(source), os.fsencode(target), kind.encode(), flags, options.encode())


def call(name: str, *arguments: Any) -> None:
    """A function of the C library; raises OSError where it fails."""
    converted = [ctypes.c_ulong(value) if isinstance(value, int) else value for value in arguments]
    if getattr(_libc, name)(*converted) != 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{name}: {os.strerror(number)}", str(arguments[:3]))


if __name__ == "__main__":
    main()
