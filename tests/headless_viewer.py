"""The viewer without a screen: pictures of recordings, drawn in software."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from mtp_bench.viz.palette import Color
from mtp_bench.viz.rerun_sdk import ViewerClient
from mtp_bench.viz.rerun_viewer import free_port, viewer_program

if TYPE_CHECKING:
    from rerun.experimental import ViewerState

T = TypeVar("T")

DRIVERS = ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d", "/usr/local/share/vulkan/icd.d")
WAIT = 40.0  # s


def require_driver() -> None:
    """Skip where there is nothing that draws, and say what to install."""
    named = os.environ.get("VK_DRIVER_FILES") or os.environ.get("VK_ICD_FILENAMES")
    if not named and not any(list(Path(folder).glob("*.json")) for folder in DRIVERS):
        pytest.skip("no Vulkan driver: apt-get install libvulkan1 mesa-vulkan-drivers")


@contextmanager
def headless_viewer(size: str = "1600x900") -> Iterator[ViewerClient]:
    """A viewer of its own, that listens on this machine only."""
    port = free_port()
    command = [viewer_program(), "--headless", "--bind", "127.0.0.1", "--port", str(port)]
    command += ["--window-size", size, "--hide-welcome-screen", "--threads", "2"]
    quiet = subprocess.DEVNULL
    with subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet) as viewer:
        try:
            client = until(lambda: _connected(viewer, f"rerun+http://127.0.0.1:{port}/proxy"))
            yield client
        finally:
            viewer.terminate()


def _connected(viewer: subprocess.Popen[bytes], url: str) -> ViewerClient:
    assert viewer.poll() is None, f"the viewer ended with status {viewer.returncode}"
    client = ViewerClient.connect(url)
    client.get_state()
    return client


def open_at(viewer: ViewerClient, recording: Path, frame: int) -> ViewerState:
    """Open a file at a frame; what the viewer then shows, with every view drawn."""
    viewer.open(str(recording))
    until(lambda: viewer.set_time("frame", sequence=frame, play_state="paused"))
    state = viewer.get_state()
    while state.loading or any(one.current_time != frame for one in state.recordings):
        time.sleep(0.05)
        state = viewer.get_state()
    return state


def picture(viewer: ViewerClient, path: Path, view_id: str | None = None) -> NDArray[np.uint8]:
    """A picture [height, width, 3] of one view or of the whole window; also written to ``path``."""
    viewer.save_screenshot(str(path), view_id)
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def near(image: NDArray[np.uint8], color: Color, tolerance: int = 12) -> int:
    """Number of pixels of a colour."""
    gap = np.abs(image.astype(np.int64) - np.array(color)).max(axis=-1)
    return int((gap <= tolerance).sum())


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
