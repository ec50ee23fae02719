"""The judge's side of an agent process: it starts the process, exchanges messages by a deadline, and ends it."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from ...core import MtpBenchError
from . import processes
from .channel import Channel
from .fork_server import ForkServer, ForkServerError, discard, server_for
from .layout import (
    KERNELS,
    SUBMISSION,
    TEMPORARY,
    Image,
    Layout,
    child_script,
    environment,
    library,
    packages,
    python,
)
from .limits import Isolation, Limits, SandboxBackend
from .wire import header_of

_EXIT_CODE_SECONDS = 2.0  # until it is known how a process ended
_END_SECONDS = 5.0  # that the system may take to end a process
_WATCH_SECONDS = 0.1  # between checks of the agent's processes while the judge waits
_MOST_PROCESSES = 64
_MOST_FILES = (
    10_000  # in its temporary folder: their names take memory that no limit counts
)
MOST_THREADS = (
    1024  # of all its processes; the system's own limit does not hold for root
)
Message = tuple[dict[str, Any], bytearray]
_unsandboxed: set[int] = set()  # pids of the agents that run without a sandbox
_starting = (
    threading.Lock()
)  # an agent that is just started is not taken for an adopted process


class ExcessError(Exception):
    """The agent's processes are too many, or hold too much memory."""


@dataclass(frozen=True)
class SandboxSpec:
    """Layout, submission image and sandbox of one agent process."""

    layout: Layout
    image: Image
    backend: SandboxBackend


class AgentProcess:
    """A process with one agent. Use it in a ``with`` statement: at the end no process of the agent is left."""

    def __init__(self, limits: Limits, spec: SandboxSpec, most_bytes: int) -> None:
        """``most_bytes``: of the body of a message."""
        self._limits, self._spec, self.most_bytes = limits, spec, most_bytes
        self._sandboxed = spec.backend != "none"
        self._peak = 0
        self._watched = time.monotonic()
        self._answered = False  # after its first message it runs in its own root
        self._spawned: subprocess.Popen[bytes] | None = (
            None  # without a sandbox; None: a fork of a fork server
        )
        self._pid: int | None = None
        self._handle: int | None = (
            None  # of the process: its pid may be given to another one
        )

    @property
    def isolation(self) -> Isolation:
        """The sandbox of the process."""
        return Isolation(
            mechanism=self._spec.backend,
            memory="cgroup" if self._group.folders else "watch",
        )

    def __enter__(self) -> Self:
        if sys.platform == "win32":
            raise MtpBenchError(
                "agents run in processes of their own on Linux and macOS only; use `mtp-bench run`"
            )
        with (
            ExitStack() as undo
        ):  # after an interruption half-way no process is left either
            self._start(undo)
            self._undo = undo.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._undo.close()

    def _start(self, undo: ExitStack) -> None:
        server = (
            server_for(self._spec.layout) if self._sandboxed else None
        )  # outside the agent's time
        self._group = processes.make_group(self._limits.memory, MOST_THREADS)
        undo.callback(self._group.remove)
        if server is None:
            self._spawn(undo)
        else:
            try:
                self._fork(server, undo)
            except (
                ForkServerError,
                OSError,
            ):  # once more: the system may have ended it, such as for lack of memory
                self._fork(server_for(self._spec.layout), undo)
        self.channel = Channel(self._orders, self._answers, self._log, self.most_bytes)

    @contextmanager
    def _pipes(self, undo: ExitStack) -> Iterator[list[int]]:
        """The agent's ends of new pipes: standard input, orders, answers, log, and the one for its exit code."""
        orders, self._orders = os.pipe()
        self._answers, answers = os.pipe()
        self._log, log = os.pipe()
        self._news, news = os.pipe()
        stdin, end = os.pipe()  # not /dev/null, a file that all agents share
        os.close(end)
        for descriptor in (self._orders, self._answers, self._log, self._news):
            undo.callback(os.close, descriptor)
        theirs = [stdin, orders, answers, log, news]
        try:
            yield theirs
        finally:
            for descriptor in theirs:
                os.close(descriptor)

    def _fork(self, server: ForkServer, undo: ExitStack) -> None:
        """Fork it from a process that has loaded the library; a server that fails or was interrupted is discarded."""
        self.begun = time.monotonic()
        try:
            with self._pipes(undo) as theirs, ExitStack() as opened:
                # The fork does not see the files of its control groups, so it gets them open.
                paths = map(Path, self._group.members)
                groups = [
                    opened.enter_context(path.open("wb", buffering=0)).fileno()
                    for path in paths
                ]
                self._pid = server.fork([*theirs, *groups], self._limits.disk)
            self._handle = os.pidfd_open(self._pid)
            if self._ended():
                raise ForkServerError(
                    "an agent process of the sandbox ended as soon as it was started"
                )
        except BaseException:
            discard()
            if self._handle is not None:
                os.close(self._handle)
            self._pid = self._handle = None
            raise
        undo.callback(self._kill)

    def _spawn(self, undo: ExitStack) -> None:
        """Start it without a sandbox; meanwhile the memory of the judge is closed to processes of the same user."""
        folder = undo.enter_context(
            tempfile.TemporaryDirectory(prefix="mtp_bench-agent-")
        )
        self._own_children = {*processes.children(os.getpid())}
        undo.callback(processes.guard, False)
        processes.guard(True)
        self.begun = time.monotonic()
        with self._pipes(undo) as (stdin, orders, answers, log, _), _starting:
            self._spawned = subprocess.Popen(
                [*python(), child_script(), str(orders), str(answers)],
                cwd=folder,
                env=environment(False, folder, str(self._spec.image.networks)),
                stdin=stdin,
                stdout=log,
                stderr=log,
                pass_fds=(orders, answers),
                start_new_session=True,
            )
            undo.callback(self._kill)
            self._pid = self._spawned.pid
            _unsandboxed.add(self._pid)
        with suppress(OSError, AttributeError):  # it ended at once; not on every system
            self._handle = os.pidfd_open(self._pid)

    def setup(self, parameters: dict[str, Any]) -> dict[str, Any]:
        """The first message to the agent's side: paths in its root, and its limits."""
        limits = self._limits
        counted = {
            "AS": limits.memory,
            "FSIZE": limits.disk,
            "NOFILE": 1024,
            "CORE": 0,
            "MSGQUEUE": 0,
        }
        common = {"parameters": parameters, "path": [str(library()), *packages()]}
        if (
            self._sandboxed
        ):  # in its user namespace NPROC counts the agent's processes alone
            counted |= {"NPROC": MOST_THREADS}
            return {
                **common,
                "submission": SUBMISSION,
                "kernels": KERNELS,
                "limits": counted,
                "unsandboxed": None,
            }
        entered = {"judge": os.getpid(), "groups": self._group.members}
        submission = str(self._spec.image.submission)
        return {
            **common,
            "submission": submission,
            "kernels": None,
            "limits": counted,
            "unsandboxed": entered,
        }

    def receive(self, deadline: float) -> Message | None:
        """The next message; None if it is not complete at ``deadline`` (s, of `time.monotonic`).

        Raises WireError for a message that is malformed or longer than allowed, EndedError if the process has ended,
        ExcessError if its processes are too many or hold too much memory.
        """
        while (message := self.channel.whole()) is None:
            now = time.monotonic()
            if now >= deadline:
                return None
            if now >= self._watched + _WATCH_SECONDS:
                self._watch()
                self._watched = time.monotonic()
            if not self.channel.read():
                self.channel.wait(min(deadline, self._watched + _WATCH_SECONDS))
        self._answered = True
        return header_of(message[0]), message[1]

    def others(self) -> int:
        """Number of running processes that it has started."""
        running = (
            [] if self._pid is None or self._ended() else processes.children(self._pid)
        )
        return len(running) + len(self._adopted())

    def _adopted(self) -> list[int]:
        """Processes that unsandboxed agents have started, and whose own parents have ended."""
        if self._spawned is None:  # in a sandbox the agent itself adopts them
            return []
        with _starting:
            return processes.adopted(self._own_children | _unsandboxed)

    def peak_memory(self) -> int:
        """Largest resident memory seen so far, bytes."""
        if self._pid is not None and not self._ended():
            self._peak = max(self._peak, processes.status(self._pid, b"VmHWM") * 1024)
        return self._peak

    def exit_text(self) -> str:
        """Exit status of the process, in words."""
        try:
            code = (
                self._spawned.wait(_EXIT_CODE_SECONDS)
                if self._spawned
                else self._reported_exit_code()
            )
        except (subprocess.TimeoutExpired, ValueError, KeyError):
            return "closed its connection"
        if -code in set(map(int, signal.Signals)):
            return f"was ended by {signal.Signals(-code).name}"
        return f"ended by itself with exit code {code}"

    def _reported_exit_code(self) -> int:
        """Exit code as the parent of a fork reports it; ValueError where the report does not come in time."""
        text, deadline = b"", time.monotonic() + _EXIT_CODE_SECONDS
        while b"}" not in text and processes.ready(
            self._news, deadline - time.monotonic()
        ):
            part = os.read(self._news, 4096)
            if not part:
                break
            text += part
        return int(json.loads(text)["ended"])

    def _watch(self) -> None:
        """Raise ExcessError where the agent's processes together exceed what limits of each process do not bound."""
        if self._pid is None or self._ended():
            return
        self.peak_memory()
        if self._group.exceeded():
            raise ExcessError(
                f"its processes held more than {self._limits.memory >> 20} MiB"
            )
        family = [
            p
            for first in (self._pid, *self._adopted())
            for p in processes.descendants(first, _MOST_PROCESSES)
        ]
        if len(family) > _MOST_PROCESSES:
            raise ExcessError(
                f"it had started {len(family) - 1} other processes, or more"
            )
        threads = sum(processes.status(pid, b"Threads") for pid in family)
        if threads > MOST_THREADS:
            raise ExcessError(
                f"its {len(family)} processes had {threads} threads, expected at most {MOST_THREADS}"
            )
        files = (
            processes.files_below(self._pid, TEMPORARY)
            if self._sandboxed and self._answered
            else 0
        )
        if files > _MOST_FILES:
            raise ExcessError(
                f"it had made {files} files, expected at most {_MOST_FILES}"
            )
        if self._group.folders:
            return  # which bounds their memory
        # Memory that they share may be in no page table now: count all that they could reach.
        memory = processes.memory(self._pid, True) + sum(
            processes.memory(pid, False) for pid in family[1:]
        )
        if memory > self._limits.memory:
            raise ExcessError(
                f"its {len(family)} processes held {memory >> 20} MiB, expected at most {self._limits.memory >> 20} MiB"
            )

    def _ended(self) -> bool:
        """True if the agent's process has ended: its pid may belong to another process."""
        return self._handle is not None and processes.ready(self._handle)

    def _kill(self) -> None:
        """End the agent and all that it started, and wait for it."""
        if self._spawned is not None:
            with suppress(OSError):
                os.killpg(self._spawned.pid, signal.SIGKILL)
            self._spawned.wait()
            deadline = time.monotonic() + _END_SECONDS
            while (
                left := self._adopted()
            ) and time.monotonic() < deadline:  # each round adopts their children
                processes.end(left, deadline - time.monotonic())
            _unsandboxed.discard(self._spawned.pid)
        elif self._handle is not None:
            with suppress(OSError):
                signal.pidfd_send_signal(self._handle, signal.SIGKILL)
            processes.ready(
                self._handle, _END_SECONDS
            )  # the first process of a namespace ends after all others
            while processes.ready(self._news, _END_SECONDS) and os.read(
                self._news, 4096
            ):
                pass  # until its parent, which waits for it, has ended too
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None
