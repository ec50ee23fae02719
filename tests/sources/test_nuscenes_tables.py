"""Broken nuScenes tables: one clear error each, which names the file and the token."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.errors import DataError
from mtp_bench.sources import open_source
from tests.support.nuscenes_root import VERSION, Record, Tables, make_tables, nuscenes_card, write_root, write_tables


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return write_root(tmp_path)


def find(tables: Tables, table: str, token: str) -> Record:
    return next(record for record in tables[table] if record["token"] == token)


def change(table: str, token: str, **changes: Any) -> Callable[[Tables], None]:
    return lambda tables: find(tables, table, token).update(changes)


def remove(table: str, token: str) -> Callable[[Tables], None]:
    return lambda tables: tables[table].remove(find(tables, table, token))


def repeat(table: str, original: str, **changes: Any) -> Callable[[Tables], None]:
    return lambda tables: tables[table].append({**find(tables, table, original), **changes})


def without(table: str, token: str, key: str) -> Callable[[Tables], None]:
    def drop(tables: Tables) -> None:
        del find(tables, table, token)[key]

    return drop


def scaled_times(divisor: float) -> Callable[[Tables], None]:
    """All time stamps in another unit."""

    def scale(tables: Tables) -> None:
        for record in tables["sample"]:
            record["timestamp"] = record["timestamp"] / divisor

    return scale


BOX, CAR, WALKER, T = "sample_annotation", "scene-0003-car", "scene-0003-walker", "scene-0003-t"
C1, C2 = f"{CAR}-t1", f"{CAR}-t2"
S3, POSE, FAR, KEY = "scene-0003-token", "scene-0003-pose-1", "scene-0003-far-1", "scene-0003-lidar-1-True-2"
NAN, INF = float("nan"), float("inf")
BROKEN: dict[str, tuple[Callable[[Tables], None], str, str, str]] = {  # change, file, token, what the error says
    "sample missing in the chain": (remove("sample", T + "2"), "sample", T + "2", "is 'scene-0003-t2', but sample"),
    "sample without next": (change("sample", T + "1", next=""), "sample", T + "2", "its 'prev' does not"),
    "sample chain goes back": (change("sample", T + "2", next=T + "0"), "sample", T + "2", "its 'next' does not"),
    "sample repeated in the chain": (change("sample", T + "1", next=T + "1"), "sample", T + "1", "broken chain"),
    "sample chain goes to another scene": (
        change("sample", T + "2", scene_token="scene-0001-token"), "sample", T + "1", "belongs to another scene",
    ),
    "sample twice": (repeat("sample", T + "1"), "sample", T + "1", "expected one"),
    "sample in no scene": (change("sample", T + "1", scene_token="?"), "sample", T + "1", "is '\\?', but scene"),
    "sample with no scene": (change("sample", T + "1", scene_token=""), "sample", T + "1", "is '', but scene"),
    "box with no instance": (change(BOX, C1, instance_token=""), BOX, C1, "instance_token is '', but instance"),
    "instance without boxes": (
        change("instance", CAR, first_annotation_token=""), "instance", CAR, "first_annotation_token is ''",
    ),
    "sample beside the chain": (
        repeat("sample", T + "1", token="new", prev="", next=""), "scene", S3, "not one chain",
    ),
    "time stands": (change("sample", T + "1", timestamp=1), "sample", T + "0", "its 'next' is not later"),
    "time not finite": (change("sample", T + "1", timestamp=NAN), "sample", T + "1", "timestamp is nan"),
    "time is text": (change("sample", T + "1", timestamp="now"), "sample", T + "1", "timestamp is 'now'"),
    "time negative": (change("sample", T + "1", timestamp=-5), "sample", T + "1", "timestamp is -5"),
    "time too large": (change("sample", T + "1", timestamp=10**400), "sample", T + "1", "expected a time in microsec"),
    "time is a truth value": (change("sample", T + "1", timestamp=True), "sample", T + "1", "timestamp is True"),
    "times in milliseconds": (scaled_times(1000), "sample", "scene-0001-t0", "scene-0001 are 0.0005 s .* in microsec"),
    "times in seconds": (scaled_times(1e6), "sample", "scene-0001-t0", "scene-0001 are 5e-07 s apart"),
    "times in nanoseconds": (scaled_times(0.001), "sample", "scene-0301-t0", "expected a time in microseconds"),
    "first sample is another": (
        change("scene", S3, first_sample_token=T + "1"), "scene", S3, "its first record",
    ),
    "last sample unknown": (
        change("scene", S3, last_sample_token="x"), "scene", S3, "is 'x', but sample.json",
    ),
    "number of samples": (
        change("scene", S3, nbr_samples=5), "scene", S3, "says that it has 5 .*found 4",
    ),
    "number of samples too large": (
        change("scene", S3, nbr_samples=10**30), "scene", S3, r"expected a whole number up to 1e\+09",
    ),
    "number of samples is a truth value": (change("scene", S3, nbr_samples=True), "scene", S3, "is True, expected a"),
    "scene name": (change("scene", S3, name="../x"), "scene", S3, "name is '../x'"),
    "no lidar keyframe": (
        change("sample_data", KEY, is_key_frame=False), "sample_data", T + "2", "no LIDAR_TOP",
    ),
    "two lidar keyframes": (
        change("sample_data", "scene-0003-lidar-1-False-2", is_key_frame=True),
        "sample_data", KEY, "a second LIDAR_TOP keyframe",
    ),
    "keyframe of no sample": (
        change("sample_data", KEY, sample_token="x"),
        "sample_data", KEY, "sample_token is 'x', but sample.json",
    ),
    "keyframe of no sensor": (
        change("sample_data", KEY, calibrated_sensor_token="x"),
        "sample_data", KEY, "calibrated_sensor_token is 'x'",
    ),
    "sensor unknown": (
        change("calibrated_sensor", "cam-1", sensor_token="x"), "calibrated_sensor", "cam-1", "sensor_token is 'x'",
    ),
    "pose missing": (remove("ego_pose", POSE), "ego_pose", POSE, "has no record"),
    "pose twice": (repeat("ego_pose", POSE), "ego_pose", POSE, "expected one"),
    "pose that is not used twice": (repeat("ego_pose", FAR), "ego_pose", FAR, "expected one"),
    "sensor twice": (repeat("sensor", "lidar", channel="CAM"), "sensor", "lidar", "expected one"),
    "calibration twice": (
        repeat("calibrated_sensor", "lidar-1", sensor_token="cam"), "calibrated_sensor", "lidar-1", "expected one",
    ),
    "category twice": (repeat("category", "car", name="animal"), "category", "car", "expected one"),
    "pose too far": (change("ego_pose", POSE, translation=[1e308, 0, 0]), "ego_pose", POSE, r"up to 1e\+09"),
    "pose not finite": (
        change("ego_pose", POSE, translation=[0, INF, 0]), "ego_pose", POSE, "translation",
    ),
    "pose not turned": (
        change("ego_pose", POSE, rotation=[0, 0, 0, 0]), "ego_pose", POSE, "expected a unit quaternion",
    ),
    "box missing in the chain": (
        remove(BOX, C2), BOX, C2, f"is '{CAR}-t2', but sample_",
    ),
    "box without next": (change(BOX, C1, next=""), BOX, C2, "broken"),
    "box of another instance": (
        change(BOX, CAR + "-t3", instance_token=WALKER), BOX, WALKER + "-t3", "a second box",
    ),
    "chain of another instance": (
        change(BOX, C2, instance_token=WALKER),
        BOX, C1, "belongs to another instance",
    ),
    "two boxes in a sample": (
        change(BOX, C2, sample_token=T + "1"), BOX, C2, "a second box",
    ),
    "boxes go back in time": (
        change(BOX, WALKER + "-t0", sample_token=T + "2"), BOX, WALKER, "is not later",
    ),
    "box in another scene": (
        change(BOX, "scene-0301-car-t3", sample_token="scene-0001-t3"),
        BOX, "scene-0301-car-t2", "'next' is in another scene",
    ),
    "box in no sample": (
        change(BOX, C1, sample_token="x"), BOX, C1, "sample_token is 'x'",
    ),
    "box of no instance": (
        change(BOX, C1, instance_token="x"), BOX, C1, "is 'x', but instance",
    ),
    "box not finite": (
        change(BOX, C1, translation=[NAN, 0, 0]), BOX, C1, "translation is",
    ),
    "box too far": (change(BOX, C1, translation=[0, -1e25, 0]), BOX, C1, r"-1e\+25, 0.0\], expected .* up to 1e\+09"),
    "box too far for a number": (change(BOX, C1, translation=[10**400, 0, 0]), BOX, C1, "translation is .* 3 numbers"),
    "box at a truth value": (change(BOX, C1, translation=[True, 0, 0]), BOX, C1, r"is \[True, 0, 0\], expected 3"),
    "box too large": (change(BOX, C1, size=[1, 100.5, 1]), BOX, C1, "and up to 100 m"),
    "box turned without end": (change(BOX, C1, rotation=[1e308, 0, 0, 0]), BOX, C1, r"rotation is .* up to 1e\+09"),
    "box without size": (
        change(BOX, C1, size=[1, 0, 1]), BOX, C1, "sizes above 0",
    ),
    "box with two sizes": (
        change(BOX, C1, size=[1, 2]), BOX, C1, "expected 3 numbers",
    ),
    "box size not finite": (
        change(BOX, C1, size=[1, NAN, 1]), BOX, C1, "size is",
    ),
    "box with a text": (
        change(BOX, C1, translation=["1", 2, 3]), BOX, C1, "expected 3",
    ),
    "box without rotation": (
        without(BOX, C1, "rotation"), BOX, C1, "rotation is None",
    ),
    "box not turned properly": (
        change(BOX, C1, rotation=[0.7, 0, 0, 0.6]), BOX, C1, "expected a unit quaternion",
    ),
    "box rotation not finite": (
        change(BOX, C1, rotation=[NAN, 0, 0, 1]), BOX, C1, "rotation is",
    ),
    "number of boxes": (change("instance", CAR, nbr_annotations=3), "instance", CAR, "says that it has 3 .*found 4"),
    "number of boxes too large": (change("instance", CAR, nbr_annotations=10**30), "instance", CAR, "a whole number"),
    "number of boxes is text": (change("instance", CAR, nbr_annotations="4"), "instance", CAR, "a whole number"),
    "first box is another": (change("instance", CAR, first_annotation_token=C1), "instance", CAR, "its first"),
    "last box is of another": (
        change("instance", CAR, last_annotation_token=WALKER + "-t3"), "instance", CAR, "its last record",
    ),
    "instance of no category": (change("instance", CAR, category_token="x"), "instance", CAR, "category_token is 'x'"),
    "instance without a token": (without("instance", CAR, "token"), "instance", "", "token is None, expected a text"),
}  # fmt: skip


@pytest.mark.parametrize("case", BROKEN)
def test_broken_tables(data: Path, case: str) -> None:
    spoil, file, token, message = BROKEN[case]
    tables = make_tables()
    spoil(tables)
    write_tables(data, tables)
    with pytest.raises(DataError, match=message) as caught:
        open_source(nuscenes_card(), data)
    assert str(data / "nuscenes" / VERSION / f"{file}.json") in str(caught.value)
    assert token in str(caught.value)
