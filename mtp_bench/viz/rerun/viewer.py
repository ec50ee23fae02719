"""The window of the viewer that comes with rerun."""

import importlib.util
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO

from ...core import MtpBenchError
from ..incident import Incident
from ..run_replay import Replay
from .recording import save_recording
from .sdk import INSTALL

LOCAL = "127.0.0.1"  # the viewer's own default is every network interface
START_SECONDS = 30.0
OTHER_WAYS = (
    "write a file with --save FILE.rrd and serve it to a browser with `rerun "
    "--serve-web FILE.rrd`, or draw an event with --at and --png"
)


def viewer_program() -> str:
    """Return the path of the viewer's program.

    Raises MtpBenchError if the package is incomplete.
    """
    spec = importlib.util.find_spec("rerun_cli")
    if spec is not None and spec.origin is not None:
        name = "rerun.exe" if os.name == "nt" else "rerun"
        program = Path(spec.origin).with_name(name)
        if program.is_file():
            return str(program)
    raise MtpBenchError(f"the viewer of rerun is missing: {INSTALL}")


def require_display() -> None:
    """Raise MtpBenchError if no window can open."""
    has_display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform.startswith("linux") and not has_display:
        raise MtpBenchError(f"no display for the viewer: {OTHER_WAYS}")


def show_recording(
    replays: Sequence[Replay], is_all: bool, at: Incident | None
) -> None:
    """Open a viewer on runs of one scene.

    It shows the frame of ``at`` and stays when this process ends. Raises MtpBenchError
    if the viewer does not start.
    """
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        path = Path(folder) / "scene.rrd"
        save_recording(path, replays, is_all, at)
        # the viewer reads the open file to its end although it is deleted
        with path.open("rb") as content:
            start_viewer(content)


def free_port() -> int:
    """Return a port that is not in use."""
    with socket.socket() as probe:
        probe.bind((LOCAL, 0))
        return int(probe.getsockname()[1])


def start_viewer(content: IO[bytes]) -> None:
    """Start a viewer of a recording, with a session of its own.

    Raises MtpBenchError if it does not start.
    """
    quiet = subprocess.DEVNULL
    port = free_port()
    command = [viewer_program(), "--bind", LOCAL, "--port", str(port)]
    viewer = subprocess.Popen(
        [*command, "--hide-welcome-screen", "-"],
        stdin=content,
        stdout=quiet,
        stderr=quiet,
        start_new_session=True,
    )
    deadline = time.monotonic() + START_SECONDS
    while viewer.poll() is None and time.monotonic() < deadline:
        with suppress(OSError):
            socket.create_connection((LOCAL, port), timeout=1.0).close()
            return
        time.sleep(0.05)
    viewer.terminate()
    raise MtpBenchError("the viewer did not start: try --save FILE.rrd")
