"""Input cuts: counts by hand, the choice, and what is stored."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mtp_bench import load_submission
from mtp_bench.cards import load_card
from mtp_bench.env import MTPEnv
from mtp_bench.errors import MtpBenchError
from mtp_bench.sources import load_scenes
from mtp_bench.tracking import HypothesisTracker, stored_cuts
from mtp_bench.tracking.detection_cuts import STORE
from mtp_bench.training import detection_cuts
from mtp_bench.training.detection_cuts import Counts, Drive, as_toml, tried_cuts
from tests.support.command_line import CommandLine
from tests.support.tracking_scenes import kitti_task


def test_mota() -> None:
    assert Counts(0.5, truth=100, false=10, missed=20, switches=5).mota == pytest.approx(0.65)
    assert Counts(0.5, truth=0, false=1, missed=0, switches=0).mota == 0


def test_what_comes_of_cuts(card: str, kitti: str) -> None:
    scenes, task = list(load_scenes(card, data=kitti)), MTPEnv(card, kitti).task
    tried = tried_cuts([Drive(scenes, load_card(card), task)])
    assert list(tried) == list(task.classes)
    for number, (name, counts) in enumerate(tried.items()):
        assert [c.truth for c in counts] == [counts[0].truth] * len(detection_cuts.QUANTILES)
        assert counts[0].cut == -np.inf
        assert counts[0].truth == sum(
            int((scene.truth.class_id[~scene.truth.neutral] == number).sum()) for scene in scenes
        )
        assert name in task.classes


def test_stored_cuts() -> None:
    table = tomllib.loads(STORE.read_text())
    task = kitti_task()
    assert stored_cuts(task) == table["pointrcnn"]
    assert stored_cuts(replace(task, detector="pointrcnn-mine", classes=("car",))) == {"car": table["pointrcnn"]["car"]}
    assert stored_cuts(replace(task, detector="wildtrack_mvdet")) == {}
    tracker = HypothesisTracker(min_detection_score=stored_cuts(task))
    tracker.reset(task)


def test_the_table_is_read_as_it_was_written() -> None:
    assert tomllib.loads(as_toml("mine", {"car": 0.4251, "bus": 3.0})) == {"mine": {"car": 0.425, "bus": 3.0}}


def test_the_baselines_with_cuts_are_built() -> None:
    for name in ("stp_cut", "mtp_cut"):
        agent = load_submission(name).build(kitti_task())
        agent.reset(kitti_task())


@pytest.mark.data
@pytest.mark.parametrize("detector", ["acf", "megvii", "centerpoint"])
def test_the_command_gives_the_stored_cuts(cli: CommandLine, data_root: Path, detector: str) -> None:
    table = tomllib.loads(cli.ok("train", "cut", detector, "--data", data_root))
    assert table[detector] == tomllib.loads(STORE.read_text())[detector]


def test_where_the_truth_is_not_complete_there_are_no_false_positives(
    monkeypatch: pytest.MonkeyPatch, card: str, kitti: str
) -> None:
    from mtp_bench.running.options import RunOptions
    from mtp_bench.training import presence_recipes
    from mtp_bench.training.split import Split, open_split

    monkeypatch.setattr(
        Split, "scenes", lambda self: (replace(self.source.load(n), truth_complete=False) for n in self.names)
    )
    monkeypatch.setitem(
        presence_recipes.RECIPES, "mine", presence_recipes.Recipe((presence_recipes.Scenes(card, "val"),))
    )
    assert open_split(card, RunOptions(kitti)).names
    with pytest.raises(MtpBenchError, match="the truth is not complete"):
        detection_cuts.best_cuts("mine", RunOptions(kitti))
