"""The files of every dataset: what is written is read, and one broken cell gives one error that says where."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings, strategies as st
from pyarrow import feather

from mtp_bench.cards import Card
from mtp_bench.core import Floats, Scene, StoredTracks
from mtp_bench.core.errors import DataError
from mtp_bench.core.geometry import wrap_angle
from mtp_bench.running.track_export import write_tracks
from mtp_bench.sources import open_source, with_tracks
from mtp_bench.sources.files.columns import COLUMNS
from mtp_bench.sources.kitti.files import DETECTION, LABEL, ODOMETRY, OXTS
from mtp_bench.sources.mot3d import COLUMNS as MOT
from mtp_bench.sources.readers import TableColumn, read_named_table
from tests.support.drawn_recordings import Layout, Recording, Row, recordings
from tests.support.layouts import LAYOUTS, WILDTRACK, small_root
from tests.support.nuscenes_root import DETECTIONS, VERSION, edited, sample
from tests.support.source_files import write

FEW = settings(max_examples=8, derandomize=True, deadline=None)
OFFICIAL = {
    "KITTI": "tracks",
    "KITTI, own frames": "tracks",
    "nuScenes": "tracks.json",
    "Argoverse 2": "tracks.feather",
}


@FEW
@given(data=st.data())
@pytest.mark.parametrize("name", LAYOUTS)
def test_what_is_written_is_read(name: str, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    layout, folder = LAYOUTS[name], tmp_path_factory.mktemp("layout")
    recording = data.draw(recordings(layout))
    root = layout.write(folder, recording)
    card = layout.card(folder)
    scene = open_source(card, root).load(layout.scene)
    place = [row.box[:2] for row in recording.truth]
    recording = recording.every(layout.stride)
    frames = len(recording.time)
    np.testing.assert_allclose(scene.time[:frames], recording.time, atol=1e-6)
    if layout.people:
        middle = [3, 9] if layout is WILDTRACK else np.round((np.min(place, axis=0) + np.max(place, axis=0)) / 2)
        np.testing.assert_allclose(scene.ego, np.tile([*middle, 0, 0], (scene.frames, 1)))
    elif layout.own_frames:
        assert scene.world is not None
        assert_same_boxes(scene.world, recording.pose[:, :4])
        np.testing.assert_array_equal(scene.ego, np.zeros((frames, 4)))
    else:
        assert_same_boxes(scene.ego, recording.pose[:, :4])
    assert_same_truth(scene, recording, layout, card.task.classes)
    assert (scene.truth_complete, scene.listed_targets, scene.skipped) == (True, False, {})
    if layout.detector:
        assert not scene.simulated
        assert scene.detector == f"{layout.detector}, stored detections"
        assert_same_detections(scene, recording, layout, card.task.classes)
    for form in sorted({"table", OFFICIAL.get(name, "table")}):
        assert_tracks_come_back(scene, card, root, folder / form)


def assert_tracks_come_back(scene: Scene, card: Card, root: Path, path: Path) -> None:
    """The true boxes, written as tracks with scores that tell them apart."""
    truth = scene.truth
    score = np.linspace(0.1, 0.9, len(truth.box))
    rows = StoredTracks(truth.start, truth.box, truth.velocity, truth.class_id, score, truth.object_id)
    write_tracks([(scene, rows)], card, str(root), path, table=path.name == "table")
    tracks = with_tracks(open_source(card, root), card, root, path).load(scene.name).tracks
    assert tracks is not None
    np.testing.assert_array_equal(tracks.start, truth.start)
    np.testing.assert_array_equal(tracks.class_id, truth.class_id)
    np.testing.assert_allclose(tracks.score, score, atol=1e-6)
    assert_same_boxes(tracks.box, truth.box)
    pairs = set(zip(tracks.object_id.tolist(), truth.object_id.tolist(), strict=True))
    assert len(pairs) == len({first for first, _ in pairs}) == len({last for _, last in pairs})


def assert_same_boxes(found: Floats, expected: Floats | list[Floats]) -> None:
    """Rows x y z yaw and more, whose angles may differ by whole turns."""
    off = found - np.reshape(expected, found.shape)
    off[:, 3] = wrap_angle(off[:, 3])
    np.testing.assert_allclose(off, 0, atol=2e-6)


def assert_same_truth(scene: Scene, recording: Recording, layout: Layout, classes: tuple[str, ...]) -> None:
    used = [row for row in recording.truth if layout.kinds[row.kind][0] in classes]
    used.sort(key=lambda row: (row.frame, str(row.name)))
    truth, frame = scene.truth, scene.truth.frame_of_rows
    names = np.array([scene.name_of(number).rpartition("-")[2] for number in truth.object_id.tolist()], dtype=str)
    order = np.lexsort([names, frame])
    neutral = [layout.kinds[row.kind][1] or not row.seen for row in used]
    expected = [
        (row.frame, str(row.name), classes.index(layout.kinds[row.kind][0]), is_neutral)
        for row, is_neutral in zip(used, neutral, strict=True)
    ]
    columns = (frame, names, truth.class_id, truth.neutral)
    found = list(zip(*(column[order].tolist() for column in columns), strict=True))
    assert found == expected
    assert_same_boxes(truth.box[order], [row.box for row in used])
    assert truth.eligible[order].tolist() == [layout.neutral_targets or not one for one in neutral]
    velocity = velocities(used, recording.time, layout.ahead)
    np.testing.assert_allclose(truth.velocity[order], velocity, atol=1e-4)


def velocities(rows: list[Row], time: Floats, ahead: bool) -> Floats:
    """From the frame before, and with ``ahead`` to the frame after; NaN without one of them."""
    place = {(row.frame, row.name): row.box[:2] for row in rows}
    found = np.full((len(rows), 2), np.nan)
    for i, row in enumerate(rows):
        first, last = row.frame - 1, row.frame + ahead
        if (first, row.name) in place and (last, row.name) in place:
            found[i] = (place[last, row.name] - place[first, row.name]) / (time[last] - time[first])
    return found


def assert_same_detections(scene: Scene, recording: Recording, layout: Layout, classes: tuple[str, ...]) -> None:
    names = [layout.kinds[row.kind][0] for row in recording.detections]
    rows = [
        (row, classes.index(name)) for row, name in zip(recording.detections, names, strict=True) if name in classes
    ]
    rows.sort(key=lambda pair: (pair[0].frame, pair[1], pair[0].box[0]))
    seen, frame = scene.detections, scene.detections.frame_of_rows
    order = np.lexsort([seen.box[:, 0], seen.class_id, frame])
    columns = zip(frame[order].tolist(), seen.class_id[order].tolist(), seen.score[order].tolist(), strict=True)
    assert list(columns) == [(row.frame, class_id, row.score) for row, class_id in rows]
    assert_same_boxes(seen.box[order], [row.box for row, _ in rows])
    assert np.isnan(seen.velocity).all()


# ---- one broken cell
NAN = float("nan")
WRONG_NUMBERS = {  # cell -> what the error says of it
    "two": "'two', expected a number", "2_0": "'2_0', expected a number", "nan": "nan, expected a finite number",
    "-inf": "-inf, expected a finite number", "1e300": "1e+300, expected a finite number",
}  # fmt: skip
TEXTS: dict[str, tuple[str, str, str, str]] = {  # layout, file, columns, delimiter
    "KITTI, labels": ("KITTI", "training/label_02/0000.txt", LABEL, " "),
    "KITTI, detections": ("KITTI", "detections/pointrcnn/Car/0000.txt", DETECTION, ","),
    "KITTI, GPS": ("KITTI", "training/oxts/0000.txt", OXTS, " "),
    "KITTI, odometry": ("KITTI, odometry", "poses_orbslam3/0000.txt", ODOMETRY, " "),
    "3DMOT2015, truth": ("3DMOT2015", "train/TUD-Stadtmitte/gt/gt.txt", MOT, ","),
    "3DMOT2015, detections": ("3DMOT2015", "train/TUD-Stadtmitte/det/det.txt", MOT, ","),
    "ETH/UCY": ("ETH/UCY", "biwi_eth.txt", "frame id x y", "\t"),
    "WILDTRACK": ("WILDTRACK", "detections/mvdet_test.txt", "frame gx gy", " "),
}


def assert_refused(load: Callable[[], object], *texts: str) -> None:
    with pytest.raises(DataError) as caught:
        load()
    for text in texts:
        assert text in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", TEXTS)
def test_one_broken_cell_of_a_text(name: str, tmp_path: Path) -> None:
    layout, file, columns, delimiter = TEXTS[name]
    root, read = small_root(layout, tmp_path)
    read()
    rows = [line.split(delimiter) for line in (root / file).read_text().splitlines()]
    wrong = list(WRONG_NUMBERS)[: 2 if name == "KITTI, detections" else 5]  # detections may be NaN, and are left out
    for i, column in enumerate(columns.split()):
        line, cell = i % len(rows), wrong[i % len(wrong)]
        text = f"'{cell}', expected one of Car, " if column == "type" and delimiter == " " else WRONG_NUMBERS[cell]
        place = f"line {line + 1}" if "one of" in text else f"line {line + 1}, column {column!r}"
        changed = [list(row) for row in rows]
        changed[line][i] = cell
        write(root / file, *map(delimiter.join, changed))
        assert_refused(read, f"{root / file}, {place}: ", text)


def wrong_cells(column: TableColumn) -> dict[str, str]:
    """Cells that are wrong in a column of own scenes, and what the error says of them."""
    if column.text:
        letters = f"a word of {10**5} characters, expected"
        return {"b" * 10**5: letters, **({} if column.gaps else {"": "an empty cell, expected a word"})}
    if column.flag:
        return {"2": "2, expected 0 or 1", "maybe": "'maybe', expected 1, 0, true or false"}
    cells = WRONG_NUMBERS if column.largest < 1e12 else {"inf": "inf, expected a finite"}
    if column.gaps:
        return {cell: text for cell, text in cells.items() if cell != "nan"}
    return cells | {"": "an empty cell, expected a number"}


@pytest.mark.parametrize("name", COLUMNS)
def test_one_broken_cell_of_own_scenes(name: str, tmp_path: Path) -> None:
    path, columns = tmp_path / "table.csv", COLUMNS[name]
    rows = [{one.name: "word" if one.text else "1" for one in columns} for _ in range(3)]
    header = ",".join(one.name for one in columns)
    for i, column in enumerate(columns):
        for cell, text in wrong_cells(column).items():
            if not cell and len(columns) == 1:
                continue  # a blank line, which is skipped
            changed = list(rows)
            changed[i % 3] = rows[i % 3] | {column.name: cell}
            write(path, header, *(",".join(row.values()) for row in changed))
            where = f"{path}, line {i % 3 + 2}, column {column.name!r}: "
            assert_refused(lambda: read_named_table(path, columns), where, text)
    write(path, header, *(",".join(row.values()) for row in rows))
    assert len(read_named_table(path, columns)) == 3


@pytest.mark.parametrize("file", ["annotations", "city_SE3_egovehicle", "mine"])
def test_one_empty_cell_of_argoverse2(file: str, tmp_path: Path) -> None:
    root, read = small_root("Argoverse 2", tmp_path)
    (path,) = root.rglob(f"{file}.feather")
    table = feather.read_table(path)
    for i, column in enumerate(table.column_names):
        cells = table[column].to_pylist()
        cells[1] = None
        if column != "log_id":  # rows of other logs are left out
            feather.write_feather(table.set_column(i, column, pa.array(cells, table[column].type)), str(path))
            assert_refused(read, f"{path}, row 2, column {column!r}: an empty cell, expected a ")


NUSCENES: dict[str, dict[str, Any]] = {  # table -> wrong values of its keys
    "scene": {"token": 1, "name": "a/b"},
    "sample": {"token": None, "scene_token": 1, "timestamp": NAN},
    "sensor": {"token": 1, "channel": None},
    "calibrated_sensor": {"token": 1, "sensor_token": None},
    "sample_data": {"sample_token": 1, "calibrated_sensor_token": [], "is_key_frame": "yes", "ego_pose_token": None},
    "ego_pose": {"token": 1, "translation": [1e308, 0, 0], "rotation": [NAN, 0, 0, 0]},
    "category": {"token": 1, "name": None},
    "instance": {"token": 1, "category_token": 1},
    "sample_annotation": {
        "token": 1, "sample_token": None, "instance_token": 1, "translation": [0, NAN, 0], "size": [1, 100.5, 1],
        "rotation": [1, 0, 0], "num_lidar_pts": "2", "num_radar_pts": 1.5,
    },
}  # fmt: skip
BOX = {
    "sample_token": 1, "translation": [NAN, 0, 0], "size": [101, 1, 1], "rotation": "w", "velocity": [1e308, 0],
    "detection_name": "tram", "detection_score": NAN,
}  # fmt: skip


@pytest.mark.parametrize("table", NUSCENES)
def test_one_broken_value_of_a_table_of_nuscenes(table: str, tmp_path: Path) -> None:
    root, read = small_root("nuScenes", tmp_path)
    path = root / VERSION / f"{table}.json"
    records = json.loads(path.read_text())
    for key, value in NUSCENES[table].items():
        path.write_text(json.dumps([*records[:-1], {**records[-1], key: value}]))
        assert_refused(read, f"{path}, [{len(records) - 1}].{key}", "expected")


def test_one_broken_value_of_a_detection_of_nuscenes(tmp_path: Path) -> None:
    root, read = small_root("nuScenes", tmp_path)
    token = sample("scene-0003", 1)
    for key, value in BOX.items():
        with edited(root.parent / DETECTIONS) as content:
            before = content["results"][token][0]
            content["results"][token][0] = {**before, key: value}
        assert_refused(read, f"{root.parent / DETECTIONS}, sample '{token}', [0].{key}", "expected")
        with edited(root.parent / DETECTIONS) as content:
            content["results"][token][0] = before
