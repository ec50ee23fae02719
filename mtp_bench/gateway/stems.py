"""The judge's side of `stem`: one stem per process of the judge, for the submission that it runs now."""

from __future__ import annotations

import atexit
import json
import os
import select
import signal
import socket
import struct
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

from .filter import system_call_filter
from .layout import KERNELS, LOADED, TEMPORARY, Layout, environment, interpreter, library, packages
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
        self.layout = layout
        self._door, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._door.setsockopt(socket.SOL_SOCKET, _PASS_CREDENTIALS, 1)
        plan = {"path": [str(library()), *packages()], "kernels": KERNELS, "modules": LOADED}
        script = str(library() / "mtp_bench" / "gateway" / "stem.py")
        program = [str(interpreter()), "-I", "-S", "-B", script, json.dumps(plan), str(theirs.fileno())]
        open_cell = replace(layout, masked=())  # a new /proc is refused where the old one is masked
        words = command("bubblewrap", open_cell, program, {TEMPORARY: _SPACE}, rights=_RIGHTS)
        nothing, end_of_it = os.pipe()
        os.close(end_of_it)
        try:
            self._process = subprocess.Popen(
                words, cwd="/", env=environment(isolated=True), stdin=nothing, stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL, pass_fds=(theirs.fileno(),), start_new_session=True,
            )  # fmt: skip
        finally:
            theirs.close()
            os.close(nothing)
        try:
            self._hear(READY, _START)
        except StemError:
            self.close()
            raise

    @property
    def lives(self) -> bool:
        """Whether it can be asked for forks."""
        return self._process.poll() is None

    def grow(self, descriptors: Sequence[int], space: int) -> int:
        """A fork, shut in anew, with the agent's side of the gateway running in it; the number of its process.

        ``descriptors``: its standard input, orders, answers, log, and where its end is told. ``space``: bytes of its
        temporary folder. It reads the first order before it does anything for the agent. Raises StemError.
        """
        order = {"private": {TEMPORARY: space}, "masked": self.layout.masked, "work": TEMPORARY, "filter": _rules()}
        try:
            socket.send_fds(self._door, [json.dumps(order).encode()], list(descriptors))
        except OSError as error:
            raise StemError(str(error)) from None
        return self._hear(HERE, _GROW)

    def close(self) -> None:
        """End it and its forks."""
        self._door.close()
        with suppress(OSError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def _hear(self, expected: bytes, seconds: float) -> int:
        """Who says what is expected: the number of the process as this one knows it."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            if not select.select([self._door], [], [], max(0.0, deadline - time.monotonic()))[0]:
                break
            text, more, _, _ = self._door.recvmsg(64, socket.CMSG_SPACE(_CREDENTIALS.size))
            numbers = [_CREDENTIALS.unpack(data)[0] for _, kind, data in more if kind == socket.SCM_CREDENTIALS]
            if text != expected or not numbers:
                break
            return int(numbers[0])
        raise StemError(f"it did not say {expected.decode()}")


_planted: list[Stem] = []  # at most one


def stem_of(layout: Layout) -> Stem | None:
    """The stem for a layout, planted when it is first asked for; None where there can be none."""
    if not can_stem(layout):
        return None
    if _planted and (_planted[0].layout != layout or not _planted[0].lives):
        uproot()
    if not _planted:
        try:
            _planted.append(Stem(layout))
        except (StemError, OSError):
            _refused.add(layout)
            return None
    return _planted[0]


def can_stem(layout: Layout) -> bool:
    """Whether forks can have a temporary folder of their own: what is shown must not lie below it."""
    below = any(there.startswith(f"{TEMPORARY}/") for _, there in layout.shown)
    return layout not in _refused and not below and _rules() != ""


def uproot() -> None:
    """End the stem of this process."""
    while _planted:
        _planted.pop().close()


_refused: set[Layout] = set()
atexit.register(uproot)


def _rules() -> str:
    import base64

    return base64.b64encode(system_call_filter() or b"").decode()
