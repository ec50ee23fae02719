"""Uncertainty with scenes as the unit: bootstrap intervals, sign-flip tests, shared ranks (protocol, "Uncertainty").

A mean over targets is a ratio of sums over scenes: ``numerator`` [S] and ``denominator`` [S] (the number of targets).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ShapeError
from ..shapes import require_finite, require_shape

Array = NDArray[np.float64]

RESAMPLES = 2000
LEVEL = 0.95
EXACT_SCENES = 14  # all sign flips up to here
FLIPS = 10_000  # random sign flips beyond
_SEED = 20_250_101


def bootstrap_interval(numerator: ArrayLike, denominator: ArrayLike) -> tuple[float, float] | None:
    """Percentile interval (95 %) of sum(numerator) / sum(denominator) over resampled scenes.

    Scenes without a target (denominator 0) are left out; None with fewer than two others. The resamples depend on the
    number of scenes only, so agents are compared on the same ones.
    """
    top, bottom = _sums(numerator, denominator)
    if len(bottom) < 2:
        return None
    counts = _resamples(len(bottom))
    ratio = (counts @ top) / (counts @ bottom)
    low, high = np.quantile(ratio, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


def paired_interval(a: ArrayLike, b: ArrayLike, denominator: ArrayLike) -> tuple[float, float] | None:
    """Interval of the difference a - b of two means over the same targets: numerators [S], [S], denominator [S]."""
    return bootstrap_interval(np.asarray(a, dtype=np.float64) - np.asarray(b, dtype=np.float64), denominator)


def share_interval(part: ArrayLike, whole: ArrayLike) -> tuple[float, float] | None:
    """Percentile interval (95 %) of sum(part) / sum(whole) over resampled scenes, [S] each and of either sign.

    None with fewer than two scenes, or where the whole is not above 0 in nearly all resamples.
    """
    top, bottom = np.asarray(part, dtype=np.float64), np.asarray(whole, dtype=np.float64)
    require_shape("whole", bottom, top.shape)
    require_finite("part", top)
    require_finite("whole", bottom)
    if len(bottom) < 2:
        return None
    counts = _resamples(len(bottom))
    total = counts @ bottom
    if (total <= 0).mean() > (1 - LEVEL) / 2:
        return None
    positive = total > 0
    low, high = np.quantile((counts @ top)[positive] / total[positive], [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


def sign_flip_test(difference: ArrayLike) -> float:
    """Two-sided p of the summed difference [S] per scene, if its sign were a matter of chance in every scene.

    All 2^S signs up to EXACT_SCENES scenes; else FLIPS random ones and the observed one. Scenes without a difference do
    not matter. 1.0 without any.
    """
    given = np.asarray(difference, dtype=np.float64)
    require_shape("difference", given, (None,))
    require_finite("difference", given)
    given = given[given != 0]
    count = len(given)
    if count == 0:
        return 1.0
    # a sum of the same terms in another order is as extreme
    limit = abs(float(given.sum())) - 1e-12 * float(np.abs(given).sum())
    if count <= EXACT_SCENES:
        bits = (np.arange(1 << count)[:, None] >> np.arange(count)) & 1
        return float((np.abs((1.0 - 2.0 * bits) @ given) >= limit).mean())
    signs = np.random.default_rng(_SEED).choice([-1.0, 1.0], size=(FLIPS, count))
    extreme = int((np.abs(signs @ given) >= limit).sum())
    return (1 + extreme) / (1 + FLIPS)


def shared_ranks(numerators: ArrayLike, denominator: ArrayLike) -> list[int]:
    """Ranks, 1 = least mean, of agents [A, S] over the same targets [S].

    From the best on, an agent shares the rank of the leader of the group before it if their paired interval covers 0;
    else it leads the next group. Without an interval (fewer than two scenes) all share rank 1.
    """
    top, bottom = np.asarray(numerators, dtype=np.float64), np.asarray(denominator, dtype=np.float64)
    require_shape("numerators", top, (None, len(bottom)))
    order = np.argsort(top.sum(axis=1), kind="stable")
    ranks = [1] * len(top)
    leader, rank = -1, 1
    for position, agent in enumerate(order.tolist()):
        interval = paired_interval(top[agent], top[leader], bottom) if leader >= 0 else None
        if leader < 0 or (interval is not None and interval[0] > 0):
            leader, rank = agent, position + 1
        ranks[agent] = rank
    return ranks


def _sums(numerator: ArrayLike, denominator: ArrayLike) -> tuple[Array, Array]:
    top, bottom = np.asarray(numerator, dtype=np.float64), np.asarray(denominator, dtype=np.float64)
    require_shape("denominator", bottom, (None,))
    require_shape("numerator", top, bottom.shape)
    require_finite("numerator", top)
    require_finite("denominator", bottom)
    if (bottom < 0).any():
        raise ShapeError(f"denominator reaches down to {bottom.min()}, expected counts of 0 or more")
    return top[bottom > 0], bottom[bottom > 0]


@lru_cache(maxsize=64)
def _resamples(scenes: int) -> Array:
    """How often each scene occurs in each resample [RESAMPLES, S]."""
    rng = np.random.default_rng([_SEED, scenes])
    counts = rng.multinomial(scenes, np.full(scenes, 1.0 / scenes), size=RESAMPLES)
    return counts.astype(np.float64)
