"""Completion of words in a shell, as bash asks for it."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from mtp_bench.core.bundle import baseline_names, card_ids
from mtp_bench.training.predictors import ON
from mtp_bench.viz.incident import INCIDENT_KINDS
from mtp_bench.viz.rerun.shown import LEVELS
from mtp_bench.viz.terminal.event_table import ORDERS
from tests.support.command_line import CommandLine

OFFERED: dict[str, Sequence[str]] = {  # in a folder with a card and a submission
    "run stp --env MTP-KITTI": [name for name in card_ids() if name.startswith("MTP-KITTI")],
    "data --env mi": ["mine.toml"], "run stp_s": [name for name in baseline_names() if name.startswith("stp_s")],
    "compare stp o": ["own"], "submit ./o": ["./own"], "events runs/stp --kind ": INCIDENT_KINDS,
    "events runs/stp --sort ": ORDERS, "view runs/stp --level ": LEVELS, "train predictor modes --on ": ON,
    "ver": ["verify"], "run --sc": ["--scenes", "--scheduler"],
}  # fmt: skip


@pytest.mark.parametrize("words", OFFERED)
def test_words_that_are_offered(words: str, cli: CommandLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "submission.toml").touch()
    (tmp_path / "mine.toml").touch()
    monkeypatch.chdir(tmp_path)
    line = f"mtp-bench {words}"
    environment = {"_MTP_BENCH_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": line.count(" ")}
    for name, value in environment.items():
        monkeypatch.setenv(name, str(value))
    assert sorted(cli.ok().split()) == sorted(OFFERED[words])
