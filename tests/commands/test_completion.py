"""Completion of words in a shell."""

from pathlib import Path

import pytest

from mtp_bench.core.bundle import baseline_names, card_ids
from mtp_bench.training.predictors import ON
from mtp_bench.viz.incident import INCIDENT_KINDS
from mtp_bench.viz.rerun.shown import LEVELS
from mtp_bench.viz.terminal.event_table import ORDERS
from tests.support.command_line import CommandLine


class Shell:
    """Completion as bash asks for it, in a folder with a card and a submission."""

    def __init__(self, cli: CommandLine, folder: Path, patch: pytest.MonkeyPatch) -> None:
        self._cli, self._patch = cli, patch
        (folder / "own").mkdir()
        (folder / "own" / "submission.toml").touch()
        (folder / "mine.toml").touch()
        patch.chdir(folder)
        patch.setenv("_MTP_BENCH_COMPLETE", "complete_bash")

    def __call__(self, words: str) -> list[str]:
        line = f"mtp-bench {words}"
        self._patch.setenv("COMP_WORDS", line)
        self._patch.setenv("COMP_CWORD", str(len(line.split(" ")) - 1))
        return self._cli.ok().split()


@pytest.fixture
def offered(cli: CommandLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Shell:
    return Shell(cli, tmp_path, monkeypatch)


def test_environments_and_cards(offered: Shell) -> None:
    assert offered("run stp --env MTP-KITTI") == [name for name in card_ids() if name.startswith("MTP-KITTI")]
    nuscenes = [name for name in card_ids() if name.startswith("MTP-nu")]
    assert (offered("compare stp --env MTP-nu"), offered("data --env mi")) == (nuscenes, ["mine.toml"])


def test_submissions(offered: Shell) -> None:
    assert offered("run stp_s") == [name for name in baseline_names() if name.startswith("stp_s")]
    assert (offered("compare stp o"), offered("submit ./o")) == (["own"], ["./own"])


WORDS = {
    "events runs/stp --kind": INCIDENT_KINDS,
    "events runs/stp --sort": ORDERS,
    "view runs/stp --level": LEVELS,
    "train predictor modes --on": ON,
}


@pytest.mark.parametrize("asked", WORDS)
def test_words_that_an_option_takes(asked: str, offered: Shell) -> None:
    assert sorted(offered(f"{asked} ")) == sorted(WORDS[asked])


def test_commands_and_options(offered: Shell) -> None:
    assert (offered("ver"), sorted(offered("run --sc"))) == (["verify"], ["--scenes", "--scheduler"])
