"""Judge's side of an agent process: start, messages by a deadline, and end."""

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
_MAX_PROCESSES = 64
_MAX_OPEN_FILES = 1024  # of each
# most files in its temporary folder: their names take memory that no limit counts
_MAX_FILES = 10_000
# most threads in all its processes; the system's own limit does not hold for root
MAX_THREADS = 1024
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
    """A process with one agent.

    Use it in a ``with`` statement: at the end no process of the agent is left.
    """

    def __init__(self, limits: Limits, spec: SandboxSpec, most_bytes: int) -> None:
        """Prepare a process.

        ``most_bytes`` limits the body of a message.
        """
        self._limits = limits
        self._spec = spec
        self.most_bytes = most_bytes
        self._sandboxed = spec.backend != "none"
        self._peak = 0
        self._watched_at = time.monotonic()  # last check of its processes
        self._answered = False  # after its first message it runs in its own root
        # without a sandbox; None: a fork of a fork server
        self._spawned: subprocess.Popen[bytes] | None = None
        self._pid: int | None = None
        # handle of the process, since its pid may be given to another one
        self._handle: int | None = None

    @property
    def isolation(self) -> Isolation:
        """Sandbox of the process."""
        return Isolation(
            mechanism=self._spec.backend,
            memory="cgroup" if self._group.folders else "watch",
        )

    def __enter__(self) -> Self:
        if sys.platform == "win32":
            raise MtpBenchError(
                "agents run in processes of their own on Linux and macOS only; use `mtp-bench run`"
            )
        # after an interruption half-way no process is left either
        with ExitStack() as undo:
            self._start(undo)
            self._undo = undo.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._undo.close()

    def _start(self, undo: ExitStack) -> None:
        server = None
        if self._sandboxed:  # outside the agent's time
            server = server_for(self._spec.layout)
        self._group = processes.make_group(self._limits.memory, MAX_THREADS)
        undo.callback(self._group.remove)
        if server is None:
            self._spawn(undo)
        else:
            try:
                self._fork(server, undo)
            except (ForkServerError, OSError):
                # once more: the system may have ended it, such as for lack of memory
                self._fork(server_for(self._spec.layout), undo)
        self.channel = Channel(self._orders, self._answers, self._log, self.most_bytes)

    @contextmanager
    def _pipes(self, undo: ExitStack) -> Iterator[list[int]]:
        """Yield the agent's ends of new pipes.

        They are standard input, orders, answers, log, and the one for its exit code.
        """
        orders, self._orders = os.pipe()
        self._answers, answers = os.pipe()
        self._log, log = os.pipe()
        self._exit_report, exit_report = os.pipe()
        stdin, end = os.pipe()  # not /dev/null, a file that all agents share
        os.close(end)
        for descriptor in (self._orders, self._answers, self._log, self._exit_report):
            undo.callback(os.close, descriptor)
        theirs = [stdin, orders, answers, log, exit_report]
        try:
            yield theirs
        finally:
            for descriptor in theirs:
                os.close(descriptor)

    def _fork(self, server: ForkServer, undo: ExitStack) -> None:
        """Fork the agent's process from one that has loaded the library.

        A server that fails or was interrupted is discarded.
        """
        self.begun = time.monotonic()
        try:
            with self._pipes(undo) as theirs, ExitStack() as opened:
                # The fork does not see the files of its control groups, so it gets them
                # open.
                descriptors = list(theirs)
                for path in map(Path, self._group.members):
                    group = opened.enter_context(path.open("wb", buffering=0))
                    descriptors.append(group.fileno())
                self._pid = server.fork(descriptors, self._limits.disk)
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
        """Start the agent's process without a sandbox.

        Meanwhile the memory of the judge is closed to processes of the same user.
        """
        folder = undo.enter_context(
            tempfile.TemporaryDirectory(prefix="mtp_bench-agent-")
        )
        # children of the judge before, which are not the agent's
        self._own_children = {*processes.children(os.getpid())}
        undo.callback(processes.guard, on=False)
        processes.guard(on=True)
        self.begun = time.monotonic()
        with self._pipes(undo) as (stdin, orders, answers, log, _), _starting:
            self._spawned = subprocess.Popen(
                [*python(), child_script(), str(orders), str(answers)],
                cwd=folder,
                env=environment(
                    isolated=False,
                    work=folder,
                    networks=str(self._spec.image.networks),
                ),
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
        """Return the first message to the agent's side."""
        limits = self._limits
        system_limits = {
            "AS": limits.memory,
            "FSIZE": limits.disk,
            "NOFILE": _MAX_OPEN_FILES,
            "CORE": 0,
            "MSGQUEUE": 0,
        }
        setup: dict[str, Any] = {
            "parameters": parameters,
            "path": [str(library()), *packages()],
            "limits": system_limits,
        }
        if self._sandboxed:
            # in its user namespace NPROC counts the agent's processes alone
            system_limits["NPROC"] = MAX_THREADS
            return setup | {
                "submission": SUBMISSION,
                "kernels": KERNELS,
                "unsandboxed": None,
            }
        return setup | {
            "submission": str(self._spec.image.submission),
            "kernels": None,
            "unsandboxed": {"judge": os.getpid(), "groups": self._group.members},
        }

    def receive(self, deadline: float) -> Message | None:
        """Return the next message.

        None if it is not complete at ``deadline``.
        The deadline is in s, of `time.monotonic`. Raises WireError for a message that
        is malformed or longer than allowed, EndedError if the process has ended,
        ExcessError if its processes are too many or hold too much memory.
        """
        while (message := self.channel.take_message()) is None:
            now = time.monotonic()
            if now >= deadline:
                return None
            if now >= self._watched_at + _WATCH_SECONDS:
                self._watch()
                self._watched_at = time.monotonic()
            if not self.channel.read():
                self.channel.wait(min(deadline, self._watched_at + _WATCH_SECONDS))
        self._answered = True
        return header_of(message[0]), message[1]

    def count_started(self) -> int:
        """Count the running processes that the agent has started."""
        count = len(self._adopted())
        if self._pid is not None and not self._ended():
            count += len(processes.children(self._pid))
        return count

    def _adopted(self) -> list[int]:
        """Return processes of unsandboxed agents whose own parents have ended."""
        if self._spawned is None:  # in a sandbox the agent itself adopts them
            return []
        with _starting:
            return processes.adopted(self._own_children | _unsandboxed)

    def peak_memory(self) -> int:
        """Return the largest resident memory seen so far, bytes."""
        if self._pid is not None and not self._ended():
            peak_kib = processes.status(self._pid, b"VmHWM")
            self._peak = max(self._peak, 1024 * peak_kib)
        return self._peak

    def exit_text(self) -> str:
        """Describe the exit status of the process."""
        try:
            if self._spawned:
                code = self._spawned.wait(_EXIT_CODE_SECONDS)
            else:
                code = self._reported_exit_code()
        except (subprocess.TimeoutExpired, ValueError, KeyError):
            return "closed its connection"
        # the code of a process that a signal ended is its number below 0
        if -code in set(map(int, signal.Signals)):
            return f"was ended by {signal.Signals(-code).name}"
        return f"ended by itself with exit code {code}"

    def _reported_exit_code(self) -> int:
        """Return the exit code as the parent of a fork reports it.

        Raises ValueError where the report does not come in time.
        """
        text = b""
        deadline = time.monotonic() + _EXIT_CODE_SECONDS
        while b"}" not in text and processes.ready(
            self._exit_report, deadline - time.monotonic()
        ):
            part = os.read(self._exit_report, 4096)
            if not part:
                break
            text += part
        return int(json.loads(text)["ended"])

    def _watch(self) -> None:
        """Raise ExcessError where the agent's processes together exceed a limit.

        These are the limits that those of each process do not bound.
        """
        if self._pid is None or self._ended():
            return
        self.peak_memory()
        if self._group.exceeded():
            raise ExcessError(
                f"its processes held more than {self._limits.memory >> 20} MiB"
            )
        family: list[int] = []
        for ancestor in (self._pid, *self._adopted()):
            family += processes.descendants(ancestor, _MAX_PROCESSES)
        if len(family) > _MAX_PROCESSES:
            raise ExcessError(
                f"it had started {len(family) - 1} other processes, or more"
            )
        threads = sum(processes.status(pid, b"Threads") for pid in family)
        if threads > MAX_THREADS:
            raise ExcessError(
                f"its {len(family)} processes had {threads} threads, "
                f"expected at most {MAX_THREADS}"
            )
        self._watch_files(self._pid)
        if not self._group.folders:  # they bound the memory of its processes
            self._watch_memory(self._pid, family)

    def _watch_files(self, pid: int) -> None:
        files = 0
        if self._sandboxed and self._answered:
            files = processes.files_below(pid, TEMPORARY)
        if files > _MAX_FILES:
            raise ExcessError(
                f"it had made {files} files, expected at most {_MAX_FILES}"
            )

    def _watch_memory(self, agent: int, family: list[int]) -> None:
        # memory that the others share with it may be in no page table now: of them all
        # that they could reach is counted
        memory = processes.memory(agent, resident=True)
        memory += sum(processes.memory(pid, resident=False) for pid in family[1:])
        if memory > self._limits.memory:
            raise ExcessError(
                f"its {len(family)} processes held {memory >> 20} MiB, "
                f"expected at most {self._limits.memory >> 20} MiB"
            )

    def _ended(self) -> bool:
        """Return True if the agent's process has ended.

        Its pid may belong to another process then.
        """
        return self._handle is not None and processes.ready(self._handle)

    def _kill(self) -> None:
        """End the agent and all that it started, and wait for it."""
        if self._spawned is not None:
            with suppress(OSError):
                os.killpg(self._spawned.pid, signal.SIGKILL)
            self._spawned.wait()
            deadline = time.monotonic() + _END_SECONDS
            # each round adopts their children
            while (pids := self._adopted()) and time.monotonic() < deadline:
                processes.end(pids, deadline - time.monotonic())
            _unsandboxed.discard(self._spawned.pid)
        elif self._handle is not None:
            with suppress(OSError):
                signal.pidfd_send_signal(self._handle, signal.SIGKILL)
            # the first process of a namespace ends after all others
            processes.ready(self._handle, _END_SECONDS)
            while processes.ready(self._exit_report, _END_SECONDS) and os.read(
                self._exit_report, 4096
            ):
                pass  # until its parent, which waits for it, has ended too
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None
