"""The dense form of the k-best association: the edge cases that other codes get wrong, and wrong input."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from mtp_bench.core.errors import ShapeError
from mtp_bench.tracking import k_best

INF = np.inf


SQUARE = [[-3.0, -1.0], [-2.0, -2.0]]
NO_ROW, NO_COLUMN = np.zeros((0, 3)), np.zeros((3, 0))

# name: cost, k, rows of each parent, base_cost -> costs, row_to_column, parent
CASES: dict[str, tuple[Any, int, Any, Any, Sequence[float], Any, list[int]]] = {
    "one pair: matched, then not": ([[-2.0]], 5, None, None, [-2, 0], [[0], [-1]], [0, 0]),
    "fewer solutions than k": ([[-1.0, INF]], 10, None, None, [-1, 0], [[0], [-1]], [0, 0]),
    "two by two": (SQUARE, 3, None, None, [-5, -3, -3], None, [0, 0, 0]),
    "costs of 1e9 and above": ([[1e9, INF], [INF, -1e12]], 9, None, None, [-1e12, -1e12 + 1e9, 0, 1e9],
                               [[-1, 1], [0, 1], [-1, -1], [0, -1]], [0] * 4),
    "inf everywhere, with a base": (np.full((1, 2), INF), 4, None, [7.0], [7], [[-1]], [0]),
    "no rows": (NO_ROW, 4, None, None, [0], np.zeros((1, 0), int).tolist(), [0]),
    "no columns": (NO_COLUMN, 4, None, None, [0], [[-1, -1, -1]], [0]),
    "a parent without rows": ([[-2.0]], 5, [[]], [1.5], [1.5], [[-1]], [0]),
    "a parent without rows among others": ([[-2.0]], 5, [[], [0]], [-1.0, 0.0], [-2, -1, 0], [[0], [-1], [-1]],
                                           [1, 0, 1]),
    "no rows and no columns": (np.zeros((0, 0)), 4, None, None, [0], np.zeros((1, 0), int).tolist(), [0]),
    "k = 0": ([[-2.0]], 0, None, None, [], np.zeros((0, 1), int).tolist(), []),
    "ties come by parent, then by columns": ([[-1.0, -1.0]] * 2, 99, [[0, 1], [0]], [0.0, -1.0],
                                             [-2] * 4 + [-1] * 5 + [0],
                                             [[0, 1], [1, 0], [0, -1], [1, -1], [-1, 0], [-1, 1], [0, -1], [1, -1],
                                              [-1, -1], [-1, -1]], [0, 0, 1, 1, 0, 0, 0, 0, 1, 0]),
    "no parents": ([[-2.0]], 5, [], None, [], np.zeros((0, 1), int).tolist(), []),
    "duplicate parents: the cheapest stands for them": ([[-2.0]], 5, [[0], [0], [0]], [3.0, 1.0, 2.0], [-1, 1],
                                                        [[0], [-1]], [1, 1]),
    "duplicate parents of equal cost: the first": ([[-2.0]], 1, [[0], [0]], [1.0, 1.0], [-1], [[0]], [0]),
    "parents that differ in a row without a pair": ([[INF], [-1.0]], 9, [[0, 1], [1]], [0.0, 0.5], [-1, -0.5, 0, 0.5],
                                                    [[-1, 0], [-1, 0], [-1, -1], [-1, -1]], [0, 1, 0, 1]),
    "positive costs stay unmatched at first": ([[4.0, 1.0]], 3, None, None, [0, 1, 4], [[-1], [1], [0]], [0, 0, 0]),
    "costs of zero count as matches": ([[0.0]], 9, None, [1.0], [1, 1], None, [0, 0]),
    "private dummies give no duplicates": (np.full((3, 3), -1.0), 1000, None, None,
                                           [-3] * 6 + [-2] * 18 + [-1] * 9 + [0], None, [0] * 34),
    "more rows than columns": ([[-1.0], [-2.0], [-3.0]], 9, None, None, [-3, -2, -1, 0],
                               [[-1, -1, 0], [-1, 0, -1], [0, -1, -1], [-1, -1, -1]], [0] * 4),
    "float32": (np.array(SQUARE, np.float32), 1, None, None, [-5], [[0, 1]], [0]),
    "lists": ([[-3, -1], [-2, -2]], 1, [[0]], [1], [-2], [[0, -1]], [0]),
    "not contiguous": (np.repeat(np.array(SQUARE), 2, axis=1)[:, ::2], 1, None, None, [-5], [[0, 1]], [0]),
    "read only": (np.broadcast_to(-1.0, (1, 1)), 1, None, None, [-1], [[0]], [0]),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_case(case: str) -> None:
    cost, k, parents, base, costs, row_to_column, parent = CASES[case]
    mask = None if parents is None else np.zeros((len(parents), len(cost)), bool)
    for number, rows in enumerate(parents or ()):
        np.asarray(mask)[number, rows] = True
    found = k_best(cost, k, mask, base)
    assert [column.dtype for column in found] == [np.float64, np.int64, np.int64]
    np.testing.assert_array_equal(found[0], costs)
    np.testing.assert_array_equal(found[2], parent)
    assert found[1].shape == (len(costs), np.shape(cost)[0])
    if row_to_column is not None:  # None: the order of ties is not defined
        np.testing.assert_array_equal(found[1], np.reshape(row_to_column, found[1].shape))
    assert len({(p, *row) for p, row in zip(found[2].tolist(), found[1].tolist(), strict=True)}) == len(costs)


ERRORS: dict[str, tuple[Any, int, Any, Any, str]] = {
    "NaN": ([[0.0, np.nan]], 1, None, None, r"cost\[0, 1\] is nan"),
    "-inf": ([[-INF, 1.0]], 1, None, None, r"cost\[0, 0\] is -inf"),
    "costs that overflow": ([[1.5e308, 1.5e308]], 1, None, None, "too large to be summed"),
    "base NaN": ([[0.0]], 1, None, [np.nan], "base_cost has nan"),
    "negative k": ([[0.0]], -1, None, None, "k is -1"),
    "base_cost too long": ([[0.0]], 1, None, [0.0, 1.0], r"base_cost has shape \(2,\), expected \(1,\)"),
    "mask too wide": ([[0.0]], 1, np.ones((1, 2), bool), None, r"parents has shape \(1, 2\), expected \('any', 1\)"),
}  # fmt: skip


@pytest.mark.parametrize("case", ERRORS)
def test_error(case: str) -> None:
    cost, k, parents, base, message = ERRORS[case]
    with pytest.raises(ShapeError, match=message):
        k_best(cost, k, parents, base)


def test_input_is_left_as_it_was() -> None:
    cost, base = np.array(SQUARE), np.array([1.0, 0.0])
    mask = np.array([[True, False], [True, True]])
    arguments: list[ArrayLike] = [cost, mask, base]
    before = [np.array(a) for a in arguments]
    found = k_best(cost, 5, mask, base)
    np.testing.assert_array_equal(k_best(SQUARE, 5, [[1, 0], [1, 1]], [1, 0])[1], found[1], "lists of 0 and 1")
    for argument, copy in zip(arguments, before, strict=True):
        np.testing.assert_array_equal(argument, copy)
