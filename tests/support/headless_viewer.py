"""Rerun's viewer without a screen, which draws in software."""

import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import pytest

from mtp_bench.viz.rerun import viewer as rerun_viewer
from mtp_bench.viz.rerun.viewer import LOCAL, free_port

T = TypeVar("T")

WAIT = 40.0  # s


@contextmanager
def windows_without_a_screen(patch: pytest.MonkeyPatch) -> Iterator[str]:
    """Address of a headless viewer that starts in place of a window; it ends with the context."""
    port, started, popen = free_port(), [], subprocess.Popen

    def start(command: list[str], **keywords: Any) -> subprocess.Popen[bytes]:
        started.append(popen([*command, "--headless", "--window-size", "640x480"], **keywords))
        return started[-1]

    patch.setenv("DISPLAY", ":0")
    patch.setattr(rerun_viewer, "free_port", lambda: port)
    patch.setattr(subprocess, "Popen", start)
    try:
        yield f"rerun+http://{LOCAL}:{port}/proxy"
    finally:
        for viewer in started:
            viewer.terminate()
            viewer.wait()


def until(action: Callable[[], T]) -> T:
    """The result of an action as soon as it does not fail for want of a listener or of data."""
    end = time.monotonic() + WAIT
    while True:
        try:
            return action()
        except (OSError, RuntimeError):
            if time.monotonic() > end:
                raise
            time.sleep(0.1)
