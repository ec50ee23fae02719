"""Progress of reading large files, told in equal pieces."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial

PIECES = 100  # of any work, however large


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
    """Work of ``size`` bytes; without callbacks a progress bar shows on the error stream, if that is a terminal."""
    with ExitStack() as stack:
        if size and started is None and progress is None and sys.stderr.isatty():
            progress = stack.enter_context(_bar())
        work = Work(size, started or (lambda _: None), progress or (lambda _: None))
        yield work
        work.finish()


@contextmanager
def _bar() -> Iterator[Callable[[str], object]]:
    """A transient progress bar; the function that tells it the name of the file at hand, once per piece."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as shown:
        task = shown.add_task("", total=PIECES)
        yield lambda name: shown.update(task, advance=1, description=f"reading {name} (once)")
