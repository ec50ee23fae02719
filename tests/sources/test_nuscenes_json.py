"""Long JSON files read in pieces, and what stands beside the tables of nuScenes: rotations and official splits."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mtp_bench.errors import DataError
from mtp_bench.sources.nuscenes import json_stream
from mtp_bench.sources.nuscenes.fields import yaw_of
from mtp_bench.sources.nuscenes.json_stream import read_entries, read_records
from mtp_bench.sources.nuscenes.splits import SPLITS, official_scenes, split_scenes
from tests.support.nuscenes_root import Record, write_json


def ignore(size: int) -> None:
    """Of no interest."""


def records(path: Path) -> list[Record]:
    return list(read_records(path, ignore))


CONTENT: list[Record] = [
    {
        "token": "a",
        "text": 'quotes " and \\ and [ ] { } , é 日本 😀',
        "list": [1, 2.5, -3e-7, None, True],
        "deep": {"x": [{}]},
    },
    {},
    {"deep": {"x": [{}]}},
    {"number": 1234567890123, "empty": "", "long": "x" * 40},
]


@pytest.mark.parametrize("chunk", [1, 2, 3, 7, 64, 1 << 20])
@pytest.mark.parametrize("indent", [None, 1, 50], ids=["one line", "many lines", "far indented"])
@pytest.mark.parametrize(("ascii_only", "encoding"), [(True, "utf-8"), (False, "utf-8"), (False, "utf-8-sig")])
def test_records_do_not_depend_on_where_a_chunk_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chunk: int, indent: int | None, ascii_only: bool, encoding: str
) -> None:
    monkeypatch.setattr(json_stream, "_CHUNK", chunk)
    path = tmp_path / "table.json"
    path.write_text(json.dumps(CONTENT, indent=indent, ensure_ascii=ascii_only) + " \n", encoding=encoding)
    sizes: list[int] = []
    assert list(read_records(path, sizes.append)) == CONTENT
    assert sum(sizes) == path.stat().st_size - 3 * (encoding == "utf-8-sig")
    nested = {"meta": -1.25e-70, "more": 3e200, "results": {"one": [1, 2], "two": []}, "after": CONTENT}
    path.write_text(json.dumps(nested, indent=indent, ensure_ascii=ascii_only), encoding=encoding)
    assert list(read_entries(path, "results", ignore)) == [("one", [1, 2]), ("two", [])]


def test_only_a_piece_of_a_long_file_is_in_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(json_stream, "_CHUNK", 256)
    path = tmp_path / "table.json"
    write_json(path, [{"token": str(i)} for i in range(2000)])
    read = 0

    def count(size: int) -> None:
        nonlocal read
        read += size

    for place, record in enumerate(read_records(path, count)):
        assert record["token"] == str(place)
        assert read <= (place + 1) * 30 + 512


@pytest.mark.parametrize("content", ["[]", " [ ] "])
def test_a_table_may_be_empty(tmp_path: Path, content: str) -> None:
    (tmp_path / "table.json").write_text(content)
    assert records(tmp_path / "table.json") == []


BAD_JSON: dict[str, tuple[str, str]] = {  # text, what the error says
    "empty": ("", r"got b'', expected a text that begins with '\['"),
    "no list": ('{"a": 1}', r"expected a text that begins with '\['"),
    "cut off between records": ('[{"a": 1},', "the file ends here: is it cut off"),
    "cut off after a record": ('[{"a": 1}', "the file ends here: is it cut off"),
    "cut off within a record": ('[{"a": 1}, {"a": [1, 2', "the file ends here: is it cut off"),
    "cut off within a text": ('[{"a": "bc', "the file ends here: is it cut off"),
    "no comma": ('[{"a": 1} {"a": 2}]', "expect ',' or ']'"),
    "wrong literal": ('[{"a": 1}, {"a": nul}]', "invalid string in json text"),
    "not a number of JSON": ('[{"a": Infinity}]', "invalid char in json text"),
    "too many digits": ('[{"a": ' + "9" * 5000 + "}]", "integer overflow"),
    "deep, but not too deep": ("[" * 500 + "]" * 500, r"got '\[+\.\.\.\]+', expected a record"),
    "too deep": ("[" * 100_000, "nested deeper than 1000 levels"),
    "too deep within a record": ('[{"a": ' * 100_000, "nested deeper than 1000 levels"),
    "no record": ("[1, 2]", "got '1', expected a record"),
    "more after the end": ('[{"a": 1}] []', "trailing garbage"),
}


@pytest.mark.parametrize("chunk", [3, 1 << 20])
@pytest.mark.parametrize("case", BAD_JSON)
def test_bad_json(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, case: str, chunk: int) -> None:
    monkeypatch.setattr(json_stream, "_CHUNK", chunk)
    content, message = BAD_JSON[case]
    path = tmp_path / "table.json"
    path.write_text(content)
    with pytest.raises(DataError, match=message) as caught:
        records(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("chunk", [1, 2, 3, 4, 5, 7, 64])
def test_nan_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chunk: int) -> None:
    monkeypatch.setattr(json_stream, "_CHUNK", chunk)
    path = tmp_path / "table.json"
    path.write_text('[{"a": NaN, "b": [NaN,1.5, NaN], "N": "Na"}, {"NaN": "aNaN"}]')
    assert records(path) == [{"a": None, "b": [None, 1.5, None], "N": "Na"}, {"NaN": "aNaN"}]


def test_an_error_in_the_middle_is_found_without_reading_on(tmp_path: Path) -> None:
    path = tmp_path / "table.json"
    path.write_text('[{"a": }, ' + '{"b": 1}, ' * 500_000 + "{}]")
    sizes: list[int] = []
    with pytest.raises(DataError, match="unallowed token"):
        list(read_records(path, sizes.append))
    assert sum(sizes) < path.stat().st_size / 2


def test_binary_files_and_missing_keys(tmp_path: Path) -> None:
    path = tmp_path / "table.json"
    path.write_bytes(b'[{"a": "\xff\xfe"}]')
    with pytest.raises(DataError, match="invalid bytes in UTF8"):
        records(path)
    path.write_text('{"meta": {}}')
    with pytest.raises(DataError, match="has no 'results'"):
        list(read_entries(path, "results", ignore))


@pytest.mark.parametrize(
    ("rotation", "yaw"),
    [
        pytest.param([1, 0, 0, 0], 0.0, id="ahead"),
        pytest.param([0.7071, 0, 0, 0.7071], np.pi / 2, id="left"),
        pytest.param([-0.7071, 0, 0, -0.7071], np.pi / 2, id="left, the other sign"),
        pytest.param([np.cos(0.1), 0, np.sin(0.1), 0], 0.0, id="nose down"),
        pytest.param([np.cos(0.4), np.sin(0.4), 0, 0], 0.0, id="rolled"),
        pytest.param([0, 0, 0, 1], np.pi, id="back"),
        # yaw 1.0, then pitch 0.3: the projected x axis keeps its heading
        pytest.param(
            [
                np.cos(0.5) * np.cos(0.15),
                -np.sin(0.5) * np.sin(0.15),
                np.cos(0.5) * np.sin(0.15),
                np.sin(0.5) * np.cos(0.15),
            ],
            1.0,
            id="turned and pitched",
        ),
    ],
)
def test_yaw(rotation: list[float], yaw: float) -> None:
    assert yaw_of(np.array([rotation], dtype=np.float64))[0] == pytest.approx(yaw)


def test_official_splits() -> None:
    scenes = official_scenes()
    assert {name: len(scenes[name]) for name in SPLITS} == {
        "train": 500, "train_val": 200, "val": 150, "mini_train": 8, "mini_val": 2,
    }  # fmt: skip
    whole = {*scenes["train"], *scenes["train_val"], *scenes["val"]}
    assert len(whole) == 850
    assert {*scenes["mini_train"], *scenes["mini_val"]} < whole
    assert max(scenes["train_val"]) < min(scenes["train"])
    assert split_scenes("all", ["scene-9", "scene-0301"]) == ("scene-0301", "scene-9")
    assert split_scenes("train", ["scene-9", "scene-0301"]) == ("scene-0301",)
