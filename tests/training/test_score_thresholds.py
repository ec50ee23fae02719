"""Score thresholds: counts by hand, the choice, and what is stored."""

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
from mtp_bench.running.options import RunOptions
from mtp_bench.sources import load_scenes
from mtp_bench.tracking import HypothesisTracker, score_thresholds
from mtp_bench.tracking.parameters import read_detector
from mtp_bench.training.presence_rows import PresenceRecipe
from mtp_bench.training.score_thresholds import (
    QUANTILES,
    Counts,
    TrainingScenes,
    as_toml,
    best_thresholds,
    try_thresholds,
)
from mtp_bench.training.split import SceneChoice, Split
from tests.support.command_line import CommandLine
from tests.support.tracking_scenes import kitti_task


def test_mota() -> None:
    assert Counts(0.5, truth=100, false=10, missed=20, switches=5).mota == pytest.approx(0.65)
    assert Counts(0.5, truth=0, false=1, missed=0, switches=0).mota == 0


def test_every_threshold_is_counted_on_the_same_truth(card: str, kitti: str) -> None:
    scenes, task = list(load_scenes(card, data=kitti)), MTPEnv(card, kitti).task
    tried = try_thresholds([TrainingScenes(scenes, load_card(card), task)])
    assert list(tried) == list(task.classes)
    for number, counts in enumerate(tried.values()):
        truth = sum(int((scene.truth.class_id[~scene.truth.neutral] == number).sum()) for scene in scenes)
        assert [c.truth for c in counts] == [truth] * len(QUANTILES)
        assert counts[0].threshold == -np.inf


def test_thresholds_of_a_task() -> None:
    task, stored = kitti_task(), (read_detector("pointrcnn") or {})["min_detection_score"]
    assert score_thresholds(task) == stored
    assert score_thresholds(replace(task, detector="pointrcnn-mine", classes=("car",))) == {"car": stored["car"]}
    assert score_thresholds(replace(task, detector="wildtrack_mvdet")) == {}
    HypothesisTracker(min_detection_score=score_thresholds(task)).reset(task)
    for name in ("stp_cut", "mtp_cut"):
        load_submission(name).build(task).reset(task)


def test_the_table_is_read_as_it_was_written() -> None:
    thresholds = {"car": 0.425, "bus": 3.0}
    assert tomllib.loads(as_toml({"car": 0.4251, "bus": 3.0})) == {"min_detection_score": thresholds}


@pytest.mark.data
@pytest.mark.parametrize("detector", ["acf", "megvii", "centerpoint"])
def test_the_command_gives_the_stored_thresholds(cli: CommandLine, data_root: Path, detector: str) -> None:
    made = tomllib.loads(cli.ok("train", "score-thresholds", detector, "--data", data_root))
    assert made["min_detection_score"] == (read_detector(detector) or {})["min_detection_score"]


def test_false_positives_need_complete_truth(monkeypatch: pytest.MonkeyPatch, card: str, kitti: str) -> None:
    def incomplete(split: Split) -> list[object]:
        return [replace(split.source.load(name), truth_complete=False) for name in split.names]

    monkeypatch.setattr(Split, "scenes", incomplete)
    recipe = PresenceRecipe((SceneChoice(card, "val"),))
    monkeypatch.setattr(PresenceRecipe, "of", lambda detector: recipe)
    with pytest.raises(MtpBenchError, match="the truth is not complete"):
        best_thresholds("mine", RunOptions(kitti))
