"""How an agent's process is shut in on this system, and the command that does it."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from ..errors import SubmissionError
from .filter import system_call_filter
from .layout import TEMPORARY, Layout, bare_layout, environment, python
from .limits import Mechanism

_UID = 1000  # of the agent, inside
_TRY = 30.0  # s


@cache
def mechanism() -> Mechanism:
    """The best that works here: it is tried once per process."""
    if not sys.platform.startswith("linux"):
        return "none"
    for way in _WAYS:
        if _works(way):
            return way
    return "none"


def command(
    way: Mechanism,
    layout: Layout,
    program: Sequence[str],
    private: Mapping[str, int],
    info: int | None = None,
    rules: int | None = None,
    held: Sequence[int] = (),
    groups: Sequence[str] = (),
    rights: Sequence[str] = (),
) -> list[str]:
    """The command line that runs ``program`` shut in.

    Args:
        way: Who does it; "none": nobody, it just runs.
        layout: The files that it sees.
        program: What runs there.
        private: Folders of its own, with the bytes that they hold.
        info: Descriptor to which ``{"child-pid": number}`` is written; bubblewrap needs none.
        rules: Descriptor from which bubblewrap reads the filter of system calls; None: it sets none.
        held: Descriptors of the program, which nobody else holds on to.
        groups: Doors of the control groups that it enters.
        rights: Capabilities over its cell that bubblewrap leaves it.
    """
    here = Path(__file__).parent
    start = [*python(), str(here / "launch.py")]
    prepared = {
        "judge": os.getpid(), "groups": list(groups), "info": info if way == "none" else None, "rules": rules,
    }  # fmt: skip
    if way == "bubblewrap":
        prepared["rules"] = None  # it closes what it has read
        tool = shutil.which("bwrap") or "bwrap"
        program = [tool, *_bubblewrap(layout, private, info, rules, rights), "--", *program]
    elif way == "namespaces":
        plan = {
            # resolved: a link on the way would be followed below another root
            "shown": [(os.path.realpath(here), there) for here, there in layout.shown],
            **{name: getattr(layout, name) for name in ("links", "covered", "devices", "masked")},
            "private": dict(private), "uid": _UID, "told": info, "held": list(held), "work": TEMPORARY,
            "filter": base64.b64encode(system_call_filter() or b"").decode(),
        }  # fmt: skip
        program = [*python(), str(here / "namespaces.py"), json.dumps(plan), *program]
    return [*start, json.dumps(prepared), *program]


def _bubblewrap(
    layout: Layout, private: Mapping[str, int], info: int | None, rules: int | None, rights: Sequence[str]
) -> list[str]:
    words = (
        "--unshare-user --unshare-pid --unshare-net --unshare-ipc --unshare-uts --unshare-cgroup-try "
        f"--uid {_UID} --gid {_UID} --hostname agent --die-with-parent --new-session --as-pid-1 --cap-drop ALL"
    ).split()
    for option, values in (("--cap-add", rights), ("--info-fd", [info]), ("--seccomp", [rules])):
        words += [word for value in values if value is not None for word in (option, str(value))]
    for text, there in layout.links:
        words += ["--symlink", text, there]
    for folder, size in private.items():  # first: what is shown may lie below, such as a library in /tmp
        words += ["--size", str(size), "--tmpfs", folder]
    covered = set(layout.covered)
    for here, there in layout.shown:
        for folder in [folder for folder in covered if there.startswith(f"{folder}/")]:
            words += ["--tmpfs", folder]
            covered.discard(folder)
        words += ["--ro-bind", here, there]
    for device in layout.devices:
        words += ["--dev-bind", device, device]
    words += ["--proc", "/proc"]
    for path in layout.masked:
        words += ["--ro-bind", "/dev/null", path]
    for folder in ("/", "/proc", *layout.covered):
        words += ["--remount-ro", folder]
    return [*words, "--chdir", TEMPORARY]


_WAYS: tuple[Mechanism, ...] = ("bubblewrap", "namespaces")


def _works(way: Mechanism) -> bool:
    """Whether a program starts that way and sees nothing but what it is shown."""
    rules = system_call_filter()
    if rules is None or (way == "bubblewrap" and shutil.which("bwrap") is None):
        return False
    seen = "import os; print(sorted(os.listdir('/')))"
    program = [*python(), "-c", seen]
    layout = bare_layout()
    with tempfile.TemporaryFile() as told, tempfile.TemporaryFile() as filtering:
        filtering.write(rules)
        filtering.flush()
        filtering.seek(0)
        words = command(way, layout, program, {TEMPORARY: 1 << 20}, told.fileno(), filtering.fileno())
        try:
            done = subprocess.run(
                words,
                pass_fds=(told.fileno(), filtering.fileno()),
                env=environment(isolated=True),
                stdin=subprocess.DEVNULL,
                capture_output=True,
                timeout=_TRY,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise SubmissionError(
                f"{way} took more than {_TRY:.0f} s to start here, so it is not known whether it holds an agent: "
                "try again when the machine is less busy"
            ) from None
        except OSError:
            return False
    there = {Path(path).parts[1] for path in [*(t for _, t in layout.shown), *(t for _, t in layout.links)]}
    return done.returncode == 0 and done.stdout.decode() == f"{sorted(there | {'dev', 'proc', 'tmp'})}\n"
