"""Tables of all sources: what is written is read again, and one error for each broken cell, line and file."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from mtp_bench.core.errors import DataError
from mtp_bench.sources.base import usable
from mtp_bench.sources.files.columns import COLUMNS
from mtp_bench.sources.kitti.files import DETECTION, LABEL, ODOMETRY as POSES, OXTS, RESULT
from mtp_bench.sources.mot3d import COLUMNS as MOT
from mtp_bench.sources.readers import TableColumn, read_named_table, read_table
from mtp_bench.sources.wildtrack import ANNOTATIONS, DETECTIONS
from tests.sources import test_kitti as kitti, test_mot3d as mot3d, test_wildtrack as wildtrack
from tests.support.source_files import assert_one_error, write

Lines = list[str] | None  # of a file; None: the file is removed
LAYOUTS = {  # columns and delimiter
    "label": (LABEL, " "), "result": (RESULT, " "), "detection": (DETECTION, ","), "GPS": (OXTS, " "),
    "odometry": (POSES, " "), "MOTChallenge": (MOT, ","), "people": ("frame id x y", " "),
}  # fmt: skip
NUMBERS = st.floats(-1e9, 1e9, allow_subnormal=False)
WRONG_NUMBERS = {  # cell -> what the error says of it
    "two": "'two', expected a number", "2_0": "'2_0', expected a number", "nan": "nan, expected a finite number",
    "-inf": "-inf, expected a finite number", "1e300": "1e+300, expected a finite number",
}  # fmt: skip


@given(data=st.data())
@pytest.mark.parametrize("layout", LAYOUTS)
def test_numbers_of_a_text_come_back_and_one_broken_cell_is_named(
    layout: str, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    columns, delimiter = LAYOUTS[layout]
    names, path = columns.split(), tmp_path_factory.mktemp("text") / "table.txt"
    words = "type" if layout in ("label", "result") else ""
    numbers = [name for name in names if name != words]
    rows = data.draw(st.lists(st.lists(NUMBERS, min_size=len(numbers), max_size=len(numbers)), max_size=4))
    cells = [dict(zip(numbers, map(repr, row), strict=True)) | {words: "Car"} for row in rows]

    def save() -> None:
        write(path, "", *(delimiter.join(row[name] for name in names) for row in cells))

    save()
    table = read_table(path, columns, delimiter, words)
    np.testing.assert_array_equal(table.matrix(" ".join(numbers)), np.array(rows).reshape(-1, len(numbers)))
    assert table.line.tolist() == list(range(2, len(rows) + 2))
    if rows:
        row, name = data.draw(st.integers(0, len(rows) - 1)), data.draw(st.sampled_from(numbers))
        cells[row][name] = data.draw(st.sampled_from(list(WRONG_NUMBERS)))
        save()
        with pytest.raises(DataError) as caught:
            read_table(path, columns, delimiter, words)
        assert str(caught.value).startswith(
            f"{path}, line {row + 2}, column {name!r}: {WRONG_NUMBERS[cells[row][name]]}"
        )


def wrong_cell(column: TableColumn) -> dict[str, str]:
    """Cells that are wrong in a column of own scenes, and what the error says of them."""
    if column.text:
        return {
            "" if not column.gaps else "a" * 201: "expected",
            "b" * 100_000: "a word of 100000 characters, expected",
        }
    cells = dict(WRONG_NUMBERS) if column.largest < 1e12 else {"inf": "inf, expected a finite"}
    if column.flag:
        return {"2": "2, expected 0 or 1", "maybe": "'maybe', expected 1, 0, true or false"}
    if column.gaps:
        del cells["nan"]
        return cells
    return cells | {"": "an empty cell, expected a number"}


@given(data=st.data())
@pytest.mark.parametrize("name", COLUMNS)
def test_one_broken_cell_of_own_scenes_is_named(
    name: str, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path, columns = tmp_path_factory.mktemp("own") / "table.csv", COLUMNS[name]
    column = data.draw(st.sampled_from(columns))
    rows = [{one.name: "word" if one.text else "1" for one in columns} for _ in range(3)]
    lines = [",".join(one.name for one in columns), *(",".join(row.values()) for row in rows)]
    write(path, *lines)
    assert len(read_named_table(path, columns)) == 3
    cell, text = data.draw(st.sampled_from(list(wrong_cell(column).items())))
    row = data.draw(st.integers(0, 2))
    lines[row + 1] = ",".join((rows[row] | {column.name: cell}).values())
    write(path, *lines)
    with pytest.raises(DataError) as caught:
        read_named_table(path, columns)
    assert str(caught.value).startswith(f"{path}, line {row + 2}, column {column.name!r}: ")
    assert text in str(caught.value)


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


PARKED, CALIBRATION = kitti.PARKED, kitti.CALIBRATION.splitlines()
ODOMETRY = "poses_orbslam3/0000.txt"
KITTI: dict[str, tuple[str, Lines, str]] = {  # file, its lines, what the error says
    "a misspelt type": (kitti.LABELS, [PARKED, PARKED.replace("Car", "Cars")], "line 2: type 'Cars', expected one"),
    "a flat label": (kitti.LABELS, [PARKED.replace("1.5 2 4", "1 0 1")], "line 1: a box with a size"),
    "a label after the end": (
        kitti.LABELS, [PARKED.replace("0", "6", 1)],
        "line 1: frame 6, but .* 6 frames; a recording of your own needs a name that no official sequence has"),
    "an object twice": (kitti.LABELS, [PARKED, "", PARKED], "line 3: a second box of object 7 in frame 0"),
    "another type": (kitti.DETECTED, [kitti.detection(0, 1, 0, 1, 2, 3)], r"line 1: type 1, expected 2 \(Car\)"),
    "no detections": (kitti.DETECTED, None, "no file"),
    "GPS/IMU too short": (
        kitti.OXTS, [kitti.oxts()] * 5,
        "has 5 rows, expected one for each frame of the sequence map; a recording of your own needs a name that no"),
    "GPS/IMU empty": (kitti.OXTS, [], "is empty, expected one row per frame"),
    "a calibration without the image": (kitti.CALIB, CALIBRATION[1:], "no line 'P2'; found R_rect"),
    "a calibration without a turn": (
        kitti.CALIB, [line if "R_rect" not in line else "R_rect 0 0 0 0 0 0 0 0 0" for line in CALIBRATION],
        "line 'R_rect' must hold a rotation"),
    "a calibration not finite": (kitti.CALIB, [each.replace("-1.5", "nan") for each in CALIBRATION], "'Tr_imu_velo'"),
    "a calibration cut off": (kitti.CALIB, [*CALIBRATION[:-1], "Tr_imu_velo 1 2"], "must hold 12 numbers"),
    "a broken sequence map": (kitti.SEQMAP, ["0000 empty 0"], "line 1: 3 columns, expected 4"),
    "an empty sequence map": (kitti.SEQMAP, [], "names no sequence"),
    "scaled poses": (ODOMETRY, ["1 0 0 0 0 1 0 0 0 0 1 0", *["2 0 0 0 0 2 0 0 0 0 2 0"] * 5], "line 2: .* rotation"),
    "transposed poses": (ODOMETRY, ["0 0 0 1 0 0 0 1 0 0 0 1"] * 6, "line 1: expected a rotation"),
    "poses too short": (ODOMETRY, ["1 0 0 0 0 1 0 0 0 0 1 0"] * 5, "has 5 rows, but .* has 6"),
}  # fmt: skip

GT, DET, INI, row, seqinfo = mot3d.GT, mot3d.DET, mot3d.INI, mot3d.row, mot3d.seqinfo
MOT3D: dict[str, tuple[str, Lines, str]] = {
    "frames from 0": (GT, [row(0, 7, 0, 0)], "line 1: frame 0, expected 1 to 10, the seqLength of seqinfo.ini"),
    "a frame after the end": (DET, [row(11, -1, 0, 0)], "line 1: frame 11, expected 1 to 10"),
    "a person twice": (GT, [row(1, 7, 0, 0), row(2, 7, 0, 0), row(1, 7, 1, 0)], "line 3: a second box of object 7"),
    "no detections": (DET, None, "no file"),
    "detections in pixels": (DET, [row(1, -1, -1, -1)[:-1] + "-1"], "line 1: X, Y and Z are -1, as in the 2D benchm"),
    "truth in pixels": (GT, [row(1, 7, 1, 2), row(2, 7, -1, -1)[:-1] + "-1"], "line 2: X, Y and Z are -1, as in the"),
    "truth without rows": (GT, [], "has no rows, expected one per person and frame"),
    "no rate": (INI, [seqinfo()[0], *seqinfo()[3:]], "missing required field `frameRate`"),
}

FRAME = f"{ANNOTATIONS}/00001800.json"


def people(*values: object) -> list[str]:
    """An annotation file of people with these ids and positions, one after the other."""
    return [json.dumps([wildtrack.person(*values[i : i + 2]) for i in range(0, len(values), 2)])]


WILDTRACK: dict[str, tuple[str, Lines, str]] = {
    "no JSON": (FRAME, ["[{]"], "cannot be read as JSON"),
    "nested": (FRAME, ['[{"x": ' + "[" * 100_000], "cannot be read as JSON: nested too deeply"),
    "a truth value for an id": (FRAME, people(True, 1), r", \[0\]\.personID"),
    "no id": (FRAME, [json.dumps([{"positionID": 1}])], "`personID`"),
    "half a position": (FRAME, people(7, 1.5), r", \[0\]\.positionID"),
    "beyond the grid": (FRAME, people(3, 1, 7, 691200), r", \[1\]\.positionID: expected `int` <= 691199"),
    "a person twice": (FRAME, people(7, 1, 8, 2, 7, 3), "person 7 is there twice"),
    "no frame": (f"{ANNOTATIONS}/00001805.json", None, "no file"),
    "a cell beyond": (DETECTIONS, ["1800 480 1"], "line 1: cell 480 1 is off the grid"),
    "a cell twice": (
        DETECTIONS,
        ["1800 0 0", "1800 0 0.0"],
        "line 2: a second detection at the place of an earlier line",
    ),
    "between frames": (DETECTIONS, ["1801 1 1"], "line 1: frame 1801 is not among the annotated test frames, 1800"),
}

DATASETS: dict[str, tuple[Callable[[Path], Path], Callable[[Path], object], dict[str, tuple[str, Lines, str]]]] = {
    "KITTI": (kitti.make_root, kitti.load, KITTI),
    "3DMOT2015": (mot3d.make_root, lambda root: mot3d.load(root, "0005"), MOT3D),
    "WILDTRACK": (wildtrack.make_root, wildtrack.load, WILDTRACK),
}
CASES = [pytest.param(name, case, id=f"{name}: {case}") for name, (*_, cases) in DATASETS.items() for case in cases]


ONE_PLACE: dict[str, tuple[str, list[str], str]] = {
    "KITTI": (
        kitti.LABELS, [kitti.label(2, i, "Car", 0, 1.65, 10 + i % 2, 0) for i in (7, 8, 9)],
        "'0000', frame 2: the objects 7 and 9 are all at x 11, y 0"),
    "3DMOT2015": (
        GT, [row(5, i, 4, -5.6) for i in (3, 8, 9)],
        "frame 0: the objects 3, 8 and 9 are all at x 4, y -5.6; expected a place of its own for each"),
    "WILDTRACK": (FRAME, people(7, 5, 2, 4, 3, 5), "frame 0: the objects 7 and 3 are all at x -2.875, y -9"),
}  # fmt: skip


@pytest.mark.parametrize("dataset", DATASETS)
def test_several_objects_at_one_place_are_not_a_truth(dataset: str, tmp_path: Path) -> None:
    make_root, load, _ = DATASETS[dataset]
    root, (file, lines, text) = make_root(tmp_path), ONE_PLACE[dataset]
    write(root / file, *lines)
    with pytest.raises(DataError, match=text):
        usable(load(root))  # type: ignore[arg-type]


@pytest.mark.parametrize("dataset", DATASETS)
def test_a_pipe_in_place_of_a_file(dataset: str, tmp_path: Path) -> None:
    make_root, load, _ = DATASETS[dataset]
    path = (root := make_root(tmp_path)) / ONE_PLACE[dataset][0]
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(DataError, match=r"FIFO, expected a file|no file"):
        load(root)


@pytest.mark.parametrize(("dataset", "case"), CASES)
def test_files(tmp_path: Path, dataset: str, case: str) -> None:
    make_root, load, cases = DATASETS[dataset]
    root, (file, lines, text) = make_root(tmp_path), cases[case]
    assert_one_error(root / file, lines, text, lambda: load(root))
