"""Errors of forecasts: minADE, minFDE, miss, energy score and the curve over k (docs/definitions, "The miss error").

``n`` targets, ``S`` samples, ``T`` future frames. An absent sample has weight 0; its coordinates are never looked at.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import Bools, Floats, ShapeError, require_finite, require_shape
from .definitions import MISS_RATE_GATE, SAMPLE_FLOOR

_BLOCK = 64  # rows of the distance matrix at a time; larger products wake up the threads of the BLAS
_CHUNK = 1 << 18  # distances held at a time: they should stay in the cache


@dataclass(frozen=True, eq=False)
class Displacement:
    """Errors per target; where ``valid`` is False the errors are inf and ``miss`` is True."""

    min_ade: Floats  # [n] m, least mean distance over the horizon
    min_fde: Floats  # [n] m, least final distance, minimised on its own
    miss: Bools  # [n] min_fde above MISS_RATE_GATE
    energy_score: Floats  # [n] m
    valid: Bools  # [n] at least one sample, all of them finite
    ade: Floats  # [n, S] m per sample, inf where absent


def displacement(
    samples: ArrayLike, truth: ArrayLike, weights: ArrayLike | None = None
) -> Displacement:
    """Errors of ``samples`` [n, S, T, 2] against ``truth`` [n, T, 2], in metres.

    ``weights`` [n, S] are at least 0 and need not sum to 1; None weighs all samples alike. Samples of next to no weight
    are absent, see `floored`. A target without a sample of
    positive weight, or with a non-finite coordinate in one, is invalid: its errors are inf, never NaN and never less.
    Raises ShapeError for shapes that do not fit, a truth that is not finite, or weights below 0.
    """
    guess, true = (
        np.asarray(samples, dtype=np.float64),
        np.asarray(truth, dtype=np.float64),
    )
    weight = floored(_checked(guess, true, weights))
    ade, fde, valid = sample_errors(guess, true, weight)
    min_fde = fde.min(axis=1, initial=np.inf)
    score = np.full(len(true), np.inf)
    share = weight[valid]
    clean = np.where((share > 0)[:, :, None, None], guess[valid], true[valid][:, None])
    score[valid] = energy_score(
        clean, true[valid], share / share.sum(axis=1, keepdims=True)
    )
    min_ade, miss = ade.min(axis=1, initial=np.inf), ~(min_fde <= MISS_RATE_GATE)
    return Displacement(
        min_ade=min_ade,
        min_fde=min_fde,
        miss=miss,
        energy_score=score,
        valid=valid,
        ade=ade,
    )


def floored(weights: NDArray[Any]) -> Floats:
    """Weights [n, S] with 0 for the samples of less than 1 % of the uniform weight: they are absent in every number.

    So a sample that costs nothing in the energy score earns nothing in minADE. Samples of weight 0 do not count as
    stated; what is below the floor is dropped once.
    """
    weight = np.asarray(weights, dtype=np.float64)
    stated = (weight > 0).sum(axis=1, keepdims=True)
    floor = SAMPLE_FLOOR * weight.sum(axis=1, keepdims=True) / np.maximum(stated, 1)
    return np.where(weight < floor, 0.0, weight)


def sample_errors(
    guess: NDArray[Any], true: NDArray[Any], weight: NDArray[Any]
) -> tuple[Floats, Floats, Bools]:
    """Mean and final error [n, S] of each sample, inf if absent or in an invalid target; valid [n]. Unchecked input."""
    present = weight > 0
    broken = (present & ~np.isfinite(guess).all(axis=(2, 3))).any(axis=1)
    valid = np.asarray(present.any(axis=1) & ~broken)
    used = present & valid[:, None]
    gap = np.where(used[:, :, None, None], guess - true[:, None], 0.0)
    x, y = gap[..., 0], gap[..., 1]
    step = np.sqrt(x * x + y * y)  # an eighth of the time of np.hypot
    return (
        np.where(used, step.mean(axis=2), np.inf),
        np.where(used, step[:, :, -1], np.inf),
        valid,
    )


def k_curve(errors: ArrayLike, ks: Sequence[int]) -> NDArray[np.float64]:
    """Expected least error [n, len(ks)] of a random k-subset of the samples, from errors [n, S], inf where absent.

    Closed form over the sorted errors, sum_j e_(j) C(m-1-j, k-1) / C(m, k) with m samples present; all of them where k
    exceeds m; inf where none is. Raises ShapeError for a k below 1 or a NaN among the errors.
    """
    table = np.asarray(errors, dtype=np.float64)
    require_shape("errors", table, (None, None))
    if np.isnan(table).any():
        raise ShapeError("errors hold a NaN, expected inf for an absent sample")
    for k in ks:
        if k < 1:
            raise ShapeError(f"k is {k}, expected 1 or more")
    ordered = np.sort(table, axis=1)
    present = np.isfinite(ordered).sum(axis=1)
    curve = np.full((len(table), len(ks)), np.inf)
    for count in np.unique(present[present > 0]):
        rows = present == count
        for i, k in enumerate(ks):
            curve[rows, i] = ordered[rows, :count] @ _least_of_subset(
                int(count), min(k, int(count))
            )
    return curve


def _least_of_subset(m: int, k: int) -> NDArray[np.float64]:
    """Probability [m] that the j-th smallest of m is the least of a random k-subset: C(m-1-j, k-1) / C(m, k)."""
    probability = np.zeros(m)
    last = k / m
    for j in range(m - k + 1):
        probability[j] = last
        # C(m-2-j, k-1) / C(m-1-j, k-1): every factor lies in [0, 1], so nothing overflows
        last *= (m - k - j) / max(m - 1 - j, 1)
    return probability


def _checked(
    guess: NDArray[np.float64], true: NDArray[np.float64], weights: ArrayLike | None
) -> NDArray[np.float64]:
    """The weights, after a check of everything."""
    require_shape("samples", guess, (None, None, None, 2))
    require_shape("truth", true, (len(guess), guess.shape[2], 2))
    if guess.shape[2] == 0:
        raise ShapeError(
            f"samples have shape {guess.shape}, expected at least one future step"
        )
    require_finite("truth", true)
    weight = (
        np.ones(guess.shape[:2])
        if weights is None
        else np.asarray(weights, dtype=np.float64)
    )
    require_shape("weights", weight, guess.shape[:2])
    require_finite("weights", weight)
    if (weight < 0).any():
        raise ShapeError(
            f"weights reach down to {weight.min()}, expected 0 (absent) or more"
        )
    return weight


def energy_score(samples: Floats, truth: Floats, weights: Floats) -> Floats:
    """Energy score [n], metres, of ``samples`` [n, S, T, 2] for ``truth`` [n, T, 2]; ``weights`` [n, S] sum to 1.

    ``sum_a w_a |x_a - y| - 1/2 sum_a sum_b w_a w_b |x_a - x_b|``, the norm over the flattened T x 2 divided by sqrt(T):
    the score of the weighted samples as a distribution, at least 0 and proper (Gneiting and Raftery 2007, eq. 22). All
    inputs are finite; absent samples have weight 0.
    """
    n, count, steps, _ = samples.shape
    flat = (samples - truth[:, None]).reshape(n, count, 2 * steps)
    first = np.einsum(
        "ns,ns->n", weights, np.sqrt(np.einsum("nsd,nsd->ns", flat, flat))
    )
    if count < 2:
        return np.asarray(first / np.sqrt(steps))
    spread = np.empty(n)
    chunk = max(1, _CHUNK // (count * min(count, _BLOCK)))
    for low in range(0, n, chunk):
        part = slice(low, low + chunk)
        spread[part] = _pair_term(flat[part], weights[part])
    # rounding may leave a hair below 0 where all samples coincide
    return np.asarray(np.maximum(first - spread, 0.0) / np.sqrt(steps))


def _pair_term(flat: Floats, weight: Floats) -> Floats:
    """Sum over unordered pairs of w_a w_b |x_a - x_b|, for [n, S, d] and [n, S]."""
    flat = (
        flat - np.einsum("ns,nsd->nd", weight, flat)[:, None]
    )  # centred, the Gram matrix loses least to cancellation
    square = np.einsum("nsd,nsd->ns", flat, flat)
    total = np.zeros(len(flat))
    for low in range(0, flat.shape[1] - 1, _BLOCK):
        rows, rest = slice(low, low + _BLOCK), slice(low, None)
        distance = flat[:, rows] @ flat[:, rest].transpose(0, 2, 1)
        distance *= -2.0
        distance += square[:, rows, None]
        distance += square[:, None, rest]
        np.maximum(distance, 0.0, out=distance)
        np.sqrt(distance, out=distance)
        size = distance.shape[1]
        distance[:, :, :size] *= np.triu(np.ones((size, size)), 1)
        total += np.einsum(
            "na,na->n", (distance @ weight[:, rest, None])[:, :, 0], weight[:, rows]
        )
    return total
