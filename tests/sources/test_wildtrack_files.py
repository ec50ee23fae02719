"""Readers of the WILDTRACK files: one clear error for everything that is wrong, cameras, missing files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mtp_bench.errors import DataError
from mtp_bench.sources.wildtrack.files import CAMERAS, Camera, read_annotations, read_cameras, read_detections
from mtp_bench.sources.wildtrack.source import ANNOTATIONS, DETECTIONS, Wildtrack
from mtp_bench.sources.wildtrack.status import wildtrack_status
from tests.sources.test_wildtrack import LAST, load, make_root, person, wildtrack_card, write_people, write_text


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
    "large pixel": (
        json.dumps([person(7, 1, views=[{"viewNum": 2, "xmin": 10**400}])]),
        r"person 7, view 2: 'xmin' is 1000.*, expected an integer up to 1e\+09",
    ),
    "no person": ("[3]", "entry 0: got 3, expected an object with 'personID'"),
    "no personID": (json.dumps([{"positionID": 1, "views": []}]), "entry 0: no 'personID'"),
    "personID is text": (json.dumps([person("7", 1)]), "entry 0: 'personID' is '7', expected an integer"),
    "no positionID": (json.dumps([{"personID": 7}]), "person 7: no 'positionID'"),
    "half a position": (json.dumps([person(7, 1.5)]), "person 7: 'positionID' is 1.5, expected an integer"),
    "beyond the grid": (json.dumps([person(7, 691200)]), "person 7: positionID is 691200, off the grid of 480 x 1440"),
    "before the grid": (json.dumps([person(7, -1)]), "person 7: positionID is -1, off the grid"),
    "twice": (json.dumps([person(7, 1), person(8, 2), person(7, 3)]), "person 7 is there twice"),
    "no views": (json.dumps([{"personID": 7, "positionID": 1}]), "person 7: no list 'views'"),
    "another view": (json.dumps([person(7, 1, views=[{"viewNum": 7}])]), "person 7: viewNum is 7, expected 0 to 6"),
    "no side": (json.dumps([person(7, 1, views=[{"viewNum": 2}])]), "person 7, view 2: no 'xmin'"),
}


@pytest.mark.parametrize("case", BROKEN_ANNOTATIONS)
def test_broken_annotations(root: Path, case: str) -> None:
    content, message = BROKEN_ANNOTATIONS[case]
    write_text(root / ANNOTATIONS / "00001800.json", content)
    with pytest.raises(DataError, match=message) as caught:
        load(root)
    assert "00001800.json" in str(caught.value)


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
    write_text(root / DETECTIONS, f"1800 0 0\n{line}\n")
    with pytest.raises(DataError, match=message):
        load(root)


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


def test_a_pinhole_by_hand() -> None:
    """A camera 2 m over the origin that looks straight down, 100 pixels per unit; then with distortion."""
    down = np.diag([1.0, -1.0, -1.0])
    inner = np.array([[100.0, 0, 320], [0, 200.0, 240], [0, 0, 1]])
    camera = Camera("top", inner, np.zeros(5), down, np.array([0.0, 0.0, 2.0]))
    pixels = camera.project(np.array([[0.0, 0, 0], [1.0, 0, 0], [0, 1.0, 1.0], [0, 0, 3.0]]))
    np.testing.assert_allclose(pixels[:3], [[320, 240], [370, 240], [320, 40]])
    assert np.isnan(pixels[3]).all()  # above the camera: behind it
    bent = Camera("top", inner, np.array([0.1, 0.2, 0.01, 0.02, 0.4]), down, np.array([0.0, 0.0, 2.0]))
    # x = 0.5, y = 0: r2 = 0.25, radial = 1 + 0.025 + 0.0125 + 0.00625, x' = 0.521875 + 0.02 x 0.75, y' = 0.01 x 0.25
    np.testing.assert_allclose(bent.project(np.array([1.0, 0, 0])), [320 + 53.6875, 240 + 0.5])


def write_cameras(root: Path) -> None:
    """Cameras 2 m over the origin that look straight down: half a turn about x."""
    matrix = "<camera_matrix><rows>3</rows><data>100 0 320 0 100 240 0 0 1</data></camera_matrix>"
    straight = "<distortion_coefficients><data>\n 0 0\n 0 0 0</data></distortion_coefficients>"
    for name in CAMERAS:
        inner = f"<opencv_storage>{matrix}{straight}</opencv_storage>"
        write_text(root / f"calibrations/intrinsic_zero/intr_{name}.xml", inner)
        outer = f"<opencv_storage><rvec>\n {np.pi} 0 0 </rvec><tvec> 0 0 200 </tvec></opencv_storage>"
        write_text(root / f"calibrations/extrinsic/extr_{name}.xml", outer)


def test_cameras(root: Path) -> None:
    write_cameras(root)
    cameras = read_cameras(root)
    assert tuple(camera.name for camera in cameras) == CAMERAS
    np.testing.assert_allclose(cameras[3].project(np.array([[1.0, 1.0, 0.0]])), [[370, 190]])


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("extrinsic/extr_IDIAP1.xml", "<a>", "extr_IDIAP1.xml is no XML"),
        ("extrinsic/extr_IDIAP1.xml", "<a><rvec>1 2 3</rvec></a>", "extr_IDIAP1.xml: no 'tvec'"),
        ("extrinsic/extr_IDIAP1.xml", "<a><rvec>1 2</rvec></a>", "'rvec' must hold 3 finite numbers .*, got '1 2'"),
        (
            "extrinsic/extr_IDIAP1.xml",
            "<a><rvec>1 2 1e308</rvec></a>",
            r"'rvec' must hold 3 finite numbers up to 1e\+09",
        ),
        ("extrinsic/extr_IDIAP1.xml", "<a><rvec>1 2 nan</rvec></a>", "'rvec' must hold 3 finite numbers"),
        ("intrinsic_zero/intr_CVLab2.xml", "<a><camera_matrix>x</camera_matrix></a>", "holds 'x', expected numbers"),
    ],
)
def test_broken_calibrations(root: Path, file: str, text: str, message: str) -> None:
    write_cameras(root)
    write_text(root / "calibrations" / file, text)
    with pytest.raises(DataError, match=message):
        read_cameras(root)
    assert any(file in problem for problem in wildtrack_status(wildtrack_card(), root).problems)


def test_readers_keep_what_cameras_see(root: Path) -> None:
    views = [{"viewNum": 2, "xmin": 10, "ymin": 20, "xmax": 30, "ymax": 90}]
    write_people(root, LAST, person(7, 0, views=views), person(8, 1))
    image_box = read_annotations(root / ANNOTATIONS / "00001800.json").image_box
    np.testing.assert_array_equal(image_box[0, 2], [10, 20, 30, 90])
    assert np.isnan(image_box).sum() == 4 * 13
    write_text(root / DETECTIONS, "")
    assert read_detections(root / DETECTIONS).place.shape == (0, 2)


def test_a_byte_order_mark_is_not_read(root: Path) -> None:
    before = load(root)
    for path in (root / ANNOTATIONS / "00001800.json", root / DETECTIONS):
        path.write_text(path.read_text(encoding="utf-8"), encoding="utf-8-sig")
    after = load(root)
    assert len(after.truth.box) == len(after.detections.box) == 1
    np.testing.assert_array_equal(after.truth.box, before.truth.box)
