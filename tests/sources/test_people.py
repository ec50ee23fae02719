"""Sources of people on the ground plane (ETH/UCY, 3DMOT2015, WILDTRACK): splits, holes, what is stored."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import load_card, with_split
from mtp_bench.core import Detections
from mtp_bench.core.errors import CardError, DataError
from mtp_bench.scoring import find_targets
from mtp_bench.sources import open_source
from mtp_bench.sources.motion import as_places
from mtp_bench.sources.people import FRAME_STEP, RATE_HZ, RECORDINGS, SPLITS, TESTS, read_recording
from mtp_bench.sources.wildtrack import SCENES, STORED, Wildtrack
from tests.support.drawn_recordings import small_recording
from tests.support.layouts import MOT3D, WILDTRACK, mot3d_card, people_card, person
from tests.support.source_files import with_source, write


# ---- ETH/UCY
def make_root(tmp_path: Path) -> Path:
    """In every recording one person walks along x for three frames, and another in frames 1010 to 1040 without 1020."""
    folder = tmp_path / "eth_ucy"
    for recording in RECORDINGS:
        walking = [f"{t}.0\t1.0\t{0.04 * t}\t1.0" for t in (0, 10, 20)]
        write(folder / f"{recording}.txt", *walking, *[f"{t}\t2\t{0.01 * t - 10}\t5" for t in (1040, 1010, 1030)])
    return folder


def test_scenes_are_cut_from_the_first_frame_and_keep_holes(root: Path) -> None:
    source = open_source(people_card("univ"), root)
    assert source.names == ("students001-00000", "students001-01010", "students003-00000", "students003-01010")
    second = source.load(source.names[1])
    np.testing.assert_allclose(second.time, [40.4, 41.2, 41.6])
    np.testing.assert_allclose(second.truth.box[:, 0], [0.1, 0.3, 0.4])
    assert np.isnan(second.truth.velocity[:2]).all(), "unknown at first and after a hole"
    np.testing.assert_allclose(second.truth.velocity[2], [0.25, 0.0])
    assert (second.recording, second.detector) == ("students001", "wildtrack_mvdet, simulated detections")
    assert not len(find_targets(second, people_card()).object_id), "no past crosses the hole"


def test_what_is_held_out_is_not_trained_on() -> None:
    assert set(SPLITS["val"]).isdisjoint(SPLITS["train"])
    for name, held in TESTS.items():
        assert (SPLITS[name], {*held, *SPLITS[f"train-{name}"]}) == (held, set(RECORDINGS))
        assert len(SPLITS[f"train-{name}"]) == len(RECORDINGS) - len(held)


def test_recordings_that_are_missing_or_too_short(root: Path) -> None:
    with pytest.raises(DataError, match="eth_ucy has no scene of at least 20 frames"):
        open_source(load_card("MTP-ETH-UCY-v0"), root)
    (root / "students003.txt").unlink()
    with pytest.raises(DataError, match=r"no file .*students003\.txt"):
        open_source(people_card("univ"), root)


@pytest.mark.data
def test_only_the_people_of_biwi_eth_walk_too_fast(data_root: Path) -> None:
    """As docs/data/faults.md states it."""
    median: dict[str, float] = {}
    for recording in RECORDINGS:
        frame, person, place = read_recording(data_root / "eth_ucy" / f"{recording}.txt")
        order = np.lexsort((frame, person))
        walked = np.linalg.norm(np.diff(place[order], axis=0), axis=1)
        is_step = (np.diff(person[order]) == 0) & (np.diff(frame[order]) == FRAME_STEP)
        median[recording] = float(np.median(walked[is_step])) * RATE_HZ
    assert median.pop("biwi_eth") == pytest.approx(2.45, abs=0.005)
    assert 0.5 < min(median.values()) < max(median.values()) < 1.5


@pytest.mark.data
def test_counts_of_the_recordings(data_root: Path) -> None:
    card = load_card("MTP-ETH-UCY-v0")
    counts = {}
    for split in ("train", *TESTS):
        source = open_source(with_split(card, split), data_root)
        scenes = [source.load(name) for name in source.names]
        targets = [find_targets(scene, card) for scene in scenes]
        counts[split] = len(scenes), sum(len(s.truth.box) for s in scenes), sum(len(t.object_id) for t in targets)
        assert max(np.diff(scene.detections.start).max() for scene in scenes) <= card.size.detections
    assert counts == {
        "train": (16, 7752, 2581),
        "eth": (12, 5492, 311),
        "hotel": (17, 6453, 1078),
        "univ": (11, 39766, 20061),
        "zara1": (9, 5149, 2037),
        "zara2": (11, 9722, 4874),
    }


# ---- 3DMOT2015: a sequence of ten frames
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
def test_scenes_of_the_splits(tmp_path: Path, source: dict[str, Any], train: list[int] | None, val: Any) -> None:
    root, walk = MOT3D.write(tmp_path, small_recording(MOT3D, 10)), 5 - 0.5 * np.arange(10)
    for split, firsts in (("train", train), ("val", val)):
        card = mot3d_card(split=split, **source)
        if firsts is None:
            with pytest.raises(CardError, match=rf"split '{split}' has no scenes: TUD-\w* has \d of \d+ frames, "):
                open_source(card, root)
            continue
        scenes = [open_source(card, root).load(f"TUD-Stadtmitte-{first:04d}") for first in firsts]
        assert open_source(card, root).names == tuple(scene.name for scene in scenes)
        for first, scene in zip(firsts, scenes, strict=True):
            kept = first - 1 + card.source.stride * np.arange(scene.frames)  # type: ignore[attr-defined]
            np.testing.assert_allclose(scene.time, kept / 5)
            np.testing.assert_allclose(scene.truth.box[:, 0], walk[kept])
            np.testing.assert_array_equal(scene.ego, np.tile([3, 4, 0, 0], (scene.frames, 1)))  # of the whole sequence


# ---- WILDTRACK
@pytest.mark.parametrize(
    ("split", "first"), [("train", (0, 200, 400, 600, 800, 1000)), ("val", (1200, 1400, 1600, 1800)), ("test", (1800,))]
)
def test_scenes_of_40_frames(tmp_path: Path, split: str, first: tuple[int, ...]) -> None:
    root = WILDTRACK.write(tmp_path, small_recording(WILDTRACK, 1))
    for number in range(0, 1800, 5):
        write_people(root, number)
    source = Wildtrack(with_source("MTP-WILDTRACK-v0", split=split), root)
    assert source.names == tuple(f"wildtrack-{number:04d}" for number in first)
    for name in source.names:
        write_people(root, SCENES[name] + 195, person(3, 0))  # the last frame of the scene, and only of this one
        scene = source.load(name)
        assert scene.truth.start.tolist()[-2:] == [name == STORED, 1 + (name == STORED)]
        assert scene.visible is not None
        assert (scene.visible == 1).all()
        if name != STORED:
            assert (scene.detector, scene.simulated, len(scene.detections.box)) == ("", False, 0)
            assert len(scene.detections.start) == 41
    bare = Wildtrack(with_source("MTP-WILDTRACK-v0", split="val", detector=None), root).load(STORED)
    assert (bare.detector, len(bare.detections.box)) == ("", 0)


def write_people(root: Path, number: int, *people: dict[str, Any]) -> None:
    write(root / f"annotations_positions/{number:08d}.json", json.dumps(people))


def test_as_places_keeps_places_and_scores_alone() -> None:
    """Boxes turned, sized and lifted as a simulation may do it; the second row differs in its place only."""
    box = np.array([[1.0, 2.0, 9.0, 1.5, 3.0, 2.0, 1.0], [-4.0, 30.0, 0.875, 0.0, 0.6, 0.6, 1.75]])
    start, class_id, score = np.array([0, 1, 2]), np.array([0, 0]), np.array([0.3, 0.4])
    places = as_places(Detections(start, box, np.zeros((2, 2)), class_id, score))
    np.testing.assert_array_equal(places.box, [[1, 2, 0.875, 0, 0.6, 0.6, 1.75], box[1]])
    assert (places.start is start, places.score is score) == (True, True)
