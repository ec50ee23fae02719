"""Compiling kernels: once per installation, again if a compiled file is damaged, and where no cache can be written."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np
import pytest

from mtp_bench.core import notice
from mtp_bench.core.parallel import Workers
from mtp_bench.running.playing import compile_kernels
from mtp_bench.tracking.kernels import cache
from mtp_bench.tracking.kernels.compile import Kernel, part
from mtp_bench.tracking.kernels.tree_kernels import distinct_rows

PROGRAM = """
import numpy as np
from mtp_bench.tracking.kernels.tree_kernels import distinct_rows
member, name = np.array([[True], [True], [False]]), np.array([1, 1, 2])
print(distinct_rows(member, name), distinct_rows.function(member, name))
"""
PRINTED = "[0 2] [0 2]\n"


def start(folder: Path, **more: str) -> subprocess.Popen[str]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder), **more}
    command = [sys.executable, "-W", "error", "-c", PROGRAM]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def load(folder: Path, patch: pytest.MonkeyPatch) -> Kernel[Any]:
    """The same kernel as a new process would load it; its results are checked."""
    patch.setenv("NUMBA_CACHE_DIR", str(folder))
    patch.setenv(notice.QUIET_VARIABLE, "0")
    patch.setattr(notice, "_printed_once", set())
    kernel: Kernel[Any] = Kernel(distinct_rows.function, distinct_rows.signature)
    assert kernel(np.array([[True], [True], [False]]), np.array([1, 1, 2])).tolist() == [0, 2]
    return kernel


@pytest.fixture(scope="module")
def cached(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[tuple[str, str]]]:
    """A cache that two processes filled at the same time, and their outputs."""
    folder = tmp_path_factory.mktemp("cache")
    processes = [start(folder) for _ in range(2)]
    return folder, [process.communicate() for process in processes]


def test_two_processes_compile_once(
    cached: tuple[Path, list[tuple[str, str]]], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, outputs = cached
    assert [printed for printed, _ in outputs] == [PRINTED] * 2
    load(folder, monkeypatch)
    assert capsys.readouterr().err == ""


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


def test_a_damaged_file_is_noticed_and_the_kernel_compiled_again(
    cached: tuple[Path, list[tuple[str, str]]], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for ending, damage in DAMAGE:
        (file,) = cached[0].rglob(f"*.{ending}")
        damage(file)
        kernel = load(cached[0], monkeypatch)
        assert "is damaged and compiled again" in capsys.readouterr().err
        assert file.is_file()
        assert cache.is_sound(kernel.folder, distinct_rows.function.__code__.co_filename)


def test_read_only_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("a file, not a folder", encoding="utf-8")
    load(tmp_path / "file" / "cache", monkeypatch)
    assert "set MTP_BENCH_CACHE" in capsys.readouterr().err
    monkeypatch.setattr("mtp_bench.running.playing.parallel_map", lambda *_: pytest.fail("they would compile in vain"))
    compile_kernels(Workers(2))


def test_other_errors_of_the_compiler_are_raised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("no such instruction")

    monkeypatch.setattr(Kernel, "_jit", fail)
    with pytest.raises(RuntimeError, match="no such instruction"):
        load(tmp_path, monkeypatch)


def test_plain_python_without_numba_s_compiler(tmp_path: Path) -> None:
    assert start(tmp_path, NUMBA_DISABLE_JIT="1").communicate() == (PRINTED, "")
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
    monkeypatch.setattr(Pair, "__module__", "mtp_bench.core.errors")
    folders.append(folder_of("i8(i8)"))
    assert len(set(folders)) == 5
    monkeypatch.setitem(more.__globals__, "LITTLE", np.array([1]))
    with pytest.raises(TypeError, match=r"kernel more uses LITTLE, of type ndarray; expected a number"):
        folder_of("i8(i8)")
