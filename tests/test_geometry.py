"""Overlap and distance of boxes, against shapely and by hand."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from mtp_bench.core import Floats
from mtp_bench.core.geometry import (
    bev_corners,
    bev_intersection_area,
    boxes_meet,
    center_distance,
    iou_3d,
    sliding_contact,
    transform_boxes,
    wrap_angle,
)

MEASURES: list[Callable[[Floats, Floats], Floats]] = [bev_intersection_area, iou_3d, center_distance]
QUARTER = np.pi / 2

multipoints: Any = shapely.multipoints  # its types know no arrays of points


def box(x: float = 0, y: float = 0, z: float = 0, yaw: float = 0, l: float = 4, w: float = 2, h: float = 1) -> Floats:
    return np.array([x, y, z, yaw, l, w, h], dtype=np.float64)


def random_boxes(rng: np.random.Generator, rows: int, spread: float = 3.0) -> Floats:
    low = [-spread, -spread, -1, -7, 0.2, 0.2, 0.3]
    return rng.uniform(low, [spread, spread, 1, 7, 6, 3, 3], size=(rows, 7))


def oracle_areas(a: Floats, b: Floats) -> NDArray[np.float64]:
    first, second = (shapely.convex_hull(multipoints(shapely.points(bev_corners(one)))) for one in (a, b))
    return np.asarray(shapely.area(shapely.intersection(first, second)))


def test_random_pairs_agree_with_shapely() -> None:
    rng = np.random.default_rng(0)
    a, b = random_boxes(rng, 4000), random_boxes(rng, 4000)
    common = oracle_areas(a, b)
    assert 0.2 < np.mean(common > 0) < 0.8  # both kinds of pairs are tested
    np.testing.assert_allclose(bev_intersection_area(a, b), common, atol=1e-7)


DEGENERATE = {  # two boxes and the area they share
    "identical": (box(), box(), 8.0),
    "identical, turned": (box(yaw=0.7), box(yaw=0.7), 8.0),
    "same box a quarter turn on": (box(), box(yaw=QUARTER, l=2, w=4), 8.0),
    "same box facing back": (box(yaw=0.3), box(yaw=0.3 + np.pi), 8.0),
    "crossing": (box(), box(yaw=QUARTER), 4.0),
    "diamond in square": (box(l=2, w=2), box(yaw=QUARTER / 2, l=2**0.5, w=2**0.5), 2.0),
    "inside": (box(), box(x=0.3, l=1, w=1), 1.0),
    "inside, one edge shared": (box(), box(x=1.5, l=1, w=1), 1.0),
    "inside, corner shared": (box(), box(x=1.5, y=0.5, l=1, w=1), 1.0),
    "edges touch from outside": (box(), box(x=4), 0.0),
    "parts of edges touch": (box(), box(x=4, y=1), 0.0),
    "corners touch": (box(), box(x=4, y=2), 0.0),
    "corner touches edge": (box(l=2, w=2), box(x=1 + 2**0.5, yaw=QUARTER / 2, l=2, w=2), 0.0),
    "shifted along": (box(), box(x=1), 6.0),
    "shifted across": (box(yaw=1.1), box(yaw=1.1, x=-np.sin(1.1), y=np.cos(1.1)), 4.0),
    "far": (box(), box(x=1e4, y=-1e4), 0.0),
    "no width": (box(w=0), box(yaw=0.4), 0.0),
    "no length": (box(), box(l=0), 0.0),
    "an edge without width": (box(), box(y=1, w=0), 0.0),
    "a point inside": (box(), box(l=0, w=0), 0.0),
    "two points": (box(l=0, w=0), box(x=1, l=0, w=0), 0.0),
    "two crossing segments": (box(w=0), box(w=0, yaw=0.5), 0.0),
    "collinear segments": (box(w=0), box(w=0, x=5), 0.0),
    "long and thin": (box(l=1000, w=1e-3), box(l=1000, w=1e-3, yaw=1e-3), 1e-6 / np.sin(1e-3)),
    "far from the origin": (box(x=5e5, y=5e6), box(x=5e5 + 1, y=5e6), 6.0),
}


@pytest.mark.parametrize("case", DEGENERATE)
@pytest.mark.parametrize("turn", [0.0, 0.1, 1.0, QUARTER, 3.0, -2.2])
def test_degenerate_pairs(case: str, turn: float) -> None:
    *pair, common = DEGENERATE[case]
    a, b = (transform_boxes(one[None], turn, [0.7, -0.2, 0]) for one in pair)
    for first, second in ((a, b), (b, a)):
        np.testing.assert_allclose(bev_intersection_area(first, second), common, atol=2e-7)


@pytest.mark.parametrize("exponent", range(-17, 0))
def test_nearly_parallel_edges(exponent: int) -> None:
    """A box against itself turned and shifted by next to nothing: the boundaries cross at tiny angles."""
    rng = np.random.default_rng(-exponent)
    a = random_boxes(rng, 200)
    b = a + rng.normal(0, 10.0**exponent, a.shape) * [1, 1, 0, 1, 1, 1, 0]
    b[:, 3] += rng.integers(-2, 3, len(a)) * np.pi
    b[:, 4:6] = np.abs(b[:, 4:6])
    np.testing.assert_allclose(bev_intersection_area(a, b), oracle_areas(a, b), atol=1e-6)


@pytest.mark.parametrize(("a", "b", "volume"), [
    pytest.param(box(), box(), 1.0, id="identical"), pytest.param(box(), box(x=2), 1 / 3, id="half a length on"),
    pytest.param(box(), box(x=4), 0.0, id="touching"),
    pytest.param(box(l=1, w=1), box(x=2, z=1, l=1, w=1), 0.0, id="a gap, and one above the other"),
    pytest.param(box(), box(z=0.5), 1 / 3, id="half a height up"),
    pytest.param(box(), box(z=2), 0.0, id="above, not touching"),
    pytest.param(box(), box(yaw=QUARTER), 1 / 3, id="cross"),
    pytest.param(box(l=0, w=0, h=0), box(l=0, w=0, h=0), 0.0, id="both empty"),
])  # fmt: skip
def test_values_by_hand(a: Floats, b: Floats, volume: float) -> None:
    np.testing.assert_allclose(iou_3d(a[None], b[None]), volume, atol=1e-8)


@pytest.mark.parametrize("measure", MEASURES)
def test_symmetric_and_unmoved_by_rigid_motion(measure: Callable[[Floats, Floats], Floats]) -> None:
    rng = np.random.default_rng(1)
    a, b = random_boxes(rng, 1000), random_boxes(rng, 1000)
    value = measure(a, b)
    np.testing.assert_allclose(measure(b, a), value, atol=1e-7)
    for _ in range(3):
        yaw, shift = rng.uniform(-4, 4), rng.uniform(-1000, 1000, 3)
        moved = measure(transform_boxes(a, yaw, shift), transform_boxes(b, yaw, shift))
        np.testing.assert_allclose(moved, value, atol=1e-7)


def test_corners_run_counter_clockwise_from_front_left() -> None:
    corners = bev_corners(box(x=10, y=20, yaw=QUARTER))
    np.testing.assert_allclose(corners, [[9, 22], [9, 18], [11, 18], [11, 22]], atol=1e-12)


def test_transform_turns_about_the_origin_then_shifts() -> None:
    moved = transform_boxes(box(x=1, z=3, yaw=3.0), QUARTER, [10, 20, 30])
    np.testing.assert_allclose(moved, [10, 21, 33, 3.0 + QUARTER - 2 * np.pi, 4, 2, 1], atol=1e-12)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [(0.0, 0.0), (np.pi, -np.pi), (-np.pi, -np.pi), (3.5, 3.5 - 2 * np.pi), (-7.0, -7.0 + 2 * np.pi), (100.0, None)],
)
def test_wrap_angle(angle: float, wrapped: float | None) -> None:
    got = float(wrap_angle(angle))
    assert -np.pi <= got < np.pi
    assert np.exp(1j * got) == pytest.approx(np.exp(1j * angle))
    if wrapped is not None:
        assert got == pytest.approx(wrapped)


def test_a_sliding_box_touches_from_the_first_to_the_last_contact() -> None:
    """Against boxes at many places along x; askew, across, along, and beside the track."""
    rng = np.random.default_rng(1)
    others = random_boxes(rng, 400)
    others[::4, 3] = rng.integers(-4, 5, size=100) * QUARTER
    low, high = sliding_contact((4.0, 2.0), others)
    x = np.arange(-12.0, 12.0, 0.043)
    slider = np.tile(box(z=0.0), (len(x), 1))
    slider[:, 0] = x
    touched = np.array([boxes_meet(slider, np.tile(other, (len(x), 1))) for other in others])
    # beside the track y of the other box may part both for every x, which is not asked for
    reach = (others[:, 4] * np.abs(np.sin(others[:, 3])) + others[:, 5] * np.abs(np.cos(others[:, 3]))) / 2 + 1.0
    within = np.abs(others[:, 1]) < reach
    assert 0.3 < within.mean() < 1
    expected = (x >= low[:, None]) & (x <= high[:, None]) & within[:, None]
    np.testing.assert_array_equal(expected, touched)
