"""The evaluator of tests/support/kitti_mot.py, on stories of one car."""

from __future__ import annotations

import numpy as np
import pytest

from mtp_bench.sources.kitti.files import Labels
from tests.support.kitti_mot import Annotations, Counts, TrackRows, count_scene, finish

# One car 20 m ahead, one letter per frame:
# truth: X a car, o a hidden one, V a van, . none.   tracks: a, b an id at the car's place, ? one 9 m beside, . none.
STORIES: dict[str, tuple[str, str, tuple[int, int, int, int, int, int]]] = {
    #                                     truth hits misses false switches fragments
    "found": ("XXX", "aaa", (3, 3, 0, 0, 0, 0)),
    "missed at first": ("XXX", ".aa", (3, 2, 1, 0, 0, 0)),
    "never found": ("XX", "..", (2, 0, 2, 0, 0, 0)),
    "beside it": ("X", "?", (1, 0, 1, 1, 0, 0)),
    "switch": ("XXXX", "aabb", (4, 4, 0, 0, 1, 1)),
    "switch in the last frame": ("XXX", "aab", (3, 3, 0, 0, 1, 1)),
    "switch of one frame and back": ("XXXX", "aaba", (4, 4, 0, 0, 2, 2)),
    "lost and found": ("XXXXX", "aa.aa", (5, 4, 1, 0, 0, 1)),
    "another id after a gap is no switch": ("XXXXX", "aa.bb", (5, 4, 1, 0, 0, 1)),
    "found again for one frame only": ("XXXXX", "aa.a.", (5, 3, 2, 0, 0, 0)),
    "hidden objects do not count": ("XoX", "a.a", (2, 2, 0, 0, 0, 0)),
    "found hidden ones neither": ("ooo", "aab", (0, 0, 0, 0, 0, 0)),
    "vans do not count": ("VV", "aa", (0, 0, 0, 0, 0, 0)),
    "nothing there": ("..", "aa", (0, 0, 0, 2, 0, 0)),
}


@pytest.mark.parametrize("case", STORIES)
def test_story(case: str) -> None:
    truth, tracks, expected = STORIES[case]
    counts = Counts()
    count_scene("0", len(truth), story_truth(truth), story_tracks(tracks), "car", counts)
    finish(counts)
    found = counts.truth, counts.hits, counts.misses, counts.false, counts.switches, counts.fragments
    assert found == expected


def test_low_tracks_and_those_in_dont_care_areas_are_excused() -> None:
    truth = story_truth("...")
    # Image boxes are 100 wide and 50 high. The area of frame 1 covers 60 % of it, that of frame 2 40 %.
    for t, right in ((1, 60.0), (2, 40.0)):
        truth.labels.type[t] = "DontCare"
        truth.labels.image_box[t] = 0, 0, right, 50
    counts = Counts()
    count_scene("0", 3, truth, story_tracks("aaa"), "car", counts)
    assert counts.false == 2
    low = story_tracks("aaa")
    low.image_box[:, 3] = 25.0
    counts = Counts()
    count_scene("0", 3, truth, low, "car", counts)
    assert counts.false == 0


def test_the_score_of_a_track_is_the_mean_over_its_rows() -> None:
    rows = story_tracks("aabb")
    rows.score[:] = [1.0, 4.0, 2.0, 2.9]
    assert rows.above(2.5).track_id.tolist() == [0, 0]


PLACE = np.array([20.0, 0.0, 0.8, 0.0, 4.0, 1.8, 1.5])


def story_truth(story: str) -> Annotations:
    n = len(story)
    box = np.tile(PLACE, (n, 1))
    kinds = {"X": "Car", "o": "Car", "V": "Van", ".": "Tram"}
    labels = Labels(
        line=np.arange(n), frame=np.arange(n), object_id=np.zeros(n, dtype=np.int64),
        type=np.array([kinds[c] for c in story], dtype="U16"), truncated=np.zeros(n),
        occluded=np.array([3 if c == "o" else 0 for c in story]), alpha=np.zeros(n), image_box=np.zeros((n, 4)),
        box=box,
    )  # fmt: skip
    return Annotations(labels, box)


def story_tracks(story: str) -> TrackRows:
    frame = np.array([t for t, c in enumerate(story) if c != "."], dtype=np.int64)
    box = np.tile(PLACE, (len(frame), 1))
    box[:, 1] = [9.0 if story[t] == "?" else 0.0 for t in frame]
    ids = np.array([1 if story[t] == "b" else 0 for t in frame])
    image_box = np.tile([0.0, 0.0, 100.0, 50.0], (len(frame), 1))
    return TrackRows(frame, ids, np.zeros(len(frame), dtype=np.int64), box, np.ones(len(frame)), image_box)
