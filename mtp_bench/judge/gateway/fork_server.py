"""Fork servers as the judge sees them: one per thread, for its submission.

One per thread, since a sandbox of bubblewrap ends with the thread that started it, and
since a server makes one fork at a time. The process itself is `fork_server_main`.
"""

import atexit
import base64
import json
import os
import signal
import socket
import struct
import subprocess
import tempfile
import threading
from collections.abc import Sequence
from contextlib import suppress

from ...core import MtpBenchError
from .fork_server_main import FORKED, READY
from .layout import (
    KERNELS,
    LOADED,
    TEMPORARY,
    Layout,
    child_script,
    environment,
    library,
    packages,
    python,
)
from .processes import ready
from .sandbox import bubblewrap_command, system_call_filter

_START_SECONDS = 120.0  # to load the library; without compiled kernels it takes long
_FORK_SECONDS = 60.0  # until a fork is in its namespaces, also on a busy machine
_SPACE_BYTES = 64 << 20  # of the server's own temporary folder
_CREDENTIALS = struct.Struct("3i")  # pid, user, group
_PASS_CREDENTIALS = getattr(socket, "SO_PASSCRED", 16)  # its number on Linux


class ForkServerError(MtpBenchError):
    """A fork server does not start or does not fork."""


class ForkServer:
    """A process with the library loaded, in the sandbox of one submission."""

    def __init__(self, layout: Layout) -> None:
        """Start the process.

        Raises ForkServerError where it does not load the library in time.
        """
        self._layout = layout
        self._environment = environment(isolated=True)
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.setsockopt(socket.SOL_SOCKET, _PASS_CREDENTIALS, 1)
        setup = {
            "path": [str(library()), *packages()],
            "kernels": KERNELS,
            "modules": LOADED,
        }
        program = [
            *python(),
            child_script(),
            "fork-server",
            json.dumps(setup),
            str(theirs.fileno()),
        ]
        stdin, end = os.pipe()  # empty
        os.close(end)
        with tempfile.TemporaryFile() as log:
            try:
                self._process = subprocess.Popen(
                    bubblewrap_command(layout, program, _SPACE_BYTES),
                    cwd="/",
                    env=self._environment,
                    stdin=stdin,
                    stdout=subprocess.DEVNULL,
                    stderr=log,
                    pass_fds=(theirs.fileno(),),
                    start_new_session=True,
                )
            finally:
                theirs.close()
                os.close(stdin)
            try:
                self._read_pid(READY, _START_SECONDS)
            except BaseException as error:  # an interruption too
                self.stop()
                log.seek(0)
                lines = log.read().decode(errors="replace").strip().splitlines()
                if isinstance(error, ForkServerError) and lines:
                    raise ForkServerError(
                        f"the fork server of the sandbox does not start: {lines[-1]}"
                    ) from None
                raise

    @property
    def running(self) -> bool:
        """True if its process is alive."""
        return self._process.poll() is None

    def fits(self, layout: Layout) -> bool:
        """Return True if a new server would be the same."""
        same_environment = self._environment == environment(isolated=True)
        return same_environment and self._layout == layout

    def fork(self, descriptors: Sequence[int], space: int) -> int:
        """Fork a sandboxed agent process and return its pid.

        It reads the first order before it does anything for the agent. ``descriptors``:
        its standard input, orders, answers, log, the pipe for its exit code, and the
        open ``cgroup.procs`` files of its control groups. ``space``: bytes of its
        temporary folder. Raises ForkServerError.
        """
        request = {
            "temporary": TEMPORARY,
            "space": space,
            "masked": self._layout.masked,
            "filter": base64.b64encode(system_call_filter() or b"").decode(),
        }
        try:
            socket.send_fds(
                self._socket, [json.dumps(request).encode()], list(descriptors)
            )
        except OSError as error:
            raise ForkServerError(
                f"the fork server of the sandbox does not answer: {error}"
            ) from None
        return self._read_pid(FORKED, _FORK_SECONDS)

    def stop(self) -> None:
        """End the server and its forks."""
        self._socket.close()
        if self.running:  # else its pid may belong to another process
            with suppress(OSError):
                os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def _read_pid(self, expected: bytes, seconds: float) -> int:
        """Return the pid, added by the kernel, of the process that sends ``expected``."""
        if ready(self._socket.fileno(), seconds):
            with suppress(OSError):  # it has ended
                text, messages, _, _ = self._socket.recvmsg(
                    64, socket.CMSG_SPACE(_CREDENTIALS.size)
                )
                pids = [
                    _CREDENTIALS.unpack(data)[0]
                    for _, kind, data in messages
                    if kind == socket.SCM_CREDENTIALS
                ]
                if text == expected and pids:
                    return int(pids[0])
        raise ForkServerError(
            f"the fork server of the sandbox is not {expected.decode()} after "
            f"{seconds:g} s or has ended; try again when the machine is less busy"
        )


# native id of the thread that started it -> server
_servers: dict[int, ForkServer] = {}


def server_for(layout: Layout) -> ForkServer:
    """Return this thread's fork server, started at the first call.

    Raises ForkServerError.
    """
    for owner, server in list(_servers.items()):  # such as those of threads that ended
        if not server.running:
            server.stop()
            _servers.pop(owner, None)
    thread = threading.get_native_id()
    if thread in _servers and not _servers[thread].fits(layout):
        discard()
    if thread not in _servers:
        _servers[thread] = ForkServer(layout)
    return _servers[thread]


def discard() -> None:
    """Stop this thread's fork server.

    The next call of `server_for` starts another.
    """
    server = _servers.pop(threading.get_native_id(), None)
    if server is not None:
        server.stop()


@atexit.register
def _stop_all() -> None:
    for server in list(_servers.values()):
        server.stop()
