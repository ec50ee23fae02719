"""Files of all sources that break a rule of their own: one error each, which names the file."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.core.errors import DataError
from mtp_bench.sources.readers import read_table
from mtp_bench.sources.wildtrack import ANNOTATIONS, DETECTIONS
from tests.support.layouts import person, small_root
from tests.support.source_files import assert_one_error, write

TABLES: dict[str, tuple[str, str]] = {  # second line of a table, what the error says of it
    "cut off": (
        "1,2", r"line 3: 2 columns, expected 3 \(frame, x, yaw\); column 3 \(yaw\) is missing: is the file cut off\?$"),
    "too short": ("1,2\n3,4,5", r"line 3: 2 columns, expected 3 .*; column 3 \(yaw\) is missing$"),
    "too long": ("1,2,3,word,5", r"line 3: 5 columns, expected 3 .*; column 4 is 'word': remove what is not listed"),
    "blanks for commas": ("1 2 3", "line 3: this file is separated by blanks, expected commas"),
    "tabs for commas": ("1\t2\t3", "line 3: this file is separated by tabs, expected commas"),
    "semicolons and another number of columns": ("1;2;3;4", "is separated by semicolons, expected commas"),
    "half a frame": ("1.5,2,3", "line 3, column 'frame': 1.5, expected a whole number"),
    "degrees": ("1,2,90", r"line 3, column 'yaw': 90, expected radians"),
    "no text": ("\udcff", "cannot be read as text"),
}  # fmt: skip


@pytest.mark.parametrize(("line", "text"), TABLES.values(), ids=TABLES)
def test_a_table(tmp_path: Path, line: str, text: str) -> None:
    def read() -> None:
        table = read_table(tmp_path / "table.txt", "frame x yaw", ",")
        table.refuse_degrees("yaw")
        table.whole_numbers("frame")

    assert_one_error(tmp_path / "table.txt", ["0,0,0", "", line], text, read)


@pytest.mark.parametrize("line", ["0,Car,1.5", "0, Car, 1.5", "0;Car;1.5;2"])
def test_another_separator_than_blanks(line: str, tmp_path: Path) -> None:
    write(tmp_path / "table.txt", line)
    with pytest.raises(DataError, match=r"line 1: this file is separated by \w+s, expected blanks$"):
        read_table(tmp_path / "table.txt", "frame type x", words="type")


def test_a_table_that_is_sound(tmp_path: Path) -> None:
    (tmp_path / "table.txt").write_text("0 Car 1.5\r\n\r\n  7  Van -2e3\r\n", encoding="utf-8-sig")
    table = read_table(tmp_path / "table.txt", "frame type x", words="type")
    assert (table.whole_numbers("frame").tolist(), table["x"].tolist()) == ([0, 7], [1.5, -2000.0])
    assert (table["type"].tolist(), table.line.tolist()) == (["Car", "Van"], [1, 3])
    assert table.select(table["type"] == "Van").line.tolist() == [3]


Lines = list[str]
Change = Callable[[Lines], Lines] | None  # of the lines of a file; None: the file is removed
Cases = dict[str, tuple[str, Change, str]]  # file, its change, what the error says


def all_lines(*lines: str) -> Change:
    return lambda _: list(lines)


def swap(old: str, by: str, line: int = 0) -> Change:
    """One line with another text in it."""

    def change(lines: Lines) -> Lines:
        assert old in lines[line]
        return [*lines[:line], lines[line].replace(old, by, 1), *lines[line + 1 :]]

    return change


def edit(change: Callable[[Any], object]) -> Change:
    """Another content of a JSON file."""

    def changed(lines: Lines) -> Lines:
        content = json.loads("\n".join(lines))
        change(content)
        return [json.dumps(content)]

    return changed


def record(token: str, /, **changes: Any) -> Change:
    """Changes of a record of nuScenes."""
    return edit(lambda records: next(each for each in records if each["token"] == token).update(changes))


def repeat(token: str, /, **changes: Any) -> Change:
    """A second record, with changes."""
    return edit(lambda records: records.append({**next(each for each in records if each["token"] == token), **changes}))


LABELS, OXTS, CALIB = "training/label_02/0000.txt", "training/oxts/0000.txt", "training/calib/0000.txt"
DETECTED, SEQMAP = "detections/pointrcnn/Car/0000.txt", "evaluate_tracking.seqmap.val"
ODOMETRY, UNIT = "poses_orbslam3/0000.txt", "1 0 0 0 0 1 0 0 0 0 1 0"
RENAME = "a recording of your own needs a name that no official sequence has"
KITTI: Cases = {  # three frames with the object 3
    "a flat label": (LABELS, swap("1.5 2.0 4.0", "1 0 1"), "line 1: a box with a size"),
    "a label in degrees": (LABELS, lambda lines: [lines[0].rpartition(" ")[0] + " 90"], "'rotation_y': 90, expected r"),
    "a label after the end": (LABELS, swap("0", "3"), f"line 1: frame 3, but .* 3 frames; {RENAME}"),
    "an object twice": (LABELS, lambda lines: [lines[0], "", lines[0]], "line 3: a second box of object 3 in frame 0"),
    "another type": (DETECTED, swap(",2,", ",1,"), r"line 1: type 1, expected 2 \(Car\)"),
    "no detections": (DETECTED, None, "no file"),
    "GPS/IMU too short": (
        OXTS, lambda lines: lines[:-1],
        f"has 2 rows, expected one for each frame of the sequence map; {RENAME}"),
    "GPS/IMU empty": (OXTS, all_lines(), "is empty, expected one row per frame"),
    "a calibration without the image": (CALIB, lambda lines: lines[1:], "no line 'P2'; found R_rect"),
    "a calibration without a focal length": (
        CALIB, swap("707", "0"), r"line 'P2': the focal lengths are \[0.0, 707.0\] pixels, expected numbers above 0"),
    "a calibration with a negative focal length": (
        CALIB, lambda lines: [lines[0].replace("0 0 707", "0 0 -707"), *lines[1:]], r"are \[707.0, -707.0\] pixels"),
    "a calibration without a turn": (CALIB, swap("1 0 0 0 1", "0 0 0 0 0", 1), "line 'R_rect' must hold a rotation"),
    "a calibration not finite": (CALIB, swap("-1.5", "nan", 3), "'Tr_imu_velo'"),
    "a calibration cut off": (CALIB, lambda lines: [*lines[:-2], "Tr_imu_velo 1 2"], "must hold 12 numbers"),
    "a broken sequence map": (SEQMAP, all_lines("0000 empty 0"), "line 1: 3 columns, expected 4"),
    "an empty sequence map": (SEQMAP, all_lines(), "names no sequence"),
    "scaled poses": (ODOMETRY, all_lines(UNIT, *[UNIT.replace("1", "2")] * 2), "line 2: .* rotation"),
    "transposed poses": (ODOMETRY, all_lines(*["0 0 0 1 0 0 0 1 0 0 0 1"] * 3), "line 1: expected a rotation"),
    "poses too short": (ODOMETRY, all_lines(*[UNIT] * 2), "has 2 rows, but .* has 3"),
}  # fmt: skip

GT, DET = (f"train/TUD-Stadtmitte/{file}" for file in ("gt/gt.txt", "det/det.txt"))
PIXELS = "X, Y and Z are -1, as in the 2D benchm"
MOT3D: Cases = {
    "frames from 0": (GT, swap("1,", "0,"), "line 1: frame 0, expected 1 to 3, the seqLength of seqinfo.ini"),
    "a frame after the end": (DET, swap("3,", "4,", 2), "line 3: frame 4, expected 1 to 3"),
    "a person twice": (GT, lambda lines: [*lines, lines[0]], "line 4: a second box of object 3"),
    "no detections": (DET, None, "no file"),
    "detections in pixels": (DET, all_lines("1,-1,10,20,30,40,1,-1,-1,-1"), f"line 1: {PIXELS}"),
    "truth in pixels": (GT, lambda lines: [lines[0], "2,7,10,20,30,40,1,-1,-1,-1"], f"line 2: {PIXELS}"),
    "truth without rows": (GT, all_lines(), "has no rows, expected one per person and frame"),
    "no rate": (
        "train/TUD-Stadtmitte/seqinfo.ini", lambda lines: [*lines[:2], *lines[3:]],
        "missing required field `frameRate`"),
}  # fmt: skip

FRAME = f"{ANNOTATIONS}/00001800.json"


def people(*values: object) -> Change:
    """An annotation file of people with these ids and positions, one after the other."""
    return all_lines(json.dumps([person(*values[i : i + 2]) for i in range(0, len(values), 2)]))


WILDTRACK: Cases = {
    "no JSON": (FRAME, all_lines("[{]"), "cannot be read as JSON"),
    "nested": (FRAME, all_lines('[{"x": ' + "[" * 100_000), "cannot be read as JSON: nested too deeply"),
    "a truth value for an id": (FRAME, people(True, 1), r", \[0\]\.personID"),
    "no id": (FRAME, all_lines(json.dumps([{"positionID": 1}])), "`personID`"),
    "half a position": (FRAME, people(7, 1.5), r", \[0\]\.positionID"),
    "beyond the grid": (FRAME, people(3, 1, 7, 691200), r", \[1\]\.positionID: expected `int` <= 691199"),
    "a person twice": (FRAME, people(7, 1, 8, 2, 7, 3), "person 7 is there twice"),
    "no frame": (f"{ANNOTATIONS}/00001805.json", None, "no file"),
    "a cell beyond": (DETECTIONS, all_lines("1800 480 1"), "line 1: cell 480 1 is off the grid"),
    "a cell twice": (
        DETECTIONS,
        all_lines("1800 0 0", "1800 0 0.0"),
        "line 2: a second detection at the place of an earlier line",
    ),
    "between frames": (
        DETECTIONS,
        all_lines("1801 1 1"),
        "line 1: frame 1801 is not among the annotated test frames, 1800",
    ),
}

SCENE, SAMPLE, DATA, MOUNT, POSE, BOX = (
    f"v1.0-mini/{table}.json"
    for table in ("scene", "sample", "sample_data", "calibrated_sensor", "ego_pose", "sample_annotation")
)
FOUND = "detections/megvii_all.json"
T1, CAR, KEY = "scene-0003-t1", "scene-0003-3", "scene-0003-lidar-1-True-2"
NUSCENES: Cases = {  # three samples, with an object each
    "a sample is in no scene": (SAMPLE, record(T1, scene_token="?"), r"record 'scene-0003-t1': scene_token is '\?'"),
    "a sample comes twice": (SAMPLE, repeat(T1), "token 'scene-0003-t1', expected one"),
    "two samples have one time": (SAMPLE, record(T1, timestamp=1_500_000_000_000_000), "at least 0 s; expected"),
    "times are in milliseconds": (
        SAMPLE, edit(lambda records: [each.update(timestamp=each["timestamp"] / 1000) for each in records]),
        "Check that timestamp is in microseconds"),
    "a scene has no samples": (SCENE, repeat("scene-0003-token", token="new", name="new"), "record 'new'"),
    "a scene has a name twice": (SCENE, repeat("scene-0003-token", token="t"), "several scenes 'scene-0003'"),
    "no lidar keyframe": (DATA, record(KEY, is_key_frame=False), "LIDAR_TOP keyframe of sample 'scene-0003-t2'"),
    "two lidar keyframes": (DATA, repeat(KEY, token="d3"), "record 'd3': a second LIDAR"),
    "an unknown sensor": (MOUNT, record("cam-1", sensor_token="x"), "sensor_token is 'x'"),
    "a pose is missing": (POSE, edit(lambda records: records.pop(3)), "no record 'scene-0003-pose-1'"),
    "a pose is not turned": (
        POSE, record("scene-0003-pose-1", rotation=[0, 0, 0, 0]), "'scene-0003-pose-1': rotation is"),
    "two boxes in a sample": (BOX, record(f"{CAR}-t2", sample_token=T1), "record 'scene-0003-3-t2': a second box"),
    "a box of no instance": (
        BOX, record(f"{CAR}-t1", instance_token=""), "record 'scene-0003-3-t1': instance_token is ''"),
    "a box is not turned properly": (
        BOX, record(f"{CAR}-t1", rotation=[0.7, 0, 0, 0.6]), r"'scene-0003-3-t1': rotation is \[0\.7, "),
    "a detection of norm 2": (
        FOUND, edit(lambda file: file["results"][T1][0].update(rotation=[2, 0, 0, 0])), "'scene-0003-t1': rotation is"),
    "a detection of another sample": (
        FOUND, edit(lambda file: file["results"][T1][0].update(sample_token="x")), "'scene-0003-t1', box 0: sample_token is 'x'"),
    "no detection": (
        FOUND, edit(lambda file: file["results"][T1].append(3)), r"sample 'scene-0003-t1', \[1\]: expected"),
    "no list": (FOUND, edit(lambda file: file["results"].update({T1: {}})), "sample 'scene-0003-t1'"),
}  # fmt: skip

PEOPLE: Cases = {
    "between frames": ("biwi_eth.txt", all_lines("5 1 0 0"), "frame 5, expected a multiple of 10"),
    "a person twice": ("biwi_eth.txt", lambda lines: [lines[0], *lines], "line 2: a second box of object 3 in frame 0"),
}

DATASETS = {"KITTI": KITTI, "3DMOT2015": MOT3D, "WILDTRACK": WILDTRACK, "nuScenes": NUSCENES, "ETH/UCY": PEOPLE}
CASES = [pytest.param(name, case, id=f"{name}: {case}") for name, cases in DATASETS.items() for case in cases]


ONE_PLACE: dict[str, tuple[str, Change, str]] = {
    "KITTI": (
        LABELS, lambda lines: [lines[2], lines[2].replace("2 3", "2 9", 1)],
        "'0000', frame 2: the objects 3 and 9 are all at x 9, y 4"),
    "3DMOT2015": (
        GT, all_lines(*(f"1,{i},10,20,30,40,1,4,-5.6,0" for i in (3, 8, 9))),
        "frame 0: the objects 3, 8 and 9 are all at x 4, y -5.6; expected a place of its own for each"),
    "WILDTRACK": (FRAME, people(7, 5, 2, 4, 3, 5), "frame 0: the objects 7 and 3 are all at x -2.875, y -9"),
}  # fmt: skip


def changed_lines(path: Path, change: Change) -> Lines | None:
    return change and change(path.read_text().splitlines() if path.exists() else [])


@pytest.mark.parametrize("dataset", ONE_PLACE)
def test_several_objects_at_one_place_are_not_a_truth(dataset: str, tmp_path: Path) -> None:
    root, read = small_root(dataset, tmp_path)
    file, change, text = ONE_PLACE[dataset]
    write(root / file, *(changed_lines(root / file, change) or []))
    with pytest.raises(DataError, match=text):
        read()


@pytest.mark.parametrize("dataset", ONE_PLACE)
def test_a_pipe_in_place_of_a_file(dataset: str, tmp_path: Path) -> None:
    root, read = small_root(dataset, tmp_path)
    path = root / ONE_PLACE[dataset][0]
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(DataError, match=r"FIFO, expected a file|no file"):
        read()


@pytest.mark.parametrize(("dataset", "case"), CASES)
def test_files(tmp_path: Path, dataset: str, case: str) -> None:
    root, read = small_root(dataset, tmp_path)
    file, change, text = DATASETS[dataset][case]
    assert_one_error(root / file, changed_lines(root / file, change), text, read)
