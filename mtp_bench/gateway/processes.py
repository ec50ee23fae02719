"""What Linux tells about a process and those that it started; elsewhere nothing."""

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
    """Bytes that were resident at most; 0 where it is not known."""
    with suppress(OSError, ValueError, IndexError):
        return int(_told(f"/proc/{pid}/status").split(b"\nVmHWM:")[1].split()[0]) * 1024
    return 0


def _told(path: str) -> bytes:
    """A file of the system; these are read after every frame, and `Path` takes longer."""
    with open(path, "rb", buffering=0) as file:  # noqa: PTH123
        return file.read()


def resident(pid: int) -> int:
    """Bytes of it that are in memory now; 0 where it is not known."""
    with suppress(OSError, ValueError, IndexError):
        return int(_told(f"/proc/{pid}/statm").split()[1]) * _PAGE
    return 0


def threads(pid: int) -> int:
    """Number of its threads; 0 where it is not known."""
    with suppress(OSError, ValueError, IndexError):
        return int(_told(f"/proc/{pid}/status").split(b"\nThreads:")[1].split()[0])
    return 0


def files_below(pid: int, folder: str) -> int:
    """Number of files in the file system that a process has at ``folder``; 0 where it is not known."""
    with suppress(OSError):
        found = os.statvfs(f"/proc/{pid}/root{folder}")
        return found.f_files - found.f_ffree
    return 0


def hide_memory(hidden: bool) -> None:
    """Whether this process is closed to others of the same user; on Linux, elsewhere nothing happens."""
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(_DUMPABLE, 0 if hidden else 1, 0, 0, 0)


def mapped(pid: int) -> int:
    """Bytes of its address space: what it holds at most; 0 where it is not known."""
    with suppress(OSError, ValueError, IndexError):
        return int(_told(f"/proc/{pid}/statm").split()[0]) * _PAGE
    return 0


def children(pid: int) -> list[int]:
    """Processes that it started, and those whose own parents have ended."""
    found: list[int] = []
    with suppress(OSError):
        for task in os.listdir(f"/proc/{pid}/task"):  # noqa: PTH208
            with suppress(OSError, ValueError):  # this thread has ended
                found += map(int, _told(f"/proc/{pid}/task/{task}/children").split())
    return found


def descendants(pid: int, most: int | None = None) -> list[int]:
    """The process itself, its children, theirs, and so on, until they are more than ``most``."""
    found = [pid]
    for parent in found:  # grows as it is read
        if most is not None and len(found) > most:
            break
        found += children(parent)
    return found


def ready(descriptor: int, seconds: float = 0.0) -> bool:
    """Whether there is something to read, or the process of a handle has ended, at the latest after so long."""
    found = select.poll()  # not select.select, which takes no number above 1023
    found.register(descriptor, select.POLLIN)
    return bool(found.poll(max(0.0, 1000 * seconds)))


def end(processes: Iterable[int], seconds: float) -> None:
    """Kill processes and wait until they are gone, at most so long."""
    handles: list[int] = []
    for pid in processes:
        with suppress(OSError, AttributeError):
            handles.append(os.pidfd_open(pid))
            signal.pidfd_send_signal(handles[-1], signal.SIGKILL)
    deadline = time.monotonic() + seconds
    for handle in handles:
        ready(handle, deadline - time.monotonic())
        os.close(handle)
