"""Progress of reading large files, told in equal pieces."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

PIECES = 100  # of any work, however large
PATIENCE = 1.0  # s without a progress bar


class Work:
    """A number of bytes to read; tells each hundredth of them that is done."""

    def __init__(self, size: int, started: Callable[[int], object], progress: Callable[[str], object]) -> None:
        self._size, self._progress = size, progress
        self._done = self._told = 0
        self._name = ""
        started(PIECES if size else 0)

    def on(self, name: str) -> Callable[[int], None]:
        """A counter of the bytes that are read of the file ``name``."""
        return partial(self._read, name)

    def finish(self) -> None:
        """All that is left needs no work."""
        self._tell(PIECES if self._size else 0)

    def _read(self, name: str, size: int) -> None:
        self._name = name
        self._done += size
        self._tell(min(self._done * PIECES // self._size, PIECES) if self._size else 0)

    def _tell(self, pieces: int) -> None:
        for _ in range(self._told, pieces):
            self._progress(self._name)
        self._told = max(self._told, pieces)


def no_work() -> Work:
    """Work that tells nothing."""
    return Work(0, lambda _: None, lambda _: None)


@contextmanager
def working(
    size: int, started: Callable[[int], object] | None, progress: Callable[[str], object] | None
) -> Iterator[Work]:
    """Work of ``size`` bytes; without callbacks a progress bar shows on the error stream if it takes a while."""
    bar = _Bar() if started is None and progress is None else None
    try:
        work = Work(size, started or (lambda _: None), bar.advance if bar else progress or (lambda _: None))
        yield work
        work.finish()
    finally:
        if bar:
            bar.stop()


class _Bar:
    """A transient progress bar, on a terminal only, that appears after a while."""

    def __init__(self) -> None:
        self._begin = time.monotonic()
        self._done = 0
        self._shown: tuple[Any, Any] | None = None

    def advance(self, name: str) -> None:
        self._done += 1
        if self._shown is None and time.monotonic() - self._begin > PATIENCE and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import Progress

            shown = Progress(console=Console(stderr=True), transient=True)
            shown.start()
            self._shown = shown, shown.add_task("", total=PIECES)
        if self._shown is not None:
            shown, task = self._shown
            shown.update(task, completed=self._done, description=f"reading {name} (once)")

    def stop(self) -> None:
        if self._shown is not None:
            self._shown[0].stop()
