"""Paths along lanes, on roads that are drawn here."""

from itertools import pairwise

import numpy as np
import pytest

from mtp_bench.geometry import rotate
from mtp_bench.prediction.lane_paths import LanePaths, lane_paths
from mtp_bench.types import Floats, Observation

Q, SHIFT = 20, np.array([100.0, -50.0])


def line(*corners: tuple[float, float]) -> Floats:
    """Points [n, 2], 2 m apart, along a polyline."""
    parts = [np.linspace(a, b, round(np.hypot(*np.subtract(b, a)) / 2) + 1) for a, b in pairwise(corners)]
    return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])


def observed(*lanes: tuple[Floats, tuple[int, ...]], spare: int = 2) -> Observation:
    """Lanes of at most 20 points, each with its successors, and ``spare`` rows of padding."""
    rows = len(lanes) + spare
    point, valid = np.zeros((rows, Q, 2), np.float32), np.zeros((rows, Q), np.int8)
    follow = np.full((rows, 4), -1, np.int16)
    for i, (center, after) in enumerate(lanes):
        point[i, : len(center)], valid[i, : len(center)], follow[i, : len(after)] = center, 1, after
    return {"lane_point": point, "lane_valid": valid, "lane_next": follow}


#        2
#        |          rows 0 and 4 lead to a junction, from which roads go left (1, then 2) and on (3); row 5 comes
#   --4--+--0--+    towards row 0, 3.5 m beside it
JUNCTION = observed(
    (line((0, 0), (20, 0)), (1, 3)),
    (line((20, 0), (26, 2), (30, 6), (32, 12)), (2,)),
    (line((32, 12), (32, 40)), ()),
    (line((20, 0), (58, 0)), ()),
    (line((-30, 0), (0, 0)), (0,)),
    (line((20, 3.5), (0, 3.5)), ()),
)


def paths(x: float, y: float, heading: float, metres: float = 60.0, most: int = 4) -> LanePaths:
    """Paths of one object at the junction."""
    return lane_paths(JUNCTION, np.array([[x, y]]), np.array([heading]), most, metres)


def test_a_path_goes_on_along_successors_and_straight_on_behind_the_last_one() -> None:
    found = paths(-5.5, 0.8, 0.1)
    assert found.points.shape == (1, 4, 31, 2)
    assert found.valid.tolist() == [[True, True, False, False]]  # left, and on
    np.testing.assert_allclose(found.chance[0], [0.5, 0.5, 0, 0])
    np.testing.assert_allclose(found.offset[0, :2], 0.8)
    step = np.linalg.norm(np.diff(found.points[0, :2], axis=1), axis=-1)
    np.testing.assert_allclose(step, 2.0, atol=0.12)  # corners are cut
    ends = found.points[0, :2, -1]
    left, on = ends[np.argsort(ends[:, 0])]
    np.testing.assert_allclose(on, [54.5, 0], atol=1e-4)
    assert left[0] == pytest.approx(32)
    beyond = paths(40, -0.5, 0.0)  # the lane ends at 58 m
    np.testing.assert_allclose(beyond.points[0, 0, [0, -1]], [[40, 0], [100, 0]], atol=1e-4)
    assert beyond.offset[0, 0] == pytest.approx(-0.5)


@pytest.mark.parametrize(
    ("x", "y", "heading", "metres", "count"),
    [
        (-5.0, 0.0, 0.0, 20.0, 1),  # the fork is farther away than the object gets
        (-5.0, 0.0, 0.0, 40.0, 2),
        (22.0, 0.3, 0.15, 30.0, 2),  # inside the junction, on both lanes
        (29.0, 5.0, 0.8, 30.0, 1),  # on the turn
        (10.0, 0.0, np.pi, 30.0, 0),  # against the traffic
        (10.0, 3.4, np.pi, 30.0, 1),
        (10.0, 1.8, 0.0, 30.0, 2),  # between two lanes: the one in its direction
        (10.0, 9.0, 0.0, 30.0, 0),
    ],
)  # fmt: skip
def test_paths_are_on_lanes_near_in_the_direction_of_travel(
    x: float, y: float, heading: float, metres: float, count: int
) -> None:
    found = paths(x, y, heading, metres)
    assert found.valid.sum() == count
    assert found.chance.sum() == pytest.approx(float(count > 0))
    assert (np.diff(found.chance[0]) <= 0).all()
    assert not found.points[~found.valid].any()


def test_each_object_has_its_own_distance_and_paths_are_shared() -> None:
    place, heading = np.array([[5.0, 0], [6, 0], [10, 9], [-1, 0.2]]), np.zeros(4)
    metres = np.array([10.0, 40.0, 40.0, 60.0])
    found = lane_paths(JUNCTION, place, heading, 4, metres)
    assert found.valid.sum(axis=1).tolist() == [1, 2, 0, 2]
    for i in range(4):
        alone = lane_paths(JUNCTION, place[i : i + 1], heading[i : i + 1], 4, metres[i])
        np.testing.assert_allclose(found.points[i, :, : alone.points.shape[2]], alone.points[0])
        np.testing.assert_array_equal(found.chance[i], alone.chance[0])


def test_only_the_likeliest_paths_are_kept_and_an_empty_map_has_none() -> None:
    assert paths(-5.5, 0.8, 0.1, most=1).valid.tolist() == [[True]]
    nothing = lane_paths(observed(), np.zeros((2, 2)), np.zeros(2), 3, 20.0)
    assert not nothing.valid.any()
    assert lane_paths(JUNCTION, np.zeros((0, 2)), np.zeros(0), 3, 20.0).points.shape == (0, 3, 11, 2)


def test_paths_move_with_the_scene() -> None:
    moved = JUNCTION | {"lane_point": (rotate(JUNCTION["lane_point"], 0.7) + SHIFT).astype(np.float32)}
    place, heading = np.array([[5.0, 0.4], [23, 1]]), np.array([0.05, 0.3])
    here = lane_paths(JUNCTION, place, heading, 4, 50.0)
    there = lane_paths(moved, rotate(place, 0.7) + SHIFT, heading + 0.7, 4, 50.0)
    np.testing.assert_array_equal(here.valid, there.valid)
    np.testing.assert_allclose(here.offset, there.offset, atol=1e-4)
    expected = np.where(here.valid[..., None, None], rotate(here.points, 0.7) + SHIFT, 0)
    np.testing.assert_allclose(there.points, expected, atol=1e-3)


def test_a_ring_ends_with_the_distance_and_a_piece_that_follows_itself_with_it_too() -> None:
    angle = np.linspace(0, 2 * np.pi, 58)
    ring = 19 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    lanes = observed(*((ring[19 * i : 19 * i + 20], ((i + 1) % 3,)) for i in range(3)))
    found = lane_paths(lanes, np.array([[19.0, 0.5]]), np.array([np.pi / 2]), 3, 200.0)
    assert found.valid.sum() == 1
    np.testing.assert_allclose(np.hypot(*found.points[0, 0].T), 19.0, atol=0.3)
    stub = observed((np.array([[0.0, 0], [0, 0], [0.1, 0]]), (0,)))
    assert lane_paths(stub, np.array([[0.05, 0]]), np.zeros(1), 3, 50.0).valid.sum() == 1
