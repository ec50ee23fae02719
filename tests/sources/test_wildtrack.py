"""WILDTRACK source on files of a few people: ground plane, scenes, truth, what is found and missing."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import Card
from mtp_bench.core import Detections, Scene
from mtp_bench.sources.motion import as_places
from mtp_bench.sources.wildtrack import ANNOTATIONS, DETECTIONS, SCENES, STORED, Wildtrack
from tests.support.source_files import with_source, write

LAST = 1800  # number of the first frame with stored detections
CENTRE = 240 + 480 * 720  # positionID of the middle of the area


def wildtrack_card(**source: Any) -> Card:
    return with_source("MTP-WILDTRACK-v0", **source)


def person(identity: Any, position: Any, **views: Any) -> dict[str, Any]:
    unseen = [{"viewNum": v, "xmin": -1, "ymin": -1, "xmax": -1, "ymax": -1} for v in range(7)]
    return {"personID": identity, "positionID": position, "views": unseen, **views}


def write_people(root: Path, number: int, *people: dict[str, Any]) -> None:
    write(root / ANNOTATIONS / f"{number:08d}.json", json.dumps(people))


def make_root(tmp_path: Path) -> Path:
    """One person in the middle of the first frame of the last scene, who is detected; the other frames are empty."""
    folder = tmp_path / "wildtrack"
    for number in range(0, 2000, 5):
        write_people(folder, number)
    write_people(folder, LAST, person(7, CENTRE))
    write(folder / DETECTIONS, f"{LAST} 240 720")
    return folder


def load(root: Path, name: str = STORED, **source: Any) -> Scene:
    return Wildtrack(wildtrack_card(**source), root).load(name)


@pytest.mark.parametrize(("cell", "place"), [
    pytest.param((0, 0), (-3.0, -9.0), id="first corner"),
    pytest.param((479, 0), (8.975, -9.0), id="end of the first row"),
    pytest.param((0, 1), (-3.0, -8.975), id="start of the second row"),
    pytest.param((240, 720), (3.0, 9.0), id="middle"), pytest.param((479, 1439), (8.975, 26.975), id="last corner"),
])  # fmt: skip
def test_ground_plane(root: Path, cell: tuple[int, int], place: tuple[float, float]) -> None:
    """Annotations and detections are on one grid, x runs fastest; people stand on z = 0."""
    write_people(root, LAST, person(7, cell[0] + 480 * cell[1]))
    write(root / DETECTIONS, f"{LAST} {cell[0]} {cell[1]}")
    scene = load(root)
    for box in (scene.truth.box, scene.detections.box):
        np.testing.assert_allclose(box, [[*place, 0.875, 0, 0.6, 0.6, 1.75]], atol=1e-12)
    np.testing.assert_allclose(scene.ego, np.tile([3.0, 9.0, 0.0, 0.0], (40, 1)))
    np.testing.assert_array_equal(scene.time, np.arange(40) / 2)


@pytest.mark.parametrize(
    ("split", "first"), [("train", (0, 200, 400, 600, 800, 1000)), ("val", (1200, 1400, 1600, 1800)), ("test", (1800,))]
)
def test_splits(root: Path, split: str, first: tuple[int, ...]) -> None:
    source = Wildtrack(wildtrack_card(split=split), root)
    assert source.names == tuple(f"wildtrack-{number:04d}" for number in first)
    for name in source.names:
        write_people(root, SCENES[name] + 195, person(3, 0))  # the last frame of the scene, and only of this one
        assert source.load(name).truth.start.tolist()[-2:] == [name == STORED, 1 + (name == STORED)]


def test_only_the_last_scene_has_stored_detections(root: Path) -> None:
    stored = load(root)
    assert (stored.detector, stored.simulated) == ("mvdet, stored detections", False)
    assert stored.detections.score.tolist() == [1.0]
    assert np.isnan(stored.detections.velocity).all()
    for scene in (load(root, "wildtrack-1600"), load(root, detector=None)):
        assert (scene.detector, scene.simulated, len(scene.detections.box)) == ("", False, 0)
        assert len(scene.detections.start) == 41


def test_as_places_keeps_places_and_scores_alone() -> None:
    """Boxes turned, sized and lifted as a simulation may do it; the second row differs in its place only."""
    box = np.array([[1.0, 2.0, 9.0, 1.5, 3.0, 2.0, 1.0], [-4.0, 30.0, 0.875, 0.0, 0.6, 0.6, 1.75]])
    start, class_id, score = np.array([0, 1, 2]), np.array([0, 0]), np.array([0.3, 0.4])
    places = as_places(Detections(start, box, np.zeros((2, 2)), class_id, score))
    np.testing.assert_array_equal(places.box, [[1, 2, 0.875, 0, 0.6, 0.6, 1.75], box[1]])
    assert (places.start is start, places.score is score) == (True, True)


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
