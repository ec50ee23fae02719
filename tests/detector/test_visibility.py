"""Visible fractions against brute-force rays and figures worked out by hand; coverage, occlusion level, truncation."""

import numpy as np
import pytest

from mtp_bench.core import Floats, Truth
from mtp_bench.core.geometry import bev_corners, bev_intersection_area
from mtp_bench.detector.visibility import Sensor, covered, visibility_of, visible_fractions
from tests.support.detector_scenes import truth_of

ALL_AROUND = Sensor(reach=100.0, field_of_view=2 * np.pi)
AHEAD = Sensor(reach=50.0, field_of_view=np.pi / 2)
AT_ORIGIN = np.zeros(2)


def _box(x: float, y: float, yaw: float = 0.0, length: float = 4.0, width: float = 2.0) -> list[float]:
    return [x, y, 0.0, yaw, length, width, 1.6]


def _wall(x: float, low: float, high: float) -> list[float]:
    """A thin wall across the x axis, from y = low to y = high."""
    return _box(x, (low + high) / 2, length=1e-6, width=high - low)


def _truth(frames: list[list[list[float]]]) -> Truth:
    frame = np.repeat(np.arange(len(frames)), [len(boxes) for boxes in frames])
    box = np.array([row for boxes in frames for row in boxes], dtype=np.float64).reshape(-1, 7)
    return truth_of(frame, np.arange(len(box)), box, len(frames))


def visible_fraction(box: Floats, sensor: Floats) -> Floats:
    return visible_fractions(_truth([box.tolist()]), sensor[None])


def _ray_fractions(box: Floats, sensor: Floats, rays: int) -> Floats:
    """Visible fractions by crossing every ray with every edge of every box."""
    angle = (np.arange(rays) + 0.5) / rays * 2 * np.pi
    direction = np.stack([np.cos(angle), np.sin(angle)], -1)
    nearest = np.full((rays, len(box)), np.inf)
    for m, corners in enumerate(bev_corners(box) - sensor):
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            edge = b - a
            det = edge[0] * direction[:, 1] - edge[1] * direction[:, 0]
            along_edge = (a[1] * direction[:, 0] - a[0] * direction[:, 1]) / det
            along_ray = (a[1] * edge[0] - a[0] * edge[1]) / det
            crossed = (along_edge >= 0) & (along_edge <= 1) & (along_ray > 0)
            nearest[crossed, m] = np.minimum(nearest[crossed, m], along_ray[crossed])
    hit = np.isfinite(nearest)
    first = hit & (nearest == nearest.min(1, keepdims=True))
    fraction: Floats = first.sum(0) / hit.sum(0)
    return fraction


def _scattered(rng: np.random.Generator, count: int) -> Floats:
    """Boxes of many sizes that do not overlap, none at the origin."""
    kept = np.zeros((0, 7))
    while len(kept) < count:
        x, y = rng.uniform(-40, 40, 2)
        box = np.array([_box(x, y, rng.uniform(-4, 4), rng.uniform(0.4, 12), rng.uniform(0.4, 3))])
        apart = bev_intersection_area(np.repeat(box, len(kept), axis=0), kept).sum() == 0
        if np.hypot(x, y) > 7 and apart:
            kept = np.concatenate([kept, box])
    return kept


@pytest.mark.parametrize("seed", range(2))
def test_scattered_boxes_are_as_visible_as_to_a_fine_ring_of_rays(seed: int) -> None:
    box = _scattered(np.random.default_rng(seed), 30)
    expected = _ray_fractions(box, AT_ORIGIN, 60_000)
    assert expected.min() < 0.05
    np.testing.assert_allclose(visible_fraction(box, AT_ORIGIN), expected, atol=0.02)


@pytest.mark.parametrize(("name", "near", "expected"), [
    ("beside it", [_wall(5.0, 6.0, 8.0)], 1.0), ("behind it", [_wall(20.0, -10.0, 10.0)], 1.0),
    ("upper half", [_wall(5.0, 0.0, 9.0)], 0.5),
    ("middle", [_wall(5.0, -2.5, 2.5)], 1 - np.arctan(0.5) / np.arctan(1.0)),
    ("all of it", [_wall(5.0, -9.0, 9.0)], 0.0),
    ("two that overlap in angle", [_wall(5.0, -9.0, 0.0), _wall(4.0, -3.0, 0.0)], 0.5),
    ("around the sensor", [_box(0.0, 0.0)], 1.0), ("on the other side", [_wall(-5.0, -9.0, 9.0)], 1.0),
])  # fmt: skip
def test_a_wall_of_90_degrees_is_visible_past(name: str, near: list[list[float]], expected: float) -> None:
    box = np.array([_wall(10.0, -10.0, 10.0), *near])
    assert visible_fraction(box, AT_ORIGIN)[0] == pytest.approx(expected, abs=1e-6), name


def test_visibility_does_not_depend_on_the_order_of_boxes_or_on_the_heading_of_the_world() -> None:
    rng = np.random.default_rng(7)
    box = _scattered(rng, 25)
    order = rng.permutation(25)
    plain = visible_fraction(box, AT_ORIGIN)
    np.testing.assert_allclose(visible_fraction(box[order], AT_ORIGIN), plain[order], atol=1e-9)
    for turn in (1.0, np.pi, -2.5):
        cos, sin = np.cos(turn), np.sin(turn)
        turned = box.copy()
        turned[:, :2] = box[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + [500.0, -300.0]
        turned[:, 3] += turn
        np.testing.assert_allclose(visible_fraction(turned, np.array([500.0, -300.0])), plain, atol=1e-9)


@pytest.mark.parametrize(
    ("visible", "level"),
    [(0.81, 0), (0.8, 0), (0.79, 1), (0.41, 1), (0.4, 1), (0.39, 2), (0.06, 2), (0.05, 2), (0.04, 3)],
)
def test_the_occlusion_level_follows_the_visible_fraction(visible: float, level: int) -> None:
    """A fraction at a threshold is not below it."""
    truth = _truth([[_wall(10.0, -10.0, 10.0)]])
    stated = visibility_of(truth, np.zeros((1, 4)), ALL_AROUND, visible=np.array([visible]))
    assert stated.occlusion.tolist() == [level]
    if visible in (0.8, 0.4, 0.05):
        return
    # the far wall spans 45 degrees to each side; the near one hides all of it but an angle on the left
    top = 5 * np.tan(np.pi / 4 - visible * np.pi / 2)
    truth = _truth([[_wall(10.0, -10.0, 10.0), _wall(5.0, -20.0, float(top))]])
    assert visibility_of(truth, np.zeros((1, 4)), ALL_AROUND).occlusion.tolist() == [level, 0]


def test_distance_and_bearing_are_relative_to_the_ego_of_the_frame() -> None:
    truth = _truth([[_box(10.0, 0.0)], [], [_box(10.0, 0.0), _box(3.0, 5.0)]])
    ego = np.array([[0.0, 0.0, 1.0, 0.0], [9.0, 9.0, 9.0, 9.0], [3.0, 0.0, 1.0, np.pi / 2]])
    seen = visibility_of(truth, ego, ALL_AROUND)
    np.testing.assert_allclose(seen.distance, [10.0, 7.0, 5.0])
    np.testing.assert_allclose(seen.bearing, [0.0, -np.pi / 2, 0.0], atol=1e-12)


@pytest.mark.parametrize(("x", "y", "inside", "cut"), [
    (49.9, 0, True, False), (50.1, 0, False, False), (10, 9.9, True, True), (10, -9.9, True, True),
    (10, 10.1, False, True), (-9, 0, False, True), (10, 6.9, True, False), (10, 7.1, True, True),
    (10, -7.1, True, True),  # its rear is at x = 8, its far side 1 m beyond y
])  # fmt: skip
def test_a_box_is_covered_by_its_centre_and_truncated_by_a_corner(x: float, y: float, inside: bool, cut: bool) -> None:
    truth, ego = _truth([[_box(x, y)]]), np.zeros((1, 4))
    for sensor, covers, truncates in ((AHEAD, inside, cut), (ALL_AROUND, True, False)):
        assert covered(truth, ego, sensor).tolist() == [covers]
        assert visibility_of(truth, ego, sensor).truncated.tolist() == [truncates]
