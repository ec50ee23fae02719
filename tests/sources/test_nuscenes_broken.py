"""Broken files of nuScenes: one error each, which names the file and the record."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.core.errors import DataError
from mtp_bench.sources import open_source
from mtp_bench.sources.nuscenes.layout import SPLITS, official_scenes, scenes_by_split
from mtp_bench.sources.nuscenes.tables import TableRecord, read_records
from mtp_bench.sources.text import decode
from tests.support.nuscenes_root import DETECTIONS, PREDICTION, VERSION, edited, nuscenes_card, sample

Change = Callable[[list[dict[str, Any]]], object]
NAN = float("nan")


def record(token: str, /, **changes: Any) -> Change:
    return lambda records: next(each for each in records if each["token"] == token).update(changes)


def remove(token: str) -> Change:
    return lambda records: records.remove(next(each for each in records if each["token"] == token))


def repeat(token: str, /, **changes: Any) -> Change:
    return lambda records: records.append({**next(each for each in records if each["token"] == token), **changes})


def scale_times(divisor: float) -> Change:
    return lambda records: [each.update(timestamp=each["timestamp"] / divisor) for each in records]


BOX, CAR, WALKER, T = "sample_annotation", "scene-0003-car", "scene-0003-walker", "scene-0003-t"
S3, POSE, KEY = "scene-0003-token", "scene-0003-pose-1", "scene-0003-lidar-1-True-2"
C1, C2 = f"{CAR}-t1", f"{CAR}-t2"
TABLES: dict[str, tuple[str, Change, str]] = {  # table, change, what the error names
    "a sample is in no scene": ("sample", record(T + "1", scene_token="?"), f"record '{T}1': scene_token is '?'"),
    "a sample comes twice": ("sample", repeat(T + "1"), f"token '{T}1', expected one"),
    "two samples have one time": ("sample", record(T + "1", timestamp=1_500_000_200_000_000), "at least 0 s; expected"),
    "times are in milliseconds": ("sample", scale_times(1000), "Check that timestamp is in microseconds"),
    "a scene has no samples": ("scene", repeat(S3, token="new", name="new"), "record 'new'"),
    "a scene has a name twice": ("scene", record(S3, name="scene-0001"), "several scenes 'scene-0001'"),
    "no lidar keyframe": ("sample_data", record(KEY, is_key_frame=False), f"LIDAR_TOP keyframe of sample '{T}2'"),
    "two lidar keyframes": ("sample_data", record("scene-0003-lidar-1-False-2", is_key_frame=True), "a second LIDAR"),
    "an unknown sensor": ("calibrated_sensor", record("cam-1", sensor_token="x"), "sensor_token is 'x'"),
    "a pose is missing": ("ego_pose", remove(POSE), f"no record '{POSE}'"),
    "a pose is not turned": ("ego_pose", record(POSE, rotation=[0, 0, 0, 0]), f"'{POSE}': rotation is"),
    "two boxes in a sample": (BOX, record(C2, sample_token=T + "1"), f"record '{C2}': a second box"),
    "a box of no instance": (BOX, record(C1, instance_token=""), f"record '{C1}': instance_token is ''"),
    "a box of another instance": (BOX, record(CAR + "-t3", instance_token=WALKER), f"'{WALKER}-t3': a second box"),
    "a box is not turned properly": (BOX, record(C1, rotation=[0.7, 0, 0, 0.6]), f"'{C1}': rotation is [0.7, "),
}


@pytest.mark.parametrize(("table", "change", "text"), TABLES.values(), ids=TABLES)
def test_tables(data: Path, table: str, change: Change, text: str) -> None:
    with edited(data / f"nuscenes/{VERSION}/{table}.json") as records:
        change(records)
    with pytest.raises(DataError) as caught:
        open_source(nuscenes_card(), data)
    assert all(each in str(caught.value) for each in (f"{table}.json", text))


S = sample("scene-0003", 1)
BOXES: dict[str, dict[str, Any] | Callable[[dict[str, Any]], object]] = {  # changes of a box, or of the results
    "quaternion of norm 2": {"rotation": [2, 0, 0, 0]},
    "box of another sample": {"sample_token": "x"},
    "no box": lambda results: results[S].append(3),
    "no list": lambda results: results.update({S: {}}),
}


@pytest.mark.parametrize("change", BOXES.values(), ids=BOXES)
def test_detections(data: Path, change: dict[str, Any] | Callable[[dict[str, Any]], object]) -> None:
    with edited(data / DETECTIONS) as content:
        if isinstance(change, dict):
            content["results"][S][1].update(change)
        else:
            change(content["results"])
    with pytest.raises(DataError, match=rf"megvii_all\.json, sample '{S}'"):
        open_source(nuscenes_card(), data)


TARGETS: dict[str, Any] = {
    "no such instance": {"scene-0003": [f"x_{T}0"]},
    "no such sample": {"scene-0003": ["scene-0003-car_x"]},
    "a sample of another scene": {"scene-0003": ["scene-0003-car_scene-0001-t0"]},
    "a sample without the box": {"scene-0003": [f"{WALKER}_{T}2"]},
    "an instance alone": {"scene-0003": [CAR]},
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


def test_official_splits() -> None:
    scenes = official_scenes()
    assert [len(scenes[name]) for name in SPLITS] == [500, 200, 150, 8, 2]
    whole = {*scenes["train"], *scenes["train_val"], *scenes["val"]}
    assert len(whole) == 850
    assert {*scenes["mini_train"], *scenes["mini_val"]} < whole
    assert max(scenes["train_val"]) < min(scenes["train"])
    assert scenes_by_split(["scene-9", "scene-0301"]) == {"train": ("scene-0301",), "all": ("scene-0301", "scene-9")}
