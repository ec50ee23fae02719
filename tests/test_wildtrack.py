"""WILDTRACK source on files of a few people: ground plane, scenes, cameras, bad input, what is found and missing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import Card, load_card
from mtp_bench.errors import CardError, DataError, UnknownNameError
from mtp_bench.sources.motion import backward_velocity
from mtp_bench.sources.people import as_places
from mtp_bench.sources.wildtrack import (
    ANNOTATIONS,
    DETECTIONS,
    SCENES,
    STORED,
    Wildtrack,
)
from mtp_bench.sources.wildtrack_files import CAMERAS, Camera, read_annotations, read_cameras, read_detections
from mtp_bench.sources.wildtrack_status import wildtrack_status
from mtp_bench.types import Detections, Scene

LAST = 1800  # number of the first frame with stored detections
CENTRE = 240 + 480 * 720  # positionID of the middle of the area


def wildtrack_card(**source: Any) -> Card:
    card = load_card("MTP-WILDTRACK-v0")
    return card.model_copy(update={"source": card.source.model_copy(update=source)})


def person(identity: Any, position: Any, **views: Any) -> dict[str, Any]:
    unseen = [{"viewNum": v, "xmin": -1, "ymin": -1, "xmax": -1, "ymax": -1} for v in range(7)]
    return {"personID": identity, "positionID": position, "views": unseen, **views}


def write_people(root: Path, number: int, *people: dict[str, Any]) -> None:
    path = root / ANNOTATIONS / f"{number:08d}.json"
    path.write_text(json.dumps(people), encoding="utf-8")


def write_text(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Nobody in any frame but the first of the last scene: one person in the middle, who is detected."""
    folder = tmp_path / "wildtrack"
    (folder / ANNOTATIONS).mkdir(parents=True)
    for number in range(0, 2000, 5):
        write_people(folder, number)
    write_people(folder, LAST, person(7, CENTRE))
    write_text(folder / DETECTIONS, f"{LAST} 240 720\n")
    return folder


def load(root: Path, name: str = STORED, **source: Any) -> Scene:
    return Wildtrack(wildtrack_card(**source), root).load(name)


@pytest.mark.parametrize(
    ("cell", "place"),
    [
        pytest.param((0, 0), (-3.0, -9.0), id="first corner"),
        pytest.param((479, 0), (8.975, -9.0), id="end of the first row"),
        pytest.param((0, 1), (-3.0, -8.975), id="start of the second row"),
        pytest.param((240, 720), (3.0, 9.0), id="middle"),
        pytest.param((479, 1439), (8.975, 26.975), id="last corner"),
    ],
)
def test_ground_plane(root: Path, cell: tuple[int, int], place: tuple[float, float]) -> None:
    """Annotations and detections are on one grid, x runs fastest; people stand on z = 0."""
    write_people(root, LAST, person(7, cell[0] + 480 * cell[1]))
    write_text(root / DETECTIONS, f"{LAST} {cell[0]} {cell[1]}\n")
    scene = load(root)
    for box in (scene.truth.box, scene.detections.box):
        np.testing.assert_allclose(box, [[*place, 0.875, 0, 0.6, 0.6, 1.75]], atol=1e-12)
    np.testing.assert_allclose(scene.ego, np.tile([3.0, 9.0, 0.0, 0.0], (40, 1)))
    np.testing.assert_array_equal(scene.time, np.arange(40) / 2)


@pytest.mark.parametrize(
    ("split", "first"),
    [("train", (0, 200, 400, 600, 800, 1000)), ("val", (1200, 1400, 1600, 1800)), ("test", (1800,))],
)
def test_splits(root: Path, split: str, first: tuple[int, ...]) -> None:
    source = Wildtrack(wildtrack_card(split=split), root)
    assert source.names == tuple(f"wildtrack-{number:04d}" for number in first)
    for name in source.names:
        write_people(root, SCENES[name] + 195, person(3, 0))  # the last frame of the scene, and only of this one
        assert source.load(name).truth.start.tolist()[-2:] == [name == STORED, 1 + (name == STORED)]
    with pytest.raises(UnknownNameError, match="wildtrack-0100"):
        source.load("wildtrack-0100")


def test_only_the_last_scene_has_stored_detections(root: Path) -> None:
    stored = load(root)
    assert (stored.detector, stored.simulated) == ("mvdet, stored detections", False)
    assert stored.detections.score.tolist() == [1.0]
    assert np.isnan(stored.detections.velocity).all()
    for scene in (load(root, "wildtrack-1600"), load(root, detector=None)):
        assert (scene.detector, scene.simulated) == ("", False)
        assert len(scene.detections.box) == 0
        assert len(scene.detections.start) == 41


def test_as_places_keeps_places_and_scores_alone() -> None:
    """Boxes turned, sized and lifted as a simulation may do it; the second row differs in its place only."""
    box = np.array([[1.0, 2.0, 9.0, 1.5, 3.0, 2.0, 1.0], [-4.0, 30.0, 0.875, 0.0, 0.6, 0.6, 1.75]])
    start, class_id, score = np.array([0, 1, 2]), np.array([0, 0]), np.array([0.3, 0.4])
    given = Detections(start, box, np.zeros((2, 2)), class_id, score)
    places = as_places(given)
    np.testing.assert_array_equal(places.box, [[1, 2, 0.875, 0, 0.6, 0.6, 1.75], box[1]])
    assert (places.start is start, places.score is score) == (True, True)


def test_detections_are_sorted_by_frame(root: Path) -> None:
    write_text(root / DETECTIONS, "1995 8 4\n\n1800 4 0\n1805 12 0\n1800 0 0\n")
    detections = load(root).detections
    np.testing.assert_allclose((detections.box[:, 0] + 3) / 0.025, [4, 0, 12, 8])
    np.testing.assert_array_equal(detections.start, [0, 2, *[3] * 38, 4])


def test_truth_is_complete_and_everyone_counts(root: Path) -> None:
    write_people(root, LAST, person(9, 5), person(2, 70))
    scene = load(root)
    assert scene.truth.object_id.tolist() == [9, 2]
    assert scene.truth.eligible.all()
    assert not scene.truth.neutral.any()
    assert scene.truth_complete
    assert scene.visible is not None
    np.testing.assert_array_equal(scene.visible, [1, 1])


def test_velocities_look_back(root: Path) -> None:
    """Person 1 walks 40 cells = 1 m per step along x, is away for a frame, comes back; person 2 stands."""
    for t, x in ((0, 0), (1, 40), (2, 80), (4, 160), (5, 200)):
        write_people(root, LAST + 5 * t, person(2, 480), person(1, x))
    write_people(root, LAST + 15, person(2, 480))
    truth = load(root).truth
    walker = truth.velocity[truth.object_id == 1]
    np.testing.assert_allclose(walker[[1, 2, 4]], np.tile([2.0, 0.0], (3, 1)))
    assert np.isnan(walker[[0, 3]]).all()
    np.testing.assert_allclose(truth.velocity[truth.object_id == 2][1:], 0, atol=1e-12)


def test_a_velocity_knows_nothing_of_the_future() -> None:
    frame, ids, time = np.array([0, 1, 2]), np.array([4, 4, 4]), np.array([0.0, 0.5, 1.0])
    there = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0]])
    elsewhere = np.array([[0.0, 0.0], [1.0, 0.0], [9.0, 9.0]])
    one, other = (backward_velocity(frame, ids, position, time)[:2] for position in (there, elsewhere))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"classes": ("pedestrian", "car")}, "no class 'car'"),
        ({"rate": 10.0}, r"task.rate is 10.0 Hz, but WILDTRACK is annotated at 2.0 Hz"),
    ],
)
def test_cards_that_do_not_fit(root: Path, change: dict[str, Any], message: str) -> None:
    card = wildtrack_card()
    with pytest.raises(CardError, match=message):
        Wildtrack(card.model_copy(update={"task": card.task.model_copy(update=change)}), root)


BROKEN_ANNOTATIONS = {
    "no JSON": ("[{]", r"00001800.json, line 1, column 3: no JSON"),
    "no list": ("{}", "got dict, expected a list of people"),
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
        ("1800 1", "line 2: got '1800 1', expected three numbers 'frame gx gy'"),
        ("1800 a 1", "line 2: got '1800 a 1', expected three numbers"),
        ("1800 nan 1", "line 2: cell nan 1 is off the grid of 480 x 1440"),
        ("1800 480 1", "line 2: cell 480 1 is off the grid"),
        ("1800 1 -1", "line 2: cell 1 -1 is off the grid"),
        ("1800 1 1440", "line 2: cell 1 1440 is off the grid"),
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


@pytest.mark.parametrize("folder", ["wildtrack", "Wildtrack_dataset", ""])
def test_folders_in_which_it_is_found(root: Path, folder: str) -> None:
    place = root.parent / "data" / folder
    place.parent.mkdir(exist_ok=True)
    root.rename(place)
    assert Wildtrack(wildtrack_card(), root.parent / "data").root == place


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
        ("extrinsic/extr_IDIAP1.xml", "<a><rvec>1 2</rvec></a>", "'rvec' must hold 3 finite numbers, got '1 2'"),
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


def test_status(root: Path, tmp_path: Path) -> None:
    status = wildtrack_status(wildtrack_card(), root)
    assert status.usable
    assert not status.verified
    found = {check.what: (check.found, check.expected) for check in status.checks}
    assert found == {"frames": (400, 400), "annotations": (1, 9518), "people": (1, 313), "detections": (1, 966)}
    assert status.notes[0] == "detections only for the last 40 frames; the other frames have simulated ones"
    assert "pixels cannot be computed" in status.notes[1]
    absent = wildtrack_status(wildtrack_card(), tmp_path / "elsewhere")
    assert absent.root is None
    assert len(absent.searched) == 3


def test_status_names_what_is_missing_and_broken(root: Path) -> None:
    write_text(root / ANNOTATIONS / "00001805.json", "[")
    (root / ANNOTATIONS / "00001810.json").unlink()
    (root / DETECTIONS).unlink()
    status = wildtrack_status(wildtrack_card(), root)
    assert status.missing == ("annotations_positions/00001810.json", "detections/mvdet_test.txt")
    assert len(status.problems) == 1
    assert "00001805.json" in status.problems[0]
    assert wildtrack_status(wildtrack_card(split="train"), root).missing == ()
