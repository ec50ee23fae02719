"""Intervals, tests and gaps with units of recordings."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import ArrayLike

from mtp_bench.scoring import bootstrap_interval, paired_difference
from mtp_bench.scoring.rank import NO_GAP, gap_closed
from mtp_bench.scoring.statistics import PairedDifference, UnitSums, share_interval, significant_pairs

steady = settings(derandomize=True, deadline=None, max_examples=25)


@pytest.mark.parametrize(("units", "least"), [(6, 0.92), (20, 0.92)])
def test_coverage_is_about_that_promised(units: int, least: float) -> None:
    # units of unequal weight and means that lean to one side: the percentile interval holds the mean in 80 and 90 %
    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(200):
        weight = rng.integers(1, 20, units)
        interval = bootstrap_interval(weight * rng.gamma(4.0, 0.75, units), weight)
        assert interval is not None
        inside += interval[0] <= 3.0 <= interval[1]
    assert least <= inside / 200 <= 0.995


@pytest.mark.parametrize("count", [[], [3], [3, 1], [3, 0, 1], [0, 0, 0]])
def test_fewer_than_three_units_have_no_interval(count: list[int]) -> None:
    assert bootstrap_interval(np.ones(len(count)), count) is None


def flip_test(difference: ArrayLike, weight: ArrayLike | None = None) -> PairedDifference:
    """Return the test of differences [U] from 0; ``weight`` [U]: 1 unless stated."""
    count = len(np.asarray(difference))
    found = paired_difference(difference, np.zeros(count), np.ones(count) if weight is None else weight)
    assert found is not None
    return found


def extreme_share(difference: list[float], weight: list[float], mean: float) -> float:
    """Share of all sign flips whose sum is as extreme as the observed one, after ``mean`` is taken off."""
    rest = [d - mean * w for d, w in zip(difference, weight, strict=True)]
    flips = (
        sum(s * r for s, r in zip(signs, rest, strict=True)) for signs in itertools.product((-1, 1), repeat=len(rest))
    )
    return float(np.mean([abs(flip) >= abs(sum(rest)) - 1e-9 for flip in flips]))


@steady
@given(st.lists(st.tuples(st.integers(-5, 5), st.integers(1, 3)), min_size=1, max_size=8))
def test_sign_flips_and_their_interval_equal_enumeration(units: list[tuple[int, int]]) -> None:
    difference, weight = map(list, zip(*units, strict=True))
    found = flip_test(difference, weight)
    assert found.p == pytest.approx(extreme_share(difference, weight, 0.0))
    assert (found.interval is None) == (len(units) < 6)
    if found.interval is not None:
        low, high = found.interval
        assert low - 1e-12 <= sum(difference) / sum(weight) <= high + 1e-12
        assert (found.p < 0.05) == (low > 0 or high < 0)
        if any(difference):
            assert min(extreme_share(difference, weight, end) for end in (low, high)) >= 0.05
            assert max(extreme_share(difference, weight, end) for end in (low - 1e-6, high + 1e-6)) < 0.05


def test_many_scenes_are_sampled_and_repeat() -> None:
    rng = np.random.default_rng(3)
    even, shifted = rng.normal(0, 1, 40), rng.normal(1, 1, 40)
    assert flip_test(shifted).p < 1e-3
    assert flip_test(even).p > 0.05
    assert flip_test(even) == flip_test(even)
    assert flip_test(np.ones(40)).p == 1 / 10_001  # never 0
    for mean in np.linspace(-0.6, 0.6, 40):
        found = flip_test(even + mean)
        assert found.interval is not None
        assert (found.p < 0.05) == (found.interval[0] > 0 or found.interval[1] < 0)


def test_an_error_without_weight_changes_no_other_pair() -> None:
    weight, pairs = np.r_[np.ones(10), np.zeros(40)], np.arange(600).reshape(2, 300)
    errors = np.abs(np.random.default_rng(0).normal(1.0, 0.5, (601, 50))) * weight
    errors[:300] += 0.3 * weight
    forged = errors.copy()
    forged[600] += weight == 0
    assert (significant_pairs(forged, weight, pairs) == significant_pairs(errors, weight, pairs)).all()


@pytest.mark.parametrize("gain", [[1.0, -1.0, 1.0, -1.0, 1.0, -0.9], [0.0] * 6, [-1.0] * 6, [1.0], [1.0, 1.0]], ids=str)
def test_there_is_no_gap_unless_the_pipeline_is_surely_worse_than_true_pasts(gain: list[float]) -> None:
    truth = np.full(len(gain), 3.0)
    sums = [UnitSums(10, np.ones(len(gain)), error, 1.0) for error in (truth, truth + gain, truth)]
    assert gap_closed(*sums).why == NO_GAP


def test_the_interval_of_a_share() -> None:
    rng = np.random.default_rng(3)
    whole = rng.normal(2.0, 1.0, 30)
    assert share_interval(0.4 * whole, whole) == pytest.approx((0.4, 0.4))
    part = 0.4 * whole + rng.normal(0.0, 0.5, 30)
    interval = share_interval(part, whole)
    assert interval is not None
    assert interval[0] < part.sum() / whole.sum() < interval[1]
    assert interval[1] - interval[0] > 0.05


def test_there_is_no_share_of_nothing() -> None:
    assert share_interval([1.0], [2.0]) is None
    assert share_interval([1.0, 1.0, 0.5], [0.1, -0.1, 0.0]) is None
