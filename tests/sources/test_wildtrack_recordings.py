"""WILDTRACK source on the real recording: known counts, detections, cameras, and the noise profile fitted to them."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from mtp_bench.cards import load_card, with_split
from mtp_bench.detector import load_profile
from mtp_bench.detector.fit.objects import robust_deviation
from mtp_bench.detector.fit.samples import RADIAL, TANGENTIAL, collect_samples
from mtp_bench.detector.simulate import simulate
from mtp_bench.detector.visibility import Sensor, visibility_of
from mtp_bench.scoring import find_targets
from mtp_bench.sources import describe
from mtp_bench.sources.wildtrack.files import read_annotations
from mtp_bench.sources.wildtrack.source import ANNOTATIONS, SCENES, SPLITS, STORED, Wildtrack
from mtp_bench.types import Detections, Floats, Scene, Truth

pytestmark = pytest.mark.data

PEOPLE = ("pedestrian",)
SENSOR = Sensor(reach=25.0, field_of_view=2 * np.pi)
RADIUS = 0.5  # m
CAMERAS = ("CVLab1", "CVLab2", "CVLab3", "CVLab4", "IDIAP1", "IDIAP2", "IDIAP3")  # in the order of ``viewNum``


@pytest.fixture(scope="module")
def scenes(data_root: Path) -> dict[str, Scene]:
    sources = [Wildtrack(with_split(load_card("MTP-WILDTRACK-v0"), split), data_root) for split in ("train", "val")]
    return {name: source.load(name) for source in sources for name in source.names}


def hits(truth: Truth, detections: Detections) -> int:
    """Pairs within half a metre, one to one, as many as possible."""
    count = 0
    for t in range(truth.frames):
        off = truth.box[truth.rows(t), None, :2] - detections.box[None, detections.rows(t), :2]
        near = np.hypot(off[..., 0], off[..., 1]) <= RADIUS
        count += int(near[linear_sum_assignment(near, maximize=True)].sum())
    return count


def test_counts_of_the_dataset(data_root: Path, scenes: dict[str, Scene]) -> None:
    status = describe(load_card("MTP-WILDTRACK-v0"), data_root)
    assert {check.what: check.found for check in status.checks} == {
        "frames": 400,
        "annotations": 9518,
        "people": 313,
        "detections": 966,
    }
    assert status.verified
    assert tuple(scenes) == tuple(SCENES)
    assert sum(scene.frames for scene in scenes.values()) == 400
    assert sum(len(scene.truth.box) for scene in scenes.values()) == 9518
    frame = np.concatenate([40 * i + scene.truth.frame_of_rows for i, scene in enumerate(scenes.values())])
    ids = np.concatenate([scene.truth.object_id for scene in scenes.values()])
    tracks = [np.sort(frame[ids == i]) for i in np.unique(ids)]
    assert len(tracks) == 313
    assert sum(bool((np.diff(track) > 1).any()) for track in tracks) == 27


def test_people_keep_their_ids_across_scenes(scenes: dict[str, Scene]) -> None:
    card = load_card("MTP-WILDTRACK-v0")
    assert {scene.recording for scene in scenes.values()} == {"wildtrack"}
    forecast = [np.unique(find_targets(scenes[name], card).object_id) for name in SPLITS["val"]]
    assert (len(np.unique(np.concatenate(forecast))), len(np.concatenate(forecast))) == (63, 95)


def test_people_walk(scenes: dict[str, Scene]) -> None:
    """Backward differences are known for nine in ten rows; the middle speed is that of people who walk or stand."""
    speed = np.concatenate([np.hypot(*scene.truth.velocity.T) for scene in scenes.values()])
    assert np.isfinite(speed).mean() > 0.9
    assert 0.2 < np.nanmedian(speed) < 1.5
    assert np.nanquantile(speed, 0.99) < 3.5


def test_stored_detections_lie_on_the_truth(scenes: dict[str, Scene]) -> None:
    truth, detections = scenes[STORED].truth, scenes[STORED].detections
    assert (len(truth.box), len(detections.box)) == (952, 966)
    assert hits(truth, detections) / len(truth.box) == pytest.approx(0.950, abs=5e-4)
    assert hits(truth, detections) / len(detections.box) == pytest.approx(0.936, abs=5e-4)
    assert all(scene.detector == "" for name, scene in scenes.items() if name != STORED)


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated pinhole camera, as the published, undistorted images have it."""

    intrinsic: Floats  # [3, 3] pixels
    rotation: Floats  # [3, 3] world to camera (x right, y down, z forward)
    translation: Floats  # [3] m

    def project(self, points: Floats) -> Floats:
        """Pixels ``[..., 2]`` of points ``[..., 3]`` (m, world; the ground is z = 0) in front of the camera."""
        seen = points @ self.rotation.T + self.translation
        pixels: Floats = (seen / seen[..., 2:] @ self.intrinsic.T)[..., :2]
        return pixels


def read_camera(root: Path, name: str) -> Camera:
    inner = root / f"calibrations/intrinsic_zero/intr_{name}.xml"
    outer = root / f"calibrations/extrinsic/extr_{name}.xml"
    rotation = Rotation.from_rotvec(_values(outer, "rvec")).as_matrix()
    return Camera(_values(inner, "camera_matrix").reshape(3, 3), rotation, _values(outer, "tvec") / 100)


def _values(path: Path, key: str) -> Floats:
    """Numbers of one node of OpenCV's XML, which writes them plain or inside of ``data``."""
    node = ElementTree.parse(path).find(key)
    assert node is not None
    data = node.find("data")
    return np.array(((node if data is None else data).text or "").split(), dtype=np.float64)


def read_pixel_boxes(path: Path) -> Floats:
    """Left, top, right, bottom ``[M, 7, 4]`` in pixels of the people of a frame; -1 where nobody is seen."""
    sides = ("xmin", "ymin", "xmax", "ymax")
    people = json.loads(path.read_text())
    views = [sorted(person["views"], key=lambda view: int(view["viewNum"])) for person in people]
    return np.reshape([[[view[side] for side in sides] for view in seen] for seen in views], (-1, len(CAMERAS), 4))


def test_feet_project_to_the_lower_edges_of_the_pixel_boxes(data_root: Path) -> None:
    """Within two pixels: the grid of the annotations is where the library puts it on the ground."""
    root = data_root / "wildtrack"
    paths = sorted((root / ANNOTATIONS).glob("*.json"))[::20]
    place = np.concatenate([read_annotations(path).place for path in paths])
    box = np.concatenate([read_pixel_boxes(path) for path in paths])
    ground = np.column_stack([place, np.zeros(len(place))])
    for view, name in enumerate(CAMERAS):
        left, top, right, bottom = box[:, view].T
        whole = (left > 0) & (right < 1919) & (top > 0) & (bottom < 1079)
        assert whole.sum() >= 30
        feet = read_camera(root, name).project(ground[whole])
        width = (right - left)[whole]
        assert np.abs(feet[:, 1] - bottom[whole]).max() < 2.0
        assert (np.abs(feet[:, 0] - (left + right)[whole] / 2) < width / 2 + 1).mean() > 0.99


def test_the_profile_makes_what_the_last_frames_have(scenes: dict[str, Scene]) -> None:
    """MVDet's detections and simulated ones of the same frames: misses, errors, false positives."""
    scene, profile = scenes[STORED], load_profile("wildtrack_mvdet")
    people, clutter = collect_samples([scene], PEOPLE, SENSOR)["pedestrian"]
    assert (len(people.hit), int(people.hit.sum()), len(clutter.score)) == (952, 911, 55)
    look = visibility_of(scene.truth, scene.ego, SENSOR, scene.visible)
    runs = [simulate(scene.truth, scene.ego, PEOPLE, profile, SENSOR, seed, 0.5, visibility=look) for seed in range(30)]
    made, false = collect_samples([replace(scene, detections=run) for run in runs], PEOPLE, SENSOR)["pedestrian"]
    assert made.hit.mean() == pytest.approx(people.hit.mean(), abs=0.015)
    assert len(false.score) / len(runs) == pytest.approx(len(clutter.score), rel=0.25)
    for column in (RADIAL, TANGENTIAL):
        real, spread = (robust_deviation(one.error[one.hit, column]) for one in (people, made))
        assert spread == pytest.approx(real, rel=0.2)


def test_simulated_detections_are_as_good_as_stored_ones(scenes: dict[str, Scene]) -> None:
    """On the frames without stored detections: recall .950 and precision .936 within two points."""
    profile = load_profile("wildtrack_mvdet")
    found = true = pairs = 0
    for seed, (name, scene) in enumerate(scenes.items()):
        if name == STORED:
            continue
        look = visibility_of(scene.truth, scene.ego, SENSOR, scene.visible)
        seen = simulate(scene.truth, scene.ego, PEOPLE, profile, SENSOR, seed, 0.5, visibility=look)
        assert (seen.score == 1.0).all()
        found, true = found + len(seen.box), true + len(scene.truth.box)
        pairs += hits(scene.truth, seen)
    assert pairs / true == pytest.approx(0.950, abs=0.02)
    assert pairs / found == pytest.approx(0.936, abs=0.02)
