"""Notices about long work: on a pipe, on a terminal, in workers, and where the error stream is broken."""

from __future__ import annotations

import io
import os
import subprocess
import sys
import time

import pytest

from mtp_bench import notice
from mtp_bench.parallel import Workers, parallel_map, reported


@pytest.fixture
def fast(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hundred times faster than users see it."""
    monkeypatch.setenv("MTP_BENCH_QUIET", "0")
    for name in ("SILENT_SECONDS", "LINE_SECONDS", "BAR_SECONDS"):
        monkeypatch.setattr(notice, name, getattr(notice, name) / 100)


def speaks(text: str, seconds: float = 0) -> None:
    """Work of 30 ms, which is long."""
    with notice.work(text, seconds):
        time.sleep(0.03)


@pytest.mark.usefixtures("fast")
def test_long_work_speaks_and_says_how_far_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    with notice.work("everything", around=True), reported("reading\x1b[2J") as progress:
        progress.started(4)
        for name in ("a", "b"):
            time.sleep(0.15)
            progress.done(name)
        speaks("a table", seconds=300)
        time.sleep(0.15)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "mtp_bench: reading?[2J, 0 of 4"
    assert lines[1].startswith("mtp_bench: reading?[2J, 0 of 4, 1 s so far")
    assert any(line.startswith("mtp_bench: reading?[2J, 1 of 4, a, about 1 s left") for line in lines)
    assert "mtp_bench: a table, about 5 min" in lines, "known to be long: at once"
    assert lines[-1].startswith("mtp_bench: reading?[2J, 2 of 4, b, about ")


@pytest.mark.usefixtures("fast")
def test_short_work_workers_and_those_who_want_it_are_silent(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with notice.work("short"):
        pass
    with notice.work("around"), notice.work(""):
        time.sleep(0.05)
    parallel_map(speaks, [("in a worker", 300), ("in a worker", 300)], Workers(2))
    assert not capfd.readouterr().err
    speaks("here")
    assert capfd.readouterr().err.startswith("mtp_bench: here\n")
    monkeypatch.setenv("MTP_BENCH_QUIET", "1")
    speaks("quiet")
    assert not capfd.readouterr().err


@pytest.mark.usefixtures("fast")
@pytest.mark.parametrize("stream", ["closed", "missing"])
def test_an_error_stream_that_cannot_be_written_to_stops_nothing(monkeypatch: pytest.MonkeyPatch, stream: str) -> None:
    closed = io.StringIO()
    closed.close()
    monkeypatch.setattr(sys, "stderr", closed if stream == "closed" else None)
    speaks("unheard")


@pytest.mark.usefixtures("fast")
def test_a_terminal_shows_a_bar_that_leaves_no_trace() -> None:
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    code = "from tests.test_notice import *; notice.SILENT_SECONDS = 0\n"
    code += "with reported('x') as p: p.started(2); time.sleep(.1); p.done(); time.sleep(.4)"
    subprocess.run([sys.executable, "-c", code], stderr=theirs, check=True)
    shown = os.read(ours, 1 << 16).decode()
    assert "\r[##########----------] 1 of 2, about " in shown
    assert shown.rpartition("\r")[0].rpartition("\r")[2].strip() == ""
