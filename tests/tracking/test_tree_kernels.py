"""Kernels of the hypothesis tree: compiled and plain code agree, and say what sets say."""

import numpy as np
import pytest

from mtp_bench.core import Bools, Ints
from mtp_bench.core.tracks import UNBORN
from mtp_bench.tracking.kernels.tree_kernels import distinct_rows, grow, histories

Case = tuple[Ints, Ints, Bools, Ints, Ints, int]


def random_case(seed: int) -> Case:
    rng = np.random.default_rng(seed)
    leaves, detections, old, new = (int(rng.integers(low, high)) for low, high in ((0, 7), (0, 5), (1, 4), (1, 6)))
    member, parent = rng.random((old, leaves)) < 0.7, rng.integers(0, old, new)
    column = np.full((new, leaves), -1)
    for h in range(new):
        free = rng.permutation(detections).tolist()
        for i in range(leaves):
            if member[parent[h], i] and free and rng.random() < 0.6:
                column[h, i] = free.pop()
    return column, parent, member, rng.integers(0, 3, leaves), rng.integers(1, 4, leaves), detections


def expected(case: Case) -> tuple[list[tuple[int, int]], list[set[tuple[int, int]]]]:
    """Distinct leaves as (old leaf, detection) in order, and those of each hypothesis."""
    column, parent, member, age, max_age, detections = case
    held = []
    for h, row in enumerate(column):
        mine = [(i, int(c)) for i, c in enumerate(row) if member[parent[h], i]]
        born = sorted(set(range(detections)) - {c for _, c in mine})
        held.append({(i, c) for i, c in mine if c >= 0 or age[i] + 1 < max_age[i]} | {(-1, d) for d in born})
    every = sorted({leaf for leaves in held for leaf in leaves}, key=lambda leaf: (leaf[0] < 0, *leaf))
    return every, held


@pytest.mark.parametrize("seed", range(25))
def test_growth(seed: int) -> None:
    case = random_case(seed)
    every, held = expected(case)
    for run in (grow, grow.function):
        leaf, detection, member, name = run(*case)
        leaves = list(zip(leaf.tolist(), detection.tolist(), strict=True))
        assert (leaves, [{leaves[e] for e in np.flatnonzero(row)} for row in member]) == (every, held)
        for a, first in zip(held, name, strict=True):
            assert all(first == second for b, second in zip(held, name, strict=True) if a == b)


@pytest.mark.parametrize("named", [True, False], ids=["names", "equal names"])
@pytest.mark.parametrize("seed", range(10))
def test_distinct_rows(seed: int, named: bool) -> None:
    _, _, member, name = grow(*random_case(seed))
    name = name if named else np.zeros_like(name)  # names only save time
    _, first = np.unique(member, axis=0, return_index=True)
    for run in (distinct_rows, distinct_rows.function):
        np.testing.assert_array_equal(run(member, name), np.sort(first))


def test_histories_walk_up_the_tree() -> None:
    """A ring of three layers, the last at place 0: leaf 1 came from leaf 0, which was born at place 2."""
    measured = np.arange(3 * 2 * 7, dtype=np.float64).reshape(3, 2, 7)
    detection = np.array([[-1, 4], [0, 0], [7, 7]])
    parent = np.array([[0, 0], [9, 9], [-1, -1]])
    for run in (histories, histories.function):
        past, taken = run(np.array([1, 0]), measured, detection, parent, 0, 2)
        np.testing.assert_array_equal(past[0], [np.zeros(7), measured[2, 0], measured[0, 1]])
        np.testing.assert_array_equal(past[1], [np.zeros(7), measured[2, 0], measured[0, 0]])
        assert taken.tolist() == [[UNBORN, 7, 4], [UNBORN, 7, -1]]
