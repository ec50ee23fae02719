"""Errors of samples: by hand, by enumeration, and what must never help."""

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

from mtp_bench.scoring import displacement, energy_score, k_curve
from mtp_bench.scoring.forecasts import sample_weights

steady = settings(derandomize=True, deadline=None, max_examples=50)
seeds = st.integers(0, 10_000)


INVALID: dict[str, tuple[float, list[float], bool]] = {
    # first coordinate of sample 0, weights, valid
    "NaN in a sample": (np.nan, [1.0, 1.0], False),
    "inf in a sample": (np.inf, [1.0, 1.0], False),
    "NaN in an absent sample": (np.nan, [0.0, 1.0], True),
    "inf in an absent sample": (-np.inf, [0.0, 1.0], True),
    "no sample at all": (0.0, [0.0, 0.0], False),
}


@pytest.mark.parametrize(("value", "weights", "valid"), INVALID.values(), ids=INVALID.keys())
def test_broken_output_is_never_better(value: float, weights: list[float], valid: bool) -> None:
    samples, truth = np.zeros((1, 2, 2, 2)), np.zeros((1, 2, 2))
    samples[0, 0, 0, 0] = value
    got = displacement(samples, truth, [weights])
    want = 0.0 if valid else np.inf
    assert (got.valid.tolist(), got.miss.tolist()) == ([valid], [not valid])
    assert (got.min_ade[0], got.min_fde[0], got.energy_score[0]) == (want, want, want)


def test_without_targets_and_without_samples() -> None:
    assert len(displacement(np.zeros((0, 4, 3, 2)), np.zeros((0, 3, 2))).min_ade) == 0
    got = displacement(np.zeros((2, 0, 3, 2)), np.zeros((2, 3, 2)))
    assert got.min_ade.tolist() == got.energy_score.tolist() == [np.inf, np.inf]
    assert not got.valid.any()


# ---- what must not matter, and what must not help
@steady
@given(seeds, st.floats(-3, 3))
def test_order_scale_of_weights_and_place_do_not_matter(seed: int, yaw: float) -> None:
    rng = np.random.default_rng(seed)
    samples, truth = rng.normal(0, 2, (5, 6, 3, 2)), rng.normal(0, 1, (5, 3, 2))
    weight = rng.random((5, 6)) * (rng.random((5, 6)) > 0.25)
    weight[:, 0] += 0.1
    want = displacement(samples, truth, weight)
    order = rng.permutation(6)
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    got = displacement(samples[:, order] @ turn + 300, truth @ turn + 300, 7 * weight[:, order])
    for name in ("min_ade", "min_fde", "energy_score"):
        np.testing.assert_allclose(getattr(got, name), getattr(want, name), rtol=1e-9, atol=1e-9)
    assert np.array_equal(got.valid, want.valid)


FLOOR = {
    # weights of four samples of errors 1, 2, 3, 4 m: minADE
    "exactly enough, so that `<` and not `<=` drops": ([1.0, 199.0, 100.0, 100.0], 1.0),
    "next to nothing": ([0.0024, 0.5, 0.2, 0.2976], 2.0),
    "absent samples raise the floor": ([0.0034, 0.0, 0.5, 0.4966], 1.0),
    "... of those that are there": ([0.0033, 0.0, 0.5, 0.4967], 3.0),
    "dropped once": ([0.0024, 0.002501, 0.001, 0.994099], 2.0),  # of the two that are left it would be too light
    "any scale": ([24.0, 5000.0, 2000.0, 2976.0], 2.0),
}


@pytest.mark.parametrize(("weight", "want"), FLOOR.values(), ids=FLOOR.keys())
def test_a_sample_of_next_to_no_weight_is_absent(weight: list[float], want: float) -> None:
    samples = np.arange(1.0, 5.0)[None, :, None, None] * np.array([1.0, 0.0])
    got = displacement(samples, np.zeros((1, 1, 2)), [weight])
    assert (got.min_ade[0], got.min_fde[0]) == (want, want)
    there = np.isfinite(got.ade[0])
    without = displacement(samples[:, there], np.zeros((1, 1, 2)), [np.array(weight)[there]])
    if weight[3] < 0.9:  # else those that are left would be dropped in turn
        assert got.energy_score == pytest.approx(without.energy_score)


# ---- the curve over k
@steady
@given(seeds, st.integers(1, 7))
def test_the_curve_is_the_mean_over_all_subsets(seed: int, k: int) -> None:
    errors = np.random.default_rng(seed).integers(0, 5, (3, 6)).astype(float)
    errors[1, :2] = np.inf
    want = []
    for row in errors:
        present = row[np.isfinite(row)]
        want.append(np.mean([min(c) for c in itertools.combinations(present, min(k, len(present)))]))
    np.testing.assert_allclose(k_curve(errors, [k])[:, 0], want, rtol=1e-12)


def test_the_curve_of_a_target_without_samples_is_infinite() -> None:
    assert k_curve(np.full((1, 3), np.inf), (1, 3)).tolist() == [[np.inf, np.inf]]
    assert k_curve(np.zeros((2, 0)), (1,)).tolist() == [[np.inf], [np.inf]]


# ---- energy score
def by_sums(samples: NDArray[Any], truth: NDArray[Any], weight: NDArray[Any]) -> float:
    """The definition, one pair at a time; of one target."""
    first = sum(w * np.linalg.norm(x - truth) for x, w in zip(samples, weight, strict=True))
    pairs = 0.0
    for (x, v), (y, w) in itertools.permutations(zip(samples, weight, strict=True), 2):
        pairs += v * w * float(np.linalg.norm(x - y))
    return float((first - pairs / 2) / np.sqrt(len(truth)))


def test_energy_score_of_many_samples_in_blocks() -> None:
    rng = np.random.default_rng(0)
    samples, truth = rng.normal(size=(2, 150, 2, 2)), rng.normal(size=(2, 2, 2))
    weight = rng.dirichlet(np.ones(150), 2)
    want = [by_sums(*case) for case in zip(samples, truth, weight, strict=True)]
    np.testing.assert_allclose(energy_score(samples, truth, weight), want, rtol=1e-9)


# ---- weights from log-weights
def test_weights_of_log_weights() -> None:
    got = sample_weights(np.array([[0.0, -np.inf, -1e31, np.log(0.5)], [-5000.0, -np.inf, 0.0, -np.inf]]))
    assert got[0].tolist() == [1.0, 0.0, 0.0, 0.5]
    assert got[1, 0] > 0  # however light, it is there
    assert (sample_weights(np.full((2, 3), -np.inf)) == 0).all()
    assert sample_weights(np.zeros((2, 0))).shape == (2, 0)
