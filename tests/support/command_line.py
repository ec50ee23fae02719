"""The command line called in this process, and submissions to call it with."""

import inspect
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import pytest

from mtp_bench.commands.app import main
from mtp_bench.core import ENDING_SIGNALS
from tests.support.small_scenes import EchoAgent, empty_action, write_kitti

IMPORTS = """from __future__ import annotations
from dataclasses import dataclass
from typing import Any
import numpy as np
"""
AGENT = """
class Agent(EchoAgent):
    def reset(self, task):
        super().reset(task)
        self.moved = None

    def act(self, observation):
        if self.moved is None:
            self.moved = bool(np.abs(observation["ego_pose"][[0, 1, 3]]).max() > 1e-6)
        {body}
        return super().act(observation)

def build(task, noise=0.0, **parameters):
    return Agent(noise=noise)
"""

TERMINAL = ("FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE")  # make a pipe look like a terminal


def plain_environment() -> dict[str, str]:
    """The environment of this process for programs whose output is not shown on a terminal."""
    return {name: value for name, value in os.environ.items() if name not in TERMINAL}


@dataclass(frozen=True)
class Output:
    """Exit status and output of a command."""

    status: int
    out: str
    err: str

    @property
    def error(self) -> str:
        """The text of the only error line; fails the test if the command did anything else on the error stream."""
        assert self.status == 1, (self.status, self.err)
        assert self.err.startswith("error: "), self.err
        assert self.err.endswith("\n")
        assert len(self.err.splitlines()) == 1, self.err
        return self.err.removeprefix("error: ").strip()


@contextmanager
def restored_signals() -> Iterator[None]:
    """Give this process its handlers of signals back, which a command keeps to its end."""
    handlers = {number: signal.getsignal(number) for number in ENDING_SIGNALS}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


class CommandLine:
    """Calls ``mtp-bench`` with arguments."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, *arguments: object) -> Output:
        self._capsys.readouterr()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", ["mtp-bench", *map(str, arguments)])
            for name in TERMINAL:
                patch.delenv(name, raising=False)
            with restored_signals(), pytest.raises(SystemExit) as left:
                main()
        status = left.value.code
        assert status is None or isinstance(status, int)
        captured = self._capsys.readouterr()
        return Output(status or 0, captured.out, captured.err)

    def ok(self, *arguments: object) -> str:
        """Output of a command that must succeed and keep the error stream clean."""
        output = self(*arguments)
        assert output.status == 0, output.err
        assert output.err == "", output.err
        return output.out


def on_terminal(columns: int, *arguments: object) -> list[str]:
    """Lines that a command prints on a terminal of so many columns, without styles."""
    import pty

    ours, theirs = pty.openpty()
    environment = {**plain_environment(), "COLUMNS": str(columns), "TERM": "xterm"}
    command = [sys.executable, "-m", "mtp_bench", *map(str, arguments)]
    with subprocess.Popen(command, env=environment, stdout=theirs, stderr=subprocess.PIPE) as process:
        os.close(theirs)
        printed = b""
        with suppress(OSError):  # the other end is closed
            while part := os.read(ours, 1 << 16):
                printed += part
        _, said = process.communicate()
    os.close(ours)
    assert process.returncode == 0, said.decode()
    return re.sub(r"\x1b\[[\d;]*m", "", printed.decode()).splitlines()


def read_json(path: Path) -> Any:
    """Content of a JSON file; NaN and infinity, which JSON does not have, fail the test."""

    def refuse(text: str) -> NoReturn:
        raise AssertionError(f"{path} holds {text}")

    return json.loads(path.read_text(), parse_constant=refuse)


def write_submission(folder: Path, name: str = "echo", tables: str = "", body: str = "pass") -> Path:
    """A submission that answers with the detections themselves and needs nothing of the tests.

    ``body`` runs in every frame before.
    """
    folder.mkdir(parents=True)
    manifest = f'name = "{name}"\nauthors = ["A. Author"]\nagent = "agent:build"\n{tables}'
    (folder / "submission.toml").write_text(manifest)
    source = [inspect.getsource(part) for part in (empty_action, EchoAgent)]
    (folder / "agent.py").write_text("\n\n".join([IMPORTS, *source, AGENT.format(body=body)]))
    return folder


def ship(folder: Path, repository: Path, card: str) -> pytest.MonkeyPatch:
    """Make the small card one that ships, in a bundle of its own in ``folder``; undo the patch that is returned."""
    (folder / "envs" / "reference").mkdir(parents=True)
    (folder / "pyproject.toml").touch()
    (folder / "envs" / Path(card).name).write_text(Path(card).read_text())
    (folder / "baselines").symlink_to(repository / "baselines")
    patch = pytest.MonkeyPatch()
    patch.setattr("mtp_bench.core.bundle._PACKAGE", folder / "mtp_bench")
    return patch


def write_training(folder: Path, like: str, names: Sequence[str]) -> str:
    """A KITTI root whose training split has the sequences ``names``, copies of one of the validation split."""
    root = write_kitti(folder)
    for name in names:
        copy_sequence(Path(root), like, name)
    return root


def copy_sequence(root: Path, name: str, to: str) -> None:
    """Copy a sequence of a KITTI root under another name, which the sequence map does not list."""
    for path in list((root / "kitti_tracking").rglob(f"{name}.txt")):
        shutil.copy(path, path.with_stem(to))
