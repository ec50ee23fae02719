"""Matching: maximum cardinality, then minimum cost, inside the gate; against enumeration for small n."""

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

from mtp_bench.scoring import Pairs, match, match_sticky
from mtp_bench.scoring.matching import match_best
from mtp_bench.scoring.pairs import box_pairs, near_pairs

steady = settings(derandomize=True, deadline=None, max_examples=200)


def pairs_of(cost: NDArray[Any]) -> Pairs:
    """Pairs of a dense matrix; inf is forbidden."""
    row, column = np.nonzero(np.isfinite(cost))
    return Pairs(row, column, cost[row, column].astype(np.float64))


def best(cost: NDArray[Any]) -> tuple[int, float]:
    """Most pairs, and the least total cost of so many, by enumeration."""
    rows, columns = cost.shape
    found = (0, 0.0)
    for size in range(1, min(rows, columns) + 1):
        for chosen in itertools.combinations(range(rows), size):
            for partner in itertools.permutations(range(columns), size):
                total = sum(cost[r, c] for r, c in zip(chosen, partner, strict=True))
                if np.isfinite(total) and (size > found[0] or total < found[1]):
                    found = (size, total)
    return found


def value(matched: NDArray[Any], cost: NDArray[Any]) -> tuple[int, float]:
    rows = np.flatnonzero(matched >= 0)
    assert len(set(matched[rows].tolist())) == len(rows)  # one to one
    return len(rows), float(cost[rows, matched[rows]].sum())


def costs(element: st.SearchStrategy[float]) -> st.SearchStrategy[NDArray[np.float64]]:
    cell = st.one_of(element, st.just(float("inf")))
    shape = st.tuples(st.integers(1, 4), st.integers(1, 5))
    return shape.flatmap(
        lambda s: st.lists(cell, min_size=s[0] * s[1], max_size=s[0] * s[1]).map(lambda v: np.array(v).reshape(s))
    )


@steady
@given(costs(st.floats(0, 10)))
def test_equals_enumeration(cost: NDArray[np.float64]) -> None:
    got, want = value(match(pairs_of(cost), len(cost)), cost), best(cost)
    assert got[0] == want[0]
    assert got[1] == pytest.approx(want[1], abs=1e-9)


@steady
@given(costs(st.integers(0, 3).map(float)))
def test_equals_enumeration_under_ties(cost: NDArray[np.float64]) -> None:
    matched = match(pairs_of(cost), len(cost))
    assert value(matched, cost) == best(cost)
    assert np.array_equal(matched, match(pairs_of(cost), len(cost)))


@steady
@given(costs(st.integers(1, 8).map(lambda c: -float(c))))
def test_the_best_total_equals_enumeration(cost: NDArray[np.float64]) -> None:
    full = np.where(np.isfinite(cost), cost, 0.0)
    rows, columns = cost.shape
    full = np.pad(full, ((0, 0), (0, rows)))  # every row may stay alone
    want = min(full[range(rows), chosen].sum() for chosen in itertools.permutations(range(columns + rows), rows))
    assert value(match_best(pairs_of(cost), rows), cost)[1] == want


INF = np.inf
CASES: dict[str, tuple[list[list[float]], list[int]]] = {
    # cost matrix, column of each row
    "square of equal costs": ([[1.0, 1.0], [1.0, 1.0]], [0, 1]),
    "costs of 1e15": ([[1e15, 1e15 + 2], [1e15 + 1, 1e15 + 8]], [1, 0]),
    "negative costs": ([[-5.0, -1.0], [-4.0, INF]], [1, 0]),
    "costs all equal": ([[3.0, 3.0, 3.0], [3.0, 3.0, 3.0], [3.0, 3.0, 3.0]], [0, 1, 2]),
    "large component of one value, one row left over": ([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0]], [0, 1, -1]),
}


@pytest.mark.parametrize(("cost", "want"), CASES.values(), ids=CASES.keys())
def test_named_case(cost: list[list[float]], want: list[int]) -> None:
    assert match(pairs_of(np.array(cost)), len(cost)).tolist() == want


def test_no_rows_and_no_columns() -> None:
    nothing = Pairs(np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros(0))
    assert (match(nothing, 0).tolist(), match(nothing, 2).tolist()) == ([], [-1, -1])
    empty = np.zeros(0, dtype=np.intp)
    assert match_sticky(nothing, 0, empty, empty).tolist() == []


# ---- sticky mode: one object and one or two tracks per frame, rows and columns numbered through
def sticky(costs_of_frames: list[list[list[float]]]) -> list[int]:
    """Track (0, 1, ...) of each object in each frame; object i and track j are the same in every frame."""
    n, m = np.array(costs_of_frames[0]).shape
    parts = [pairs_of(np.array(c)) for c in costs_of_frames]
    row = np.concatenate([p.row + n * t for t, p in enumerate(parts)])
    column = np.concatenate([p.column + m * t for t, p in enumerate(parts)])
    pairs = Pairs(row, column, np.concatenate([p.cost for p in parts]))
    total = len(costs_of_frames)
    matched = match_sticky(pairs, n * total, np.arange(n * total) - n, np.arange(m * total) - m)
    return [int(c % m) if c >= 0 else -1 for c in matched]


STICKY: dict[str, tuple[list[list[list[float]]], list[int]]] = {
    "forgotten after a frame without a match": ([[[0.1, INF]], [[INF, INF]], [[1.5, 0.1]]], [0, -1, 1]),
    "kept pairs take precedence over cardinality": (
        [[[0.1, INF], [INF, INF]], [[0.1, 0.2], [0.1, INF]]], [0, -1, 0, -1]),
}  # fmt: skip


@pytest.mark.parametrize(("cost", "want"), STICKY.values(), ids=STICKY.keys())
def test_sticky_case(cost: list[list[list[float]]], want: list[int]) -> None:
    assert sticky(cost) == want


@steady
@given(st.integers(0, 10_000))
def test_sticky_equals_a_frame_by_frame_dictionary(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, m, frames = 4, 5, 6
    cost = rng.uniform(0, 5, (frames, n, m))
    cost[rng.random(cost.shape) < 0.5] = INF
    before: dict[int, int] = {}
    want: list[int] = []
    for dense in cost:
        kept = {r: c for r, c in before.items() if np.isfinite(dense[r, c])}
        rest = dense.copy()
        rest[list(kept)] = INF
        rest[:, list(kept.values())] = INF
        free = match(pairs_of(rest), n)
        before = {**kept, **{r: int(c) for r, c in enumerate(free) if c >= 0}}
        want += [before.get(r, -1) for r in range(n)]
    assert sticky(cost.tolist()) == want


# ---- candidate pairs
@steady
@given(st.integers(0, 10_000), st.sampled_from([1.0, 1e5, 1e9]))
def test_near_pairs_are_all_pairs_inside_the_gate(seed: int, offset: float) -> None:
    rng = np.random.default_rng(seed)
    frame_a, frame_b = np.sort(rng.integers(0, 4, 20)), np.sort(rng.integers(0, 4, 25))
    a, b = rng.uniform(-5, 5, (20, 2)) + offset, rng.uniform(-5, 5, (25, 2)) - rng.integers(0, 2) + offset
    gap = a[:, None] - b
    inside = (frame_a[:, None] == frame_b) & (np.sqrt((gap**2).sum(-1)) <= 2.0)
    i, j, distance = near_pairs(frame_a, a, frame_b, b, 2.0)
    assert set(zip(i.tolist(), j.tolist(), strict=True)) == set(map(tuple, np.argwhere(inside).tolist()))
    np.testing.assert_allclose(distance, np.hypot(*gap[i, j].T))


@pytest.mark.parametrize("gate", [0.7, 1.7, 1.9])
def test_the_gate_is_inclusive_however_far_into_the_recording(gate: float) -> None:
    frame = np.arange(0, 10**7, 99_991)
    a, b = np.tile([0.05, 0.0], (len(frame), 1)), np.tile([0.05 + gate, 0.0], (len(frame), 1))
    b[0, 0] = -0.3373  # no round numbers
    i, j, distance = near_pairs(frame, a, frame, b, gate)
    assert i.tolist() == j.tolist() == list(range(len(frame)))
    assert (distance[1:] == gate).all()


def boxes(*rows: tuple[float, float]) -> NDArray[np.float64]:
    return np.array([[x, y, 0.0, 0.0, 4.0, 2.0, 1.5] for x, y in rows])


def test_boxes_pair_by_class_and_unstated_classes_with_every_class() -> None:
    frame, one = np.zeros(3, dtype=int), np.zeros(1, dtype=int)
    near, kinds = boxes((0, 0.5), (0, 0.4), (0, 0.3)), np.array([0, 1, -1])
    found = box_pairs(one, boxes((0, 0)), np.array([1]), frame, near, kinds, "center_distance", (2.0, 1.0))
    assert found.column.tolist() == [1, 2]
    assert found.cost.tolist() == pytest.approx([0.4, 0.3])


def test_the_threshold_is_that_of_the_true_box() -> None:
    one = np.zeros(1, dtype=int)
    for class_id, count in ((0, 1), (1, 0)):
        found = box_pairs(one, boxes((0, 0)), np.array([class_id]), one, boxes((1.5, 0)), np.array([-1]),
                          "center_distance", (2.0, 1.0))  # fmt: skip
        assert len(found) == count


def test_boxes_pair_by_overlap() -> None:
    one, two = np.zeros(1, dtype=int), np.zeros(2, dtype=int)
    # shifted by 1 of 4 m: overlap 3/5; by 2: 2/6
    found = box_pairs(one, boxes((0, 0)), one, two, boxes((1, 0), (2, 0)), two, "iou_3d", (0.5,))
    assert found.column.tolist() == [0]
    assert found.cost.tolist() == pytest.approx([0.4])


@pytest.mark.parametrize("seed", range(10))
def test_large_components_are_matched_in_memory_of_their_pairs(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(seed)
    row, column = np.nonzero(rng.random((8, 12)) < 0.5)
    pairs = Pairs(row, column, -rng.integers(1, 9, len(row)).astype(np.float64))
    dense = match_best(pairs, 8)
    monkeypatch.setattr("mtp_bench.scoring.matching._MAX_CELLS", 0)
    sparse = match_best(pairs, 8)
    cost = dict(zip(zip(row.tolist(), column.tolist(), strict=True), pairs.cost.tolist(), strict=True))
    worth = [sum(cost[i, j] for i, j in enumerate(found.tolist()) if j >= 0) for found in (dense, sparse)]
    assert worth[0] == worth[1]
    assert len(set(sparse[sparse >= 0])) == (sparse >= 0).sum()
