"""When and where kernels are compiled, and that damaged ones are not loaded; each case in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import NamedTuple

import pytest

from mtp_bench.tracking.kernels import cache
from mtp_bench.tracking.kernels.compile import part

PROGRAM = """
import numpy as np
from mtp_bench.tracking.kernels.tree_kernels import distinct_rows
member, name = np.array([[True], [True], [False]]), np.array([1, 1, 2])
print(distinct_rows(member, name), distinct_rows.function(member, name))
"""
PRINTED = "[0 2] [0 2]\n"


def start(folder: Path, **more: str) -> subprocess.Popen[str]:
    """A process that calls one kernel."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder), **more}
    command = [sys.executable, "-W", "error", "-c", PROGRAM]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def run(folder: Path, **more: str) -> tuple[str, str]:
    """What such a process prints and writes to stderr."""
    return start(folder, **more).communicate()


def test_compiled_once_whatever_the_processes(tmp_path: Path) -> None:
    processes = [start(tmp_path) for _ in range(3)]
    outputs = [process.communicate() for process in processes]
    assert [printed for printed, _ in outputs] == [PRINTED] * 3
    assert sorted(said.count("once per machine") for _, said in outputs) == [0, 0, 1]
    assert run(tmp_path) == (PRINTED, "")


def flip(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


def make_folder(file: Path) -> None:
    file.unlink()
    (file / "inside").mkdir(parents=True)


DAMAGE: list[tuple[str, Callable[[Path], None]]] = [
    ("nbi", flip), ("nbc", flip), ("nbc", make_folder), ("nbc.sha256", make_folder),
]  # fmt: skip


def test_a_damaged_file_is_noticed_and_the_kernel_compiled_again(tmp_path: Path) -> None:
    run(tmp_path)
    for ending, damage in DAMAGE:
        (file,) = tmp_path.rglob(f"*.{ending}")
        damage(file)
        printed, said = run(tmp_path)
        assert printed == PRINTED
        assert "is damaged and compiled again" in said
        assert file.is_file()
    assert run(tmp_path) == (PRINTED, "")


def test_works_where_nothing_can_be_written(tmp_path: Path) -> None:
    nowhere = tmp_path / "file" / "cache"
    nowhere.parent.write_text("a file, not a folder", encoding="utf-8")
    printed, said = run(nowhere)
    assert printed == PRINTED
    assert "set NUMBA_CACHE_DIR" in said


def test_runs_in_plain_python_without_numba_s_compiler(tmp_path: Path) -> None:
    assert run(tmp_path, NUMBA_DISABLE_JIT="1") == (PRINTED, "")
    assert not list(tmp_path.iterdir())


class Pair(NamedTuple):
    """A record; the file that defines it counts as the code that uses it does."""

    first: int
    second: int


LITTLE = 1


@part
def twice(x: int) -> int:
    """A part."""
    return 2 * x


def more(x: int) -> int:
    """A function that calls it."""
    return twice(x) + Pair(x, LITTLE).second


def folder_of(signature: str) -> Path:
    assert isinstance(more, FunctionType)
    return cache.folder_of(more, signature)


def test_the_folder_depends_on_callees_constants_records_and_signature(monkeypatch: pytest.MonkeyPatch) -> None:
    folders = [folder_of("i8(i8)"), folder_of("f8(f8)")]
    monkeypatch.setitem(more.__globals__, "LITTLE", 2)
    folders.append(folder_of("i8(i8)"))
    monkeypatch.setitem(more.__globals__, "twice", cache.cache_folder)
    folders.append(folder_of("i8(i8)"))
    monkeypatch.setattr(Pair, "__module__", "mtp_bench.errors")
    folders.append(folder_of("i8(i8)"))
    assert len(set(folders)) == 5
