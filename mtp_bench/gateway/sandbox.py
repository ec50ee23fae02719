"""The sandbox of agent processes: bubblewrap with a filter of system calls, where both work on this system."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from ..errors import SubmissionError
from .filter import system_call_filter
from .layout import DEVICES, TEMPORARY, Layout, bare_layout, environment, python
from .limits import SandboxBackend

_UID = 1000  # of the agent, inside
_CAPABILITIES = ("CAP_SYS_ADMIN", "CAP_SETPCAP")  # over the sandbox: to mount, and to drop capabilities for good
_TRIAL_SECONDS = 30.0
_NAMESPACES = (
    "--unshare-user --unshare-pid --unshare-net --unshare-ipc --unshare-uts --unshare-cgroup-try "
    f"--uid {_UID} --gid {_UID} --hostname agent --die-with-parent --new-session --as-pid-1 --cap-drop ALL"
)


@cache
def sandbox_backend() -> SandboxBackend:
    """The sandbox that works here, tried once per process; "none": agents run unsandboxed."""
    usable = sys.platform.startswith("linux") and system_call_filter() is not None
    return "bubblewrap" if usable and shutil.which("bwrap") is not None and bubblewrap_works() else "none"


def bubblewrap_command(layout: Layout, program: Sequence[str], space: int) -> list[str]:
    """The command line that runs ``program`` in a sandbox with a temporary folder of ``space`` bytes.

    It keeps `_CAPABILITIES` over its sandbox and has no filter: `fork_server_main` takes both away from its forks. Its
    /proc is whole, since the kernel refuses forks a new one where the old one is masked.
    """
    words = [shutil.which("bwrap") or "bwrap", *_NAMESPACES.split()]
    for capability in _CAPABILITIES:
        words += ["--cap-add", capability]
    for text, there in layout.links:
        words += ["--symlink", text, there]
    words += ["--size", str(space), "--tmpfs", TEMPORARY]
    covered = set(layout.covered)
    for here, there in layout.shown:
        for folder in [folder for folder in covered if there.startswith(f"{folder}/")]:
            words += ["--tmpfs", folder]
            covered.discard(folder)
        words += ["--ro-bind", here, there]
    for device in DEVICES:
        words += ["--dev-bind", device, device]
    words += ["--proc", "/proc"]
    for folder in ("/", "/proc", *layout.covered):
        words += ["--remount-ro", folder]
    return [*words, "--chdir", TEMPORARY, "--", *program]


def bubblewrap_works() -> bool:
    """True if a program starts in a sandbox and sees only the files that it is shown.

    Raises SubmissionError where that takes too long to tell.
    """
    layout = bare_layout()
    program = [*python(), "-c", "import os; print(sorted(os.listdir('/')))"]
    try:
        done = subprocess.run(
            bubblewrap_command(layout, program, 1 << 20),
            env=environment(isolated=True),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=_TRIAL_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise SubmissionError(
            f"bubblewrap took more than {_TRIAL_SECONDS:.0f} s to start, so it is not known whether agents can be "
            "sandboxed here: try again when the machine is less busy"
        ) from None
    except OSError:
        return False
    paths = [TEMPORARY, "/dev", "/proc", *(there for _, there in (*layout.shown, *layout.links))]
    expected = sorted({Path(path).parts[1] for path in paths})
    return done.returncode == 0 and done.stdout.decode() == f"{expected}{os.linesep}"
