"""Lines on the error stream about long work: what it does, about how long it takes, and how far it is.

The first line comes after two seconds, or at once if the work is known to take longer, the next ones every ten seconds.
On a terminal a line with a bar is updated instead. Worker processes print nothing, nor does ``MTP_BENCH_QUIET=1``.
"""

import os
import shutil
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

QUIET = "MTP_BENCH_QUIET"  # environment variable
SILENT_SECONDS = 2.0  # of work that may be short
LINE_SECONDS = 10.0  # between lines
BAR_SECONDS = 0.25  # between two states of the bar
_KEPT_SECONDS = 0.005  # an item that takes less was kept from before: its time is not that of the others

_jobs: list["Notice"] = []  # unfinished ones of this process, the innermost last
_watchers: list[threading.Thread] = []  # at most one, as long as there are jobs
_told: set[str] = set()
_lock = threading.RLock()  # of the jobs and of the error stream


def _forked() -> None:
    """Take a new lock in a forked process: another thread may have held the old one."""
    global _lock  # noqa: PLW0603
    _lock = threading.RLock()
    _jobs.clear()
    _watchers.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


class Notice:
    """Work that takes a while; see `long_work`."""

    def __init__(self, text: str, seconds: float, around: bool) -> None:
        self.text, self.around, self.has_spoken = text, around, False
        self._begun = time.monotonic()
        self.next = self._begun + (
            0 if seconds > SILENT_SECONDS else SILENT_SECONDS
        )  # time of the next line
        self._seconds = seconds
        self.started(0)

    def started(self, total: int) -> None:
        """Count ``total`` items from now on, of which none is finished."""
        with _lock:
            self._total, self._count, self._kept, self._name, self._since = (
                total,
                0,
                0,
                "",
                time.monotonic(),
            )

    def done(self, name: str = "", count: int = 1) -> None:
        """Count more finished items; ``name`` is shown."""
        now = time.monotonic()
        with _lock:
            self._count, self._name = self._count + count, name
            if now - self._since < _KEPT_SECONDS:
                self._kept, self._since = self._count, now
            elif (
                self._count == self._kept + count
            ):  # the first item with a time: print the estimate soon
                self.next = min(self.next, now + SILENT_SECONDS)

    def speak(self, now: float) -> None:
        """Print a line if one is due at the time ``now``, in seconds of `time.monotonic`."""
        if now >= self.next:
            parts = ", ".join(filter(None, self._parts(now)))
            line = "".join(letter if letter.isprintable() else "?" for letter in parts)
            bar = self.has_bar()
            _write(_over(line) if bar else f"mtp_bench: {line}\n")
            self.next, self.has_spoken = (
                now + (BAR_SECONDS if bar else LINE_SECONDS),
                True,
            )

    def _parts(self, now: float) -> tuple[str, ...]:
        """The text, the items, and the time that is left, by their rate or the estimate, or else has passed."""
        passed, left = now - self._begun, self._seconds - (now - self._begun)
        if self._count > self._kept:
            left = (
                (now - self._since)
                / (self._count - self._kept)
                * (self._total - self._count)
            )
        still = self.has_spoken or self._count
        told = f"about {_duration(left)}{' left' if still else ''}" if left > 0 else ""
        told = told or (f"{_duration(passed)} so far" if self.has_spoken else "")
        if not self._total:
            return self.text, told
        counted, tenths = (
            f"{self._count} of {self._total}",
            min(10, 10 * self._count // self._total),
        )
        if self.has_bar():  # the end is cut off where the terminal is narrow
            return (
                f"[{'##' * tenths}{'--' * (10 - tenths)}] {counted}",
                told,
                self.text,
                self._name,
            )
        return self.text, counted, self._name, told

    def has_bar(self) -> bool:
        """True on a terminal, where other output does not follow at once."""
        with suppress(ValueError, AttributeError):  # closed or missing
            return (
                not self.around
                and sys.stderr.isatty()
                and os.environ.get("TERM") != "dumb"
            )
        return False


def say_once(text: str) -> None:
    """Print a line, once per process; nothing where lines of work are not printed either."""
    if text not in _told and not _silent():
        _told.add(text)
        _write(f"mtp_bench: {text}\n")


def _silent() -> bool:
    from multiprocessing import parent_process

    return os.environ.get(QUIET, "0") not in ("", "0") or parent_process() is not None


@contextmanager
def long_work(text: str, seconds: float = 0, around: bool = False) -> Iterator[Notice]:
    """Print lines about work while it lasts; without ``text`` none, as while waiting for the user.

    ``seconds``: about how long it takes; 0: not known yet. ``around``: lines of work inside it stand for its own.
    """
    job = Notice(text, seconds, around)
    if _silent():
        yield job
        return
    with _lock:
        job.next = min(
            [
                job.next,
                *(
                    outer.next
                    for outer in _jobs[-1:]
                    if outer.around and not outer.has_spoken
                ),
            ]
        )
        _jobs.append(job)
        if not _watchers:
            _watchers.append(threading.Thread(target=_watch, daemon=True))
            _watchers[0].start()
        _speak()
    try:
        yield job
    finally:
        with _lock:
            _jobs.remove(job)
            if job.has_spoken:
                _write(f"{_over('')}\r" if job.has_bar() else "")
                for outer in _jobs:
                    outer.next = max(outer.next, time.monotonic() + SILENT_SECONDS)


def _watch() -> None:
    """Print lines until all jobs of this process are finished, those of other threads too."""
    while True:
        with _lock:
            if not _jobs:
                _watchers.clear()
                return
            _speak()
        time.sleep(BAR_SECONDS)


def _speak() -> None:
    """Print the line of the innermost job that is due or has printed before; a job without text silences outer ones."""
    now = time.monotonic()
    due = [job for job in _jobs if not job.text or job.has_spoken or now >= job.next]
    if due and due[-1].text:
        due[-1].speak(now)


def _write(text: str) -> None:
    with suppress(
        OSError, ValueError, AttributeError
    ):  # closed, full or missing: work goes on
        sys.stderr.write(text)
        sys.stderr.flush()


def _over(line: str) -> str:
    """The line with what replaces the previous one on the terminal."""
    width = shutil.get_terminal_size().columns - 1
    return f"\r{line[:width].ljust(width)}"


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    return f"{round(seconds / 60)} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
