"""Files of 3DMOT2015: one clear error for everything that is wrong; what is found and missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mtp_bench.errors import DataError
from mtp_bench.sources import describe, open_source
from tests.sources.test_mot3d import DET, GT, INI, SEQUENCE, TEN, load, make_root, mot3d_card, row, seqinfo
from tests.support.source_files import assert_one_error, write


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return make_root(tmp_path)


BROKEN: dict[str, tuple[str, list[str] | None, str]] = {  # file, its lines (None: removed), what the error says
    "true row cut off": (GT, [row(1, 7, 0, 0), "2,7,10,20"], r"line 2: 4 columns, expected 10 \(frame, id, left"),
    "row too long": (GT, [row(1, 7, 0, 0) + ",1"], "line 1: 11 columns, expected 10"),
    "blanks for commas": (DET, [row(1, -1, 0, 0).replace(",", " ")], "line 1: 1 columns, expected 10"),
    "not a number": (GT, ["", row(1, 7, 0, 0).replace("20", "top")], r"line 2, column 4 \(top\): got 'top'"),
    "true NaN": (GT, [row(1, 7, np.nan, 0)], "line 1: X is nan, expected a finite number"),
    "detected NaN": (DET, [row(1, -1, 0, 0), row(2, -1, 0, np.nan)], "line 2: Y is nan, expected a finite"),
    "infinite score": (DET, [row(1, -1, 0, 0, np.inf)], "line 1: confidence is inf, expected a finite"),
    "true place out of bounds": (GT, [row(1, 7, -1e308, 0)], r"line 1: X is -1e\+308, expected .* up to 1e\+09"),
    "true id out of bounds": (GT, [row(1, 10**30, 0, 0)], r"line 1: id is 1e\+30, expected .* up to 1e\+09"),
    "frame out of bounds": (DET, [row(10**30, -1, 0, 0)], r"line 1: frame is 1e\+30, expected .* up to"),
    "many digits": (DET, [row(10**3999, -1, 0, 0)], "line 1: frame is inf, expected a finite number up to"),
    "frames from 0": (GT, [row(0, 7, 0, 0)], "line 1: frame 0, expected 1 to 10, the seqLength of seqinfo.ini"),
    "frame after the end": (DET, [row(TEN + 1, -1, 0, 0)], "line 1: frame 11, expected 1 to 10"),
    "half a frame": (GT, [row(1, 7, 0, 0).replace("1", "1.5", 1)], "line 1: frame is 1.5, expected a whole number"),
    "half an id": (GT, [row(1, 7, 0, 0).replace("7", "7.5", 1)], "line 1: id is 7.5, expected a whole number"),
    "person twice": (GT, [row(1, 7, 0, 0), row(2, 7, 0, 0), row(1, 7, 1, 0)], "line 3: a second box of object 7 in f"),
    "no truth": (GT, None, "no file"),
    "no detections": (DET, None, "no file"),
    "detections in pixels only": (DET, [row(1, -1, -1, -1)[:-1] + "-1"], r"-1 in every row, as in the 2D benchmark"),
    "truth is no text": (GT, ["\udcff"], "cannot be read as text"),
    "no seqinfo": (INI, None, r"write it with the lines '\[Sequence\]', 'name=TUD-Stadtmitte', 'frameRate=25' and "),
    "seqinfo without rate": (INI, [seqinfo()[0], *seqinfo()[3:]], "no key 'frameRate' in the section"),
    "seqinfo without length": (INI, seqinfo()[:3], "no key 'seqLength' in the section"),
    "seqinfo of another section": (INI, ["[Other]", *seqinfo()[1:]], "no key 'frameRate' in the section"),
    "seqinfo without section": (INI, seqinfo()[1:], "cannot be read: File contains no section headers"),
    "rate not a number": (INI, seqinfo(rate="7 Hz"), "frameRate is '7 Hz', expected a number above 0"),
    "no frames": (INI, seqinfo(length="0"), "seqLength is '0', expected a number above 0"),
    "endless": (INI, seqinfo(length="99999999"), r"seqLength is '99999999', expected a number .* up to 1e\+06"),
    "rate out of bounds": (INI, seqinfo(rate="1e30"), r"frameRate is '1e30', expected .* and up to 1e\+06"),
    "half a length": (INI, seqinfo(length="9.5"), "seqLength is 9.5, expected a whole number"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_broken_files_give_one_clear_error(root: Path, case: str) -> None:
    file, lines, text = BROKEN[case]
    assert_one_error(root / file, lines, text, lambda: load(root, "0005"))


def test_a_byte_order_mark_is_no_number(root: Path) -> None:
    text = (root / GT).read_text(encoding="utf-8")
    (root / GT).write_text(text.replace("\n", "\r\n"), encoding="utf-8-sig")
    assert len(load(root, "0005").truth.box) == 7


@pytest.mark.parametrize("folder", ["mot3d2015", "3DMOT2015", "."])
def test_the_root_is_the_parent_or_the_folder_itself(root: Path, folder: str) -> None:
    data = root if folder == "." else root.parent
    if folder == "3DMOT2015":
        root.rename(root.parent / folder)
    assert open_source(mot3d_card(), data).names == (f"{SEQUENCE}-0005",)
    assert describe(mot3d_card(), data).usable


def test_missing_root(root: Path, tmp_path: Path) -> None:
    nowhere = tmp_path / "nothing"
    with pytest.raises(DataError, match=r"none of .*mot3d2015, .*3DMOT2015, .*given as data root.*motchallenge\.net"):
        open_source(mot3d_card(), nowhere)
    with pytest.raises(DataError, match=r"train/PETS09-S2L1 is in none of .*; found there: TUD-Stadtmitte; name"):
        open_source(mot3d_card(sequence="PETS09-S2L1"), root)


def test_status_lists_what_is_missing_and_what_is_wrong(root: Path) -> None:
    status = describe(mot3d_card(), root)
    assert status.usable
    assert not status.verified  # ten frames of 179
    assert [(check.what, check.found) for check in status.checks] == [
        ("frames", 10), ("tracks", 2), ("boxes", 15), ("detections", 10),
    ]  # fmt: skip
    write(root / GT, "1,2,3")
    (root / DET).unlink()
    (root / INI).unlink()
    status = describe(mot3d_card(), root)
    assert status.missing == [INI, DET]
    assert [problem.partition(": ")[2] for problem in status.problems] == [
        "3 columns, expected 10 (frame, id, left, top, width, height, confidence, X, Y, Z): is the file cut off?"
    ]
    assert [check.found for check in status.checks] == [0, 0, 0, 0]


def test_status_with_a_simulated_detector_needs_no_detections(root: Path) -> None:
    (root / DET).unlink()
    status = describe(mot3d_card(detector={"profile": "clean"}), root)
    assert status.usable
    assert [check.what for check in status.checks] == ["frames", "tracks", "boxes"]
