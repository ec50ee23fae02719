"""The process of which agents are forks: it loads the library once, so that not every scene has to.

Started as ``python stem.py PLAN DOOR`` inside the cell that bubblewrap made for one submission, with rights over that
cell alone and a socket to the judge. It imports the library, nothing of the submission. For each scene it makes a fork,
shuts it in anew (processes, mounts, network, messages, names, a temporary folder and a /proc of its own), drops all
rights, sets the filter of system calls, and only then reads what the agent is. So an agent starts from the same state
as every other, and what it leaves behind ends with its namespaces.
"""

from __future__ import annotations

import base64
import gc
import importlib
import importlib.util
import itertools
import json
import os
import resource
import signal
import socket
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

READY, HERE = b"ready", b"here"
MOST = 1 << 20  # bytes of an order
MOST_FILES = 1024  # that a process has open
_OWN = ("pid", "net", "ipc", "uts", "mnt")  # and that of the control groups, once it is in them
_NOSUID, _NODEV, _NOEXEC, _RECURSIVE, _PRIVATE, _READ_ONLY = 2, 4, 8, 0x4000, 0x40000, 1


def main() -> None:
    """Load the library, then make a fork for every order."""
    plan, given = json.loads(sys.argv[1]), int(sys.argv[2])
    resource.setrlimit(resource.RLIMIT_NOFILE, (MOST_FILES, MOST_FILES))
    door = socket.socket(fileno=os.dup(given))  # below the limit, so that forks close it, as the judge's may not be
    os.close(given)
    gc.disable()  # until all is there
    system, child = _part("namespaces"), _part("child")
    child.prepare(plan)
    for name, kernels in plan["modules"].items():
        module = importlib.import_module(name)
        for kernel in kernels:
            getattr(module, kernel).compiled()
    _require_nothing_shared()
    gc.freeze()  # what is there now is shared by all forks: collecting would copy it
    gc.enable()
    door.send(READY)
    while True:
        text, descriptors, _, _ = socket.recv_fds(door, MOST, 8)
        if not text:
            return
        if os.fork() == 0:
            _only(partial(_grow, system, child, json.loads(text), descriptors, door))
        for descriptor in descriptors:
            os.close(descriptor)
        _forget_the_ended()


def _only(work: Callable[[], None]) -> None:
    """Do the work and end: whatever becomes of it, a fork never goes on in the stem's place."""
    code = 1
    try:
        work()
        code = 0
    except BaseException as error:
        with suppress(OSError):
            os.write(2, f"{type(error).__name__}: {error}\n".encode())
    finally:
        os._exit(code)


def _grow(system: Any, child: Any, order: dict[str, Any], descriptors: list[int], door: socket.socket) -> None:
    """In a fork: new namespaces, whose first process is the agent's; this one waits and tells how it ended."""
    nothing, orders, answers, log, told, *groups = descriptors
    system.call("prctl", system.PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    system.call("unshare", sum(system.NEW[name] for name in _OWN))
    inner = os.fork()
    if inner:
        _close_all_but(told)
        _, status = os.waitpid(inner, 0)
        os.write(told, json.dumps({"ended": os.waitstatus_to_exitcode(status)}).encode())
        return
    for descriptor, place in ((nothing, 0), (log, 1), (log, 2)):
        os.dup2(descriptor, place)
    for group in groups:
        os.write(group, b"0")  # this process
    system.call("unshare", system.NEW["cgroup"])  # now: their names tell the number of the judge
    _shut_in(system, order)
    door.send(HERE)  # with it the system tells the judge the number of this process
    _close_all_but(0, 1, 2, orders, answers)
    _draw_anew()
    sys.argv[1:] = [str(orders), str(answers)]
    child.main(orders, answers)


def _shut_in(system: Any, order: dict[str, Any]) -> None:
    """What the cell leaves to share, anew: temporary folders and /proc; then no rights, and the filter."""
    system.call("prctl", system.PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    os.setsid()
    _part("launch").join_keyring()
    system.mount("none", "/", "", _RECURSIVE | _PRIVATE)
    for folder, size in order["private"].items():
        system.mount("tmpfs", folder, "tmpfs", _NOSUID | _NODEV, f"size={size}")
    system.mount("proc", "/proc", "proc", _NOSUID | _NODEV | _NOEXEC)
    for path in order["masked"]:
        system.show("/dev/null", path, 0)
    system.attributes("/proc", _READ_ONLY, recursive=False)
    system.drop_rights()
    system.set_filter(base64.b64decode(order["filter"]))
    os.chdir(order["work"])


def _draw_anew() -> None:
    """Random numbers that nobody seeded differ between agents; those of the standard library do by themselves."""
    import numpy as np

    np.random.seed()  # noqa: NPY002


def _require_nothing_shared() -> None:
    """Refuse memory that forks would share for writing: one agent could leave a note there for the next."""
    for line in Path("/proc/self/maps").read_text().splitlines():
        rights = line.split()[1]
        if rights[1] == "w" and rights[3] == "s":
            raise SystemExit(f"memory that is shared: {line}")


def _close_all_but(*kept: int) -> None:
    """Not by /proc/self/fd: that is soon another process's /proc."""
    ends = [-1, *sorted(kept), MOST_FILES]
    for one, other in itertools.pairwise(ends):
        if one + 1 < other:  # an empty range would be all of them
            os.closerange(one + 1, other)


def _forget_the_ended() -> None:
    with suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass


def _part(name: str) -> Any:
    """A module beside this one, alone: its package is the judge's."""
    spec = importlib.util.spec_from_file_location(f"mtp_bench_{name}", Path(__file__).with_name(f"{name}.py"))
    if spec is None or spec.loader is None:
        raise ImportError(f"{name}.py is not there")
    sys.modules[spec.name] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


if __name__ == "__main__":
    main()
