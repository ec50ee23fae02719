"""Errors of forecasts: minADE, minFDE, miss, energy score and the curve over k.

``n`` targets, ``S`` samples, ``T`` future frames. An absent sample has weight 0; its
coordinates are never looked at (docs/definitions, "The miss error").
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import Bools, Floats, ShapeError, require_finite, require_shape
from .definitions import MISS_RATE_GATE, SAMPLE_FLOOR

# rows of the distance matrix at a time; larger products wake up the threads of the BLAS
_BLOCK = 64
_CHUNK = 1 << 18  # distances held at a time: they should stay in the cache


@dataclass(frozen=True, eq=False)
class Displacement:
    """Errors per target.

    Where ``valid`` is False the errors are inf and ``miss`` is True.
    """

    min_ade: Floats  # [n] m, least mean distance over the horizon
    min_fde: Floats  # [n] m, least final distance, minimised on its own
    miss: Bools  # [n] min_fde above MISS_RATE_GATE
    energy_score: Floats  # [n] m
    valid: Bools  # [n] at least one sample, all of them finite
    ade: Floats  # [n, S] m per sample, inf where absent


def displacement(
    samples: ArrayLike, truth: ArrayLike, weights: ArrayLike | None = None
) -> Displacement:
    """Return the errors of ``samples`` [n, S, T, 2], in metres.

    ``truth`` [n, T, 2]. ``weights`` [n, S] are at least 0 and need not sum to 1; None
    weighs all samples alike. `drop_light_samples` says which are absent. A target
    without a sample of positive weight, or with a non-finite coordinate in one, is
    invalid: its errors are inf, never NaN and never less. Raises ShapeError for
    shapes that do not fit, a truth that is not finite, or weights below 0.
    """
    paths = np.asarray(samples, dtype=np.float64)
    true_path = np.asarray(truth, dtype=np.float64)
    weight = drop_light_samples(_checked_weights(paths, true_path, weights))
    ade, fde, valid = sample_errors(paths, true_path, weight)
    min_fde = fde.min(axis=1, initial=np.inf)
    valid_path = true_path[valid]
    valid_weight = weight[valid]
    is_present = (valid_weight > 0)[:, :, None, None]
    clean_paths = np.where(is_present, paths[valid], valid_path[:, None])
    share = valid_weight / valid_weight.sum(axis=1, keepdims=True)
    score = np.full(len(true_path), np.inf)
    score[valid] = energy_score(clean_paths, valid_path, share)
    return Displacement(
        min_ade=ade.min(axis=1, initial=np.inf),
        min_fde=min_fde,
        miss=~(min_fde <= MISS_RATE_GATE),
        energy_score=score,
        valid=valid,
        ade=ade,
    )


def drop_light_samples(weights: NDArray[Any]) -> Floats:
    """Return weights [n, S] with 0 for samples below 1 % of the uniform weight.

    Samples of weight 0 are left out of every metric. So a sample that costs nothing in
    the energy score earns nothing in minADE. The uniform weight is that of the samples
    above 0. It is not computed again for those that stay.
    """
    weight = np.asarray(weights, dtype=np.float64)
    sample_count = (weight > 0).sum(axis=1, keepdims=True)
    floor = (
        SAMPLE_FLOOR * weight.sum(axis=1, keepdims=True) / np.maximum(sample_count, 1)
    )
    return np.where(weight < floor, 0.0, weight)


def sample_errors(
    paths: NDArray[Any], true_path: NDArray[Any], weight: NDArray[Any]
) -> tuple[Floats, Floats, Bools]:
    """Return mean and final error [n, S] of each sample, and valid [n].

    Errors are inf if the sample is absent or its target invalid. Input is not checked.
    """
    present = weight > 0
    broken = (present & ~np.isfinite(paths).all(axis=(2, 3))).any(axis=1)
    valid = np.asarray(present.any(axis=1) & ~broken)
    used = present & valid[:, None]
    offset = np.where(used[:, :, None, None], paths - true_path[:, None], 0.0)
    x = offset[..., 0]
    y = offset[..., 1]
    distance = np.sqrt(x * x + y * y)  # an eighth of the time of np.hypot
    ade = np.where(used, distance.mean(axis=2), np.inf)
    return ade, np.where(used, distance[:, :, -1], np.inf), valid


def k_curve(errors: ArrayLike, ks: Sequence[int]) -> NDArray[np.float64]:
    """Return the expected least error [n, len(ks)] of a random k-subset of samples.

    ``errors`` [n, S]: inf where absent. Closed form over the sorted errors,
    sum_j e_(j) C(m-1-j, k-1) / C(m, k) with m samples present; all of them where k
    exceeds m; inf where none is. Raises ShapeError for a k below 1 or a NaN among the
    errors.
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
            probability = _probability_of_min(int(count), min(k, int(count)))
            curve[rows, i] = ordered[rows, :count] @ probability
    return curve


def _probability_of_min(m: int, k: int) -> NDArray[np.float64]:
    """Return the probability [m] that the j-th smallest is the least of a k-subset.

    There are m samples, so it is C(m-1-j, k-1) / C(m, k).
    """
    probability = np.zeros(m)
    value = k / m
    for j in range(m - k + 1):
        probability[j] = value
        # C(m-2-j, k-1) / C(m-1-j, k-1): every factor lies in [0, 1], so nothing
        # overflows
        value *= (m - k - j) / max(m - 1 - j, 1)
    return probability


def _checked_weights(
    paths: NDArray[np.float64],
    true_path: NDArray[np.float64],
    weights: ArrayLike | None,
) -> NDArray[np.float64]:
    """Return the weights, after a check of everything."""
    require_shape("samples", paths, (None, None, None, 2))
    require_shape("truth", true_path, (len(paths), paths.shape[2], 2))
    if paths.shape[2] == 0:
        raise ShapeError(
            f"samples have shape {paths.shape}, expected at least one future step"
        )
    require_finite("truth", true_path)
    if weights is None:
        return np.ones(paths.shape[:2])
    weight = np.asarray(weights, dtype=np.float64)
    require_shape("weights", weight, paths.shape[:2])
    require_finite("weights", weight)
    if (weight < 0).any():
        raise ShapeError(
            f"weights reach down to {weight.min()}, expected 0 (absent) or more"
        )
    return weight


def energy_score(samples: Floats, truth: Floats, weights: Floats) -> Floats:
    """Return the energy score [n], metres, of ``samples`` [n, S, T, 2].

    ``truth`` [n, T, 2]; ``weights`` [n, S] sum to 1. The score of the weighted samples
    as a distribution, at least 0 and proper (Gneiting and Raftery 2007, eq. 22):
    ``sum_a w_a |x_a - y| - 1/2 sum_a sum_b w_a w_b |x_a - x_b|``, the norm over the
    flattened T x 2 divided by sqrt(T). All inputs are finite; absent samples have
    weight 0.
    """
    targets, count, steps, _ = samples.shape
    offset = (samples - truth[:, None]).reshape(targets, count, 2 * steps)
    distance = np.sqrt(np.einsum("nsd,nsd->ns", offset, offset))
    mean_distance = np.einsum("ns,ns->n", weights, distance)
    if count < 2:
        return np.asarray(mean_distance / np.sqrt(steps))
    spread = np.empty(targets)
    chunk = max(1, _CHUNK // (count * min(count, _BLOCK)))
    for low in range(0, targets, chunk):
        part = slice(low, low + chunk)
        spread[part] = _pair_term(offset[part], weights[part])
    # rounding may leave a hair below 0 where all samples coincide
    return np.asarray(np.maximum(mean_distance - spread, 0.0) / np.sqrt(steps))


def _pair_term(offset: Floats, weight: Floats) -> Floats:
    """Return the sum over unordered pairs of w_a w_b |x_a - x_b|.

    ``offset`` [n, S, d], ``weight`` [n, S].
    """
    # centred, the Gram matrix loses least to cancellation
    offset = offset - np.einsum("ns,nsd->nd", weight, offset)[:, None]
    square = np.einsum("nsd,nsd->ns", offset, offset)
    total = np.zeros(len(offset))
    for low in range(0, offset.shape[1] - 1, _BLOCK):
        rows = slice(low, low + _BLOCK)
        columns = slice(low, None)
        distance = offset[:, rows] @ offset[:, columns].transpose(0, 2, 1)
        distance *= -2.0
        distance += square[:, rows, None]
        distance += square[:, None, columns]
        np.maximum(distance, 0.0, out=distance)
        np.sqrt(distance, out=distance)
        size = distance.shape[1]
        distance[:, :, :size] *= np.triu(np.ones((size, size)), 1)
        weighted = (distance @ weight[:, columns, None])[:, :, 0]
        total += np.einsum("na,na->n", weighted, weight[:, rows])
    return total
