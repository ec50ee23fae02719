"""Messages over the pipes to and from an agent, and its output."""

import os
import select
import time
from collections import deque
from contextlib import suppress

from .wire import HEADER_LIMIT, PREFIX, Arrays, WireError, encode

_MAX_OUTPUT_BYTES = 4096  # of the agent's output that are kept
_PIPE_BYTES = 1 << 20  # of a pipe's buffer, if the system allows it
_LOG_READS = 16  # at once: an agent that prints much must not keep the judge busy
_LOG_PART_BYTES = 1 << 16  # of one of these reads
_MAX_LINE = 200  # characters of the agent's output in an error message


class EndedError(Exception):
    """The agent has closed its pipe."""


class Channel:
    """Judge's ends of three pipes: orders, answers and log. Only `wait` blocks."""

    def __init__(self, orders: int, answers: int, log: int, max_body: int) -> None:
        """Take over the descriptors. ``max_body``: bytes of the body of an answer."""
        self._orders = orders
        self._answers = answers
        self._log = log
        self._max_body = max_body
        self._outgoing: deque[memoryview] = deque()
        self._printed = bytearray()
        # grows to `_expected` bytes: first the prefix, then header and body
        self._incoming = bytearray()
        self._expected = PREFIX.size
        self._lengths: tuple[int, int] | None = None
        for descriptor in (orders, answers, log):
            os.set_blocking(descriptor, False)
            with suppress(ImportError, AttributeError, OSError):
                import fcntl

                fcntl.fcntl(descriptor, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        self._poll = select.poll()
        self._poll.register(answers, select.POLLIN)
        self._poll.register(log, select.POLLIN)

    def send(self, header: dict[str, object], arrays: Arrays | None = None) -> None:
        """Queue a message.

        It is written as far as the agent reads, now and in `wait`.
        """
        self._outgoing.append(memoryview(encode(header, arrays)))
        self._write()

    def take_message(self) -> tuple[bytearray, bytearray] | None:
        """Return header and body of the message that is read, once complete.

        The caller owns both. Raises WireError for one that is longer than allowed,
        before memory is allocated for it.
        """
        if self._lengths is None and len(self._incoming) == PREFIX.size:
            header_bytes, body_bytes = PREFIX.unpack(self._incoming)
            if header_bytes > HEADER_LIMIT or body_bytes > self._max_body:
                raise WireError(
                    f"it announced a message of {header_bytes} + {body_bytes} bytes"
                )
            self._lengths = header_bytes, body_bytes
            self._expected = header_bytes + body_bytes
            self._incoming = bytearray()
        if self._lengths is None or len(self._incoming) < self._expected:
            return None
        message = self._incoming
        header_bytes, _ = self._lengths
        self._lengths = None
        self._expected = PREFIX.size
        self._incoming = bytearray()
        return message[:header_bytes], message[header_bytes:]

    def read(self) -> bool:
        """Read what has arrived.

        Return False if nothing has.
        Raises EndedError, and WireError for an empty message.
        """
        missing = self._expected - len(self._incoming)
        if not missing:  # a message of no bytes
            raise WireError("an empty message")
        try:
            part = os.read(self._answers, min(missing, _PIPE_BYTES))
        except BlockingIOError:
            return False
        if not part:
            raise EndedError
        self._incoming += part
        return True

    def wait(self, deadline: float) -> None:
        """Wait until a pipe is ready, at most until ``deadline``.

        The deadline is in s, of `time.monotonic`.
        """
        if self._outgoing:
            self._poll.register(self._orders, select.POLLOUT)
        seconds = max(0.0, deadline - time.monotonic())
        ready = dict(self._poll.poll(seconds * 1000))
        if self._outgoing:
            self._poll.unregister(self._orders)
        if self._orders in ready:
            self._write()
        if self._log in ready:
            self._read_log()

    def printed(self) -> str:
        """Return the last line of the output that was kept."""
        self._read_log()
        lines = self._printed.decode(errors="replace").strip().split("\n")
        return lines[-1].strip()[:_MAX_LINE]

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
            for _ in range(_LOG_READS):
                part = os.read(self._log, _LOG_PART_BYTES)
                self._printed += part[: _MAX_OUTPUT_BYTES - len(self._printed)]
                if not part:
                    with suppress(KeyError):
                        self._poll.unregister(self._log)
                    return
