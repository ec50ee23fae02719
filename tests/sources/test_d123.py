"""Logs of 123D as own scenes: what is read and what is not, mistakes, and AV2 logs equal to the native ones."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from mtp_bench.cards import load_card, with_detector, with_files
from mtp_bench.core import Scene
from mtp_bench.core.errors import DataError
from mtp_bench.sources import load_scenes
from mtp_bench.sources.argoverse2.source import scene_lanes
from mtp_bench.sources.d123.logs import LABELS, import_logs
from tests.support.command_line import CommandLine
from tests.support.drawn_recordings import Recording, Row
from tests.support.layouts import d123_tables, write_log
from tests.support.own_scenes import assert_same
from tests.support.small_scenes import write_card

BOXES, EGO = "box_detections_se3", "ego_state_se3"
NUSCENES = "MTP-nuScenes-mini-v0"
START, FRAMES = 1_700_000_000_000_000, 10
Tables = dict[str, tuple[dict[str, Any], dict[str, Any]]]  # columns and metadata by name of the file


def log_tables() -> Tables:
    """The ego drives along x with 5 m/s, its poses 4 ms before and 6 ms after each frame; "far" comes towards it."""
    truth = [
        Row(t, name, kind, np.array([x + step * t, y, 1, 0, 4, 2, 1.5]))
        for t in range(FRAMES)
        for name, kind, x, y, step in (("car", "1", 10, 3, 1), ("man", "2", 4, -10, 0), ("far", "1", 72, 0, -2))
    ]
    tables = d123_tables(Recording(np.arange(FRAMES) / 10, np.zeros((FRAMES, 6)), truth, []))
    times = [START + 100_000 * t + late for t in range(FRAMES) for late in (-4000, 6000)]
    line = {b"__ndarray__": True, b"dtype": "<f8", b"shape": [3, 3]}

    def lane(x: float, kind: int, after: list[int]) -> bytes:
        xyz = {
            y: {**line, b"data": np.array([[x + s, y, 9.0] for s in (0, 4, 8)]).tobytes()} for y in (2000, 2002, 1998)
        }
        lines = dict(zip(("centerline", "left_boundary", "right_boundary"), xyz.values(), strict=True))
        return msgspec.msgpack.encode({"lane_type": kind, "lane_group_id": 7, "successor_ids": after, **lines})

    lanes = [lane(1000, 2, [42, 41, 99]), lane(1008, 3, []), lane(1008, 2, []), lane(5000, 2, [])]
    poses = [[1000.2 + 5e-6 * (t - START), 2000.0, 50.4, 1.0, 0.0, 0.0, 0.0] for t in times]
    tables[EGO] = {"timestamp_us": times, "imu_se3": poses}, {}
    tables[BOXES][0]["num_lidar_points"] = [[5, 0, None]] * FRAMES
    tables[BOXES][0]["velocity_3d"] = [[[9.0, 9.0, 9.0]] * 3] * FRAMES
    features = [*lanes, msgspec.msgpack.encode({"intersection_id": 1})]
    return {
        **tables,
        "route_position": ({"remaining_m": [9.0]}, {"polyline_x": [1.0]}),
        "map": ({"object_id": [40, 41, 42, 43, 7], "map_layer": [0, 0, 0, 0, 1], "features": features}, {}),
    }


def imported(tmp_path: Path, tables: Tables) -> Scene:
    import_logs(write_log(tmp_path / "split/one", tables).parent, tmp_path / "own", 10, 60)
    card = with_files(load_card(write_card(tmp_path)), tmp_path / "own")
    (scene,) = load_scenes(with_detector(card, "kitti_pointrcnn"))
    return scene


def test_a_log_is_a_scene(tmp_path: Path) -> None:
    scene = imported(tmp_path, log_tables())
    truth, names = scene.truth, [scene.name_of(i) for i in scene.truth.object_id.tolist()]
    np.testing.assert_allclose(scene.ego[1:, 0], 0.2 + 0.5 * np.arange(1, FRAMES), atol=1e-6)
    np.testing.assert_allclose(scene.ego[0, 0], 0.18, atol=1e-6, err_msg="a single pose before it: no motion")
    assert names == ["car", "man"] * 5 + ["car", "man", "far"] * 5, "far is within 60 m from frame 5 on"
    assert truth.neutral.tolist() == [name == "man" for name in names]
    first, second = scene.lanes
    assert (first.following, second.following, first.junction) == ((1,), (), True), "without that of bicycles"
    np.testing.assert_allclose([first.center[2], first.left[2], first.right[2]], [[4, 0], [4, 2], [4, -2]])


@pytest.mark.parametrize(("registry", "table"), tomllib.loads(LABELS.read_text()).items())
def test_every_label_is_a_class_or_skipped(registry: str, table: dict[str, str]) -> None:
    assert list(table) == [str(number) for number in range(len(table))], registry
    assert {word.removeprefix("neutral ") for word in table.values()} <= {"skipped", *load_card(NUSCENES).task.classes}


def content(folder: Path) -> list[bytes]:
    return [path.read_bytes() for path in sorted(folder.rglob("*.parquet"))]


def test_what_leaks_changes_nothing(tmp_path: Path) -> None:
    imported(tmp_path / "a", log_tables())
    changed = log_tables()
    changed[BOXES][0]["velocity_3d"] = [[[-1.0, 7.0, np.nan]] * 3] * FRAMES
    changed["route_position"] = ({"remaining_m": [1.0]}, {"polyline_x": [7.0]})
    changed[EGO][0]["imu_se3"][-1][1] += 1.0  # 6 ms after the last frame
    imported(tmp_path / "b", changed)
    del changed["route_position"]
    imported(tmp_path / "c", changed)
    log, city = tmp_path / "c/split/one", tmp_path / "maps/made/made_up.arrow"
    city.parent.mkdir(parents=True)
    (log / "map.arrow").rename(city)
    import_logs(log, tmp_path / "d", 10, 60)
    assert content(tmp_path / "a/own") == content(tmp_path / "b/own") == content(tmp_path / "c/own")
    assert content(tmp_path / "a/own") == content(tmp_path / "d"), "a map of the city"


LINE = msgspec.msgpack.encode({"centerline": {b"shape": [1]}})
BROKEN: list[tuple[str, int, dict[str, Any], str]] = [  # file, its columns (0) or metadata (1), change, message
    (BOXES, 1, {"box_detection_label_class": "my.Labels"}, "unknown labels 'Labels', expected one of AV2Sensor"),
    (BOXES, 0, {"label": [[1, 2, 9]] * FRAMES}, "WODPerceptionBoxDetectionLabel has no label 9"),
    (BOXES, 0, {"label": [[1, 2]] * FRAMES}, f"{BOXES}.label has other lengths of its lists than the columns bef"),
    (BOXES, 0, {"label": [1] * FRAMES}, "one cannot be read as a file of 123D: "),
    (BOXES, 0, {"timestamp_us": [START + 140_000 * t for t in range(FRAMES)]}, "one has 7.14 frames per second: exp"),
    (BOXES, 0, {"timestamp_us": [START] * FRAMES}, f"{BOXES}.arrow: the times of its rows do not increase"),
    (EGO, 0, {"imu_se3": None}, f"{EGO}.arrow cannot be read as a file of 123D: no column '{EGO}.imu_se3', found: "),
    (EGO, 0, {"imu_se3": [[2.0] * 7] * 20}, f"{EGO}.arrow, pose 1: rotation is [2.0, 2.0, 2.0, 2.0], expected a unit"),
    (EGO, 0, {"timestamp_us": [5] * 20}, f"{EGO}.arrow: no frame of the boxes has a pose of the 0.1 s before it"),
    ("sync", 1, {"split": "nuscenes-interpolated_val"}, "boxes between keyframes show the next keyframe"),
    ("map", 0, {"features": [LINE] * 5}, "map.arrow cannot be read as a file of 123D: a lane lacks one of its lines"),
]


@pytest.mark.parametrize(("name", "part", "change", "message"), BROKEN)
def test_a_mistake_is_one_sentence(name: str, part: int, change: dict[str, Any], message: str, tmp_path: Path) -> None:
    tables = log_tables()
    tables[name][part].update(change)
    with pytest.raises(DataError) as caught:
        import_logs(write_log(tmp_path / "one", tables), tmp_path / "own", 10, 60)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "own").exists()


@pytest.mark.parametrize("name", ["sync", BOXES, EGO, "map"])
@pytest.mark.parametrize("size", [None, 0, 500, -300])
def test_a_broken_file_is_one_sentence(name: str, size: int | None, tmp_path: Path) -> None:
    path = write_log(tmp_path / "one", log_tables()) / f"{name}.arrow"
    path.write_bytes(b"no arrow" * 100 if size is None else path.read_bytes()[:size])
    with pytest.raises(DataError, match=rf"{name}\.arrow cannot be read as a file of 123D: \S"):
        import_logs(tmp_path / "one", tmp_path / "own", 10, 60)


def test_the_command_says_what_is_next(tmp_path: Path, cli: CommandLine) -> None:
    write_log(tmp_path / "split/one", log_tables())
    out = cli("import", "123d", tmp_path / "split", "-o", tmp_path / "own", "--rate", "5").out
    assert out.startswith("1 log with 12 boxes in 5 frames and 2 lanes in ")
    assert "mtp-bench study --env MTP-AV2-v0 --files" in out
    error = cli("import", "123d", tmp_path, "-o", tmp_path / "b").error
    assert all(text in error for text in ("has no box_detections_se3.arrow", "; logs are in split: name one"))


def ordered(scene: Scene) -> list[Any]:
    """Names of the objects, and all numbers of their boxes, by frame and name."""
    truth, names = scene.truth, np.array([scene.name_of(number) for number in scene.truth.object_id.tolist()])
    order = np.lexsort([names, truth.frame_of_rows])
    columns = truth.frame_of_rows, truth.box, truth.velocity, truth.class_id, truth.neutral, truth.eligible
    return [names[order], np.column_stack([scene.time, scene.ego]), *(column[order] for column in columns)]


@pytest.mark.data
@pytest.mark.parametrize(("env", "rate"), [("MTP-AV2-v0", 2), ("MTP-AV2-10Hz-v0", 10)])
def test_logs_are_equal_to_the_native_ones(env: str, rate: int, data_root: Path, tmp_path: Path) -> None:
    import_logs(data_root / "123d/logs/av2-sensor_val", tmp_path / "own", rate, 60)
    card = load_card(env)
    for scene in load_scenes(with_files(card, tmp_path / "own"), data_root):
        (native,) = load_scenes(card, data_root, [scene.name])
        (names, *numbers), (same, *others) = ordered(scene), ordered(native)
        assert names.tolist() == same.tolist()
        for number, other in zip(numbers, others, strict=True):
            np.testing.assert_allclose(number, other, rtol=0, atol=1e-9)
        assert_same(scene.lanes, scene_lanes(card, data_root, native))
