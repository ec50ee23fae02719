"""Paths along lanes, and futures on them, on roads that are drawn here."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mtp_bench.agent import Frame
from mtp_bench.core import Floats, Ints, Observation
from mtp_bench.core.geometry import rotate
from mtp_bench.prediction import KinematicPredictor, LanePredictor
from mtp_bench.prediction.lane_paths import LanePaths, lane_paths
from mtp_bench.prediction.lanes import bend_limits
from tests.support.tracking_scenes import kitti_task, tracks_with_past

SHIFT = np.array([100.0, -50.0])


def line(*corners: tuple[float, float]) -> Floats:
    """Points [n, 2], 2 m apart, along a polyline."""
    parts = [np.linspace(a, b, round(np.hypot(*np.subtract(b, a)) / 2) + 1) for a, b in pairwise(corners)]
    return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])


def observed(*lanes: tuple[Floats, tuple[int, ...]]) -> Observation:
    """Lanes of at most 20 points, each with its successors, and two rows of padding."""
    rows = len(lanes) + 2
    point, valid = np.zeros((rows, 20, 2), np.float32), np.zeros((rows, 20), np.int8)
    follow = np.full((rows, 4), -1, np.int16)
    for i, (center, after) in enumerate(lanes):
        point[i, : len(center)], valid[i, : len(center)], follow[i, : len(after)] = center, 1, after
    return {"lane_point": point, "lane_valid": valid, "lane_next": follow}


#           2
#   5       |      rows 4 and 0 lead to a junction, from which roads go left (1, then 2) and on (3); row 5 comes
#   4--0----1--3   back beside them, 3.5 m to their left
JUNCTION = observed(
    (line((0, 0), (20, 0)), (1, 3)),
    (line((20, 0), (26, 2), (30, 6), (32, 12)), (2,)),
    (line((32, 12), (32, 40)), ()),
    (line((20, 0), (58, 0)), ()),
    (line((-30, 0), (0, 0)), (0,)),
    (line((8, 3.5), (-30, 3.5)), ()),
)


def paths(x: float, y: float, heading: float, metres: float = 60.0, most: int = 4) -> LanePaths:
    return lane_paths(JUNCTION, np.array([[x, y]]), np.array([heading]), most, metres)


def test_a_path_goes_on_along_successors_and_straight_on_behind_the_last_one() -> None:
    found = paths(-5.5, 0.8, 0.1)
    assert found.valid.tolist() == [[True, True, False, False]]  # left, and on
    np.testing.assert_allclose([found.chance[0, :2], found.offset[0, :2]], [[0.5, 0.5], [0.8, 0.8]], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(np.diff(found.points[0, :2], axis=1), axis=-1), 2.0, atol=0.12)
    left, on = found.points[0, np.argsort(found.points[0, :2, -1, 0]), -1]
    np.testing.assert_allclose([on[0], on[1], left[0]], [54.5, 0, 32], atol=1e-4)
    beyond = paths(40, -0.5, 0.0)  # the lane ends at 58 m
    np.testing.assert_allclose(beyond.points[0, 0, [0, -1]], [[40, 0], [100, 0]], atol=1e-4)
    assert (beyond.offset[0, 0], paths(-5.5, 0.8, 0.1, most=1).valid.tolist()) == (pytest.approx(-0.5), [[True]])


@pytest.mark.parametrize(
    ("x", "y", "heading", "metres", "count"),
    [
        (-5.0, 0.0, 0.0, 20.0, 1),  # the fork is farther away than the object gets
        (-5.0, 0.0, 0.0, 40.0, 2),
        (22.0, 0.3, 0.15, 30.0, 2),  # inside the junction, on both lanes
        (29.0, 5.0, 0.8, 30.0, 1),  # on the turn
        (-5.0, 0.0, np.pi, 30.0, 0),  # against the traffic
        (-5.0, 3.4, np.pi, 30.0, 1),
        (-5.0, 1.8, 0.0, 20.0, 1),  # between two lanes: the one in its direction
        (-5.0, 9.0, 0.0, 30.0, 0),
    ],
)
def test_paths_are_on_near_lanes_along_travel(x: float, y: float, heading: float, metres: float, count: int) -> None:
    found = paths(x, y, heading, metres)
    assert (found.valid.sum(), found.chance.sum()) == (count, pytest.approx(float(count > 0)))
    assert not found.points[~found.valid].any()


def test_paths_are_shared_and_move_with_the_scene() -> None:
    place, heading = np.array([[5.0, 0], [6, 0.4], [10, 9], [-1, 0.2]]), np.array([0.0, 0.05, 0, 0.3])
    metres = np.array([10.0, 40.0, 40.0, 60.0])
    moved = JUNCTION | {"lane_point": (rotate(JUNCTION["lane_point"], 0.7) + SHIFT).astype(np.float32)}
    found = lane_paths(moved, rotate(place, 0.7) + SHIFT, heading + 0.7, 4, metres)
    assert found.valid.sum(axis=1).tolist() == [1, 2, 0, 2]
    for i in range(4):
        alone = paths(place[i, 0], place[i, 1], heading[i], metres[i])
        expected = np.where(alone.valid[0, :, None, None], rotate(alone.points[0], 0.7) + SHIFT, 0)
        np.testing.assert_allclose(found.points[i, :, : alone.points.shape[2]], expected, atol=1e-3)
        np.testing.assert_allclose(found.offset[i], alone.offset[0], atol=1e-4)
    assert not lane_paths(observed(), place, heading, 3, 20.0).valid.any()
    assert lane_paths(JUNCTION, np.zeros((0, 2)), np.zeros(0), 3, 20.0).points.shape == (0, 3, 11, 2)


def test_a_lane_that_follows_itself_and_many_branches_end() -> None:
    stub = observed((np.array([[0.0, 0], [0, 0], [0.1, 0]]), (0,)))
    assert lane_paths(stub, np.array([[0.05, 0]]), np.zeros(1), 3, 50.0).valid.sum() == 1
    tree = observed(*((line((6 * d, 0), (6 * d + 6, 3 * b)), (2 * d + 2, 2 * d + 3)) for d in range(8) for b in (0, 1)))
    found = lane_paths(tree, np.array([[1.0, 0]]), np.zeros(1), 40, 60.0)
    assert found.valid.sum() > 4
    assert found.chance.sum() == pytest.approx(1)


TASK = kitti_task(dt=0.5, past=4, future=12, k=10, samples=10, lanes=8, lane_points=20)


def futures(x: float, y: float, speed: float, class_id: int = 0, hypotheses: int = 1, lanes: int = 8) -> Floats:
    """Samples [H, k, T, 2] of an object that came along x; checks the free ones against `KinematicPredictor`'s."""
    past = np.tile([x, y, 0.8, 0, 4, 2, 1.6], (1, 4, 1))
    past[0, :, 0] += speed * 0.5 * np.arange(-3, 1)
    tracks = tracks_with_past(past, class_id=np.array([class_id]))
    tracks = replace(tracks, member=np.ones((hypotheses, 1), dtype=bool), log_weight=np.zeros(hypotheses))
    results = []
    for predictor in (LanePredictor(), KinematicPredictor()):
        predictor.reset(replace(TASK, lanes=lanes))
        results.append(predictor.predict(Frame(3, tracks, (JUNCTION,))).samples)
    np.testing.assert_array_equal(results[0][:, 6:], results[1][:, 6:])
    return np.where((results[0] == results[1]).all(axis=(2, 3), keepdims=True), np.nan, results[0])


def on_lanes(samples: Floats) -> Ints:
    """Number of samples [H] along lanes."""
    return np.asarray(np.isfinite(samples[:, :, 0, 0]).sum(axis=1))


def test_six_of_ten_samples_follow_lanes_with_several_speeds() -> None:
    ends = futures(14, 0.6, 8.0, hypotheses=3)[:, :6, -1]
    left = ends[..., 1] > 1
    assert left.sum(axis=1).tolist() == [3, 3, 3]
    assert (ends[left][:, 0] < 33).all()
    ahead = np.sort(ends[~left].reshape(3, 3, 2)[..., 0], axis=1)
    assert (np.diff(ahead, axis=1) > 5).all(), "slow, even and fast"
    assert len(np.unique(ahead.round(3))) == 9, "hypotheses have other speeds"
    assert (np.abs(ends[~left][:, 1]) < 0.3).all(), "the offset fades"
    slower = futures(-5, 0.0, 12.0)[0, :6]
    steps = np.linalg.norm(np.diff(slower[slower[:, -1, 1] > 1], axis=1), axis=2)
    assert (steps.min(axis=1) < 3.5).all(), "12 m/s is too fast for the bend"


def test_a_straight_road_has_no_bend_in_any_direction() -> None:
    straight = np.stack([np.arange(0.0, 30.0, 2.0), np.zeros(15)], axis=1)
    ways = np.array([[rotate(straight, turn)] for turn in (0.5, 2.0, 3.5, 5.0)])
    limit = np.empty(ways.shape[:3])
    bend_limits(ways, np.ones((4, 1)), limit)
    assert limit.min() > 100.0


def test_who_has_no_lane_is_free() -> None:
    assert on_lanes(futures(-5, 0, 8.0)) == on_lanes(futures(-5, 0, 0.0)) == 6
    others = futures(-5, 0, 1.5, class_id=1), futures(-5, 20, 8.0), futures(-5, 0, -8.0), futures(-5, 0, 8.0, lanes=0)
    assert [on_lanes(other) for other in others] == [0] * 4
