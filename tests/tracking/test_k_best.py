"""k-best assignment against the enumeration of all partial matchings, and the edge cases that other codes get wrong."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from mtp_bench.errors import ShapeError
from mtp_bench.tracking import k_best
from mtp_bench.types import Floats, Ints

INF = np.inf


def matchings(cost: Floats, rows: tuple[int, ...]) -> Iterator[tuple[float, tuple[int, ...]]]:
    """Every partial matching of ``rows`` as (cost, column of every row of the matrix)."""
    choice = [-1] * len(cost)

    def extend(place: int, total: float) -> Iterator[tuple[float, tuple[int, ...]]]:
        if place == len(rows):
            yield total, tuple(choice)
            return
        yield from extend(place + 1, total)
        row = rows[place]
        for column in range(cost.shape[1]):
            if column not in choice and np.isfinite(cost[row, column]):
                choice[row] = column
                yield from extend(place + 1, total + float(cost[row, column]))
                choice[row] = -1

    yield from extend(0, 0.0)


def enumerated(cost: Floats, parents: list[tuple[int, ...]], base: Floats) -> list[float]:
    """Costs of all solutions of all distinct parents, sorted."""
    cheapest: dict[tuple[int, ...], float] = {}
    for rows, extra in zip(parents, base, strict=True):
        cheapest[rows] = min(cheapest.get(rows, INF), float(extra))
    return sorted(extra + total for rows, extra in cheapest.items() for total, _ in matchings(cost, rows))


def random_cost(rng: np.random.Generator, style: str) -> Floats:
    """At most 5 x 5; integers have ties, "gated" forbids half to nearly all pairs."""
    n, m = rng.integers(0, 6, 2).tolist()
    cost = rng.integers(-4, 2, (n, m)).astype(float) if style == "ties" else rng.normal(-0.3, 1.0, (n, m))
    if style != "dense":
        cost[rng.random((n, m)) < rng.uniform(0.5, 0.95)] = INF
    return np.asarray(cost)


def random_parents(rng: np.random.Generator, rows: int) -> tuple[list[tuple[int, ...]], Floats]:
    """Up to four row subsets, some of them equal, and their base costs."""
    count = int(rng.integers(1, 5))
    masks = rng.random((count, rows)) < 0.7
    if count > 1:
        masks[-1] = masks[0]
    return [tuple(np.flatnonzero(mask).tolist()) for mask in masks], np.round(rng.normal(size=count), 1)


def check_solutions(
    cost: Floats, parents: list[tuple[int, ...]], base: Floats, found: tuple[Floats, Ints, Ints]
) -> None:
    """Every solution is legal, costs what it says, and comes once; the best come first."""
    costs, row_to_column, parent = found
    assert (np.diff(costs) >= 0).all()
    seen = set()
    for total, choice, p in zip(costs, row_to_column.tolist(), parent.tolist(), strict=True):
        rows = [r for r, c in enumerate(choice) if c >= 0]
        columns = [choice[r] for r in rows]
        assert set(rows) <= set(parents[p])
        assert len(set(columns)) == len(columns)
        assert total == pytest.approx(base[p] + cost[rows, columns].sum(), abs=1e-12)
        assert base[p] == min(b for q, b in zip(parents, base, strict=True) if q == parents[p])
        seen.add((parents[p], tuple(choice)))
    assert len(seen) == len(costs)


@pytest.mark.parametrize("style", ["ties", "gated", "dense"])
@pytest.mark.parametrize("seed", range(60))
def test_equals_the_enumeration_of_all_matchings(style: str, seed: int) -> None:
    rng = np.random.default_rng([seed, len(style)])
    cost = random_cost(rng, style)
    parents, base = random_parents(rng, len(cost))
    k = int(rng.choice([1, 2, 7, 40, 500]))
    found = k_best(cost, k, parents, base)
    check_solutions(cost, parents, base, found)
    np.testing.assert_allclose(found[0], enumerated(cost, parents, base)[:k], atol=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_a_mask_names_the_same_parents_as_lists(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cost = random_cost(rng, "dense")
    parents, base = random_parents(rng, len(cost))
    mask = np.zeros((len(parents), len(cost)), dtype=bool)
    for p, rows in enumerate(parents):
        mask[p, list(rows)] = True
    for by_mask, by_list in zip(k_best(cost, 9, mask, base), k_best(cost, 9, parents, base), strict=True):
        np.testing.assert_array_equal(by_mask, by_list)


SQUARE = [[-3.0, -1.0], [-2.0, -2.0]]
NO_ROW, NO_COLUMN = np.zeros((0, 3)), np.zeros((3, 0))

# name: cost, k, parents, base_cost -> costs, row_to_column, parent
CASES: dict[str, tuple[Any, int, Any, Any, Sequence[float], Any, list[int]]] = {
    "one pair: matched, then not": ([[-2.0]], 5, None, None, [-2, 0], [[0], [-1]], [0, 0]),
    "fewer solutions than k": ([[-1.0, INF]], 10, None, None, [-1, 0], [[0], [-1]], [0, 0]),
    "two by two": (SQUARE, 3, None, None, [-5, -3, -3], None, [0, 0, 0]),
    "costs of 1e9 and above": ([[1e9, INF], [INF, -1e12]], 9, None, None, [-1e12, -1e12 + 1e9, 0, 1e9],
                               [[-1, 1], [0, 1], [-1, -1], [0, -1]], [0] * 4),
    "inf everywhere": (np.full((3, 2), INF), 4, None, None, [0], [[-1, -1, -1]], [0]),
    "inf everywhere, with a base": (np.full((1, 2), INF), 4, None, [7.0], [7], [[-1]], [0]),
    "no rows": (NO_ROW, 4, None, None, [0], np.zeros((1, 0), int).tolist(), [0]),
    "no columns": (NO_COLUMN, 4, None, None, [0], [[-1, -1, -1]], [0]),
    "nothing at all": (np.zeros((0, 0)), 1, None, [2.5], [2.5], np.zeros((1, 0), int).tolist(), [0]),
    "a parent without rows": ([[-2.0]], 5, [[]], [1.5], [1.5], [[-1]], [0]),
    "a parent without rows among others": ([[-2.0]], 5, [[], [0]], [-1.0, 0.0], [-2, -1, 0], [[0], [-1], [-1]],
                                           [1, 0, 1]),
    "no parents": ([[-2.0]], 5, [], None, [], np.zeros((0, 1), int).tolist(), []),
    "no parents, as a mask": ([[-2.0]], 5, np.zeros((0, 1), bool), [], [], np.zeros((0, 1), int).tolist(), []),
    "duplicate parents: the cheapest stands for them": ([[-2.0]], 5, [[0], [0], [0]], [3.0, 1.0, 2.0], [-1, 1],
                                                        [[0], [-1]], [1, 1]),
    "duplicate parents of equal cost: the first": ([[-2.0]], 1, [[0], [0]], [1.0, 1.0], [-1], [[0]], [0]),
    "the rows of a parent in any order, twice": (SQUARE, 1, [[1, 0, 1]], None, [-5], [[0, 1]], [0]),
    "parents that differ in a row without a pair": ([[INF], [-1.0]], 9, [[0, 1], [1]], [0.0, 0.5], [-1, -0.5, 0, 0.5],
                                                    [[-1, 0], [-1, 0], [-1, -1], [-1, -1]], [0, 1, 0, 1]),
    "k = 0": (SQUARE, 0, None, None, [], np.zeros((0, 2), int).tolist(), []),
    "positive costs stay unmatched at first": ([[4.0, 1.0]], 3, None, None, [0, 1, 4], [[-1], [1], [0]], [0, 0, 0]),
    "costs of zero count as matches": ([[0.0]], 9, None, [1.0], [1, 1], None, [0, 0]),
    "private dummies give no duplicates": (np.full((3, 3), -1.0), 1000, None, None,
                                           [-3] * 6 + [-2] * 18 + [-1] * 9 + [0], None, [0] * 34),
    "more rows than columns": ([[-1.0], [-2.0], [-3.0]], 9, None, None, [-3, -2, -1, 0],
                               [[-1, -1, 0], [-1, 0, -1], [0, -1, -1], [-1, -1, -1]], [0] * 4),
    "float32": (np.array(SQUARE, np.float32), 1, None, None, [-5], [[0, 1]], [0]),
    "integers": (np.array(SQUARE, np.int32), 1, None, None, [-5], [[0, 1]], [0]),
    "lists": ([[-3, -1], [-2, -2]], 1, [[0]], [1], [-2], [[0, -1]], [0]),
    "not contiguous": (np.repeat(np.array(SQUARE), 2, axis=1)[:, ::2], 1, None, None, [-5], [[0, 1]], [0]),
    "column order": (np.asfortranarray(SQUARE), 1, None, None, [-5], [[0, 1]], [0]),
    "read only": (np.broadcast_to(-1.0, (1, 1)), 1, None, None, [-1], [[0]], [0]),
    "parents as sets and tuples": (SQUARE, 1, [{1}, (0,)], [0.0, 0.5], [-2.5], [[0, -1]], [1]),
    "one mask as a list of booleans": (SQUARE, 1, [[False, True]], None, [-2], None, [0]),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_case(case: str) -> None:
    cost, k, parents, base, costs, row_to_column, parent = CASES[case]
    found = k_best(cost, k, parents, base)
    assert [column.dtype for column in found] == [np.float64, np.int64, np.int64]
    np.testing.assert_array_equal(found[0], costs)
    np.testing.assert_array_equal(found[2], parent)
    assert found[1].shape == (len(costs), np.shape(cost)[0])
    if row_to_column is not None:  # None: the order of ties is not defined
        np.testing.assert_array_equal(found[1], np.reshape(row_to_column, found[1].shape))
    assert len({(p, *row) for p, row in zip(found[2].tolist(), found[1].tolist(), strict=True)}) == len(costs)


ERRORS: dict[str, tuple[Any, int, Any, Any, str]] = {
    "NaN": ([[0.0, np.nan]], 1, None, None, r"cost\[0, 1\] is nan"),
    "-inf": ([[0.0], [-INF]], 1, None, None, r"cost\[1, 0\] is -inf"),
    "NaN where no parent looks": ([[0.0], [np.nan]], 1, [[0]], None, r"cost\[1, 0\]"),
    "NaN and k = 0": ([[np.nan]], 0, None, None, "nan"),
    "one dimension": ([1.0, 2.0], 1, None, None, r"shape \(2,\)"),
    "negative k": ([[0.0]], -1, None, None, "k is -1"),
    "base_cost too long": ([[0.0]], 1, [[0]], [0.0, 1.0], r"base_cost has shape \(2,\), expected \(1,\)"),
    "base_cost a single number": ([[0.0]], 1, [[0]], 3.0, r"base_cost has shape \(\)"),
    "base_cost infinite": ([[0.0]], 1, [[0], []], [0.0, INF], "base_cost has inf"),
    "base_cost NaN": ([[0.0]], 1, None, [np.nan], "base_cost has nan"),
    "row beyond the last": ([[0.0]], 1, [[0], [1]], None, r"parents\[1\] names row 1 of 1"),
    "negative row": ([[0.0]], 1, [[-1]], None, r"parents\[0\] names row -1"),
    "rows that are not whole": ([[0.0]], 1, [[0.5]], None, r"parents\[0\] is \[0.5\]"),
    "mask too wide": ([[0.0]], 1, np.ones((1, 2), bool), None, r"parents\[0\] is a mask of 2 rows, expected 1"),
    "one row for a list of rows": ([[0.0]], 1, np.ones(1, bool), None, r"parents\[0\]"),
}  # fmt: skip


@pytest.mark.parametrize("case", ERRORS)
def test_error(case: str) -> None:
    cost, k, parents, base, message = ERRORS[case]
    with pytest.raises(ShapeError, match=message):
        k_best(cost, k, parents, base)


@pytest.mark.parametrize("seed", range(15))
def test_the_first_j_of_k_are_the_j_best(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cost, (parents, base) = tracking_problem(rng), ([tuple(range(8)), tuple(range(4, 12)), (0, 11)], np.zeros(3))
    whole = k_best(cost, 40, parents, base)
    for j in (1, 2, 5, 17, 39):
        for more, fewer in zip(whole, k_best(cost, j, parents, base), strict=True):
            np.testing.assert_array_equal(more[:j], fewer)


@pytest.mark.parametrize("seed", range(15))
def test_the_order_of_rows_and_columns_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cost = tracking_problem(rng)
    rows, columns = rng.permutation(cost.shape[0]), rng.permutation(cost.shape[1])
    costs, row_to_column, _ = k_best(cost, 30)
    other_costs, other, _ = k_best(cost[np.ix_(rows, columns)], 30)
    np.testing.assert_allclose(other_costs, costs, atol=1e-12)
    # No ties here: the solutions are the same ones too.
    back = np.append(columns, -1)[other]
    restored = np.empty_like(back)
    restored[:, rows] = back
    np.testing.assert_array_equal(restored, row_to_column)


@pytest.mark.parametrize("seed", range(15))
def test_joint_over_parents_is_the_sort_of_all_separate(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cost = tracking_problem(rng)
    parents = [np.flatnonzero(rng.random(len(cost)) < 0.6).tolist() for _ in range(6)]
    base = rng.normal(size=len(parents))
    joint, _, parent = k_best(cost, 25, parents, base)
    separate = [(c, p) for p in range(len(parents)) for c in k_best(cost, 25, [parents[p]], base[p : p + 1])[0]]
    best = sorted(separate)[:25]
    np.testing.assert_allclose(joint, [c for c, _ in best], atol=1e-12)
    np.testing.assert_array_equal(parent, [p for _, p in best])


def tracking_problem(rng: np.random.Generator) -> Floats:
    """12 tracks, 10 detections, four fifths of the pairs outside the gate."""
    cost = -rng.random((12, 10))
    cost[rng.random(cost.shape) < 0.8] = INF
    return np.asarray(cost)


def test_rounding_does_not_disturb_the_order() -> None:
    # Sums of tenths are equal on paper, not as floats: the solver and the total may see them in another order.
    rng = np.random.default_rng(0)
    for _ in range(40):
        cost = -rng.integers(1, 4, (4, 4)) / 10 + 1e9 * (rng.random((4, 4)) < 0.1)
        costs, _, _ = k_best(cost, 500)
        assert (np.diff(costs) >= 0).all()
        np.testing.assert_allclose(costs, enumerated(cost, [(0, 1, 2, 3)], np.zeros(1))[: len(costs)], rtol=1e-15)


def test_input_is_left_as_it_was() -> None:
    cost, base = np.array(SQUARE), np.array([1.0, 0.0])
    mask = np.array([[True, False], [True, True]])
    arguments: list[ArrayLike] = [cost, mask, base]
    before = [np.array(a) for a in arguments]
    k_best(cost, 5, mask, base)
    for argument, copy in zip(arguments, before, strict=True):
        np.testing.assert_array_equal(argument, copy)
