"""The greedy sampler: brute force as an oracle, and pools that are small, absent, equal or far away."""

import numpy as np
import pytest

from mtp_bench.core import Floats
from mtp_bench.prediction import GreedySampler
from mtp_bench.prediction.greedy import k_medians


def make_pool(rng: np.random.Generator, objects: int, size: int, future: int = 6) -> Floats:
    """Samples [O, S, T, 2] that go in all directions and are not straight."""
    end = rng.normal(0, 5.0, (objects, size, 1, 2))
    return np.asarray(end * np.linspace(0.2, 1.0, future)[:, None] + rng.normal(0, 0.3, (objects, size, future, 2)))


def brute_force(pool: Floats, log_weight: Floats, k: int) -> tuple[Floats, Floats]:
    """Samples [k, T, 2] and log-weights [k], one object [S, T, 2] of distinct samples: every cost in full."""
    distance = np.linalg.norm(pool[:, None] - pool[None], axis=-1).mean(axis=-1)  # [S, S] of samples from each other
    weight, chosen = np.exp(log_weight), list[int]()
    for _ in range(k):
        costs = [weight @ distance[[*chosen, c]].min(axis=0) for c in range(len(pool))]
        chosen.append(int(np.argmin(costs)))
    return pool[chosen], np.log(np.bincount(distance[chosen].argmin(axis=0), weight, minlength=k))


def reduce(pool: Floats, log_weight: Floats, k: int) -> tuple[Floats, Floats]:
    return GreedySampler().reduce(pool, log_weight, k, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("size", "k", "future"), [(30, 1, 6), (30, 6, 6), (21, 20, 10), (120, 20, 12), (400, 10, 3), (9, 2, 1)]
)
def test_chooses_what_brute_force_chooses(size: int, k: int, future: int) -> None:
    rng = np.random.default_rng([size, k])
    pool, log_weight = make_pool(rng, 4, size, future), rng.normal(0, 2, (4, size))
    chosen, weight = reduce(pool, log_weight, k)
    for o in range(4):
        expected, expected_weight = brute_force(pool[o], log_weight[o], k)
        np.testing.assert_array_equal(chosen[o], expected)
        np.testing.assert_allclose(weight[o], expected_weight)


def test_compiled_and_plain_code_agree() -> None:
    rng = np.random.default_rng(0)
    pool, log_weight = make_pool(rng, 3, 25).reshape(3, 25, 12), rng.normal(0, 2, (3, 25))
    log_weight[1, 4:] = -np.inf
    found = []
    for kernel in (k_medians, k_medians.function):
        chosen, weight = np.full((3, 5, 12), np.nan), np.full((3, 5), np.nan)
        kernel(pool, log_weight, chosen, weight)
        found.append((chosen, weight))
    np.testing.assert_array_equal(found[0][0], found[1][0])
    np.testing.assert_allclose(found[0][1], found[1][1])


def test_the_order_of_the_samples_does_not_matter() -> None:
    rng = np.random.default_rng(2)
    pool, log_weight = make_pool(rng, 1, 80), rng.normal(0, 2, (1, 80))
    chosen, weight = reduce(pool, log_weight, 12)
    for _ in range(5):
        order = rng.permutation(80)
        other, other_weight = reduce(pool[:, order], log_weight[:, order], 12)
        np.testing.assert_array_equal(other, chosen)
        np.testing.assert_allclose(other_weight, weight)


def test_equal_samples_count_as_one_of_their_summed_weight() -> None:
    rng = np.random.default_rng(3)
    pool, log_weight = make_pool(rng, 1, 30), rng.normal(0, 1, (1, 30))
    times = rng.integers(1, 5, 30)
    parts = np.repeat(log_weight - np.log(times), times, axis=1)
    chosen, weight = reduce(pool, log_weight, 8)
    other, other_weight = reduce(np.repeat(pool, times, axis=1), parts, 8)
    np.testing.assert_array_equal(other, chosen)
    np.testing.assert_allclose(other_weight, weight)


@pytest.mark.parametrize("shift", [-2000.0, 0.0, 2000.0])
@pytest.mark.parametrize(("size", "k"), [(40, 6), (40, 1), (6, 6)])
def test_the_total_weight_is_kept(size: int, k: int, shift: float) -> None:
    rng = np.random.default_rng(5)
    pool, log_weight = make_pool(rng, 8, size), rng.normal(0, 30, (8, size)) + shift
    log_weight[rng.random((8, size)) < 0.2] = -np.inf
    chosen, weight = reduce(pool, log_weight, k)
    assert not np.isnan(chosen).any()
    assert not np.isnan(weight).any()
    total, expected = (np.logaddexp.reduce(some, axis=1) for some in (weight, log_weight))
    np.testing.assert_allclose(total, expected, rtol=1e-12, atol=1e-9)
