"""3DMOT2015 source on a folder of a few lines: boxes, velocities, scenes, cards that do not fit."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import Card, load_card, parse_card
from mtp_bench.core import Scene
from mtp_bench.core.errors import CardError
from mtp_bench.sources import open_source
from tests.support.source_files import write

SEQUENCE = "TUD-Stadtmitte"
TEN = 10  # frames of the small sequence
RATE = 5.0
FOLDER = f"train/{SEQUENCE}"
GT, DET, INI = f"{FOLDER}/gt/gt.txt", f"{FOLDER}/det/det.txt", f"{FOLDER}/seqinfo.ini"


def mot3d_card(task: dict[str, Any] | None = None, detector: dict[str, Any] | None = None, **source: Any) -> Card:
    """Two past and one future frames, scenes of four frames, the first of them for training."""
    content = load_card("MTP-PETS-v0").model_dump(mode="json")
    content["source"] = {"name": "mot3d", "sequence": SEQUENCE, "scene_frames": 4, "train_scenes": 1} | source
    content["task"] |= {"rate": RATE / content["source"].get("stride", 1), "past": 2, "future": 1} | (task or {})
    content["detector"] = detector
    return parse_card(content)


def row(frame: int, object_id: int, x: float, y: float, confidence: float = 1) -> str:
    return f"{frame},{object_id},10,20,30,40,{confidence},{x},{y},0"


def seqinfo(rate: str = "5", length: str = f"{TEN}") -> list[str]:
    return ["[Sequence]", f"name={SEQUENCE}", f"frameRate={rate}", f"seqLength={length}"]


def make_root(tmp_path: Path) -> Path:
    """Person 7 walks along x, 0.2 m per frame, in all ten frames; person 3 stands from frame 6 on."""
    folder = tmp_path / "mot3d2015"
    walking = [row(t, 7, 0.2 * t, 1.0) for t in range(1, TEN + 1)]
    write(folder / GT, *walking, *[row(t, 3, 4.0, -5.6) for t in range(6, TEN + 1)])
    write(folder / DET, *[row(t, -1, 0.2 * t + 0.1, 1.1, 30 + t) for t in range(1, TEN + 1)])
    write(folder / INI, *seqinfo())
    return folder


def load(root: Path, name: str, **source: Any) -> Scene:
    return open_source(mot3d_card(**source), root).load(f"{SEQUENCE}-{name}")


def test_a_scene(root: Path) -> None:
    """Frames 5 to 8: person 7 at 1.0, 1.2, 1.4, 1.6 m, person 3 in the last three."""
    scene = load(root, "0005")
    np.testing.assert_allclose(scene.time, [0.8, 1.0, 1.2, 1.4])
    np.testing.assert_array_equal(scene.truth.start, [0, 1, 3, 5, 7])
    assert scene.truth.object_id.tolist() == [7, 7, 3, 7, 3, 7, 3]
    np.testing.assert_allclose(scene.truth.box[scene.truth.object_id == 7, 0], [1.0, 1.2, 1.4, 1.6])
    np.testing.assert_array_equal(scene.truth.box[2], [4.0, -5.6, 0.875, 0, 0.6, 0.6, 1.75])
    assert scene.truth.eligible.all()
    assert (bool(scene.truth.neutral.any()), scene.truth_complete, scene.listed_targets) == (False, True, False)
    np.testing.assert_array_equal(scene.detections.start, range(5))
    np.testing.assert_allclose(scene.detections.box[0], [1.1, 1.1, 0.875, 0, 0.6, 0.6, 1.75])
    np.testing.assert_array_equal(scene.detections.score, [35, 36, 37, 38])
    assert np.isnan(scene.detections.velocity).all()
    assert (scene.detector, scene.simulated, scene.skipped) == ("acf, stored detections", False, {})
    assert set(scene.truth.class_id.tolist()) == set(scene.detections.class_id.tolist()) == {0}


def test_the_reference_point_is_the_same_in_all_scenes(root: Path) -> None:
    """x from 0.2 to 4.0, y from -5.6 to 1.0: the middle is (2.1, -2.3)."""
    for split in ("train", "val"):
        source = open_source(mot3d_card(split=split), root)
        for name in source.names:
            np.testing.assert_array_equal(source.load(name).ego, np.tile([2.0, -2.0, 0, 0], (4, 1)))


def test_rows_that_are_not_to_be_evaluated_are_neutral(root: Path) -> None:
    write(root / GT, row(5, 7, 0, 0), row(5, 8, 1, 0, confidence=0), row(6, 7, 0, 0, confidence=0))
    truth = load(root, "0005").truth
    assert (truth.neutral.tolist(), truth.eligible.tolist()) == ([False, True, True], [True, False, False])


@pytest.mark.parametrize(("source", "train", "val"), [
    pytest.param({}, [1], [5], id="two frames are left: too few for a target"),
    pytest.param({"scene_frames": 3}, [1], [4, 7], id="one frame is left"),
    pytest.param({"scene_frames": 7}, [1], [8], id="three frames are left: a scene"),
    pytest.param({"scene_frames": 5, "train_scenes": 0}, None, [1, 6], id="nothing to train on"),
    pytest.param({"scene_frames": 5, "train_scenes": 2}, [1, 6], None, id="nothing but training"),
    pytest.param({"scene_frames": 99, "train_scenes": 9}, [1], None, id="all in one"),
    pytest.param({"stride": 2, "scene_frames": 3}, [1], None, id="two kept frames are left"),
    pytest.param({"stride": 2, "scene_frames": 5, "train_scenes": 0}, None, [1], id="every second frame"),
    pytest.param({"stride": 3, "scene_frames": 3, "train_scenes": 1}, [1], None, id="one kept frame is left"),
])  # fmt: skip
def test_scenes_of_the_splits(root: Path, source: dict[str, Any], train: list[int] | None, val: Any) -> None:
    for split, firsts in (("train", train), ("val", val)):
        if firsts is None:
            with pytest.raises(CardError, match=rf"split '{split}' has no scenes: {SEQUENCE} has \d of \d+ frames, "):
                open_source(mot3d_card(split=split, **source), root)
        else:
            names = open_source(mot3d_card(split=split, **source), root).names
            assert names == tuple(f"{SEQUENCE}-{first:04d}" for first in firsts)


def test_stride_keeps_every_nth_frame(root: Path) -> None:
    scene = load(root, "0001", stride=2, scene_frames=5, train_scenes=0)
    np.testing.assert_allclose(scene.time, [0, 0.4, 0.8, 1.2, 1.6])
    np.testing.assert_array_equal(scene.truth.start, [0, 1, 2, 3, 5, 7])
    walking = scene.truth.object_id == 7
    np.testing.assert_allclose(scene.truth.box[walking, 0], [0.2, 0.6, 1.0, 1.4, 1.8])
    np.testing.assert_allclose(scene.truth.velocity[walking][1:, 0], 0.2 * RATE)
    np.testing.assert_array_equal(scene.detections.score, [31, 33, 35, 37, 39])
