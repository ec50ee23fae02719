"""The viewer that comes with rerun, opened on a recording: a window, or pages for browsers on this machine."""

from __future__ import annotations

import importlib.util
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from ...errors import MtpBenchError
from ..replay import Incident, Replay
from .blueprint import layout
from .contents import Contents, contents_of
from .log import log_runs, new_recording
from .sdk import INSTALL, ViewerClient

LOCAL = "127.0.0.1"  # the viewer's own default is every network interface
START_SECONDS = 30.0
OTHERWISE = "write a file with --save FILE.rrd, serve it with --web, or draw an event with --at and --png"


def viewer_program() -> str:
    """Path of the viewer's program; raises MtpBenchError if the package is incomplete."""
    spec = importlib.util.find_spec("rerun_cli")
    if spec is not None and spec.origin is not None:
        program = Path(spec.origin).with_name("rerun.exe" if os.name == "nt" else "rerun")
        if program.is_file():
            return str(program)
    raise MtpBenchError(f"the viewer of rerun is missing: {INSTALL}")


def require_display(otherwise: str = OTHERWISE) -> None:
    """Raise MtpBenchError if no window can open; ``otherwise``: what to do then."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise MtpBenchError(f"no display for the viewer: {otherwise}")


def show_recording(replays: Sequence[Replay], level: str = "top", at: Incident | None = None) -> None:
    """Open a viewer on runs of one scene, at the frame of ``at``; it stays when this process ends.

    Raises MtpBenchError without a display, and if the viewer does not start.
    """
    contents = contents_of(replays, level, at)
    address = open_viewer()
    _send(contents, address)
    if at is not None:
        client = ViewerClient.connect(address)
        # if that fails it is open all the same; the frame can be chosen by hand
        _keep_trying(lambda: client.set_time("frame", sequence=at.frame, play_state="paused"))


def open_viewer(otherwise: str = OTHERWISE) -> str:
    """Open a viewer that stays when this process ends; returns its address, on this machine only.

    Raises MtpBenchError without a display, and if the viewer does not start; ``otherwise`` as `require_display`.
    """
    require_display(otherwise)
    port = free_port()
    start_viewer(port, ["--expect-data-soon", "--hide-welcome-screen"], detached=True)
    return address_of(port)


def serve_recording(replays: Sequence[Replay], level: str, at: Incident | None, ready: Callable[[str], object]) -> None:
    """Serve runs of one scene to browsers on this machine until interrupted; ``ready`` gets the address.

    Raises MtpBenchError if the server does not start.
    """
    contents = contents_of(replays, level, at)
    port, page = free_port(), free_port()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # a server that is ended does not leave one behind
    server = start_viewer(port, ["--serve-web", "--web-viewer-port", str(page)])
    try:
        _send(contents, address_of(port))
        ready(f"http://{LOCAL}:{page}/?url=rerun%2Bhttp://{LOCAL}:{port}/proxy")
        server.wait()
    except KeyboardInterrupt:
        pass  # the usual end
    finally:
        server.terminate()
        server.wait()


def free_port() -> int:
    """A port that is not in use."""
    with socket.socket() as free:
        free.bind((LOCAL, 0))
        return int(free.getsockname()[1])


def start_viewer(port: int, options: Sequence[str], detached: bool = False) -> subprocess.Popen[bytes]:
    """A viewer that listens; ``detached``: it stays when this process ends. Raises MtpBenchError if none starts."""
    quiet = subprocess.DEVNULL
    command = [viewer_program(), "--bind", LOCAL, "--port", str(port), *options]
    viewer = subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=detached)

    def listens() -> None:
        if viewer.poll() is not None:
            raise MtpBenchError(f"the viewer ended with status {viewer.returncode}: try --save FILE.rrd or --web")
        socket.create_connection((LOCAL, port), timeout=1.0).close()

    try:
        started = _keep_trying(listens)
    except BaseException:  # an interruption, too, leaves no viewer behind
        viewer.terminate()
        raise
    if not started:
        viewer.terminate()
        raise MtpBenchError(f"the viewer did not start within {START_SECONDS:.0f} s: try --save FILE.rrd or --web")
    return viewer


def _keep_trying(action: Callable[[], object]) -> bool:
    """Repeat ``action`` while it raises OSError or RuntimeError; False after START_SECONDS."""
    end = time.monotonic() + START_SECONDS
    while time.monotonic() < end:
        try:
            action()
        except (OSError, RuntimeError):
            time.sleep(0.05)
        else:
            return True
    return False


def address_of(port: int) -> str:
    """Address of a viewer at this port of this machine."""
    return f"rerun+http://{LOCAL}:{port}/proxy"


def _send(contents: Contents, address: str) -> None:
    """Send the recording and its layout, also if the user has changed the layout of an earlier one."""
    recording = new_recording(contents)
    recording.connect_grpc(address)
    recording.send_blueprint(layout(contents))
    log_runs(recording, contents)
