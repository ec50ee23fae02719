"""Matching while forecasts are added: at every cut as good as a matching of what the cut keeps, made afresh."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import linear_sum_assignment

from mtp_bench.scoring.incremental_matching import NEVER, Additions, add_in_order, final_match
from mtp_bench.scoring.pairs import Pairs

steady = settings(derandomize=True, deadline=None, max_examples=75)
Case = tuple[Pairs, Any, Any, Any]  # pairs, step and confidence of the columns, tie of the pairs


def drawn(seed: int, rows: int = 4, columns: int = 6) -> Case:
    """Quarters of metres, so that many costs are equal; the columns come in the order of their confidence."""
    rng = np.random.default_rng(seed)
    inside = rng.random((rows, columns)) < rng.uniform(0.15, 0.7)
    row, column = np.nonzero(inside)
    order = rng.permutation(len(row))  # the order of pairs must not matter
    pairs = Pairs(row[order], column[order], rng.integers(0, 4, len(row)) / 4)
    confidence = rng.integers(0, 9, columns) / 8
    step = np.full(columns, NEVER)
    comes = np.lexsort((rng.random(columns), -confidence))[: rng.integers(columns // 2, columns + 1)]
    step[comes] = np.arange(len(comes))
    tie = rng.integers(0, 5, len(row)) / 4
    return pairs, step, confidence, tie


def matching_at(additions: Additions, last: int) -> dict[int, int]:
    """Row -> column when the steps up to ``last`` have come."""
    now = additions.step <= last
    return dict(zip(additions.row[now].tolist(), additions.column[now].tolist(), strict=True))


def best_by_trial(kept: dict[tuple[int, int], tuple[float, float, float]]) -> Any:
    """The best of all matchings: number of pairs, falling confidences, summed cost, summed tie."""
    found: list[Any] = [((), ())]  # taken columns and values, over the rows so far
    for row in sorted({r for r, _ in kept}):
        ways = [(c, value) for (r, c), value in kept.items() if r == row]
        found += [((*t, c), (*v, value)) for t, v in found for c, value in ways if c not in t]
    return max(map(quality, (values for _, values in found)))


def quality(values: Any) -> Any:
    cost, confidence, tie = zip(*values, strict=True) if values else ((), (), ())
    return len(values), sorted(confidence, reverse=True), -sum(cost), sum(tie)


@steady
@given(st.integers(0, 100_000))
def test_every_cut_is_matched_as_if_there_were_nothing_else(seed: int) -> None:
    pairs, step, confidence, tie = drawn(seed)
    grown = add_in_order(pairs, step, confidence, tie)
    keys = {
        (r, c): (cost, confidence[c], t)
        for r, c, cost, t in zip(pairs.row.tolist(), pairs.column.tolist(), pairs.cost, tie, strict=True)
    }
    assert (np.diff(grown.step) >= 0).all()
    for last in range(-1, int((step != NEVER).sum())):
        got = matching_at(grown, last)
        kept = {pair: value for pair, value in keys.items() if step[pair[1]] <= last}
        assert set(got.items()) <= kept.keys()
        assert len(set(got.values())) == len(got)
        # quarters and eighths are exact
        assert quality([kept[pair] for pair in got.items()]) == best_by_trial(kept)
        unmatched = set(np.flatnonzero(step <= last)) - set(got.values())
        assert unmatched == set(np.flatnonzero(grown.dropped <= last))


@steady
@given(st.integers(0, 100_000))
def test_what_is_matched_stays_so_and_each_addition_leaves_out_at_most_one(seed: int) -> None:
    pairs, step, confidence, tie = drawn(seed)
    grown = add_in_order(pairs, step, confidence, tie)
    before: dict[int, int] = {}
    for last in range(int((step != NEVER).sum())):
        now = matching_at(grown, last)
        assert before.keys() <= now.keys()
        assert len(now) - len(before) + int((grown.dropped == last).sum()) == 1
        before = now
    final = final_match(grown, 4)
    assert {r: int(c) for r, c in enumerate(final) if c >= 0} == before
    assert (grown.dropped[step == NEVER] == NEVER).all()


SMALL = np.float32(0.001)
BELOW = np.nextafter(SMALL, np.float32(0))  # the next number in single precision
CASES: dict[str, tuple[list[tuple[int, int, float, float]], list[float], list[int]]] = {
    # (row, column, cost, tie), confidence of the columns in the order in which they come, column of each row
    "the surest, not the cheapest": ([(0, 0, 1.0, 0), (0, 1, 0.5, 0)], [0.9, 0.1], [0]),
    "the cheapest of one group": ([(0, 0, 1.0, 0), (0, 1, 0.5, 0)], [0.9, 0.9], [1]),
    "the surer at equal cost": ([(0, 0, 1.0, 0), (0, 1, 1.0, 9)], [0.9, 0.1], [0]),
    "the surer among hopeless ones": ([(0, 0, 1.0, 0), (0, 1, 1.0, 9)], [4e-10, 1e-10], [0]),
    "the surer by the last bit": ([(0, 0, 1.0, 0), (0, 1, 1.0, 9)], [float(SMALL), float(BELOW)], [0]),
    "the larger tie at equal confidence": ([(0, 0, 1.0, 0), (0, 1, 1.0, 9)], [0.5, 0.5], [1]),
    "the first of two that are equal in all": ([(0, 0, 1.0, 9), (0, 1, 1.0, 9)], [0.5, 0.5], [0]),
    "an infinite tie is the largest": ([(0, 0, 1.0, np.inf), (0, 1, 1.0, 9)], [0.5, 0.5], [0]),
    "more pairs before cheap ones": ([(0, 0, 0.0, 0), (1, 0, 2.0, 0), (0, 1, 2.0, 0)], [0.9, 0.1], [1, 0]),
    "nothing inside the gate": ([], [0.5], []),
    "less than a micrometre is equal": ([(0, 0, 1.0 + 1e-8, 9), (0, 1, 1.0, 0)], [0.9, 0.9], [0]),
}


@pytest.mark.parametrize(("pairs", "confidence", "want"), CASES.values(), ids=CASES.keys())
def test_named_case(pairs: list[tuple[int, int, float, float]], confidence: list[float], want: list[int]) -> None:
    row, column, cost, tie = np.array(pairs, dtype=float).reshape(-1, 4).T
    given = Pairs(row.astype(np.intp), column.astype(np.intp), cost)
    grown = add_in_order(given, np.arange(len(confidence)), np.array(confidence), tie)
    assert final_match(grown, len(want)).tolist() == want


def test_a_large_component_is_settled() -> None:
    rng = np.random.default_rng(0)
    gap = np.abs(rng.uniform(0, 20, (120, 1)) - rng.uniform(0, 20, 150))
    row, column = np.nonzero(gap < 2.0)
    pairs = Pairs(row, column, gap[row, column])
    grown = add_in_order(pairs, np.arange(150), np.full(150, 0.5), np.zeros(len(row)))
    full = np.where(gap < 2.0, gap, 1e4)
    best = full[linear_sum_assignment(full)]
    matched = final_match(grown, 120)
    rows = np.flatnonzero(matched >= 0)
    assert len(rows) == (best < 2.0).sum()
    assert gap[rows, matched[rows]].sum() == pytest.approx(best[best < 2.0].sum(), abs=1e-3)
