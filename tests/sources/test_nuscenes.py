"""nuScenes source on a small root: frames, truth, targets, splits, what is missing."""

from pathlib import Path

import numpy as np
import pytest

from mtp_bench.cards import parse_card
from mtp_bench.core.errors import DataError, UnknownNameError
from mtp_bench.sources import describe, open_source
from mtp_bench.sources.nuscenes.source import NuScenes
from tests.support.nuscenes_root import PREDICTION, SCENES, VERSION, edited, nuscenes_card, scene, write_root


def test_targets_only(data: Path) -> None:
    found = scene(data, truth="targets")
    assert (found.truth_complete, found.listed_targets) == (False, True)
    truth = found.truth
    assert truth.object_id.tolist() == [0, 1, 0, 1, 0, 0]  # the walker is no target, all boxes of the others stay
    assert truth.eligible.tolist() == [False, True, True, False, True, False]
    assert not truth.neutral.any()  # a police car that is listed is a target


def test_scenes_without_targets_are_left_out(data: Path) -> None:
    with edited(data / PREDICTION) as targets:
        targets["scene-0003"] = []
        del targets["scene-0001"]
    assert open_source(nuscenes_card(truth="targets"), data).names == ("scene-0301",)
    assert open_source(nuscenes_card(), data).names == ("scene-0001", "scene-0003", "scene-0301")
    expected = r"has no scene of split 'val' with prediction targets; .*: train \(1\), all \(1\); choose one"
    with pytest.raises(DataError, match=expected):
        open_source(nuscenes_card(truth="targets", split="val"), data)


def test_splits(data: Path) -> None:
    for split, name in (("train", "scene-0301"), ("train_val", "scene-0001"), ("val", "scene-0003")):
        assert open_source(nuscenes_card(split=split), data).names == (name,)
    listed = r"train \(1\), train_val \(1\), val \(1\), all \(3\)"
    with pytest.raises(
        DataError, match=f"v1.0-mini has no scene of split 'mini_val'; splits with scenes: {listed}; ch"
    ):
        open_source(nuscenes_card(split="mini_val"), data)
    with pytest.raises(UnknownNameError, match="unknown scene 'scene-0301'"):
        open_source(nuscenes_card(split="val"), data).load("scene-0301")


def test_a_root_of_unofficial_scenes(data: Path) -> None:
    write_root(data, ("scene-9001",))
    assert open_source(nuscenes_card(), data).names == ("scene-9001",)
    with pytest.raises(DataError, match=r"no scene of split 'val'; splits with scenes: all \(1\)"):
        open_source(nuscenes_card(split="val"), data)


def test_a_simulated_detector_needs_no_detections(data: Path) -> None:
    (data / "nuscenes/detections/megvii_all.json").unlink()
    content = nuscenes_card().model_dump(mode="json", exclude_none=True)
    card = parse_card({**content, "detector": {"profile": "clean"}})
    bare = NuScenes(card, data).load("scene-0003")
    assert (len(bare.detections.box), bare.detector) == (0, "")
    assert "simulated" in open_source(card, data).load("scene-0003").detector
    assert describe(card, data).usable


@pytest.mark.parametrize(("counts", "neutral"), [
    ({"num_lidar_pts": 0, "num_radar_pts": 0}, True), ({"num_lidar_pts": 0}, False), ({}, False),
])  # fmt: skip
def test_boxes_without_a_point_are_neutral(data: Path, counts: dict[str, int], neutral: bool) -> None:
    """As in the official evaluation; a target of the prediction challenge is one all the same."""
    before = scene(data, SCENES[0]).truth.neutral
    with edited(data / f"nuscenes/{VERSION}/sample_annotation.json") as records:
        next(each for each in records if each["token"] == f"{SCENES[0]}-car-t1").update(counts)
    found = scene(data, SCENES[0]).truth
    changed = np.flatnonzero(found.neutral != before)
    assert len(changed) == neutral
    assert (found.frame_of_rows[changed] == 1).all()
    assert not scene(data, SCENES[0], truth="targets").truth.neutral.any()
