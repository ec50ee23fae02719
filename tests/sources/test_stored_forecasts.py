"""Forecasts of other programs as they are read: nuScenes' forms and the project's own tables, places worked out by hand."""

import json
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import Card
from mtp_bench.core import DataError
from mtp_bench.sources import StoredForecasts, forecast_forms, mapped, open_source, package_of, stored_forecasts, text
from mtp_bench.sources.readers import read_named_table, write_table
from tests.support.forecast_files import (
    FORMS,
    LOG_WEIGHTS,
    MODES,
    SCENE,
    STANDING,
    STEPS,
    Record,
    boxes,
    mfeval,
    mounted,
    results,
    uniad,
    vad,
    write_results,
)
from tests.support.nuscenes_root import SCENES, VERSION, edited, nuscenes_card, sample, write_root

# x and y after one period and at the end of 12, of the first sample and of the last, which is half as fast
CAR = {"first": (10.0, 4.0), "last": (10.0, 26.0), "slow": (10.0, 14.0)}
WALKER = {"first": (4.5, 5.0), "last": (-1.0, 5.0), "slow": (2.0, 5.0)}


def read(form: str, data: Path, path: Path, card: Card | None = None, scene: str = SCENE) -> StoredForecasts:
    card = card or nuscenes_card()
    forecasts = forecast_forms(package_of(card))[form].open(card, str(data), path)
    return forecasts(open_source(card, data).load(scene))


def read_form(form: str, root: Path, objects: list[Record], name: str = "results.json", **meta: Any) -> StoredForecasts:
    content: Any = results(objects)
    if meta:
        content = {"meta": meta, "results": content}
    return read(form, mounted(root / "data"), write_results(root / name, content))


@pytest.mark.parametrize("form", FORMS)
def test_what_is_read_of_each_form(form: str, tmp_path: Path) -> None:
    stored = read_form(form, tmp_path, FORMS[form]())
    assert stored.frame.tolist() == [1, 1, 1]
    assert stored.class_name.tolist() == ["car", "pedestrian", "car"]
    assert stored.confidence.tolist() == [0.9, 0.6, 0.3]
    steps = 6 if form == "vad" else STEPS
    assert stored.path.shape == (3, MODES, steps, 2)
    for row, expected in enumerate((CAR, WALKER)):
        np.testing.assert_allclose(stored.path[row, 0, 0], expected["first"], atol=1e-6)
        if steps == STEPS:
            np.testing.assert_allclose(stored.path[row, 0, -1], expected["last"], atol=1e-6)
            np.testing.assert_allclose(stored.path[row, 5, -1], expected["slow"], atol=1e-6)
    if form == "vip3d":
        np.testing.assert_allclose(stored.path[2], STANDING)
    else:  # the one without a forecast
        assert np.isnan(stored.path[2]).all()
        assert np.isneginf(stored.log_weight[2]).all()
    np.testing.assert_allclose(stored.box[:, :2], [[10, 2], [5, 5], [-5, 5]])


@pytest.mark.parametrize("form", ["uniad", "vip3d", "vad"])
def test_boxes_of_the_official_keys(form: str, tmp_path: Path) -> None:
    stored = read_form(form, tmp_path, FORMS[form]())
    along_y = np.pi / 2
    expected = [[10, 2, 1, along_y, 4, 2, 1.5], [5, 5, 0.5, 0, 0.6, 0.5, 1], [-5, 5, 1, along_y, 4, 2, 1.5]]
    np.testing.assert_allclose(stored.box, expected, atol=1e-3)
    assert stored.identity.tolist() == (["", "", ""] if form == "vad" else ["7", "8", "9"])
    assert not any(stored.notes.values())


def test_mfeval_has_no_boxes_and_no_tracks(tmp_path: Path) -> None:
    stored = read_form("mfeval", tmp_path, mfeval())
    np.testing.assert_allclose(stored.box[0], [10, 2, 0, 0, 4.5, 1.9, 1.65])  # the usual car
    assert stored.identity.tolist() == ["", "", ""]


def test_logarithms_are_known_by_the_form(tmp_path: Path) -> None:
    for form in ("mfeval", "uniad"):
        np.testing.assert_allclose(read_form(form, tmp_path / form, FORMS[form]()).log_weight[0], LOG_WEIGHTS)
    # null: all alike
    assert np.ptp(read_form("mfeval", tmp_path / "null", mfeval()).log_weight[1]) == 0
    assert np.ptp(read_form("vad", tmp_path / "vad", vad()).log_weight[1]) == 0


def test_a_probability_of_0_is_no_sample(tmp_path: Path) -> None:
    objects = mfeval()
    objects[0]["traj_prob"] = [0.0, 1, 1, 1, 1, 1]
    assert np.isneginf(read_form("mfeval", tmp_path, objects).log_weight[0]).tolist() == [True] + [False] * 5


def test_uniad_through_a_tilted_lidar(tmp_path: Path) -> None:
    """The lidar of frame 1 is turned by 30 degrees about the ego's length, which points along y.

    Its x axis is (0.866, 0, -0.5) and its height (0.5, 0, 0.866). It is at (0, 2, 0.5). A point of the flat lidar plane at
    the height 1 of the car's box: (10, 2, 1) is 9.5 ahead and 0.5 above, so x' = 10 cos 30 - 0.5 sin 30.
    """
    data = write_root(tmp_path / "data")
    with edited(data / "nuscenes" / VERSION / "calibrated_sensor.json") as sensors:
        half = np.pi / 12
        sensors[0]["rotation"] = [np.cos(half), np.sin(half), 0.0, 0.0]  # about the ego's x
    # in the ego's axes the car is at x 0, y -10, z 0.5; those of the lidar are turned about x by 30 degrees
    car = [0.0, -10 * np.cos(np.pi / 6) + 0.5 * np.sin(np.pi / 6)]
    objects = boxes()[:1]
    objects[0] |= {"predict_traj": [[car] * STEPS] * MODES, "predict_traj_score": LOG_WEIGHTS}
    stored = read("uniad", data, write_results(tmp_path / "f.json", results(objects)))
    np.testing.assert_allclose(stored.path[0, 0, 0], [10, 2], atol=1e-6)


def test_steps_of_vad_cumulate(tmp_path: Path) -> None:
    objects = boxes()[:1]
    along = [0.0, 1.0] * 3 + [1.0, 0.0] * 3  # to the lidar's left, then ahead: along x, then along -y
    objects[0]["fut_traj"] = along * MODES
    path = read_form("vad", tmp_path, objects).path[0, 3]
    np.testing.assert_allclose(path, [[11, 2], [12, 2], [13, 2], [13, 1], [13, 0], [13, -1]], atol=1e-6)


@pytest.mark.parametrize("name", ["results.json", "results.json.gz"])
def test_results_may_be_packed_and_under_a_key(name: str, tmp_path: Path) -> None:
    stored = read_form("uniad", tmp_path, uniad(), name, use_camera=True)
    assert stored.path.shape == (3, MODES, STEPS, 2)


def test_samples_of_other_scenes_are_counted(tmp_path: Path) -> None:
    content = {**results(mfeval(), SCENES[1]), **results(mfeval()), "of-another-dataset": []}
    data = write_root(tmp_path / "data")
    assert read("mfeval", data, write_results(tmp_path / "f.json", content)).others == 5


def test_numbers_that_are_not_json_are_read_as_unknown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mapped, "_CHUNK_BYTES", 64)
    objects = deepcopy(mfeval())  # its lists are those of other tests
    objects[0]["detection_score"] = float("nan")
    objects[0]["note"] = "NaN, Infinity"
    objects[1]["traj"][2][3] = [float("inf"), float("-inf")]
    objects[1]["traj"][2][4] = [float("nan"), None]
    stored = read_form("mfeval", tmp_path, objects)
    assert np.isnan(stored.confidence).tolist() == [True, False, False]
    assert stored.path[1, 2, 3].tolist() == [1e300, -1e300]
    assert np.isnan(stored.path[1, 2, 4]).all()


@pytest.mark.parametrize("text", ["null", "[]", "[ ]", "[[], []]"])
def test_no_forecast_in_any_way(text: str, tmp_path: Path) -> None:
    objects = mfeval()
    objects[0]["traj"] = "HERE"
    data = write_root(tmp_path / "data")
    path = write_results(tmp_path / "f.json", results(objects))
    path.write_text(path.read_text().replace('"HERE"', text))
    assert np.isneginf(read("mfeval", data, path).log_weight[0]).all()


def test_blanks_and_lines_in_a_file(tmp_path: Path) -> None:
    data = write_root(tmp_path / "data")
    path = tmp_path / "f.json"
    path.write_text(json.dumps(results(mfeval()), indent=3).replace("\n", "\r\n\t"))
    spread = read("mfeval", data, path)
    compact = read("mfeval", data, write_results(path, results(mfeval())))
    np.testing.assert_array_equal(spread.path, compact.path)


def test_fewer_samples_than_other_objects(tmp_path: Path) -> None:
    objects = mfeval()
    objects[1] |= {"traj": objects[1]["traj"][:2], "traj_prob": [0.5, 0.5]}
    stored = read_form("mfeval", tmp_path, objects)
    assert np.isnan(stored.path[1]).all(axis=(1, 2)).tolist() == [False] * 2 + [True] * 4
    assert np.isneginf(stored.log_weight[1]).tolist() == [False] * 2 + [True] * 4


def change(key: str, value: Any, form: str = "mfeval") -> tuple[str, Callable[[Record], object]]:
    def changed(content: Record) -> None:
        content[sample(SCENE, 1)][0][key] = value

    return form, changed


WRONG: dict[str, tuple[tuple[str, Callable[[Record], object]], str]] = {  # form and change, what the error says
    "a missing sample": (
        ("mfeval", lambda content: content.pop(sample(SCENE, 2))),
        "no entry for sample 'scene-0003-t2', expected one for each of 4 samples, empty where nothing is forecast",
    ),
    "no sample of the scene": (
        ("mfeval", lambda content: [content.pop(sample(SCENE, t)) for t in range(4)]),
        "no entry for sample 'scene-0003-t0', .* for scene 'scene-0003'; --split names another",
    ),
    "no list": (("mfeval", lambda content: content.update({sample(SCENE, 1): {}})), "t1': expected `array`, got"),
    "no place": (change("translation", [1.0]), r"sample 'scene-0003-t1', \[0\].translation: expected `array` of "),
    "a word as a score": (change("detection_score", "high"), r"\[0\].detection_score: expected `float .*, got `str`"),
    "a place of three numbers": (change("traj", [[[1, 2, 3]]]), r"t1', \[0\]\[0\]: expected `array` of length 2"),
    "a ragged sample": (change("traj", [[[1, 2]], [[1, 2]] * 2]), r"t1': samples of \[1, 2\] places in one object"),
    "empty samples": (change("traj", [[], [[1, 2]]]), r"t1': samples of \[0, 1\] places in one object"),
    "words as places": (change("traj", [[["1", "2"]]]), r"\[0\]\[0\]\[0\]: expected `float .*, got `str`"),
    "objects as places": (change("traj", [[{"x": 1, "y": 2}]]), r"\[0\]\[0\]: expected `array`, got `object`"),
    "a number as samples": (change("traj", 5), "expected `array`, got `int`"),
    "true": (change("traj", [[[True, 1]]]), r"\[0\]\[0\]\[0\]: expected `float .*, got `bool`"),
    "places in places": (change("traj", [[[[1, 2], [1, 2]]]]), r"expected `float .*, got `array`"),
    "another length": (change("traj", [[[1, 2]] * 3] * MODES), r"samples of shape \(6, 3, 2\), expected \(6, 12, 2\)"),
    "too few weights": (
        change("traj_prob", [1.0]),
        r"t1': samples of shape \(6, 12, 2\), expected \(1, 12, 2\): as many as weights, with as many places as of",
    ),
    "steps that do not fit": (change("fut_traj", [0.0] * 71, "vad"), "71 numbers in fut_traj, expected x y of as many"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_file(case: str, tmp_path: Path) -> None:
    (form, changed), message = WRONG[case]
    content = {**results(FORMS[form]()), sample("scene-0001", 0): []}
    changed(content)
    with pytest.raises(DataError, match=message) as caught:
        read(form, write_root(tmp_path / "data"), write_results(tmp_path / "f.json", content))
    assert "\n" not in str(caught.value)


BROKEN: dict[str, tuple[bytes, str]] = {
    "empty": (b"", "cannot be read as JSON: cannot mmap an empty file"),
    "cut off": (b'{"a": [', "cannot be read as JSON: .*; is the file cut off"),
    "a list": (b"[]", "expected `object`, got `array`"),
    "another dataset": (b'{"a": [], "b": []}', r"no entry for sample .* \(it has 2 others\), for scene"),
    "deep": (b'{"a":' * 5000, "cannot be read as JSON"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_file(case: str, tmp_path: Path) -> None:
    content, message = BROKEN[case]
    (tmp_path / "f.json").write_bytes(content)
    with pytest.raises(DataError, match=message):
        read("mfeval", write_root(tmp_path / "data"), tmp_path / "f.json")


def test_a_packed_file_that_is_not_one(tmp_path: Path) -> None:
    (tmp_path / "f.json.gz").write_bytes(b"{}")
    with pytest.raises(DataError, match="cannot be read as JSON: Not a gzipped file"):
        read("mfeval", write_root(tmp_path / "data"), tmp_path / "f.json.gz")
    packed = write_results(tmp_path / "g.json.gz", results(mfeval())).read_bytes()
    (tmp_path / "g.json.gz").write_bytes(packed[:-20])
    with pytest.raises(DataError, match="cannot be read as JSON: Compressed file ended"):
        read("mfeval", write_root(tmp_path / "data"), tmp_path / "g.json.gz")


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"no file .*f\.json"):
        read("mfeval", write_root(tmp_path / "data"), tmp_path / "f.json")


@pytest.mark.parametrize("name", ["f.json", "f.json.gz"])
def test_a_huge_file(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mapped, "MAX_BYTES", 1000)
    path = write_results(tmp_path / name, results(mfeval()))
    with pytest.raises(DataError, match="above 0 GiB unpacked, the limit"):
        read("mfeval", write_root(tmp_path / "data"), path)


def test_too_many_places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stored_forecasts, "MAX_PLACES", 3 * MODES * STEPS - 1)
    with pytest.raises(DataError, match="3 objects of a scene with up to 6 samples of 12 steps are above 215 places"):
        read_form("mfeval", tmp_path, mfeval())
    (tmp_path / "t.csv").write_text(table("scene-0003,0,car,1,1,0.5," + ",".join(["1,2"] * 12), steps=12))
    monkeypatch.setattr(stored_forecasts, "MAX_PLACES", 11)
    with pytest.raises(DataError, match=r"t\.csv, line 2: 1 objects of a scene with up to 1 samples of 12 steps"):
        read("table", tmp_path / "data", tmp_path / "t.csv")


def test_words_that_are_not_json_are_found_in_any_place() -> None:
    content = b'[NaN,NaN, -Infinity,Infinity ,"NaN","a NaN ","NaNs",xNaN]'
    expected = b'[null,null, -1e300,1e300 ,"NaN","a null ","NaNs",xNaN]'
    assert text.as_json(content) == expected


# ---- own tables
FULL = "frame,object,id,class,x,y,z,yaw,l,w,h,confidence,mode,weight,x1,y1,x2,y2"
ROWS = """
1,0,7,car,10,2,1,1.57,4,2,1.5,0.9,0,0.75,10,4,10,6
1,0,7,car,10,2,1,1.57,4,2,1.5,0.9,1,0.25,10,3,10,4
1,1,8,pedestrian,5,5,0.9,0,0.6,0.5,1.8,0.6,0,1,5,5,5,5
"""


def table(rows: str, header: str = "scene,frame,class,x,y,confidence", steps: int = 0) -> str:
    header = ",".join([header, *(f"x{s},y{s}" for s in range(1, steps + 1))])
    return f"{header}\n{rows.strip()}\n"


def own(root: Path, content: str, suffix: str = ".csv", name: str = SCENE) -> StoredForecasts:
    data = write_root(root / "data")
    folder = root / "tables"
    folder.mkdir(exist_ok=True)
    path = folder / f"{name}.csv"
    path.write_text(content)
    if suffix == ".parquet":
        columns = read_named_table(path, (*stored_forecasts.FORECASTS, *stored_forecasts._STEPS)).columns
        path.unlink()
        write_table(path.with_suffix(suffix), columns)
    return read("table", data, folder)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_folder_of_tables(suffix: str, tmp_path: Path) -> None:
    stored = own(tmp_path, table(ROWS, FULL), suffix)
    assert stored.frame.tolist() == [1, 1]
    assert stored.class_name.tolist() == ["car", "pedestrian"]
    assert stored.identity.tolist() == ["7", "8"]
    assert stored.confidence.tolist() == [0.9, 0.6]
    np.testing.assert_allclose(stored.box, [[10, 2, 1, 1.57, 4, 2, 1.5], [5, 5, 0.9, 0, 0.6, 0.5, 1.8]])
    np.testing.assert_allclose(stored.path[0], [[[10, 4], [10, 6]], [[10, 3], [10, 4]]])
    np.testing.assert_allclose(stored.path[1, 0], [[5, 5], [5, 5]])
    assert np.isnan(stored.path[1, 1]).all()
    np.testing.assert_allclose(np.exp(stored.log_weight), [[0.75, 0.25], [1.0, 0.0]])
    assert not any(stored.notes.values())


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_one_table_with_a_column_scene(suffix: str, tmp_path: Path) -> None:
    rows = "\n".join(f"{scene},{row}" for scene in ("scene-0001", SCENE) for row in ROWS.split())
    path = tmp_path / f"all{suffix}"
    (tmp_path / "all.csv").write_text(table(rows, f"scene,{FULL}"))
    if suffix == ".parquet":
        columns = (*stored_forecasts.FORECASTS, *stored_forecasts._STEPS)
        write_table(path, read_named_table(tmp_path / "all.csv", columns).columns)
    stored = read("table", write_root(tmp_path / "data"), path)
    assert stored.path.shape == (2, 2, 2, 2)
    with pytest.raises(DataError, match=r"rows of scene-0001, scene-0003 \.\., none for scene 'scene-0301'; --split"):
        read("table", tmp_path / "data", path, scene="scene-0301")


def without(columns: str, rows: str = ROWS, header: str = FULL) -> str:
    """The table without these columns."""
    names = header.split(",")
    kept = [place for place, name in enumerate(names) if name not in columns.split()]
    lines = [row.split(",") for row in (header, *rows.split())]
    return "".join(f"{','.join(line[place] for place in kept)}\n" for line in lines)


def test_columns_that_are_left_out(tmp_path: Path) -> None:
    stored = own(tmp_path, without("z yaw l w h id object mode weight", "\n".join(ROWS.split()[::2])))
    # each row is an object; the usual car is 1.65 m high, a pedestrian 1.75 m
    np.testing.assert_allclose(stored.box, [[10, 2, 0.825, 0, 4.5, 1.9, 1.65], [5, 5, 0.875, 0, 0.7, 0.7, 1.75]])
    assert stored.identity.tolist() == ["", ""]
    assert stored.log_weight.tolist() == [[0], [0]]
    assert stored.notes == {"objects without z yaw l w h, for which defaults stand in": 2}


def test_without_numbers_of_objects_the_track_tells_them(tmp_path: Path) -> None:
    stored = own(tmp_path, without("object mode"))
    assert stored.path.shape[:2] == (2, 2)
    np.testing.assert_allclose(stored.path[0, :, 0], [[10, 4], [10, 3]])  # in the order of the rows


def test_modes_are_ordered_by_their_numbers(tmp_path: Path) -> None:
    rows = ROWS.replace("0.9,0,0.75", "0.9,9,0.75")
    np.testing.assert_allclose(own(tmp_path, table(rows, FULL)).path[0, :, 0], [[10, 3], [10, 4]])


def test_an_empty_table_has_no_objects(tmp_path: Path) -> None:
    assert len(own(tmp_path, f"{FULL}\n").frame) == 0


WRONG_TABLES: dict[str, tuple[str, str]] = {  # content, what the error says
    "after the end": (table(ROWS.replace("1,1,8", "4,1,8"), FULL), "line 4, column 'frame': frame 4, but the scene has the frames 0 to 3"),
    "half a frame": (table(ROWS.replace("1,1,8", "1.5,1,8"), FULL), "line 4, column 'frame': 1.5, expected a whole"),
    "two places": (
        table(ROWS.replace("10,2,1,1.57,4,2,1.5,0.9,1", "10,3,1,1.57,4,2,1.5,0.9,1"), FULL),
        "line 3, column 'y': another y than in the first row of its object"),
    "two tracks": (table(ROWS.replace("7,car,10,2,1,1.57,4,2,1.5,0.9,1", "5,car,10,2,1,1.57,4,2,1.5,0.9,1"), FULL),
                   "line 3, column 'id': another id than in the first row"),
    "a sample twice": (table(ROWS.replace("0.9,1,0.25", "0.9,0,0.25"), FULL),
                       "line 3, column 'mode': a second row of sample 0 of its object"),
    "no weight": (table(ROWS.replace("0.9,1,0.25", "0.9,1,0"), FULL), "line 3, column 'weight': expected a probab"),
    "an empty weight": (table(ROWS.replace("0.9,1,0.25", "0.9,1,"), FULL), "line 3, column 'weight': an empty cell"),
    "no confidence": (without("confidence"), "no column 'confidence'"),
    "no class": (without("class"), "no column 'class'"),
    "a class in capitals": (table(ROWS.replace("pedestrian", "Pedestrian"), FULL), "line 4, column 'class': 'Pedes"),
    "a hole in the steps": (without("x2"), "no column 'x2', expected places x1 y1 x2 y2"),
    "no steps": (without("x1 y1 x2 y2"), "no column 'x1', expected places x1 y1 x2 y2"),
    "an unknown column": (table(ROWS, FULL.replace("weight", "wait")), "wait"),
    "a word": (table(ROWS.replace(",0.25,", ",light,"), FULL), "line 3, column 'weight': 'light', expected a number"),
    "degrees": (table(ROWS.replace("1.57", "90"), FULL), "line 2, column 'yaw': 90, expected radians"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG_TABLES)
def test_a_wrong_table(case: str, tmp_path: Path) -> None:
    content, message = WRONG_TABLES[case]
    with pytest.raises(DataError, match=message) as caught:
        own(tmp_path, content)
    assert "\n" not in str(caught.value)


def test_a_folder_without_the_scene(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"no table \.csv or \.parquet for scene 'scene-0003'; --split"):
        own(tmp_path, table(ROWS, FULL), name="scene-0001")


def test_a_file_without_scenes(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(table(ROWS, FULL))
    with pytest.raises(DataError, match=r"t\.csv: no column 'scene', expected one, or a folder"):
        read("table", write_root(tmp_path / "data"), tmp_path / "t.csv")
