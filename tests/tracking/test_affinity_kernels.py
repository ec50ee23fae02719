"""The compiled sparse gains against the plain ones."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mtp_bench.core import Floats, Ints
from mtp_bench.core.geometry import iou_3d, transform_boxes
from mtp_bench.tracking.kernels.affinity_kernels import GIOU_3D, IOU_3D, sparse_pairs
from mtp_bench.tracking.parameters import Affinity, ClassParameters
from mtp_bench.tracking.tracker import rules_of, sparse_gains
from tests.support.plain_affinity import bev_hull_area, gains, giou_3d


def random_boxes(rng: np.random.Generator, n: int, spread: float = 3.0) -> Floats:
    return rng.uniform([-spread, -spread, -1, -7, 0.2, 0.2, 0.3], [spread, spread, 1, 7, 6, 3, 3], size=(n, 7))


def edge_boxes(rng: np.random.Generator, n: int) -> Floats:
    """Boxes on a grid: most pairs touch, contain each other, share edges or corners, are equal or have no area."""
    place = [rng.choice(v, n) for v in ([-4.0, -2, -1, 0, 1, 2, 4], [-2.0, -1, -0.5, 0, 0.5, 1, 2], [0, 0.5, 1, 2])]
    size = [rng.choice(v, n) for v in ([0, 1e-4, 1, 2, 4.0], [0, 1, 2, 4.0], [0, 1, 2.0])]
    return np.column_stack([*place, rng.integers(-4, 5, n) * np.pi / 4, *size])


def by_row(a: Floats, b: Floats, kind: int, gate: float) -> Floats:
    """Affinity of each row of a with the same row of b, NaN where it is below the gate: every row is a class."""
    n = len(a)
    class_id = np.arange(n)
    indptr, column, gain = sparse_pairs(a, class_id, b, class_id, np.full(n, kind), np.full(n, gate))
    row = np.repeat(class_id, np.diff(indptr))
    np.testing.assert_array_equal(row, column)
    value = np.full(n, np.nan)
    value[row] = gain + gate
    return value


def assert_same_overlap(a: Floats, b: Floats) -> None:
    """IoU of all rows equal to 1e-9, and GIoU where the hull has a volume: else it is 0 / 0."""
    np.testing.assert_allclose(by_row(a, b, IOU_3D, 0.0), iou_3d(a, b), atol=1e-9, rtol=0)
    expected, value = giou_3d(a, b), by_row(a, b, GIOU_3D, -1.0)
    height = np.maximum(a[:, 2] + a[:, 6] / 2, b[:, 2] + b[:, 6] / 2) - np.minimum(
        a[:, 2] - a[:, 6] / 2, b[:, 2] - b[:, 6] / 2
    )
    flat = bev_hull_area(a, b) <= 1e-12 * np.maximum(a[:, 4:6].max(1), b[:, 4:6].max(1)) ** 2
    flat |= height == 0
    at_gate = np.isnan(value) & (expected < -1 + 1e-9)
    assert (flat | at_gate).mean() < 0.7
    kept = ~flat & ~at_gate
    np.testing.assert_allclose(value[kept], expected[kept], atol=1e-9, rtol=0)


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1.0, 1e3])
@pytest.mark.parametrize("offset", [0.0, 1e5])
def test_random_pairs(scale: float, offset: float) -> None:
    rng = np.random.default_rng(0)
    shift = [offset, -offset, 0, 0, 0, 0, 0]
    size = [scale, scale, scale, 1, scale, scale, scale]
    for spread in (3.0, 20.0):
        assert_same_overlap(*(random_boxes(rng, 1500, spread) * size + shift for _ in range(2)))


@pytest.mark.parametrize("turn", [0.0, 0.1, np.pi / 2, -2.2])
@pytest.mark.parametrize("offset", [0.0, 1e5])
def test_degenerate_pairs(turn: float, offset: float) -> None:
    rng = np.random.default_rng(1)
    a, b = (transform_boxes(edge_boxes(rng, 2000), turn, [offset, offset / 3, 0]) for _ in range(2))
    assert_same_overlap(a, b)
    assert_same_overlap(a, a.copy())


@pytest.mark.parametrize("exponent", range(-17, 0, 2))
def test_nearly_equal_boxes(exponent: int) -> None:
    rng = np.random.default_rng(-exponent)
    a = random_boxes(rng, 1000)
    b = a + rng.normal(0, 10.0**exponent, a.shape) * [1, 1, 0, 1, 1, 1, 0]
    b[:, 3] += rng.integers(-2, 3, len(a)) * np.pi / 2
    b[:, 4:6] = np.abs(b[:, 4:6])
    assert_same_overlap(a, b)


RULES: list[tuple[Affinity, float]] = [
    ("giou_3d", -0.2), ("giou_3d", -0.8), ("giou_3d", -1.0), ("giou_3d", 0.3), ("iou_3d", 0.1), ("iou_3d", 0.0),
    ("iou_3d", -0.5), ("center_distance", 2.0), ("center_distance", 0.0), ("center_distance", -1.0),
    ("center_distance", np.inf),
]  # fmt: skip
PARAMETERS = tuple(ClassParameters("hungarian", affinity, gate, 1, 2) for affinity, gate in RULES)


def dense(rows: tuple[Ints, Ints, Floats], shape: tuple[int, int]) -> Floats:
    """The matrix of `affinity.gains`; columns must ascend and gains must not be negative."""
    indptr, column, gain = rows
    assert len(indptr) == shape[0] + 1
    assert (gain >= 0).all()
    matrix = np.full(shape, -np.inf)
    for i in range(shape[0]):
        mine = slice(int(indptr[i]), int(indptr[i + 1]))
        assert (np.diff(column[mine]) > 0).all()
        matrix[i, column[mine]] = gain[mine]
    return matrix


def assert_same_gains(a: Floats, a_class: Ints, b: Floats, b_class: Ints, rules: tuple[ClassParameters, ...]) -> None:
    expected = gains(a, a_class, b, b_class, rules)
    np.testing.assert_allclose(
        dense(sparse_gains(a, a_class, b, b_class, rules_of(rules)), expected.shape), expected, atol=1e-9, rtol=0
    )


@pytest.mark.parametrize("rule", range(len(RULES)))
@pytest.mark.parametrize("spread", [5.0, 60.0])
def test_the_allowed_pairs_of_each_rule(rule: int, spread: float) -> None:
    rng = np.random.default_rng(rule)
    a, b = random_boxes(rng, 60, spread), random_boxes(rng, 70, spread)
    a_class, b_class = np.zeros(60, dtype=np.int64), np.zeros(70, dtype=np.int64)
    assert_same_gains(a, a_class, b, b_class, PARAMETERS[rule : rule + 1])


def test_classes_do_not_cross_and_unknown_ones_match_nothing() -> None:
    rng = np.random.default_rng(3)
    a, b = random_boxes(rng, 150, 8), random_boxes(rng, 120, 8)
    a_class, b_class = rng.integers(-1, len(RULES) + 2, 150), rng.integers(-1, len(RULES) + 2, 120)
    assert_same_gains(a, a_class, b, b_class, PARAMETERS)


@pytest.mark.parametrize(("n", "d"), [(0, 0), (0, 3), (3, 0)])
def test_nothing_to_match(n: int, d: int) -> None:
    a, b = np.zeros((n, 7)), np.zeros((d, 7))
    indptr, column, gain = sparse_gains(a, np.zeros(n, dtype=int), b, np.zeros(d, dtype=int), rules_of(PARAMETERS))
    assert indptr.tolist() == [0] * (n + 1)
    assert column.shape == gain.shape == (0,)


def test_nan_matches_nothing() -> None:
    a = random_boxes(np.random.default_rng(0), 3, 0.5)
    zero = np.zeros(3, dtype=np.int64)
    for rule in (0, 4, 7):
        for k in range(3):
            b = a.copy()
            b[1, k] = np.nan
            assert_same_gains(a, zero, b, zero, PARAMETERS[rule : rule + 1])


def test_plain_python_gives_the_same() -> None:
    rng = np.random.default_rng(8)
    a, b = random_boxes(rng, 25), random_boxes(rng, 20)
    chosen: Any = (("giou_3d", -0.5), ("iou_3d", 0.05), ("center_distance", 2.0))
    rules = rules_of([replace(PARAMETERS[0], affinity=name, gate=gate) for name, gate in chosen])
    given = (a, rng.integers(0, 3, 25), b, rng.integers(0, 3, 20), *rules)
    compiled, plain = sparse_pairs(*given), sparse_pairs.function(*given)
    for value, other in zip(compiled, plain, strict=True):
        np.testing.assert_allclose(value, other, rtol=0, atol=1e-13)
