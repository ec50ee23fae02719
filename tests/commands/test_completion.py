"""What a shell offers: the words that it would type, asked for as the shell asks."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from mtp_bench._bundle import baseline_names, card_ids
from mtp_bench.commands.submit import DIVISIONS
from mtp_bench.detector import profile_names
from mtp_bench.training.predictors import ON
from mtp_bench.viz.replay import KINDS
from mtp_bench.viz.rerun.contents import LEVELS
from mtp_bench.viz.terminal.event_table import ORDERS


def offered(words: str, folder: Path) -> list[str]:
    """Words that bash is offered for the last of ``words``."""
    line = f"mtp-bench {words}"
    asked = {"_MTP_BENCH_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(line.split(" ")) - 1)}
    done = subprocess.run(
        [sys.executable, "-m", "mtp_bench"], env={**os.environ, **asked}, cwd=folder, text=True, capture_output=True,
        check=False,
    )  # fmt: skip
    assert done.stderr == ""
    return done.stdout.split()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Somebody's own card and submission."""
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "submission.toml").touch()
    (tmp_path / "mine.toml").touch()
    return tmp_path


def test_environments_and_cards(folder: Path) -> None:
    assert offered("run stp --env MTP-KITTI", folder) == [name for name in card_ids() if name.startswith("MTP-KITTI")]
    nuscenes = ["MTP-nuScenes-CenterPoint-v0", "MTP-nuScenes-mini-v0", "MTP-nuScenes-v0"]
    assert offered("compare stp --env MTP-nu", folder) == nuscenes
    assert offered("data --env mi", folder) == ["mine.toml"]


def test_submissions(folder: Path) -> None:
    assert offered("run stp_s", folder) == [name for name in baseline_names() if name.startswith("stp_s")]
    assert offered("compare stp o", folder) == ["own"]
    assert offered("submit ./o", folder) == ["./own"]


def test_detectors(folder: Path) -> None:
    kitti = [name for name in profile_names() if name.startswith("kitti")]
    assert len(kitti) > 1
    assert offered("run stp --env MTP-KITTI-v0 --detector kitti", folder) == kitti


WORDS = {
    "events runs/stp --kind": KINDS,
    "events runs/stp --sort": ORDERS,
    "view runs/stp --level": LEVELS,
    "train predictor modes --on": ON,
    "submit stp --division": DIVISIONS,
}


@pytest.mark.parametrize("asked", WORDS)
def test_words_that_an_option_takes(asked: str, folder: Path) -> None:
    assert sorted(offered(f"{asked} ", folder)) == sorted(WORDS[asked])


def test_commands_and_options(folder: Path) -> None:
    assert offered("ver", folder) == ["verify"]
    assert sorted(offered("run --sc", folder)) == ["--scenes", "--scheduler"]
