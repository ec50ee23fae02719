"""When and where kernels are compiled, each case in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from mtp_bench.tracking.kernels.compile import Kernel, kernel
from mtp_bench.tracking.kernels.heap import sorted_numbers
from mtp_bench.types import Ints

PROGRAM = """
import sys
import numpy as np
from mtp_bench.tracking.kernels.heap import sorted_numbers
assert "numba" not in sys.modules
keys = np.array([3.0, 1.0, 2.0])
print(sorted_numbers(keys), sorted_numbers.python(keys), "numba" in sys.modules)
"""


PRINTED = "[1 2 0] [1 2 0] True"


def run(cache: Path, **more: str) -> tuple[str, str]:
    """What a process that calls one kernel prints, and says on stderr."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), **more}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout.strip(), done.stderr


def test_compiled_once_per_machine_and_said_so(tmp_path: Path) -> None:
    printed, said = run(tmp_path)
    assert printed == PRINTED
    assert said == "mtp_bench: compiling the tracking kernels, once per machine: about 20 s\n"
    assert list(tmp_path.rglob("*.nbi"))
    assert run(tmp_path) == (PRINTED, "")


def test_works_where_nothing_can_be_written(tmp_path: Path) -> None:
    nowhere = tmp_path / "file" / "cache"
    nowhere.parent.write_text("a file, not a folder", encoding="utf-8")
    printed, said = run(nowhere)
    assert printed == PRINTED
    assert "in every process (set NUMBA_CACHE_DIR" in said


def test_runs_in_plain_python_without_numba_s_compiler(tmp_path: Path) -> None:
    assert run(tmp_path, NUMBA_DISABLE_JIT="1") == (PRINTED, "")
    assert not list(tmp_path.iterdir())


@kernel
def twice(x: int) -> int:
    """One kernel."""
    return 2 * x


@kernel("i8(i8)")
def more(x: int) -> int:
    """Another that calls it."""
    return twice(x + 0 * x) + LITTLE


LITTLE = 1


def test_the_cache_knows_callees_and_constants(monkeypatch: pytest.MonkeyPatch) -> None:
    before = more._digest("1")
    monkeypatch.setitem(more.function.__globals__, "LITTLE", 2)
    changed = more._digest("1")
    monkeypatch.setitem(more.function.__globals__, "twice", Kernel(sorted_numbers.function))
    assert len({before, changed, more._digest("1"), more._digest("2")}) == 4


class Pair(NamedTuple):
    """A record; where it is defined counts like the code that uses it."""

    first: int
    second: int


@kernel
def summed(pair: Pair) -> int:
    """A kernel that makes no record itself but knows one."""
    return Pair(*pair).first + pair.second


def test_the_cache_knows_the_files_of_records(monkeypatch: pytest.MonkeyPatch) -> None:
    before = summed._digest("1")
    monkeypatch.setattr(Pair, "__module__", Kernel.__module__.replace("compile", "tables"))
    assert summed._digest("1") != before


def test_plain_python_calls_plain_python(monkeypatch: pytest.MonkeyPatch) -> None:
    def compiled(_: Ints) -> None:
        raise AssertionError("compiled code was asked for")

    monkeypatch.setattr(Kernel, "compiled", compiled)
    assert more.python(3) == 7
    assert sorted_numbers.python(np.array([2.0, 1.0])).tolist() == [1, 0]
