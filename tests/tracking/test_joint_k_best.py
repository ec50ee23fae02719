"""The joint k-best kernel against enumeration and the textbook solver, compiled and in plain Python."""

import os
import subprocess
import sys

import numpy as np
import pytest

from mtp_bench.core import Bools, Floats, Ints
from mtp_bench.tracking import k_best
from mtp_bench.tracking.kernels import pieces
from mtp_bench.tracking.kernels.association import joint_k_best
from tests.support.textbook_k_best import k_best as textbook

INF = np.inf
Problem = tuple[Floats, Bools, Floats, int]  # dense cost, member, base_cost, k


def sparse(cost: Floats) -> tuple[Ints, Ints, Floats, int]:
    row, column = np.nonzero(cost < INF)
    indptr = np.searchsorted(row, np.arange(len(cost) + 1))
    return indptr.astype(np.int64), column.astype(np.int64), cost[row, column], cost.shape[1]


def solved(problem: Problem) -> tuple[Floats, Ints, Ints]:
    cost, member, base, k = problem
    return k_best(cost, k, member, base)


def random_problem(rng: np.random.Generator, max_rows: int, max_parents: int, style: str) -> Problem:
    """Rectangular, gated by 0 to 95 %; "ties" has small integers, "huge" costs of 1e300; some parents are equal."""
    n, m = rng.integers(0, max_rows + 1, 2).tolist()
    cost = rng.integers(-4, 2, (n, m)).astype(float) if style == "ties" else rng.normal(-0.3, 1.0, (n, m))
    if style == "huge":
        cost *= 1e300
    cost[rng.random((n, m)) < rng.uniform(0.0 if n < 9 else 0.5, 0.95)] = INF
    H = int(rng.integers(1, max_parents + 1))
    member = rng.random((H, n)) < rng.choice([0.5, 0.8, 1.0])
    if H > 1:
        member[-1] = member[0]
    base = np.round(rng.normal(size=H), 1) * (1e300 if style == "huge" else 1.0)
    return cost, member, base, int(rng.choice([1, 2, 7, 40, 500]))


def matching_costs(cost: Floats, rows: list[int], columns: int) -> dict[int, Floats]:
    """Costs of all partial matchings of the rows, by the columns they use (as bits)."""
    by_columns: dict[int, Floats] = {0: np.zeros(1)}
    for row in rows:
        grown = {used: [costs] for used, costs in by_columns.items()}
        for column in range(columns):
            if cost[row, column] < INF:
                for used, costs in by_columns.items():
                    if not used >> column & 1:
                        grown.setdefault(used | 1 << column, []).append(costs + cost[row, column])
        by_columns = {used: np.concatenate(parts) for used, parts in grown.items()}
    return by_columns


def enumerated(problem: Problem) -> Floats:
    """The k least costs over all matchings of all distinct parents."""
    cost, member, base, k = problem
    cheapest: dict[tuple[int, ...], float] = {}
    for mask, extra in zip(member, base.tolist(), strict=True):
        rows = tuple(np.flatnonzero(mask).tolist())
        cheapest[rows] = min(cheapest.get(rows, INF), extra)
    costs = [
        extra + part
        for rows, extra in cheapest.items()
        for part in matching_costs(cost, list(rows), cost.shape[1]).values()
    ]
    return np.sort(np.concatenate(costs))[:k]


def check(problem: Problem, found: tuple[Floats, Ints, Ints]) -> None:
    """Every solution is legal, of a parent that stands for its equals, costs exactly what it says and comes once."""
    cost, member, base, k = problem
    costs, row_to_column, parent = found
    assert len(costs) <= k
    assert (np.diff(costs) >= 0).all()
    for total, choice, p in zip(costs.tolist(), row_to_column.tolist(), parent.tolist(), strict=True):
        expected = float(base[p])
        for row, column in enumerate(choice):
            if column >= 0:
                expected += float(cost[row, column])
        assert total == expected  # to the last bit: summed in the order of the rows
        taken = [column for column in choice if column >= 0]
        assert len(set(taken)) == len(taken)
        assert member[p][[column >= 0 for column in choice]].all()
        equal = np.flatnonzero((member == member[p]).all(axis=1))
        assert p == equal[np.argmin(base[equal])]
    seen = {(p, *choice) for p, choice in zip(parent.tolist(), row_to_column.tolist(), strict=True)}
    assert len(seen) == len(costs)


def check_against_enumeration(style: str, problems: int) -> None:
    rng = np.random.default_rng(len(style))
    for i in range(problems):
        problem = random_problem(rng, 4 if i % 10 else 6, 5, style)
        found, expected = solved(problem), enumerated(problem)
        assert len(found[0]) == len(expected), i
        scale = 1e300 if np.abs(problem[2]).max(initial=0) > 1e100 else 1.0
        np.testing.assert_allclose(found[0], expected, rtol=0, atol=1e-12 * scale, err_msg=str(i))
        if i % 20 == 0:
            check(problem, found)


@pytest.mark.parametrize("style", ["ties", "gated", "huge"])
def test_equals_enumeration(style: str) -> None:
    check_against_enumeration(style, 2500)


def test_plain_python_by_enumeration_and_by_murty_equals_enumeration() -> None:
    """Plain Python finds indices out of bounds, which compiled code does not, and follows changed constants."""
    program = "from tests.tracking.test_joint_k_best import check_in_plain_python; check_in_plain_python()"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    subprocess.run([sys.executable, "-c", program], env=environment, check=True)


def check_in_plain_python() -> None:
    for max_choices in (10**7, 0):
        pieces.MAX_CHOICES, pieces.MAX_CHOICES_AT_ONCE = max_choices, min(pieces.MAX_CHOICES_AT_ONCE, max_choices)
        for style in ("ties", "gated", "huge"):
            check_against_enumeration(style, 100)
        check_against_the_textbook_solver(12, 6, 99.0)


def tracking_problem(rng: np.random.Generator, rows: int, parents: int, gate: float) -> Problem:
    """Tracks and detections on a square, pairs within the gate; hypotheses that share most of their tracks."""
    tracks = rng.uniform(0, 3.0 * np.sqrt(rows), (rows, 2))
    detections = (tracks + rng.normal(0, 0.5, (rows, 2)))[rng.random(rows) < 0.9]
    distance = np.linalg.norm(tracks[:, None] - detections, axis=-1)
    member = np.ones((parents, rows), dtype=bool)
    doubtful = rng.permutation(rows)[: 4 + rows // 8]
    member[:, doubtful] = rng.random((parents, len(doubtful))) < 0.5
    member = member[np.sort(np.unique(member, axis=0, return_index=True)[1])]
    return np.where(distance < gate, distance - gate, INF), member, np.sort(rng.exponential(size=len(member))), 30


def check_against_the_textbook_solver(rows: int, parents: int, gate: float) -> None:
    rng = np.random.default_rng([rows, parents])
    for _ in range(2):
        problem = tracking_problem(rng, rows, parents, gate)
        found, expected = solved(problem), textbook(problem[0], 30, problem[1], problem[2])
        check(problem, found)
        # Costs are not tied here: equal to the last bit, and the same solutions.
        for ours, theirs in zip(found, expected, strict=True):
            np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(("rows", "parents", "gate"), [(60, 1, 3.0), (40, 20, 3.0), (25, 20, 5.0), (12, 6, 99.0)])
def test_equals_the_textbook_solver(rows: int, parents: int, gate: float) -> None:
    check_against_the_textbook_solver(rows, parents, gate)


@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_rows_columns_and_pairs_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cost, member, base, k = tracking_problem(rng, 20, 5, 4.0)
    rows, columns = rng.permutation(cost.shape[0]), rng.permutation(cost.shape[1])
    costs, row_to_column, parent = solved((cost, member, base, k))
    other = solved((cost[np.ix_(rows, columns)], member[:, rows], base, k))
    np.testing.assert_allclose(other[0], costs, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(np.append(columns, -1)[other[1]], row_to_column[:, rows])
    np.testing.assert_array_equal(other[2], parent)
    indptr, column, value, m = sparse(cost)
    for r in range(len(cost)):
        shuffled = indptr[r] + rng.permutation(indptr[r + 1] - indptr[r])
        part = slice(indptr[r], indptr[r + 1])
        column[part], value[part] = column[shuffled], value[shuffled]
    for ours, theirs in zip(joint_k_best(indptr, column, value, m, member, base, k),
                            (costs, row_to_column, parent), strict=True):  # fmt: skip
        np.testing.assert_array_equal(ours, theirs)


def test_rounding_does_not_disturb_the_order() -> None:
    # Sums of tenths are equal on paper, not as floats: the solver and the total may see them in another order.
    rng = np.random.default_rng(0)
    for _ in range(40):
        cost = -rng.integers(1, 4, (4, 4)) / 10 + 1e9 * (rng.random((4, 4)) < 0.1)
        problem = cost, np.ones((1, 4), dtype=bool), np.zeros(1), 500
        costs = solved(problem)[0]
        assert (np.diff(costs) >= 0).all()
        np.testing.assert_allclose(costs, enumerated(problem), rtol=1e-15)


def test_enumeration_gives_up_where_everything_is_tied() -> None:
    costs = solved((np.full((5, 15), -1.0), np.ones((1, 5), dtype=bool), np.zeros(1), 30))[0]
    assert costs.tolist() == [-5.0] * 30
    mixed = np.full((9, 9), INF)  # with a second piece, whose solutions must count once
    mixed[:6, :6], mixed[6:, 6:] = -1.0, np.diag([-0.5, -0.25, -0.125])
    mixed[mixed == 0.0] = INF
    found = solved((mixed, np.ones((1, 9), dtype=bool), np.zeros(1), 2000))
    np.testing.assert_array_equal(found[0], enumerated((mixed, np.ones((1, 9), dtype=bool), np.zeros(1), 2000)))


def test_the_pool_of_nodes_grows() -> None:
    cost = np.random.default_rng(0).random((9, 9)) - 1.0
    problem = cost, np.ones((1, 9), dtype=bool), np.zeros(1), 400
    found = solved(problem)
    check(problem, found)
    np.testing.assert_array_equal(found[0], textbook(cost, 400)[0])
