"""Notices about long work: in this process, in workers, where the error stream is broken, and of commands on a pipe."""

import io
import re
import sys
import time
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from mtp_bench.core import notice
from mtp_bench.core.parallel import Workers, parallel_map
from tests.support.command_line import CommandLine


@pytest.fixture
def fast(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hundred times faster than users see it."""
    monkeypatch.setenv("MTP_BENCH_QUIET", "0")
    for name in ("SILENT_SECONDS", "LINE_SECONDS", "BAR_SECONDS"):
        monkeypatch.setattr(notice, name, getattr(notice, name) / 100)


def work_long(text: str, seconds: float = 0) -> None:
    with notice.long_work(text, seconds):
        time.sleep(0.03)


@pytest.mark.usefixtures("fast")
def test_long_work_says_what_it_does_and_how_far_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    with notice.long_work("everything"), notice.long_work("reading\x1b[2J") as progress:
        progress.started(4)
        for name in ("a", "b"):
            time.sleep(0.15)
            progress.done(name)
        work_long("a table", seconds=300)
        time.sleep(0.15)
    lines = capsys.readouterr().err.splitlines()
    assert (lines[0], lines[1]) == ("mtp_bench: reading?[2J, 0 of 4", "mtp_bench: reading?[2J, 0 of 4, 1 s so far")
    assert "mtp_bench: reading?[2J, 1 of 4, a, about 1 s left" in lines
    assert "mtp_bench: a table, about 5 min" in lines, "known to be long: at once"
    assert lines[-1].startswith("mtp_bench: reading?[2J, 2 of 4, b, ")


def test_an_estimate_never_rises(monkeypatch: pytest.MonkeyPatch) -> None:
    """Items of 1, 1, 1, 9, 1, 1 s: what is left is said while items are alike, else what has passed."""
    now_s = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    work = notice._Work("reading", 0)
    work.started(6)
    work.shown = True
    states = []
    for seconds in (1, 1, 1, 9, 1, 1):
        now_s += seconds
        work.done()
        states.append(work.state())
    assert states[:3] == ["1 of 6, about 5 s left", "2 of 6, about 4 s left", "3 of 6, about 3 s left"]
    assert states[3:] == ["4 of 6, 12 s so far", "5 of 6, about 3 s left", "6 of 6, 14 s so far"]


def test_a_notebook_has_one_line_per_cell_that_changes() -> None:
    code = "import time\nfrom mtp_bench.core import notice\nfrom mtp_bench.core import long_work\nnotice.SILENT_SECONDS = 0.02"
    code += "\nfor name in 'ab':\n    with long_work(name) as progress:\n        progress.started(3)\n        time.sleep(0.5)"
    v4: Any = nbformat.v4
    cell = v4.new_code_cell(f"import os\nos.environ['MTP_BENCH_QUIET'] = '0'\n{code}")
    book = v4.new_notebook(cells=[cell])
    NotebookClient(book, timeout=60).execute()
    (output,) = book.cells[0].outputs
    assert output.data == {"text/plain": ""}, "it is empty at the end"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.usefixtures("fast")
def test_a_terminal_has_a_bar_that_goes_at_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    for name, value in {"TERM": "xterm-256color", "COLUMNS": "120", "NO_COLOR": "1"}.items():
        monkeypatch.setenv(name, value)
    with notice.long_work("reading [b]tables[/b]") as progress:
        progress.started(4)
        time.sleep(0.15)
        progress.done("first.json")
        time.sleep(0.15)
    text = terminal.getvalue()
    assert re.search(r"reading \[b\]tables\[/b\] ━+ +1 of 4, first\.json, about \d+ s left", text), text
    assert text.endswith("\x1b[1A\x1b[2K"), "erased"
    assert "mtp_bench:" not in text


@pytest.mark.usefixtures("fast")
def test_short_work_and_workers_are_silent(capfd: pytest.CaptureFixture[str]) -> None:
    with notice.long_work("short"):
        pass
    with notice.long_work("of a caller", 300, notice.Progress()):
        time.sleep(0.05)
    parallel_map(work_long, [("in a worker", 300), ("in a worker", 300)], Workers(2))
    assert not capfd.readouterr().err


@pytest.mark.usefixtures("fast")
def test_of_two_jobs_in_threads_the_later_one_goes_on_speaking(capsys: pytest.CaptureFixture[str]) -> None:
    first, second = notice.long_work("first"), notice.long_work("second")
    first.__enter__()
    with second:
        first.__exit__(None, None, None)
        time.sleep(0.3)
    assert len([line for line in capsys.readouterr().err.splitlines() if "second" in line]) > 1


@pytest.mark.usefixtures("fast")
@pytest.mark.parametrize("stream", ["closed", "missing"])
def test_an_error_stream_that_cannot_be_written_to_stops_nothing(monkeypatch: pytest.MonkeyPatch, stream: str) -> None:
    closed = io.StringIO()
    closed.close()
    monkeypatch.setattr(sys, "stderr", closed if stream == "closed" else None)
    work_long("unheard")


@pytest.mark.usefixtures("fast")
def test_long_commands_speak_on_a_pipe_and_leave_the_output_alone(
    cli: CommandLine, card: str, kitti: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(notice, "SILENT_SECONDS", 0.0)
    run, known = tmp_path / "run", ["--env", card, "--data", kitti]
    for arguments in (
        ["run", "stp", *known, "-o", run],
        ["score", run, "--data", kitti, "--json", "-"],
        ["events", run, "--data", kitti],
        ["export", run, "--data", kitti, "-o", tmp_path / "tracks"],
        ["video", run, "--data", kitti, "-o", tmp_path / "scene.gif"],
        ["data", "--env", card, "--data", kitti],
    ):
        output = cli(*arguments)
        lines = output.err.splitlines()
        assert output.status == 0, output.err
        assert {line.split()[0] for line in lines} == {"mtp_bench:"}, arguments
        assert any("is working" not in line for line in lines), arguments
        assert "mtp_bench:" not in output.out
