"""Readers of the WILDTRACK files: one clear error for everything that is wrong, cameras, missing files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mtp_bench.errors import DataError
from mtp_bench.sources.wildtrack.files import read_detections
from mtp_bench.sources.wildtrack.source import ANNOTATIONS, DETECTIONS, Wildtrack
from tests.sources.test_wildtrack import load, make_root, person, wildtrack_card
from tests.support.source_files import assert_one_error, write


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return make_root(tmp_path)


BROKEN_ANNOTATIONS = {
    "no JSON": ("[{]", r"00001800.json cannot be read as JSON: .*line 1 column 3"),
    "no list": ("{}", "got dict, expected a list of people"),
    "nested": ("[" * 100_000, "cannot be read as JSON: nested too deeply"),
    "digits": ('[{"personID": ' + "9" * 5000 + "}]", "cannot be read as JSON: Exceeds the limit"),
    "large personID": (json.dumps([person(10**30, 1)]), r"entry 0: 'personID' is 1000.*, expected an integer up to 1e"),
    "truth value for a personID": (json.dumps([person(True, 1)]), "entry 0: 'personID' is True, expected an integer"),
    "large position": (json.dumps([person(7, 10**400)]), r"person 7: 'positionID' is 1000.*, expected an integer up"),
    "no person": ("[3]", "entry 0: got 3, expected an object with 'personID'"),
    "no personID": (json.dumps([{"positionID": 1, "views": []}]), "entry 0: no 'personID'"),
    "personID is text": (json.dumps([person("7", 1)]), "entry 0: 'personID' is '7', expected an integer"),
    "no positionID": (json.dumps([{"personID": 7}]), "person 7: no 'positionID'"),
    "half a position": (json.dumps([person(7, 1.5)]), "person 7: 'positionID' is 1.5, expected an integer"),
    "beyond the grid": (json.dumps([person(7, 691200)]), "person 7: positionID is 691200, off the grid of 480 x 1440"),
    "before the grid": (json.dumps([person(7, -1)]), "person 7: positionID is -1, off the grid"),
    "twice": (json.dumps([person(7, 1), person(8, 2), person(7, 3)]), "person 7 is there twice"),
}


@pytest.mark.parametrize("case", BROKEN_ANNOTATIONS)
def test_broken_annotations(root: Path, case: str) -> None:
    content, message = BROKEN_ANNOTATIONS[case]
    assert_one_error(root / ANNOTATIONS / "00001800.json", [content], message, lambda: load(root))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1800 1", r"line 2: 2 columns, expected 3 \(frame, gx, gy\)"),
        ("1800 a 1", r"line 2, column 2 \(gx\): got 'a', expected a number"),
        ("1800 nan 1", "line 2: cell nan 1 is off the grid of 480 x 1440"),
        ("1800 480 1", "line 2: cell 480 1 is off the grid"),
        ("1800 1 -1", "line 2: cell 1 -1 is off the grid"),
        ("1800 1 1440", "line 2: cell 1 1440 is off the grid"),
        ("1e30 1 1", r"line 2: frame is 1e\+30, expected a whole number up to 1e\+09"),
        ("inf 1 1", "line 2: frame is inf, expected a whole number"),
        ("1800 0 0.0", "line 2: a second detection at the place of line 1"),
        ("nan 1 1", "line 2: frame is nan, expected a whole number"),
        ("1800.5 1 1", "line 2: frame is 1800.5, expected a whole number"),
        ("1801 1 1", "line 2: frame 1801 is not among the annotated test frames, 1800, 1805, ..., 1995"),
        ("2000 1 1", "line 2: frame 2000 is not among"),
        ("1795 1 1", "line 2: frame 1795 is not among"),
    ],
)
def test_broken_detections(root: Path, line: str, message: str) -> None:
    assert_one_error(root / DETECTIONS, ["1800 0 0", line], message, lambda: load(root))


def test_missing_files(root: Path, tmp_path: Path) -> None:
    (root / ANNOTATIONS / "00001805.json").unlink()
    with pytest.raises(DataError, match=r"no file .*00001805.json"):
        load(root)
    (root / DETECTIONS).unlink()
    with pytest.raises(DataError, match=r"no file .*mvdet_test.txt, detections of wildtrack-1800; .*MVDet"):
        load(root)
    assert load(root, "wildtrack-0000", split="train").detector == ""  # that split has none anyway
    with pytest.raises(DataError, match=r"annotations_positions is in none of .*Wildtrack_dataset.* get the data"):
        Wildtrack(wildtrack_card(), tmp_path / "elsewhere")


def test_a_file_without_detections(root: Path) -> None:
    write(root / DETECTIONS)
    assert read_detections(root / DETECTIONS).place.shape == (0, 2)


def test_a_byte_order_mark_is_not_read(root: Path) -> None:
    before = load(root)
    for path in (root / ANNOTATIONS / "00001800.json", root / DETECTIONS):
        path.write_text(path.read_text(encoding="utf-8"), encoding="utf-8-sig")
    after = load(root)
    assert len(after.truth.box) == len(after.detections.box) == 1
    np.testing.assert_array_equal(after.truth.box, before.truth.box)
