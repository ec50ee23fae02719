"""Both samplers on pools that are small or absent; k-means++ with scikit-learn as an oracle."""

from typing import Any

import numpy as np
import pytest
from sklearn.cluster import KMeans

from mtp_bench.agent import Sampler
from mtp_bench.core import Floats
from mtp_bench.prediction import GreedySampler, KMeansSampler
from mtp_bench.prediction.k_means import k_means as k_means_kernel
from mtp_bench.prediction.pools import polynomials

SAMPLERS: list[Sampler] = [KMeansSampler(0), KMeansSampler(5), GreedySampler()]
BOTH = pytest.mark.parametrize("sampler", SAMPLERS, ids=["seeds", "k-means", "greedy"])


def make_pool(rng: np.random.Generator, objects: int, size: int) -> Floats:
    """Samples [O, S, 5, 2] of futures that go three ways."""
    tau = np.arange(1.0, 6.0)
    way = rng.integers(0, 3, (objects, size)) * 0.4 - 0.4 + rng.normal(0, 0.08, (objects, size))
    speed = rng.normal(1.0, 0.2, (objects, size))
    direction = np.stack([np.cos(way), np.sin(way)], axis=-1)
    return np.asarray(speed[..., None, None] * tau[:, None] * direction[:, :, None, :])


def bent(rng: np.random.Generator, pool: Floats) -> Floats:
    """The pool with samples that no polynomial of degree 2 describes."""
    return np.asarray(pool + rng.normal(0, 0.05, pool.shape))


def scikit_learn(points: Floats, weight: Floats, **settings: Any) -> Any:
    """A fitted KMeans of one set of points [S, d]; its own type information is wrong."""
    return KMeans(**settings).fit(points, sample_weight=weight)


def reduce(pool: Floats, log_weight: Floats, k: int, seed: int = 0, iterations: int = 5) -> tuple[Floats, Floats]:
    return KMeansSampler(iterations).reduce(pool, log_weight, k, np.random.default_rng(seed))


def k_means(points: Floats, weight: Floats, k: int, iterations: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Centres [O, k, d] and shares [O, k] of points [O, S, d] weighted [O, S]."""
    return run_kernel(k_means_kernel, points, weight, rng.random((len(points), k)), iterations)


def run_kernel(kernel: Any, points: Floats, weight: Floats, uniform: Floats, iterations: int) -> tuple[Floats, Floats]:
    """What ``kernel`` fills in: centres [O, k, d] and shares [O, k]; ``kernel``: compiled or plain."""
    centre, log_share = np.full((*uniform.shape, points.shape[2]), np.nan), np.full(uniform.shape, np.nan)
    with np.errstate(divide="ignore"):
        log_weight = np.log(weight)
    kernel(points, log_weight, uniform, iterations, polynomials(points.shape[2] // 2), centre, log_share)
    return centre, np.exp(log_share)


@pytest.mark.parametrize("straight", [True, False])
@pytest.mark.parametrize(("size", "k", "iterations"), [(60, 20, 0), (100, 3, 10), (21, 20, 3), (5, 1, 2)])
def test_compiled_and_plain_code_agree(size: int, k: int, iterations: int, straight: bool) -> None:
    rng = np.random.default_rng([size, k])
    pool = make_pool(rng, 6, size)
    points = (pool if straight else bent(rng, pool)).reshape(6, size, 10)
    points[3] = points[3, 0]  # all at one place
    weight, uniform = rng.random((6, size)), rng.random((6, k))
    weight[4, : size - k - 1] = 0.0
    kernels = k_means_kernel, k_means_kernel.function
    ours, plain = (run_kernel(k, points, weight, uniform, iterations) for k in kernels)
    for one, other in zip(ours, plain, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)


def test_objects_may_come_in_parts() -> None:
    pool, rng = make_pool(np.random.default_rng(0), 6, 60), np.random.default_rng(1)
    whole, _ = KMeansSampler().reduce(pool, np.zeros((6, 60)), 7, np.random.default_rng(1))
    parts = [KMeansSampler().reduce(part, np.zeros((len(part), 60)), 7, rng)[0] for part in np.split(pool, [1, 4])]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


@pytest.mark.parametrize("straight", [True, False])
@pytest.mark.parametrize("iterations", [1, 300])
@pytest.mark.parametrize(("size", "k"), [(400, 20), (100, 3), (21, 20), (5, 1)])
def test_lloyds_iterations_end_where_scikit_learn_ends(size: int, k: int, iterations: int, straight: bool) -> None:
    rng = np.random.default_rng([size, k])
    pool = make_pool(rng, 6, size)
    points = (pool if straight else bent(rng, pool)).reshape(6, size, 10)
    weight = rng.random((6, size))
    weight[4, : size - k - 1] = 0.0
    weight /= weight.sum(axis=1, keepdims=True)
    seeds, _ = k_means(points, weight, k, 0, np.random.default_rng(1))
    centre, share = k_means(points, weight, k, iterations, np.random.default_rng(1))
    for o in range(6):
        settings = {"init": seeds[o], "n_init": 1, "max_iter": iterations, "tol": 0.0}
        oracle = scikit_learn(points[o], weight[o], n_clusters=k, **settings)
        np.testing.assert_allclose(centre[o], oracle.cluster_centers_, atol=1e-9)
        np.testing.assert_allclose(share[o], np.bincount(oracle.labels_, weight[o], minlength=k), atol=1e-9)


def test_polynomials_are_orthonormal_and_tell_constant_acceleration() -> None:
    tau = 0.1 * np.arange(1.0, 13.0)
    basis = polynomials(12)
    np.testing.assert_allclose(basis @ basis.T, np.eye(3), atol=1e-12)
    motion = np.stack([np.ones(12), tau, tau**2 / 2])
    np.testing.assert_allclose(motion @ basis.T @ basis, motion, atol=1e-12)


def test_one_bent_sample_among_straight_ones_keeps_its_bend() -> None:
    pool = make_pool(np.random.default_rng(11), 1, 40)
    pool[0, 7] = [[0, 0], [3, 0], [0, 0], [3, 0], [0, 0]]
    centre, _ = reduce(pool, np.zeros((1, 40)), 39)
    assert np.abs(centre[0] - pool[0, 7]).max(axis=(1, 2)).min() < 1e-9


def test_seeds_spread_over_the_pool() -> None:
    # 97 samples at one place, three far off in different directions: no seed may be wasted on the crowd.
    pool = np.zeros((30, 100, 1, 2))
    pool[:, :3, 0] = [[50.0, 0.0], [0.0, 50.0], [-50.0, -50.0]]
    centre, log_weight = reduce(pool, np.zeros((30, 100)), 4, iterations=0)
    for o in range(30):
        assert {tuple(c) for c in centre[o, :, 0].tolist()} == {(0, 0), (50, 0), (0, 50), (-50, -50)}
    np.testing.assert_allclose(np.sort(np.exp(log_weight)), np.tile([0.01, 0.01, 0.01, 0.97], (30, 1)))


def test_seeds_are_drawn_by_weight_and_squared_distance() -> None:
    # The first seed is nearly always the heavy sample; then 3 m away against 1 m away is 9 to 1.
    pool = np.zeros((8000, 3, 1, 2))
    pool[:, 1, 0, 0], pool[:, 2, 0, 0] = 1.0, 3.0
    centre, _ = reduce(pool, np.tile(np.log([1.0, 1e-4, 1e-4]), (8000, 1)), 2, iterations=0)
    assert (centre[:, :, 0, 0] == 3.0).any(axis=1).mean() == pytest.approx(0.9, abs=0.015)


@BOTH
def test_absent_samples_are_never_chosen_nor_read(sampler: Sampler) -> None:
    rng = np.random.default_rng(1)
    pool, log_weight = make_pool(rng, 40, 30), rng.normal(size=(40, 30))
    absent = rng.random((40, 30)) < 0.5
    absent[:, [0, -1]] = True  # the ends are where rounding would pick them
    log_weight[absent] = -np.inf
    results = []
    for filling in (np.nan, 1e6):
        pool[absent] = filling
        results.append(sampler.reduce(pool, log_weight, 6, np.random.default_rng(0)))
    assert (np.abs(results[0][0]) < 100).all()
    for one, other in zip(*results, strict=True):
        np.testing.assert_array_equal(one, other)


@BOTH
@pytest.mark.parametrize(
    ("present", "k"), [([1, 1, 1], 3), ([1, 1, 1], 5), ([0, 1, 0, 1, 1], 3), ([0, 0, 1], 2), ([0, 0, 0], 2), ([1], 1)]
)
def test_a_pool_that_fits_is_passed_on(present: list[int], k: int, sampler: Sampler) -> None:
    rng = np.random.default_rng(2)
    pool, log_weight = make_pool(rng, 1, len(present)), rng.normal(size=(1, len(present)))
    log_weight[0, np.array(present) == 0] = -np.inf
    chosen, weight = sampler.reduce(pool, log_weight, k, rng)
    rows = np.flatnonzero(present)
    assert chosen.shape == (1, k, 5, 2)
    np.testing.assert_array_equal(chosen[0, : len(rows)], pool[0, rows])
    np.testing.assert_array_equal(weight[0, : len(rows)], log_weight[0, rows])
    assert (weight[0, len(rows) :] == -np.inf).all()
    assert (chosen[0, len(rows) :] == 0).all()


def test_equal_samples_are_one_cluster() -> None:
    # Three distinct futures, 10, 20 and 30 times; of the five that are asked for two stay absent.
    distinct = make_pool(np.random.default_rng(5), 1, 3)[0]
    pool = np.repeat(distinct, [10, 20, 30], axis=0)[None]
    for iterations in (0, 5):
        centre, weight = reduce(pool, np.zeros((1, 60)), 5, iterations=iterations)
        assert np.isfinite(centre).all()
        there = np.isfinite(weight[0])
        np.testing.assert_allclose(np.sort(np.exp(weight[0, there])), [1 / 6, 2 / 6, 3 / 6])
        for sample, mass in zip(centre[0, there], np.exp(weight[0, there]), strict=True):
            np.testing.assert_allclose(sample, distinct[round(mass * 6) - 1], atol=1e-9)
        for absent in centre[0, ~there]:  # a repeated seed stays where it is
            assert np.abs(absent - distinct).max(axis=(1, 2)).min() < 1e-9


@BOTH
def test_far_from_the_origin_nothing_is_lost(sampler: Sampler) -> None:
    pool = np.round(make_pool(np.random.default_rng(9), 3, 100) * 2**20) / 2**20  # the shift is without rounding
    results = [sampler.reduce(pool + d, np.zeros((3, 100)), 8, np.random.default_rng(0)) for d in (0.0, 2.0**17)]
    atol = 0.0 if isinstance(sampler, GreedySampler) else 1e-9  # it chooses samples, the other one takes means
    np.testing.assert_allclose(results[1][0] - 2.0**17, results[0][0], rtol=0, atol=atol)
    np.testing.assert_allclose(results[1][1], results[0][1], rtol=0, atol=atol)
