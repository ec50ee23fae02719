"""Messages over the pipes to and from an agent, and its output."""

import os
import select
import time
from collections import deque
from contextlib import suppress

from .wire import HEADER_LIMIT, PREFIX, Arrays, WireError, encode

_KEPT = 4096  # bytes of the agent's output
_PIPE = 1 << 20  # bytes of a pipe's buffer, if the system allows it


class EndedError(Exception):
    """The agent has closed its pipe."""


class Channel:
    """The judge's ends of three pipes: orders, answers and log. Only `wait` blocks."""

    def __init__(self, orders: int, answers: int, log: int, most: int) -> None:
        """``most``: bytes of the body of an answer."""
        self._orders, self._answers, self._log, self._most = orders, answers, log, most
        self._outgoing: deque[memoryview] = deque()
        self._printed = bytearray()
        self._incoming = (
            bytearray()
        )  # grows to `_wanted` bytes: first the prefix, then header and body
        self._wanted = PREFIX.size
        self._lengths: tuple[int, int] | None = None
        for descriptor in (orders, answers, log):
            os.set_blocking(descriptor, False)
            with suppress(ImportError, AttributeError, OSError):
                import fcntl

                fcntl.fcntl(descriptor, fcntl.F_SETPIPE_SZ, _PIPE)
        self._poll = select.poll()
        self._poll.register(answers, select.POLLIN)
        self._poll.register(log, select.POLLIN)

    def send(self, header: dict[str, object], arrays: Arrays | None = None) -> None:
        """Queue a message; it is written as far as the agent reads, now and in `wait`."""
        self._outgoing.append(memoryview(encode(header, arrays)))
        self._write()

    def whole(self) -> tuple[bytearray, bytearray] | None:
        """Header and body of the message that is being read, once it is complete; the caller owns both.

        Raises WireError for one that is longer than allowed, before memory is allocated for it.
        """
        if self._lengths is None and len(self._incoming) == PREFIX.size:
            header, body = PREFIX.unpack(self._incoming)
            if header > HEADER_LIMIT or body > self._most:
                raise WireError(f"it announced a message of {header} + {body} bytes")
            self._lengths, self._wanted, self._incoming = (
                (header, body),
                header + body,
                bytearray(),
            )
        if self._lengths is None or len(self._incoming) < self._wanted:
            return None
        whole, (header, _) = self._incoming, self._lengths
        self._lengths, self._wanted, self._incoming = None, PREFIX.size, bytearray()
        return whole[:header], whole[header:]

    def read(self) -> bool:
        """Read what has arrived; False if nothing has. Raises EndedError, and WireError for an empty message."""
        if len(self._incoming) == self._wanted:  # a message of no bytes
            raise WireError("an empty message")
        try:
            part = os.read(
                self._answers, min(self._wanted - len(self._incoming), _PIPE)
            )
        except BlockingIOError:
            return False
        if not part:
            raise EndedError
        self._incoming += part
        return True

    def wait(self, deadline: float) -> None:
        """Wait until a pipe can be read or written, at most until the deadline (s, of `time.monotonic`)."""
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

    def printed(self) -> str:
        """The last line of the first output of the agent, for an error message."""
        self._read_log()
        lines = self._printed.decode(errors="replace").split("\n")
        return next(
            (line.strip()[:200] for line in reversed(lines) if line.strip()), ""
        )

    def _write(self) -> None:
        while self._outgoing:
            try:
                count = os.write(self._orders, self._outgoing[0])
            except BlockingIOError:
                return
            except BrokenPipeError:  # reading its answer shows that it ended
                self._outgoing.clear()
                return
            part = self._outgoing.popleft()
            if count < len(part):
                self._outgoing.appendleft(part[count:])

    def _read_log(self) -> None:
        with suppress(BlockingIOError):
            for _ in range(
                16
            ):  # an agent that prints much must not keep the judge busy
                part = os.read(self._log, 1 << 16)
                self._printed += part[: _KEPT - len(self._printed)]
                if not part:
                    with suppress(KeyError):
                        self._poll.unregister(self._log)
                    return
