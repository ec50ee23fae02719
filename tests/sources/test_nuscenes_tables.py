"""Broken nuScenes tables: one clear error each, which names the file and the token."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.errors import DataError
from mtp_bench.sources import open_source
from tests.support.nuscenes_root import VERSION, Record, Tables, make_tables, nuscenes_card, write_tables


def find(tables: Tables, table: str, token: str) -> Record:
    return next(record for record in tables[table] if record["token"] == token)


Case = tuple[Callable[[Tables], object], str, str, str]  # change, file, token, what the error says


def wrong(table: str, token: str, message: str, /, **changes: Any) -> Case:
    """A record with other fields, which the error names itself."""
    return change(table, token, **changes), table, token, message


def change(table: str, token: str, **changes: Any) -> Callable[[Tables], None]:
    return lambda tables: find(tables, table, token).update(changes)


def remove(table: str, token: str) -> Callable[[Tables], None]:
    return lambda tables: tables[table].remove(find(tables, table, token))


def repeat(table: str, original: str, **changes: Any) -> Callable[[Tables], None]:
    return lambda tables: tables[table].append({**find(tables, table, original), **changes})


def without(table: str, token: str, key: str) -> Callable[[Tables], object]:
    return lambda tables: find(tables, table, token).pop(key)


def same_time(first: str, second: str) -> Callable[[Tables], None]:
    return lambda tables: find(tables, "sample", second).update(timestamp=find(tables, "sample", first)["timestamp"])


def scaled_times(divisor: float) -> Callable[[Tables], None]:
    """All time stamps in another unit."""

    def scale(tables: Tables) -> None:
        for record in tables["sample"]:
            record["timestamp"] = record["timestamp"] / divisor

    return scale


BOX, CAR, WALKER, T = "sample_annotation", "scene-0003-car", "scene-0003-walker", "scene-0003-t"
C1, C2 = f"{CAR}-t1", f"{CAR}-t2"
S3, POSE, FAR, KEY = "scene-0003-token", "scene-0003-pose-1", "scene-0003-far-1", "scene-0003-lidar-1-True-2"
NAN = float("nan")
BROKEN: dict[str, Case] = {
    "sample missing": (remove("sample", T + "2"), "scene", S3, "says that it has 4 .*found 3"),
    "sample in another scene": (
        change("sample", T + "2", scene_token="scene-0001-token"),
        "scene",
        "scene-0001-token",
        "says that it has 4 .*found 5",
    ),
    "sample twice": (repeat("sample", T + "1"), "sample", T + "1", "expected one"),
    "sample in no scene": wrong("sample", T + "1", "is '\\?', but scene", scene_token="?"),
    "sample with no scene": wrong("sample", T + "1", "is '', but scene", scene_token=""),
    "box with no instance": wrong(BOX, C1, "instance_token is '', but instance", instance_token=""),
    "scene without samples": (repeat("scene", S3, token="new", name="new", nbr_samples=0), "scene", "new", "found 0"),
    "sample too many": (repeat("sample", T + "1", token="new"), "scene", S3, "says that it has 4 .*found 5"),
    "time stands": (same_time(T + "0", T + "1"), "sample", T, "another sample of scene-0003 has its time"),
    "time not finite": wrong("sample", T + "1", "timestamp is None", timestamp=NAN),
    "time is text": wrong("sample", T + "1", "timestamp is 'now'", timestamp="now"),
    "time negative": wrong("sample", T + "1", "timestamp is -5", timestamp=-5),
    "time too large": wrong("sample", T + "1", "expected a time in microsec", timestamp=10**18),
    "time is a truth value": wrong("sample", T + "1", "timestamp is True", timestamp=True),
    "times in milliseconds": (scaled_times(1000), "sample", "scene-0001-t0", "scene-0001 are 0.0005 s .* in microsec"),
    "times in seconds": (scaled_times(1e6), "sample", "scene-0001-t0", "scene-0001 are 5e-07 s apart"),
    "times in nanoseconds": (scaled_times(0.001), "sample", "scene-0301-t0", "expected a time in microseconds"),
    "number of samples": wrong("scene", S3, "says that it has 5 .*found 4", nbr_samples=5),
    "number of samples too large": wrong("scene", S3, r"expected a whole number up to 1e\+09", nbr_samples=10**10),
    "number of samples is a truth value": wrong("scene", S3, "is True, expected a", nbr_samples=True),
    "scene name": wrong("scene", S3, "name is '../x'", name="../x"),
    "no lidar keyframe": (change("sample_data", KEY, is_key_frame=False), "sample_data", T + "2", "no LIDAR_TOP"),
    "two lidar keyframes": (
        change("sample_data", "scene-0003-lidar-1-False-2", is_key_frame=True),
        "sample_data",
        KEY,
        "a second LIDAR_TOP keyframe",
    ),
    "keyframe of no sample": wrong("sample_data", KEY, "sample_token is 'x', but sample.json", sample_token="x"),
    "keyframe of no sensor": wrong("sample_data", KEY, "calibrated_sensor_token is 'x'", calibrated_sensor_token="x"),
    "sensor unknown": wrong("calibrated_sensor", "cam-1", "sensor_token is 'x'", sensor_token="x"),
    "pose missing": (remove("ego_pose", POSE), "ego_pose", POSE, "has no record"),
    "pose twice": (repeat("ego_pose", POSE), "ego_pose", POSE, "expected one"),
    "pose that is not used twice": (repeat("ego_pose", FAR), "ego_pose", FAR, "expected one"),
    "sensor twice": (repeat("sensor", "lidar", channel="CAM"), "sensor", "lidar", "expected one"),
    "calibration twice": (
        repeat("calibrated_sensor", "lidar-1", sensor_token="cam"),
        "calibrated_sensor",
        "lidar-1",
        "expected one",
    ),
    "category twice": (repeat("category", "car", name="animal"), "category", "car", "expected one"),
    "pose too far": wrong("ego_pose", POSE, r"up to 1e\+09", translation=[1e308, 0, 0]),
    "pose at no place": wrong("ego_pose", POSE, "translation", translation=[0, 1e300, 0]),
    "pose not turned": wrong("ego_pose", POSE, "expected a unit quaternion", rotation=[0, 0, 0, 0]),
    "box missing": (remove(BOX, C2), "instance", CAR, "says that it has 4 .*found 3"),
    "box of another instance": (change(BOX, CAR + "-t3", instance_token=WALKER), BOX, WALKER + "-t3", "a second box"),
    "instance without boxes": (repeat("instance", CAR, token="new", nbr_annotations=0), "instance", "new", "found 0"),
    "two boxes in a sample": wrong(BOX, C2, "a second box", sample_token=T + "1"),
    "box in no sample": wrong(BOX, C1, "sample_token is 'x'", sample_token="x"),
    "box of no instance": wrong(BOX, C1, "is 'x', but instance", instance_token="x"),
    "box not finite": wrong(BOX, C1, "translation is", translation=[NAN, 0, 0]),
    "box too far": wrong(BOX, C1, r"-1e\+25, 0.0\], expected .* up to 1e\+09", translation=[0, -1e25, 0]),
    "box too large": wrong(BOX, C1, "and up to 100 m", size=[1, 100.5, 1]),
    "box without size": wrong(BOX, C1, "sizes above 0", size=[1, 0, 1]),
    "box with two sizes": wrong(BOX, C1, "expected 3 numbers", size=[1, 2]),
    "box without rotation": (without(BOX, C1, "rotation"), BOX, C1, "rotation is None"),
    "box not turned properly": wrong(BOX, C1, "expected a unit quaternion", rotation=[0.7, 0, 0, 0.6]),
    "number of boxes": wrong("instance", CAR, "says that it has 3 .*found 4", nbr_annotations=3),
    "number of boxes too large": wrong("instance", CAR, "a whole number", nbr_annotations=10**10),
    "number of boxes is text": wrong("instance", CAR, "a whole number", nbr_annotations="4"),
    "instance of no category": wrong("instance", CAR, "category_token is 'x'", category_token="x"),
    "instance without a token": (without("instance", CAR, "token"), "instance", "", "token is None, expected a text"),
}


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
