"""Processes of an agent, from /proc, and control groups that limit all together.

On systems other than Linux the numbers are 0 or empty. Control groups are of version 2
if they are delegated to this process, of version 1 if their folders can be written;
else the judge watches the processes (`AgentProcess`).
"""

import ctypes
import os
import secrets
import select
import signal
import sys
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

ROOT = Path("/sys/fs/cgroup")
_PIDS = Path("/proc/self/ns/pid")  # the namespace in which the pids of this process are
_NAMESPACE = _PIDS.stat().st_ino if _PIDS.exists() else 0
_NAME = f"mtp_bench-{_NAMESPACE}"  # of a group, followed by the pid of the judge
_V2 = {"memory.max": "memory", "memory.swap.max": None, "pids.max": "processes"}
_V1 = {
    "memory.limit_in_bytes": "memory",
    "memory.memsw.limit_in_bytes": "with_swap",
    "pids.max": "processes",
}
# the others limit swap, which not every system has
_NEEDED = ("memory.max", "memory.limit_in_bytes", "pids.max")
_REMOVE_SECONDS = 2.0  # that the system may take to empty a group
_DUMPABLE = 4  # of prctl
_CHILD_SUBREAPER = 36
_PAGE = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 4096


@dataclass(frozen=True)
class Group:
    """Control groups (cgroups) of one agent: one of version 2, one per controller of version 1, or none."""

    folders: tuple[Path, ...]

    @property
    def members(self) -> list[str]:
        """Files to which a process writes 0 to join."""
        return [str(folder / "cgroup.procs") for folder in self.folders]

    def exceeded(self) -> bool:
        """Return True if the kernel enforced the memory limit."""
        for folder in self.folders:
            for name in ("memory.events", "memory.oom_control"):
                with suppress(OSError, ValueError):
                    for line in (folder / name).read_text().splitlines():
                        key, *numbers = line.split()
                        if key == "oom_kill" and int(numbers[0]):
                            return True
        return False

    def remove(self) -> None:
        """Remove the groups.

        Their processes must have ended.
        """
        deadline = time.monotonic() + _REMOVE_SECONDS
        for folder in self.folders:
            while folder.is_dir() and time.monotonic() < deadline:
                with suppress(OSError):
                    folder.rmdir()
                    break
                time.sleep(0.01)


def make_group(
    memory: int,
    processes: int,
    root: Path = ROOT,
    own: Path = Path("/proc/self/cgroup"),
) -> Group:
    """Make a group limited to ``memory`` bytes and ``processes`` threads.

    It has no folders if the system allows none. ``root``: where control groups are
    mounted. ``own``: file that lists those of this process.
    """
    limits = {
        "memory": str(memory),
        "with_swap": str(memory),
        "processes": str(processes),
        None: "0",
    }
    parents, limit_of_file = _places(root, own)
    for parent in parents:
        _sweep(parent)
    folders: list[Path] = []
    name = f"{_NAME}-{os.getpid()}-{secrets.token_hex(4)}"
    try:
        for parent in parents:
            folder = parent / name
            folder.mkdir()
            folders.append(folder)
        for file, limit in limit_of_file.items():
            paths = [folder / file for folder in folders if (folder / file).exists()]
            if not paths and file in _NEEDED:
                raise OSError(f"no {file}")
            for path in paths:
                path.write_text(limits[limit])
    except OSError:
        Group(tuple(folders)).remove()
        return Group(())
    return Group(tuple(folders))


def _sweep(parent: Path) -> None:
    """Remove groups of ended judges with their processes.

    These are judges of this namespace.
    """
    for folder in parent.glob(f"{_NAME}-*-*"):
        judge = folder.name.split("-")[2]  # its pid: the part behind `_NAME`
        if judge.isdigit() and not Path(f"/proc/{judge}").exists():
            with suppress(OSError, ValueError):
                for line in (folder / "cgroup.procs").read_text().split():
                    os.kill(int(line), signal.SIGKILL)
            Group((folder,)).remove()


def _places(root: Path, own: Path) -> tuple[list[Path], dict[str, str | None]]:
    """Return parents of new groups, and the limit that each file of a group holds."""
    path_of: dict[str, str] = {}  # by controller; "" in version 2
    with suppress(OSError, ValueError):
        for line in own.read_text().splitlines():
            _, controllers, path = line.split(":", 2)
            path_of |= dict.fromkeys(controllers.split(","), path)
    if {"memory", "pids"} <= path_of.keys():
        names = [f"{name}/{path_of[name].lstrip('/')}" for name in ("memory", "pids")]
        folders = sorted({root / name for name in names})
        if all(os.access(path, os.W_OK) for path in folders):
            return folders, dict(_V1)
        return [], dict(_V1)
    if "" in path_of:
        # a group with processes cannot contain others: use this process's own or its
        # parent
        group = root / path_of[""].lstrip("/")
        for folder in (group, group.parent):
            with suppress(OSError):
                delegated = (folder / "cgroup.subtree_control").read_text().split()
                is_writable = os.access(folder, os.W_OK)
                if {"memory", "pids"} <= set(delegated) and is_writable:
                    return [folder], dict(_V2)
    return [], dict(_V1)


def files_below(pid: int, folder: str) -> int:
    """Count the files that a process has below ``folder``.

    0 if unknown.
    """
    with suppress(OSError):
        state = os.statvfs(f"/proc/{pid}/root{folder}")
        return state.f_files - state.f_ffree
    return 0


def guard(on: bool) -> None:
    """Hide the memory of this process, or show it again.

    While it is hidden, the process also adopts orphans. On Linux only.
    """
    if sys.platform.startswith("linux"):
        for number, value in ((_DUMPABLE, not on), (_CHILD_SUBREAPER, on)):
            ctypes.CDLL(None).prctl(number, int(value), 0, 0, 0)


def adopted(own: Iterable[int]) -> list[int]:
    """Return running children in sessions of their own, but for ``own``.

    Children that have ended are removed from the system.
    """
    pids: list[int] = []
    for pid in sorted({*children(os.getpid())} - {*own}):
        with suppress(OSError):  # (0, 0): it is still running
            if os.getsid(pid) != os.getsid(0) and os.waitpid(pid, os.WNOHANG) == (0, 0):
                pids.append(pid)
    return pids


def children(pid: int) -> list[int]:
    """Return processes that ``pid`` started, and those that it adopted."""
    pids: list[int] = []
    with suppress(OSError):
        for task in os.listdir(f"/proc/{pid}/task"):  # noqa: PTH208
            with suppress(OSError, ValueError):  # this thread has ended
                pids += map(int, _read(f"/proc/{pid}/task/{task}/children").split())
    return pids


def descendants(pid: int, most: int) -> list[int]:
    """Return the process, its children, their children and so on.

    The search stops once they are more than ``most``.
    """
    pids = [pid]
    for parent in pids:  # grows as it is read
        if len(pids) > most:
            break
        pids += children(parent)
    return pids


def ready(descriptor: int, seconds: float = 0.0) -> bool:
    """Return True if a descriptor can be read within ``seconds``.

    The handle of a process can be read once the process has ended.
    """
    poll = select.poll()  # select.select refuses numbers above 1023
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(max(0.0, 1000 * seconds)))


def end(processes: Iterable[int], seconds: float) -> None:
    """Kill processes and wait until they have ended, at most ``seconds``."""
    handles: list[int] = []
    for pid in processes:
        with suppress(OSError, AttributeError):
            handles.append(os.pidfd_open(pid))
            signal.pidfd_send_signal(handles[-1], signal.SIGKILL)
    deadline = time.monotonic() + seconds
    for handle in handles:
        ready(handle, deadline - time.monotonic())
        os.close(handle)


def status(pid: int, name: bytes) -> int:
    """Return a number of /proc/PID/status, such as of threads.

    0 if unknown.
    """
    with suppress(OSError, ValueError, IndexError):
        lines = _read(f"/proc/{pid}/status")
        return int(lines.split(b"\n" + name + b":")[1].split()[0])
    return 0


def memory(pid: int, resident: bool) -> int:
    """Return the ``resident`` memory, else the address space, bytes.

    The address space is an upper bound of the memory; 0 if unknown.
    """
    with suppress(OSError, ValueError, IndexError):
        address_space, resident_pages = _read(f"/proc/{pid}/statm").split()[:2]
        return int(resident_pages if resident else address_space) * _PAGE
    return 0


def _read(path: str) -> bytes:
    """Read a file of /proc.

    It is read after every frame, so not with `Path`, which is slower.
    """
    with open(path, "rb", buffering=0) as file:  # noqa: PTH123
        return file.read()
