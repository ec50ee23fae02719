"""The viewer without a screen: pictures of recordings, drawn in software."""

from __future__ import annotations

import os
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

DRIVERS = ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d", "/usr/local/share/vulkan/icd.d")
WAIT = 40.0  # s


def require_driver() -> None:
    """Skip where there is nothing that draws, and say what to install."""
    named = os.environ.get("VK_DRIVER_FILES") or os.environ.get("VK_ICD_FILENAMES")
    if not named and not any(list(Path(folder).glob("*.json")) for folder in DRIVERS):
        pytest.skip("no Vulkan driver: apt-get install libvulkan1 mesa-vulkan-drivers")


@contextmanager
def headless_viewer(size: str = "1600x900") -> Iterator[object]:
    """A viewer of its own, that listens on this machine only."""
    from rerun.experimental import ViewerClient

    from mtp_bench.viz.rerun_viewer import viewer_program

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [viewer_program(), "--headless", "--bind", "127.0.0.1", "--port", str(port)]
    command += ["--window-size", size, "--hide-welcome-screen", "--threads", "2"]
    quiet = subprocess.DEVNULL
    with subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet) as viewer:
        try:
            yield _connected(ViewerClient, viewer, f"rerun+http://127.0.0.1:{port}/proxy")
        finally:
            viewer.terminate()


def _connected(client: type, viewer: subprocess.Popen[bytes], url: str) -> object:
    end = time.monotonic() + WAIT
    while True:
        assert viewer.poll() is None, f"the viewer ended with status {viewer.returncode}"
        try:
            connected = client.connect(url)  # type: ignore[attr-defined]
            connected.get_state()
        except Exception:
            if time.monotonic() > end:
                raise
            time.sleep(0.1)
        else:
            return connected
