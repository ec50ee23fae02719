"""ETH/UCY source on small files: splits, scenes with holes, broken lines; known counts on the real recordings."""

from pathlib import Path

import numpy as np
import pytest

from mtp_bench.cards import Card, load_card, parse_card, with_split
from mtp_bench.core.errors import DataError
from mtp_bench.scoring import find_targets
from mtp_bench.sources import open_source
from mtp_bench.sources.people import RECORDINGS, SPLITS, TESTS
from tests.support.source_files import assert_one_error, write

FOLDER = "eth_ucy"


def people_card(split: str = "val") -> Card:
    """Two past and one future frames."""
    content = load_card("MTP-ETH-UCY-v0").model_dump(mode="json")
    return parse_card(
        {**content, "task": content["task"] | {"past": 2, "future": 1}, "source": content["source"] | {"split": split}}
    )


def make_root(tmp_path: Path) -> Path:
    """In every recording one person walks along x for three frames, and another in frames 1010 to 1040 without 1020."""
    folder = tmp_path / FOLDER
    for recording in RECORDINGS:
        walking = [f"{t}.0\t1.0\t{0.04 * t}\t1.0" for t in (0, 10, 20)]
        write(folder / f"{recording}.txt", *walking, *[f"{t}\t2\t{0.01 * t - 10}\t5" for t in (1040, 1010, 1030)])
    return folder


def test_scenes_are_cut_from_the_first_frame_and_keep_holes(tmp_path: Path) -> None:
    source = open_source(people_card("univ"), make_root(tmp_path))
    assert source.names == ("students001-00000", "students001-01010", "students003-00000", "students003-01010")
    first, second = (source.load(name) for name in source.names[:2])
    np.testing.assert_allclose(second.time, [40.4, 41.2, 41.6])
    np.testing.assert_allclose(second.truth.box[:, 0], [0.1, 0.3, 0.4])
    assert np.isnan(second.truth.velocity[:2]).all(), "unknown at first and after a hole"
    np.testing.assert_allclose(second.truth.velocity[2], [0.25, 0.0])
    assert (second.recording, second.detector) == ("students001", "wildtrack_mvdet, simulated detections")
    np.testing.assert_array_equal(first.ego, np.tile([0.0, 3.0, 0.0, 0.0], (3, 1)))
    assert not len(find_targets(second, people_card()).object_id), "no past crosses the hole"


def test_what_is_held_out_is_not_trained_on() -> None:
    assert set(SPLITS["val"]).isdisjoint(SPLITS["train"])
    for name, held in TESTS.items():
        assert (SPLITS[name], {*held, *SPLITS[f"train-{name}"]}) == (held, set(RECORDINGS))
        assert len(SPLITS[f"train-{name}"]) == len(RECORDINGS) - len(held)


@pytest.mark.parametrize(
    ("lines", "text"),
    [
        (["5 1 0 0"], "separated by|frame 5, expected a multiple of 10"),
        (["0\t1\t0\t0", "0\t1\t1\t1"], "line 2: a second box of object 1 in frame 0"),
        (None, "no file"),
    ],
)
def test_broken_files(lines: list[str] | None, text: str, tmp_path: Path) -> None:
    root = make_root(tmp_path)
    assert_one_error(root / "students003.txt", lines, text, lambda: open_source(people_card("univ"), root))


def test_no_recording_has_enough_frames(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="eth_ucy has no scene of at least 20 frames"):
        open_source(load_card("MTP-ETH-UCY-v0"), make_root(tmp_path))


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
