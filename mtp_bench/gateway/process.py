"""The judge's side of the gateway: starts the agent's process, exchanges messages by a deadline, and ends it."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections import deque
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import Any

from ..errors import MtpBenchError
from .cgroup import make_group
from .family import children, descendants, end, files_below, hide_memory, mapped, peak_memory, resident, threads
from .filter import system_call_filter
from .image import Image
from .layout import KERNELS, SUBMISSION, TEMPORARY, Layout, environment, interpreter, library, packages
from .limits import Isolation, Limits
from .mechanism import Mechanism, command
from .wire import HEADER_LIMIT, PREFIX, Arrays, WireError, encode, header_of

_KEPT = 4096  # bytes of what the agent prints
_ENDING = 5.0  # s that the system may take to end a process
_WATCH = 0.1  # s between looks at the agent's processes while they are waited for
_MOST_PROCESSES = 64
_MOST_FILES = 10_000  # in its temporary folder: their names take memory that nothing else counts
MOST_THREADS = 1024  # of all its processes; the system's own limit does not hold for root
_PIPE = 1 << 20  # bytes that a pipe holds, where the system allows it
Message = tuple[dict[str, Any], bytes]


class EndedError(Exception):
    """The agent's process is gone."""


class ExcessError(Exception):
    """The agent's processes are too many, or hold too much memory."""


@dataclass(frozen=True)
class Cell:
    """What an agent's process is shut in with."""

    layout: Layout
    image: Image
    way: Mechanism


class AgentProcess:
    """A process that holds one agent. Use it in a ``with`` statement: at the end nothing of it is left."""

    def __init__(self, limits: Limits, cell: Cell, most: int | None = None) -> None:
        self.peak_memory = 0
        self._limits, self._cell = limits, cell
        self._most = limits.answer if most is None else most  # bytes of the body of a message
        self._watched = time.monotonic()
        self._answered = False  # once it has, it runs in its own root
        self._outgoing: deque[memoryview] = deque()
        self._printed = bytearray()
        self._pid: int | None = None  # of the process with the agent, which the one that was started may not be
        self._handle: int | None = None
        self._incoming = bytearray()  # grows to `_wanted` bytes: first the prefix, then header and body
        self._wanted = PREFIX.size
        self._lengths: tuple[int, int] | None = None

    @property
    def isolation(self) -> Isolation:
        """What holds the agent."""
        return Isolation(self._cell.way, "watch" if self._group is None else "cgroup")

    def __enter__(self) -> AgentProcess:
        if sys.platform == "win32":
            raise MtpBenchError(
                "agents run in processes of their own on Linux and macOS only; use `mtp-bench run` here"
            )
        with ExitStack() as made:  # after an interruption in the middle of it nothing is left either
            self._start(made)
            self._made = made.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._made.close()

    def _start(self, made: ExitStack) -> None:
        """Start the process; ``made`` undoes it."""
        self.begun = time.monotonic()
        self._group = make_group(self._limits.memory, MOST_THREADS)
        if self._group is not None:
            made.callback(self._group.remove)
        self._folder = None
        if not self._isolated:  # the agent could read this process's memory
            self._folder = made.enter_context(tempfile.TemporaryDirectory(prefix="mtp_bench-agent-"))
            made.callback(hide_memory, False)
            hide_memory(True)
        orders, self._orders = os.pipe()
        self._answers, answers = os.pipe()
        self._log, log = os.pipe()
        told, tell = os.pipe()
        rules, write = os.pipe()  # a pipe holds more than the filter is long
        os.write(write, system_call_filter() or b"")
        nothing, end_of_it = os.pipe()  # not /dev/null: that file is everybody's
        for descriptor in (self._orders, self._answers, self._log):
            made.callback(os.close, descriptor)
        for descriptor in (write, end_of_it):
            os.close(descriptor)
        try:
            self._process = subprocess.Popen(
                self._command(orders, answers, tell, rules),
                cwd=self._folder or "/",
                env=environment(self._isolated, *self._places),
                stdin=nothing,
                stdout=log,
                stderr=log,
                pass_fds=(orders, answers, tell, rules),
                start_new_session=True,
            )
            made.callback(self._kill)
        finally:
            for descriptor in (orders, answers, log, tell, rules, nothing):
                os.close(descriptor)
        self._learn_number(told)
        for descriptor in (self._orders, self._answers, self._log):
            os.set_blocking(descriptor, False)
            _widen(descriptor)
        self._poll = select.poll()
        self._poll.register(self._answers, select.POLLIN)
        self._poll.register(self._log, select.POLLIN)

    def setup(self, parameters: dict[str, Any]) -> dict[str, Any]:
        """The first message to the agent's side: where things are there, and its limits."""
        limits = self._limits
        counted = {} if limits.cuda else {"AS": limits.memory}  # drivers map far more than they use
        return {
            "submission": SUBMISSION if self._isolated else str(self._cell.image.submission),
            "parameters": parameters,
            "path": [str(library()), *packages()],
            "kernels": KERNELS if self._isolated else None,
            "limits": {**counted, "FSIZE": limits.disk, "NOFILE": 1024, "CORE": 0, "MSGQUEUE": 0}
            | ({"NPROC": MOST_THREADS} if self._isolated else {}),  # elsewhere the user's other processes count too
        }

    @property
    def _isolated(self) -> bool:
        return self._cell.way != "none"

    @property
    def _places(self) -> tuple[str, ...]:
        """Temporary folder and weights, where it has no root of its own."""
        return () if self._folder is None else (self._folder, str(self._cell.image.networks))

    def _command(self, orders: int, answers: int, tell: int, rules: int) -> list[str]:
        child = str(library() / "mtp_bench" / "gateway" / "child.py")
        program = [str(interpreter()), "-I", "-S", "-B", child, str(orders), str(answers)]
        doors = [] if self._group is None else self._group.doors
        private = {TEMPORARY: self._limits.disk}
        return command(self._cell.way, self._cell.layout, program, private, tell, rules, (orders, answers), doors)

    def _learn_number(self, told: int) -> None:
        """The number of the process with the agent, which whoever shuts it in tells."""
        text = b""
        with os.fdopen(told, "rb", buffering=0) as stream:
            while b"}" not in text and select.select([stream], [], [], self._limits.start)[0]:
                part = stream.read(4096)
                if not part:
                    break
                text += part
        with suppress(ValueError, KeyError, OSError, AttributeError):
            self._pid = int(json.loads(text)["child-pid"])
            self._handle = os.pidfd_open(self._pid)  # a handle: the number may be given to another process

    def send(self, header: dict[str, Any], arrays: Arrays | None = None) -> None:
        """Queue a message; it is written as far as the agent reads, now and while `receive` waits."""
        self._outgoing.extend(memoryview(part) for part in encode(header, arrays) if len(part))
        self._write()

    def receive(self, deadline: float) -> Message | None:
        """The next message, None if it is not whole at ``deadline`` (s, of `time.monotonic`).

        Raises WireError for what is no message or longer than allowed, EndedError if the process is gone, ExcessError
        if there are too many, or they hold more memory than is allowed.
        """
        while (message := self._whole()) is None:
            now = time.monotonic()
            if now >= deadline:
                return None
            if now >= self._watched + _WATCH:
                self._watch()
                self._watched = time.monotonic()
            if not self._read():
                self._wait(min(deadline, self._watched + _WATCH))
        self._answered = True
        return header_of(message[0]), message[1]

    def others(self) -> int:
        """Look at the process: its memory, and how many processes it has started that are still there."""
        if self._pid is None or self._gone():
            return 0
        self.peak_memory = max(self.peak_memory, peak_memory(self._pid))
        return len(children(self._pid))

    def printed(self) -> str:
        """The last line of what the agent printed first, for an error text."""
        self._read_log()
        lines = self._printed.decode(errors="replace").split("\n")
        return next((line.strip()[:200] for line in reversed(lines) if line.strip()), "")

    def end(self) -> str:
        """How the process ended, in words."""
        try:
            code = self._process.wait(timeout=2.0)
        except subprocess.TimeoutExpired:
            return "closed its connection"
        ended = -code if code < 0 else code - 128  # those who shut it in report a signal as 128 + its number
        if ended in set(map(int, signal.Signals)):
            return f"was ended by {signal.Signals(ended).name}"
        return f"ended by itself with exit code {code}"

    def _whole(self) -> tuple[bytes, bytes] | None:
        """Header and body of the message that is being read, once it is complete."""
        if self._lengths is None and len(self._incoming) == PREFIX.size:
            header, body = PREFIX.unpack(self._incoming)
            if header > HEADER_LIMIT or body > self._most:
                raise WireError(f"it announced a message of {header} + {body} bytes")
            self._lengths, self._wanted, self._incoming = (header, body), header + body, bytearray()
        if self._lengths is None or len(self._incoming) < self._wanted:
            return None
        whole, (header, _) = memoryview(self._incoming), self._lengths
        self._lengths, self._wanted, self._incoming = None, PREFIX.size, bytearray()
        return bytes(whole[:header]), bytes(whole[header:])

    def _watch(self) -> None:
        """See that a process that starts others does not take the machine; the limits of the system hold for each."""
        if self._pid is None or self._gone():
            return
        if self._group is not None and self._group.exceeded():
            raise ExcessError(f"its processes held more than {self._limits.memory >> 20} MiB")
        family = descendants(self._pid, _MOST_PROCESSES)
        if len(family) > _MOST_PROCESSES:
            raise ExcessError(f"it had started {len(family) - 1} other processes, or more")
        count = sum(map(threads, family))
        if count > MOST_THREADS:
            raise ExcessError(f"its {len(family)} processes had {count} threads, of {MOST_THREADS}")
        names = files_below(self._pid, TEMPORARY) if self._isolated and self._answered else 0
        if names > _MOST_FILES:
            raise ExcessError(f"it had made {names} files, of {_MOST_FILES}")
        # What the others hold together may be in the page tables of none: count all that they could reach.
        memory = resident(self._pid) + sum(map(mapped, family[1:]))
        if memory > self._limits.memory:
            raise ExcessError(
                f"its {len(family)} processes held {memory >> 20} MiB, of {self._limits.memory >> 20} MiB"
            )

    def _read(self) -> bool:
        """Read what is there; whether anything was."""
        if len(self._incoming) == self._wanted:  # a message of no bytes
            raise WireError("an empty message")
        try:
            found = os.read(self._answers, min(self._wanted - len(self._incoming), _PIPE))
        except BlockingIOError:
            return False
        if not found:
            raise EndedError
        self._incoming += found
        return True

    def _wait(self, deadline: float) -> None:
        """Wait for something to read or to write, at most until the deadline."""
        if self._outgoing:
            self._poll.register(self._orders, select.POLLOUT)
        left = max(0.0, deadline - time.monotonic())
        ready = dict(self._poll.poll(left * 1000))
        if self._outgoing:
            self._poll.unregister(self._orders)
        if self._orders in ready:
            self._write()
        if self._log in ready:
            self._read_log()

    def _write(self) -> None:
        while self._outgoing:
            try:
                count = os.write(self._orders, self._outgoing[0])
            except BlockingIOError:
                return
            except BrokenPipeError:  # the end shows when its answer is read
                self._outgoing.clear()
                return
            part = self._outgoing.popleft()
            if count < len(part):
                self._outgoing.appendleft(part[count:])

    def _read_log(self) -> None:
        with suppress(BlockingIOError):
            for _ in range(16):  # what an agent prints must not keep the judge busy
                found = os.read(self._log, 1 << 16)
                self._printed += found[: _KEPT - len(self._printed)]
                if not found:
                    with suppress(KeyError):
                        self._poll.unregister(self._log)
                    return

    def _gone(self) -> bool:
        """Whether the agent's process has ended: then its number may be another's."""
        return self._handle is not None and bool(select.select([self._handle], [], [], 0)[0])

    def _kill(self) -> None:
        """End the agent and all that it started, and wait for it."""
        if self._pid is not None:
            for _ in range(0 if self._isolated or self._gone() else 2):  # some may have started others meanwhile
                end(descendants(self._pid)[1:], _ENDING)
            with suppress(OSError):
                self._end_agent(self._pid)
        with suppress(OSError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None

    def _end_agent(self, pid: int) -> None:
        if self._handle is None:  # the process that was started is the agent
            if self._process.poll() is None:
                os.kill(pid, signal.SIGKILL)
            return
        signal.pidfd_send_signal(self._handle, signal.SIGKILL)
        gone = select.poll()
        gone.register(self._handle, select.POLLIN)
        gone.poll(1000 * _ENDING)  # the first process of a namespace ends after all others


def _widen(descriptor: int) -> None:
    with suppress(ImportError, AttributeError, OSError):
        import fcntl

        fcntl.fcntl(descriptor, fcntl.F_SETPIPE_SZ, _PIPE)
