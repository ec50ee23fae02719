"""Progress of long work on the error stream.

Work that takes more than two seconds says what it does, how far it is and about how
long it takes: with a bar in terminals, a line that changes in notebooks, else a line
every ten seconds. Worker processes print nothing, nor does ``MTP_BENCH_QUIET=1``.
"""

import math
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

QUIET_VARIABLE = "MTP_BENCH_QUIET"  # environment variable
SILENT_SECONDS = 2.0  # of work that may be short
LINE_SECONDS = 10.0  # between lines
BAR_SECONDS = 0.25  # between two states of the bar
# An item that takes less is from a cache: its time is not that of the others.
_CACHED_ITEM_SECONDS = 0.005
# An estimate is never shown to rise: one that rises less stands still, and above that
# the time that has passed is shown, as items differ too much to tell.
_MAX_RISE = 1.25

_stack: list["_Work"] = []  # unfinished work of this process, the innermost last
_watchers: list[threading.Thread] = []  # at most one, as long as there is work
_printed_once: set[str] = set()
_lock = threading.RLock()  # of the stack and of the error stream


def _reset_after_fork() -> None:
    """Take a new lock: another thread may have held the old one."""
    global _lock  # noqa: PLW0603
    _lock = threading.RLock()
    _stack.clear()
    _watchers.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_reset_after_fork)


def _ignore(*_: object) -> None:
    """Do nothing."""


@dataclass(frozen=True)
class Progress:
    """Callbacks that count the finished items of long work."""

    started: Callable[[int], object] = _ignore  # takes the number of items
    # takes the name of a finished item, and how many it stands for if not 1
    done: Callable[..., object] = _ignore


NO_PROGRESS = Progress()


@contextmanager
def long_work(
    text: str, expected_seconds: float = 0, progress: Progress = NO_PROGRESS
) -> Iterator[Progress]:
    """Show work while it lasts, and yield the callbacks that count its items.

    ``expected_seconds``: of the work; 0: not known. ``progress``: callbacks
    of a caller that counts the items of this work itself; nothing else is shown then.
    """
    if progress is not NO_PROGRESS:
        yield progress
        return
    if _is_silent():
        yield NO_PROGRESS
        return
    work = _Work(text, expected_seconds)
    with _lock:
        if _stack and not _stack[-1].shown:  # the user has been waiting since then
            work.due = min(work.due, _stack[-1].due)
        _stack.append(work)
        if not _watchers:
            _watchers.append(threading.Thread(target=_watch, daemon=True))
            _watchers[0].start()
        _show()
    try:
        yield Progress(work.started, work.done)
    finally:
        with _lock:
            _stack.remove(work)
            if work.shown:
                _bar.clear()
                _cell_line.clear()
                # else outer work would flicker between two inner ones
                for outer in _stack:
                    outer.due = max(outer.due, time.monotonic() + SILENT_SECONDS)


def say_once(text: str) -> None:
    """Print a line once per process, unless progress is silent."""
    if text not in _printed_once and not _is_silent():
        _printed_once.add(text)
        _write_line(text)


class _Work:
    """Work that is not finished, and when it is shown next."""

    def __init__(self, text: str, expected_seconds: float) -> None:
        self.text = text
        self.begin = time.monotonic()
        self.expected_seconds = expected_seconds  # 0: not known
        self.shown = False
        self.due = self.begin  # long work is shown at once
        if expected_seconds <= SILENT_SECONDS:
            self.due += SILENT_SECONDS
        self._least_left = math.inf  # s, of the estimates
        self.started(0)

    def started(self, total: int) -> None:
        """Count ``total`` items from now on, of which none is finished."""
        with _lock:
            self.total = total
            self.count = 0
            self.item_name = ""
            self._cached = 0
            self._timed_since = time.monotonic()

    def done(self, name: str = "", count: int = 1) -> None:
        """Count ``count`` more finished items.

        ``name``: of the last one, which is shown.
        """
        now_s = time.monotonic()
        with _lock:
            self.count += count
            self.item_name = name
            if now_s - self._timed_since < _CACHED_ITEM_SECONDS:
                self._cached = self.count
                self._timed_since = now_s
            elif self.count == self._cached + count:  # the first that was not cached
                self.due = min(self.due, now_s + SILENT_SECONDS)

    def state(self) -> str:
        """Finished items, and the time that is left or has passed."""
        items = ""
        if self.total:
            items = f"{self.count} of {self.total}"
        return ", ".join(filter(None, [items, self.item_name, self._time()]))

    def _time(self) -> str:
        """The time that is left by the rate of items or the estimate, else passed."""
        now_s = time.monotonic()
        passed = now_s - self.begin
        timed_items = self.count - self._cached
        seconds_left = self.expected_seconds - passed
        if timed_items > 0:
            seconds_per_item = (now_s - self._timed_since) / timed_items
            seconds_left = seconds_per_item * (self.total - self.count)
        if 0 < seconds_left < _MAX_RISE * self._least_left:
            seconds_left = min(seconds_left, self._least_left)
            self._least_left = seconds_left
            about = f"about {_duration(seconds_left)}"
            return f"{about} left" if self.shown or self.count else about
        return f"{_duration(passed)} so far" if self.shown else ""


class _CellLine:
    """One line in a notebook's cell, updated in its place."""

    def __init__(self) -> None:
        self._cell: tuple[int, Any] | None = None  # number, and handle of the line

    def show(self, work: _Work) -> None:
        """Write the state of ``work`` in place of the state before."""
        self._write(_line_of(work))

    def clear(self) -> None:
        """Empty the line, which later work of the cell uses again."""
        if self._cell is not None:
            self._write("")

    def _write(self, text: str) -> None:
        from IPython import get_ipython
        from IPython.display import display

        number = get_ipython().execution_count
        content = {"text/plain": text}
        if self._cell is not None and self._cell[0] == number:
            self._cell[1].update(content, raw=True)
        else:
            untyped: Any = display
            self._cell = number, untyped(content, raw=True, display_id=True)


class _Bar:
    """One bar at the bottom of a terminal."""

    def __init__(self) -> None:
        self._display: Any = None

    def show(self, work: _Work) -> None:
        """Draw the state of ``work`` in place of the state drawn before."""
        if self._display is None:
            self._display = self._new_display()
        (bar_id,) = self._display.task_ids
        self._display.update(
            bar_id,
            description=_printable(work.text),
            state=_printable(work.state()),
            total=work.total or None,  # None: rich shows a bar without an end
            completed=work.count,
            refresh=True,
        )

    def clear(self) -> None:
        """Remove the bar."""
        if self._display is not None:
            with suppress(OSError, ValueError):  # the stream was closed meanwhile
                self._display.stop()
            self._display = None

    @staticmethod
    def _new_display() -> Any:
        """Start rich's display with one bar."""
        from rich.console import Console
        from rich.progress import BarColumn, Progress as RichProgress, TextColumn

        display = RichProgress(
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=20),
            TextColumn("{task.fields[state]}", markup=False),
            console=Console(stderr=True),
            auto_refresh=False,
            transient=True,
            # Lines that are printed meanwhile go above the bar, but never from
            # standard output into the error stream where the two differ.
            redirect_stdout=_is_terminal(sys.stdout),
        )
        display.add_task("", state="")
        display.start()
        return display


_bar = _Bar()
_cell_line = _CellLine()


def _is_silent() -> bool:
    from multiprocessing import parent_process

    return (
        os.environ.get(QUIET_VARIABLE, "0") not in ("", "0")
        or parent_process() is not None
    )


def _watch() -> None:
    """Show work until all of this process is finished, in other threads too."""
    while True:
        with _lock:
            if not _stack:
                _watchers.clear()
                return
            _show()
        time.sleep(BAR_SECONDS)


def _show() -> None:
    """Show the innermost work that is due or was shown before."""
    now_s = time.monotonic()
    for work in reversed(_stack):
        if not work.shown and now_s < work.due:
            continue
        if now_s >= work.due:
            _show_state(work, now_s)
        return


def _show_state(work: _Work, now_s: float) -> None:
    work.due = now_s + BAR_SECONDS
    if _is_terminal(sys.stderr) and os.environ.get("TERM") != "dumb":
        with suppress(OSError, ValueError):  # closed or full: work goes on
            _bar.show(work)
    elif _in_notebook():
        _cell_line.show(work)
    else:
        _write_line(_line_of(work))
        work.due = now_s + LINE_SECONDS
    work.shown = True


def _line_of(work: _Work) -> str:
    return ", ".join(filter(None, [work.text, work.state()]))


def _in_notebook() -> bool:
    if "ipykernel" not in sys.modules:
        return False
    from IPython import get_ipython

    return get_ipython() is not None


def _is_terminal(stream: Any) -> bool:
    with suppress(ValueError, AttributeError):  # closed or missing
        return bool(stream.isatty())
    return False


def _write_line(text: str) -> None:
    with suppress(OSError, ValueError, AttributeError):  # closed, full or missing
        sys.stderr.write(f"mtp_bench: {_printable(text)}\n")
        sys.stderr.flush()


def _printable(text: str) -> str:
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def _duration(seconds: float) -> str:
    if seconds < 90:  # 1.5 min
        return f"{max(1, round(seconds))} s"
    if seconds < 5400:  # 1.5 h
        return f"{round(seconds / 60)} min"
    return f"{seconds / 3600:.1f} h"
