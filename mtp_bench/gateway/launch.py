"""The last steps before an agent's process is shut in, in a process of its own; with the standard library alone.

Started as ``python launch.py PLAN COMMAND...``: it enters the control groups and a new session keyring of its own, and
becomes COMMAND. ``PLAN``: JSON, see `mechanism.command`.
"""

from __future__ import annotations

import ctypes
import json
import os
import platform
import signal
import sys

PDEATHSIG = 1  # of prctl
_KEYCTL = {"x86_64": 250, "aarch64": 219}
_JOIN_SESSION_KEYRING = 1


def main() -> None:
    """Prepare this process and become the command."""
    plan, command = json.loads(sys.argv[1]), sys.argv[2:]
    libc = ctypes.CDLL(None, use_errno=True)
    if sys.platform == "linux":
        libc.prctl(PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
        if os.getppid() != plan["judge"]:  # it ended meanwhile
            return
        join_keyring()
    for door in plan["groups"]:
        with open(door, "w") as file:  # noqa: PTH123  (pathlib takes time)
            file.write("0")
    if plan["info"] is not None:  # a command that makes another process tells its number itself
        os.write(plan["info"], json.dumps({"child-pid": os.getpid()}).encode())
        os.close(plan["info"])
    if plan["rules"] is not None:
        os.close(plan["rules"])
    os.execv(command[0], command)


def join_keyring() -> None:
    """A session keyring of its own, where the number of that call is known."""
    if platform.machine() in _KEYCTL:
        number = ctypes.c_long(_KEYCTL[platform.machine()])
        ctypes.CDLL(None).syscall(number, _JOIN_SESSION_KEYRING, None)


if __name__ == "__main__":
    main()
