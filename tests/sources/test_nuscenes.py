"""nuScenes source on a small root: targets, splits, what is missing, texts that are not JSON."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import parse_card
from mtp_bench.core.errors import DataError, UnknownNameError
from mtp_bench.sources import describe, open_source
from mtp_bench.sources.nuscenes.layout import SPLITS, official_scenes, scenes_by_split
from mtp_bench.sources.nuscenes.source import NuScenes
from mtp_bench.sources.nuscenes.tables import TableRecord, read_records
from mtp_bench.sources.text import as_json, decode
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
    ({"num_lidar_pts": 0, "num_radar_pts": 0}, True), ({"num_lidar_pts": 0, "num_radar_pts": None}, False),
    ({"num_lidar_pts": None, "num_radar_pts": None}, False),
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


TARGETS: dict[str, Any] = {
    "no such instance": {"scene-0003": ["x_scene-0003-t0"]},
    "no such sample": {"scene-0003": ["scene-0003-car_x"]},
    "a sample of another scene": {"scene-0003": ["scene-0003-car_scene-0001-t0"]},
    "a sample without the box": {"scene-0003": ["scene-0003-walker_scene-0003-t2"]},
    "an instance alone": {"scene-0003": ["scene-0003-car"]},
    "a list": ["scene"],
}


@pytest.mark.parametrize("content", TARGETS.values(), ids=TARGETS)
def test_prediction_targets(data: Path, content: Any) -> None:
    before = json.loads((data / PREDICTION).read_text())
    (data / PREDICTION).write_text(json.dumps({**before, **content} if isinstance(content, dict) else content))
    with pytest.raises(DataError, match=r"prediction_scenes\.json"):
        open_source(nuscenes_card(truth="targets"), data)


TEXTS = {
    "empty": "", "nested too deeply": "[" * 100_000,
    "nested too deeply in a skipped value": '[{"x": ' + "[" * 100_000, "no list": '{"a": 1}', "no record": "[1, 2]",
    "bytes that are no text": b'[{"token": "\xff\xfe"}]',
}  # fmt: skip


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_texts_that_are_not_json(tmp_path: Path, text: str | bytes) -> None:
    path = tmp_path / "table.json"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(DataError, match=r"table\.json"):
        read_records(path, TableRecord)


def test_nan_is_null_outside_of_texts(tmp_path: Path) -> None:
    path = tmp_path / "table.json"
    path.write_text('[{"token": "NaN", "x": NaN, "y": [NaN,NaN]}, {"token": "aNaN"}]')
    assert [each.token for each in read_records(path, TableRecord)] == ["NaN", "aNaN"]
    with pytest.raises(DataError, match="somewhere"):
        decode(b"NaN", list[TableRecord], "somewhere")
    with pytest.raises(DataError, match=r"somewhere, \[0\]: expected `int`, got null or NaN"):
        decode(as_json(b"[NaN]"), list[int], "somewhere")


def test_official_splits() -> None:
    scenes = official_scenes()
    assert [len(scenes[name]) for name in SPLITS] == [500, 200, 150, 8, 2]
    whole = {*scenes["train"], *scenes["train_val"], *scenes["val"]}
    assert len(whole) == 850
    assert {*scenes["mini_train"], *scenes["mini_val"]} < whole
    assert max(scenes["train_val"]) < min(scenes["train"])
    assert scenes_by_split(["scene-9", "scene-0301"]) == {"train": ("scene-0301",), "all": ("scene-0301", "scene-9")}
