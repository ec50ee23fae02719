"""Memory, threads, files and children of processes, from /proc; 0 or empty on systems other than Linux."""

from __future__ import annotations

import ctypes
import os
import select
import signal
import sys
import time
from collections.abc import Iterable
from contextlib import suppress

_DUMPABLE = 4  # of prctl
_PAGE = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 4096


def peak_memory(pid: int) -> int:
    """Largest resident memory, bytes; 0 if unknown."""
    return _status(pid, b"VmHWM") * 1024


def threads(pid: int) -> int:
    """Number of its threads; 0 if unknown."""
    return _status(pid, b"Threads")


def resident(pid: int) -> int:
    """Resident memory now, bytes; 0 if unknown."""
    return _pages(pid, 1)


def mapped(pid: int) -> int:
    """Size of its address space, an upper bound of its memory, bytes; 0 if unknown."""
    return _pages(pid, 0)


def files_below(pid: int, folder: str) -> int:
    """Number of files in the file system that a process has at ``folder``; 0 if unknown."""
    with suppress(OSError):
        state = os.statvfs(f"/proc/{pid}/root{folder}")
        return state.f_files - state.f_ffree
    return 0


def hide_memory(hidden: bool) -> None:
    """Close the memory of this process to other processes of the same user, or open it again; on Linux only."""
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(_DUMPABLE, 0 if hidden else 1, 0, 0, 0)


def children(pid: int) -> list[int]:
    """Processes that it started, and those adopted from parents that ended."""
    pids: list[int] = []
    with suppress(OSError):
        for task in os.listdir(f"/proc/{pid}/task"):  # noqa: PTH208
            with suppress(OSError, ValueError):  # this thread has ended
                pids += map(int, _read(f"/proc/{pid}/task/{task}/children").split())
    return pids


def descendants(pid: int, most: int | None = None) -> list[int]:
    """The process, its children, their children and so on, until they are more than ``most``."""
    pids = [pid]
    for parent in pids:  # grows as it is read
        if most is not None and len(pids) > most:
            break
        pids += children(parent)
    return pids


def ready(descriptor: int, seconds: float = 0.0) -> bool:
    """True if a descriptor can be read, or the process of a handle has ended, within ``seconds``."""
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


def _status(pid: int, name: bytes) -> int:
    """A number of /proc/PID/status; 0 if unknown."""
    with suppress(OSError, ValueError, IndexError):
        return int(_read(f"/proc/{pid}/status").split(b"\n" + name + b":")[1].split()[0])
    return 0


def _pages(pid: int, place: int) -> int:
    """A number of /proc/PID/statm, bytes; 0 if unknown."""
    with suppress(OSError, ValueError, IndexError):
        return int(_read(f"/proc/{pid}/statm").split()[place]) * _PAGE
    return 0


def _read(path: str) -> bytes:
    """Content of a file of /proc; read after every frame, so without `Path`, which takes longer."""
    with open(path, "rb", buffering=0) as file:  # noqa: PTH123
        return file.read()
