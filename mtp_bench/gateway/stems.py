"""The judge's side of `stem`: one stem per thread of the judge, for the submission that it runs now.

Per thread, since what bubblewrap made ends with the thread that started it, and a stem gives one fork at a time.
"""

from __future__ import annotations

import atexit
import base64
import json
import os
import signal
import socket
import struct
import subprocess
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

from .family import ready
from .filter import system_call_filter
from .layout import KERNELS, LOADED, TEMPORARY, Layout, environment, library, packages, python
from .mechanism import command
from .stem import HERE, READY

_START = 120.0  # s until the library is loaded; without compiled kernels it takes long
_GROW = 10.0  # s until a fork has its namespaces
_SPACE = 64 << 20  # bytes of the stem's own temporary folder
_RIGHTS = ("CAP_SYS_ADMIN", "CAP_SETPCAP")  # over its cell: to mount, and to drop rights for good
_CREDENTIALS = struct.Struct("3i")  # number of the process, user, group
_PASS_CREDENTIALS = getattr(socket, "SO_PASSCRED", 16)


class StemError(Exception):
    """There is no stem, or it gives no fork."""


class Stem:
    """A process with the library loaded, in the cell of one submission."""

    def __init__(self, layout: Layout) -> None:
        self._layout, self._environment = layout, environment(isolated=True)
        self._door, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._door.setsockopt(socket.SOL_SOCKET, _PASS_CREDENTIALS, 1)
        plan = {"path": [str(library()), *packages()], "kernels": KERNELS, "modules": LOADED}
        script = str(library() / "mtp_bench" / "gateway" / "stem.py")
        program = [*python(), script, json.dumps(plan), str(theirs.fileno())]
        open_cell = replace(layout, masked=())  # a new /proc is refused where the old one is masked
        words = command("bubblewrap", open_cell, program, {TEMPORARY: _SPACE}, rights=_RIGHTS)
        nothing, end_of_it = os.pipe()
        os.close(end_of_it)
        try:
            self._process = subprocess.Popen(
                words, cwd="/", env=self._environment, stdin=nothing, stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL, pass_fds=(theirs.fileno(),), start_new_session=True,
            )  # fmt: skip
        finally:
            theirs.close()
            os.close(nothing)
        try:
            self._hear(READY, _START)
        except BaseException:  # an interruption too
            self.close()
            raise

    @property
    def lives(self) -> bool:
        """Whether it can be asked for forks."""
        return self._process.poll() is None

    def fits(self, layout: Layout) -> bool:
        """Whether a process that is started now would see the same files and the same environment."""
        return self._layout == layout and self._environment == environment(isolated=True)

    def grow(self, descriptors: Sequence[int], space: int) -> int:
        """A fork, shut in anew, with the agent's side of the gateway running in it; the number of its process.

        ``descriptors``: its standard input, orders, answers, log, where its end is told, and the open doors of its
        control groups. ``space``: bytes of its temporary folder. It reads the first order before it does anything for
        the agent. Raises StemError.
        """
        rules = base64.b64encode(system_call_filter() or b"").decode()
        order = {"private": {TEMPORARY: space}, "masked": self._layout.masked, "work": TEMPORARY, "filter": rules}
        try:
            socket.send_fds(self._door, [json.dumps(order).encode()], list(descriptors))
        except OSError as error:
            raise StemError(str(error)) from None
        return self._hear(HERE, _GROW)

    def close(self) -> None:
        """End it and its forks."""
        self._door.close()
        if self.lives:  # else its number may be another's
            with suppress(OSError):
                os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def _hear(self, expected: bytes, seconds: float) -> int:
        """Who says what is expected: the number of the process as this one knows it."""
        if ready(self._door.fileno(), seconds):
            with suppress(OSError):  # it has ended
                text, more, _, _ = self._door.recvmsg(64, socket.CMSG_SPACE(_CREDENTIALS.size))
                numbers = [_CREDENTIALS.unpack(data)[0] for _, kind, data in more if kind == socket.SCM_CREDENTIALS]
                if text == expected and numbers:
                    return int(numbers[0])
        raise StemError(f"it did not say {expected.decode()}")


_planted: dict[int, Stem] = {}  # by the system's number of the thread that planted it
_refused: set[Layout] = set()  # where it did not work once: each further trial could take as long


def stem_of(layout: Layout) -> Stem | None:
    """This thread's stem for a layout, planted when it is first asked for; None where there can be none."""
    if not can_stem(layout):
        return None
    _forget_the_dead()
    mine = threading.get_native_id()
    if mine in _planted and not _planted[mine].fits(layout):
        uproot()
    if mine not in _planted:
        try:
            _planted[mine] = Stem(layout)
        except (StemError, OSError):
            _refused.add(layout)
            return None
    return _planted[mine]


def can_stem(layout: Layout) -> bool:
    """Whether forks can have a temporary folder of their own: what is shown must not lie below it."""
    below = any(there.startswith(f"{TEMPORARY}/") for _, there in layout.shown)
    return layout not in _refused and not below and system_call_filter() is not None


def uproot() -> None:
    """End the stem of this thread."""
    stem = _planted.pop(threading.get_native_id(), None)
    if stem is not None:
        stem.close()


def give_up(layout: Layout) -> None:
    """End the stem of this thread, and plant none for this layout any more."""
    _refused.add(layout)
    uproot()


def _forget_the_dead() -> None:
    """Close what is left of stems that died, as with the threads that planted them."""
    for thread, stem in list(_planted.items()):
        if not stem.lives:
            stem.close()
            _planted.pop(thread, None)


@atexit.register
def _uproot_all() -> None:
    for stem in list(_planted.values()):
        stem.close()
