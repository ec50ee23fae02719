"""The parallel map."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from mtp_bench.core.errors import MtpBenchError
from mtp_bench.core.parallel import ENDING_SIGNALS, Workers, parallel_map


def test_a_process_that_dies_is_one_clear_error() -> None:
    with pytest.raises(MtpBenchError, match=r"one of 2 processes died, .*: take fewer \(--jobs\)"):
        parallel_map(os._exit, [(1,), (1,)], Workers(2))
    assert parallel_map(abs, [(-1,), (2,)], Workers(2)) == [1, 2], "the next ones work"


SHADOWS = ("pickle", "typing", "random", "json", "numpy")  # imported by workers as they start, or by their calls


PROGRAM = """
import os
from mtp_bench.core.parallel import Workers, parallel_map
if __name__ == "__main__":
    print(parallel_map(abs, [(-1,), (2,)], Workers(2)), os.environ.get("PYTHONSAFEPATH"))
"""


def test_workers_import_nothing_from_the_current_folder(tmp_path: Path) -> None:
    program, current = tmp_path / "program.py", tmp_path / "current"
    program.write_text(PROGRAM)
    current.mkdir()
    for name in SHADOWS:
        (current / f"{name}.py").write_text("open(f'{__file__}.seen', 'w').close()\n")
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    command = [sys.executable, str(program)]
    done = subprocess.run(command, cwd=current, env=environment, capture_output=True, text=True, check=False)
    assert done.stdout == "[1, 2] None\n", done.stderr
    assert not list(current.glob("*.seen"))


class NotSentError(Exception):
    """It pickles, but is made of two things, of which only the first is kept."""

    def __init__(self, frame: int, why: str) -> None:
        super().__init__(frame)
        self.why = why


def boom(frame: int) -> None:
    raise NotSentError(frame, "boom")


def test_an_unpicklable_error_is_not_reported_as_lack_of_memory() -> None:
    with pytest.raises(MtpBenchError, match=r"cannot be pickled or unpickled: .*\(--jobs 1\)"):
        parallel_map(boom, [(1,), (2,)], Workers(2))
    with pytest.raises(NotSentError):
        parallel_map(boom, [(1,), (2,)])


def blocked_signals() -> set[int]:
    return {*signal.pthread_sigmask(signal.SIG_BLOCK, ())}


def test_workers_leave_signals_to_this_process() -> None:
    """Else each would print a traceback, and a cluster's SIGTERM would look as if memory had run out."""
    before = blocked_signals()
    for blocked in parallel_map(blocked_signals, [(), ()], Workers(2)):
        assert blocked >= {*ENDING_SIGNALS}
    assert blocked_signals() == before


def test_a_system_that_cannot_block_signals(monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as Windows: the work is the same."""
    monkeypatch.delattr(signal, "pthread_sigmask")
    assert parallel_map(abs, [(-1,), (2,)], Workers(2)) == [1, 2]
