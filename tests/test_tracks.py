"""Objects that hypotheses agree on: one named case per row, and what holds for whatever a tracker says."""

import numpy as np
import pytest

from mtp_bench.core import Floats
from mtp_bench.core.tracks import Tracks, group
from mtp_bench.tracking import HypothesisTracker
from tests.support.tracking_scenes import at_once, random_frames, run


def make_tracks(leaves: list[tuple[int, int, str]], weights: list[float] | Floats) -> Tracks:
    """Leaves as (id, detection or -1, numbers of the hypotheses that hold it); box x is the number of the leaf."""
    n = len(leaves)
    box = np.zeros((n, 7))
    box[:, 0] = np.arange(n)
    member = np.zeros((len(weights), n), dtype=bool)
    for leaf, (_, _, held) in enumerate(leaves):
        member[[int(h) for h in held], leaf] = True
    return Tracks(
        track_id=np.array([i for i, _, _ in leaves], dtype=np.int64), box=box, class_id=np.arange(n) % 3,
        score=np.arange(n, dtype=np.float64), detection=np.array([d for _, d, _ in leaves], dtype=np.int64),
        past=np.zeros((n, 2, 7)), past_valid=np.ones((n, 2), dtype=bool), member=member, log_weight=np.log(weights),
    )  # fmt: skip


HALVES, THREE = [0.6, 0.4], [0.5, 0.3, 0.2]

# name: leaves (id, detection, hypotheses), weights, most, min_mass -> leaf of each object in each hypothesis, mass
CASES: dict[str, tuple[list[tuple[int, int, str]], list[float], int, float, list[list[int]], list[float]]] = {
    "no tracks": ([], HALVES, 9, 0.0, [], []),
    "one hypothesis, one track": ([(7, 0, "0")], [1.0], 9, 0.0, [[0]], [1.0]),
    "a shared leaf": ([(7, 0, "01")], HALVES, 9, 0.0, [[0, 0]], [1.0]),
    "the same detection by different identities": ([(7, 0, "0"), (8, 0, "1")], HALVES, 9, 0.0, [[0, 1]], [1.0]),
    "a swap": ([(7, 0, "0"), (8, 1, "0"), (7, 1, "1"), (8, 0, "1")], HALVES, 9, 0.0, [[0, 3], [1, 2]], [1.0, 1.0]),
    "held by the lighter hypothesis only": ([(7, 0, "01"), (8, 1, "1")], HALVES, 9, 0.0, [[0, 0], [-1, 1]], [1.0, 0.4]),
    "likelier objects first": ([(7, 0, "1"), (8, 1, "0")], HALVES, 9, 0.0, [[1, -1], [-1, 0]], [0.6, 0.4]),
    "at most two objects": ([(7, 0, "1"), (8, 1, "0"), (9, 2, "01")], HALVES, 2, 0.0, [[2, 2], [1, -1]], [1.0, 0.6]),
    "no room for objects": ([(7, 0, "0")], [1.0], 0, 0.0, [], []),
    "min_mass": ([(7, 0, "1"), (8, 1, "0")], HALVES, 9, 0.5, [[1, -1]], [0.6]),
    "min_mass is inclusive": ([(7, 0, "1"), (8, 1, "0")], HALVES, 9, 0.4, [[1, -1], [-1, 0]], [0.6, 0.4]),
    "min_mass of 1: held by all, whatever rounding says": ([(7, 0, "012"), (8, 1, "01")], [1 / 3] * 3, 9, 1.0,
                                                           [[0, 0, 0]], [1.0]),
    "min_mass beyond all": ([(7, 0, "1"), (8, 1, "0")], HALVES, 9, 0.7, [], []),
    "a leaf that no hypothesis holds": ([(7, 0, ""), (8, 1, "0")], [1.0], 9, 0.0, [[1]], [1.0]),
    # Tracks without a detection in this frame:
    "coasting everywhere": ([(7, -1, "01")], HALVES, 9, 0.0, [[0, 0]], [1.0]),
    "coasting in two states": ([(7, -1, "0"), (7, -1, "1")], HALVES, 9, 0.0, [[0, 1]], [1.0]),
    "two that coast": ([(7, -1, "0"), (8, -1, "01")], HALVES, 9, 0.0, [[1, 1], [0, -1]], [1.0, 0.6]),
    "coasting here, seen there": ([(7, -1, "0"), (7, 0, "1")], HALVES, 9, 0.0, [[0, 1]], [1.0]),
    "seen here, coasting there": ([(7, 0, "0"), (7, -1, "1")], HALVES, 9, 0.0, [[0, 1]], [1.0]),
    "its detection went to another: an object of its own": (
        [(7, 0, "0"), (7, -1, "1"), (8, 0, "1")], HALVES, 9, 0.0, [[0, 2], [-1, 1]], [1.0, 0.4]),
    "the best hypothesis keeps what coasts in it": (
        [(7, -1, "0"), (8, 0, "0"), (7, 0, "1"), (8, -1, "1")], HALVES, 9, 0.0,
        [[1, 2], [0, -1], [-1, 3]], [1.0, 0.6, 0.4]),
    "seen in two places: the heavier hypothesis says which object": (
        [(7, 0, "0"), (7, 1, "1"), (7, -1, "2")], THREE, 9, 0.0, [[0, -1, 2], [-1, 1, -1]], [0.7, 0.3]),
    "two that coast where one detection is free: the first by id": (
        [(7, 0, "0"), (8, 0, "1"), (7, -1, "2"), (8, -1, "2")], THREE, 9, 0.0, [[0, 1, 2], [-1, -1, 3]], [1.0, 0.2]),
    "one leaf, two objects": (
        [(7, -1, "01"), (7, 0, "2"), (8, 0, "1")], THREE, 9, 0.0, [[0, 2, 1], [-1, 0, -1]], [1.0, 0.3]),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_group(case: str) -> None:
    leaves, weights, most, min_mass, leaf, mass = CASES[case]
    objects = group(make_tracks(leaves, weights), most, min_mass)
    np.testing.assert_array_equal(objects.leaf, np.reshape(leaf, (len(mass), len(weights))))
    np.testing.assert_allclose(np.exp(objects.log_mass), mass)
    # The box is that in the heaviest hypothesis that holds the object; hypotheses come heaviest first.
    first = [next(i for i in row if i >= 0) for row in leaf]
    assert (objects.box[:, 0].tolist(), objects.class_id.tolist()) == (first, [i % 3 for i in first])


def test_very_unlikely_objects_keep_a_finite_mass() -> None:
    tracks = make_tracks([(7, 0, "0"), (8, 1, "1"), (9, 2, "2")], np.exp([0.0, -900.0, -1000.0]) + 1e-300)
    tracks.log_weight[:] = [0.0, -900.0, -1000.0]
    assert group(tracks, 9).log_mass.tolist() == [0.0, -900.0, -1000.0]
    assert group(tracks, 2).leaf.tolist() == [[0, -1, -1], [-1, 1, -1]]


@pytest.mark.parametrize("seed", range(5))
def test_every_track_of_every_hypothesis_is_in_one_object(seed: int) -> None:
    frames = random_frames(np.random.default_rng(seed), 25, objects=12, area=6.0)
    several = 0
    for tracks in run(HypothesisTracker(12, at_once()), frames):
        objects = group(tracks, 10_000)
        for hypothesis, held in enumerate(tracks.member):
            leaf = objects.leaf[:, hypothesis]
            np.testing.assert_array_equal(np.sort(leaf[leaf >= 0]), np.flatnonzero(held))
        for row in objects.leaf:
            taken = np.unique(tracks.detection[row[row >= 0]])
            assert len(taken[taken >= 0]) <= 1
            several += len(np.unique(row[row >= 0])) > 1
        assert (np.diff(objects.log_mass) <= 0).all()
        np.testing.assert_allclose(np.exp(objects.log_mass), (objects.leaf >= 0) @ np.exp(tracks.log_weight))
        # A single hypothesis has its own tracks as objects; more of them only add to these.
        assert set(np.flatnonzero(tracks.member[0])) <= set(objects.leaf[:, 0])
    assert several > 20
