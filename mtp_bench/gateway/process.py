"""The judge's side of the gateway: starts the agent's process, exchanges messages by a deadline, and ends it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import MtpBenchError
from .cgroup import make_group
from .channel import Channel
from .family import children, descendants, end, files_below, hide_memory, mapped, peak_memory, ready, resident, threads
from .filter import system_call_filter
from .image import Image
from .layout import KERNELS, SUBMISSION, TEMPORARY, Layout, environment, library, packages, python
from .limits import Isolation, Limits, Mechanism
from .mechanism import command
from .stems import Stem, StemError, give_up, stem_of, uproot
from .wire import Arrays, header_of

_LAST_WORDS = 2.0  # s until it is known how a process ended
_ENDING = 5.0  # s that the system may take to end a process
_WATCH = 0.1  # s between looks at the agent's processes while they are waited for
_MOST_PROCESSES = 64
_MOST_FILES = 10_000  # in its temporary folder: their names take memory that nothing else counts
MOST_THREADS = 1024  # of all its processes; the system's own limit does not hold for root
Message = tuple[dict[str, Any], bytearray]


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

    def __init__(self, limits: Limits, cell: Cell, most: int) -> None:
        self._peak = 0
        self._limits, self._cell = limits, cell
        self._most = most  # bytes of the body of a message
        self._watched = time.monotonic()
        self._answered = False  # once it has, it runs in its own root
        self._process: subprocess.Popen[bytes] | None = None  # that was started for it; None: it is a fork of a stem
        self._pid: int | None = None  # of the process with the agent, which the one that was started may not be
        self._handle: int | None = None

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
        stem = stem_of(self._cell.layout) if self._cell.way == "bubblewrap" else None  # not in the agent's time
        self._group = make_group(self._limits.memory, MOST_THREADS)
        if self._group is not None:
            made.callback(self._group.remove)
        self._folder = None
        if not self._isolated:  # the agent could read this process's memory
            self._folder = made.enter_context(tempfile.TemporaryDirectory(prefix="mtp_bench-agent-"))
            made.callback(hide_memory, False)
            hide_memory(True)
        if stem is None or not self._grow(stem, made):
            self._spawn(made)
        self._channel = Channel(self._orders, self._answers, self._log, self._most)

    @contextmanager
    def _pipes(self, made: ExitStack) -> Iterator[list[int]]:
        """The other side's ends of new pipes: standard input, orders, answers, log, and where news go."""
        orders, self._orders = os.pipe()
        self._answers, answers = os.pipe()
        self._log, log = os.pipe()
        self._told, tell = os.pipe()
        nothing, end_of_it = os.pipe()  # not /dev/null: that file is everybody's
        os.close(end_of_it)
        for descriptor in (self._orders, self._answers, self._log, self._told):
            made.callback(os.close, descriptor)
        theirs = [nothing, orders, answers, log, tell]
        try:
            yield theirs
        finally:
            for descriptor in theirs:
                os.close(descriptor)

    def _grow(self, stem: Stem, made: ExitStack) -> bool:
        """Start it as a fork of a process that has loaded the library; whether that worked."""
        self.begun = time.monotonic()
        try:
            with self._pipes(made) as theirs, self._open_doors() as doors:
                self._pid = stem.grow([*theirs, *doors], self._limits.disk)
            self._handle = os.pidfd_open(self._pid)
            if self._gone():
                raise StemError("it ended at once")
        except (StemError, OSError):
            give_up(self._cell.layout)  # and what it grew
            self._forget()
            return False
        except BaseException:  # interrupted: what it says next would be of this fork
            uproot()
            self._forget()
            raise
        made.callback(self._kill)
        return True

    @contextmanager
    def _open_doors(self) -> Iterator[list[int]]:
        """Of the control groups, which a fork enters itself: it does not see their files."""
        with ExitStack() as opened:
            doors = [] if self._group is None else self._group.doors
            yield [opened.enter_context(Path(door).open("wb", buffering=0)).fileno() for door in doors]

    def _forget(self) -> None:
        """Hold nothing of a process that is not the agent's after all."""
        if self._handle is not None:
            os.close(self._handle)
        self._pid = self._handle = None

    def _spawn(self, made: ExitStack) -> None:
        """Start it as a process that loads the library itself, with pipes that no fork holds."""
        self.begun = time.monotonic()
        with self._pipes(made) as theirs:
            self._start_alone(theirs, made)
        self._learn_number()  # once their ends are closed: where nobody is left to tell it, that shows at once

    def _start_alone(self, theirs: list[int], made: ExitStack) -> None:
        nothing, orders, answers, log, tell = theirs
        rules, write = os.pipe()  # a pipe holds more than the filter is long
        os.write(write, system_call_filter() or b"")
        os.close(write)
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
            os.close(rules)

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
        program = [*python(), child, str(orders), str(answers)]
        doors = [] if self._group is None else self._group.doors
        private = {TEMPORARY: self._limits.disk}
        return command(self._cell.way, self._cell.layout, program, private, tell, rules, (orders, answers), doors)

    def _learn_number(self) -> None:
        """The number of the process with the agent, which whoever shuts it in tells."""
        with suppress(ValueError, KeyError, OSError, AttributeError):
            self._pid = int(self._news(self._limits.start)["child-pid"])
            self._handle = os.pidfd_open(self._pid)  # a handle: the number may be given to another process

    def _news(self, seconds: float) -> dict[str, Any]:
        """What whoever shuts it in tells; raises ValueError where nothing comes in time."""
        text, deadline = b"", time.monotonic() + seconds
        while b"}" not in text and ready(self._told, deadline - time.monotonic()):
            part = os.read(self._told, 4096)
            if not part:
                break
            text += part
        found: dict[str, Any] = json.loads(text)
        return found

    def send(self, header: dict[str, Any], arrays: Arrays | None = None) -> None:
        """Queue a message; it is written as far as the agent reads, now and while `receive` waits."""
        self._channel.send(header, arrays)

    def receive(self, deadline: float) -> Message | None:
        """The next message, None if it is not whole at ``deadline`` (s, of `time.monotonic`).

        Raises WireError for what is no message or longer than allowed, EndedError if the process is gone, ExcessError
        if there are too many, or they hold more memory than is allowed.
        """
        while (message := self._channel.whole()) is None:
            now = time.monotonic()
            if now >= deadline:
                return None
            if now >= self._watched + _WATCH:
                self._watch()
                self._watched = time.monotonic()
            if not self._channel.read():
                self._channel.wait(min(deadline, self._watched + _WATCH))
        self._answered = True
        return header_of(message[0]), message[1]

    def others(self) -> int:
        """How many processes it has started that are still there."""
        return 0 if self._pid is None or self._gone() else len(children(self._pid))

    def peak_memory(self) -> int:
        """Bytes of it that were resident at most, as far as was seen before it ended."""
        if self._pid is not None and not self._gone():
            self._peak = max(self._peak, peak_memory(self._pid))
        return self._peak

    def printed(self) -> str:
        """The last line of what the agent printed first, for an error text."""
        return self._channel.printed()

    def end(self) -> str:
        """How the process ended, in words."""
        try:
            code = self._process.wait(_LAST_WORDS) if self._process else int(self._news(_LAST_WORDS)["ended"])
        except (subprocess.TimeoutExpired, ValueError, KeyError):
            return "closed its connection"
        ended = -code if code < 0 else code - 128  # those who shut it in report a signal as 128 + its number
        if ended in set(map(int, signal.Signals)):
            return f"was ended by {signal.Signals(ended).name}"
        return f"ended by itself with exit code {code}"

    def _watch(self) -> None:
        """See that a process that starts others does not take the machine; the limits of the system hold for each."""
        if self._pid is None or self._gone():
            return
        self.peak_memory()
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
        if self._group is not None:
            return  # which counts their memory
        # What the others hold together may be in the page tables of none: count all that they could reach.
        memory = resident(self._pid) + sum(map(mapped, family[1:]))
        if memory > self._limits.memory:
            raise ExcessError(
                f"its {len(family)} processes held {memory >> 20} MiB, of {self._limits.memory >> 20} MiB"
            )

    def _gone(self) -> bool:
        """Whether the agent's process has ended: then its number may be another's."""
        return self._handle is not None and ready(self._handle)

    def _kill(self) -> None:
        """End the agent and all that it started, and wait for it."""
        if self._pid is not None:
            for _ in range(0 if self._isolated or self._gone() else 2):  # some may have started others meanwhile
                end(descendants(self._pid)[1:], _ENDING)
            with suppress(OSError):
                self._end_agent(self._pid)
        if self._process is not None:
            with suppress(OSError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None

    def _end_agent(self, pid: int) -> None:
        if self._handle is None:  # the process that was started is the agent
            if self._process is not None and self._process.poll() is None:
                os.kill(pid, signal.SIGKILL)
            return
        signal.pidfd_send_signal(self._handle, signal.SIGKILL)
        ready(self._handle, _ENDING)  # the first process of a namespace ends after all others
        if self._process is None:
            while ready(self._told, _ENDING) and os.read(self._told, 4096):
                pass  # until the process that waited for it is gone too
