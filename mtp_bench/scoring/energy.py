"""Energy score of weighted samples: a proper score, so samples that do not tell where the object goes cost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_BLOCK = 64  # rows of the distance matrix at a time; larger products wake up the threads of the BLAS
_CHUNK = 1 << 18  # distances held at a time: they should stay in the cache


def energy_score(samples: Array, truth: Array, weights: Array) -> Array:
    """Energy score [n], metres, of ``samples`` [n, S, T, 2] for ``truth`` [n, T, 2]; ``weights`` [n, S] sum to 1.

    ``sum_a w_a |x_a - y| - 1/2 sum_{a != b} c_ab |x_a - x_b|``, the norm over the flattened T x 2 divided by sqrt(T),
    with ``c_ab = w_a w_b / (1 - min(w_a, w_b))``. Equal weights give the fair form of the protocol, 1 / (2 n (n - 1))
    per ordered pair; a single sample has no pair term. The denominator of a weighted form has to be chosen: with
    ``1 - sum w^2``, unbiased for weights that do not depend on the samples, a far sample of negligible weight beside
    one of weight almost 1 would earn half its distance. This one never pays: the score is at least 0, as in the fair
    form, because the pairs of a sample then weigh at most as much as the sample itself. All inputs are finite; absent
    samples have weight 0.
    """
    n, count, steps, _ = samples.shape
    flat = (samples - truth[:, None]).reshape(n, count, 2 * steps)
    first = np.einsum("ns,ns->n", weights, np.sqrt(np.einsum("nsd,nsd->ns", flat, flat)))
    if count < 2:
        return np.asarray(first / np.sqrt(steps))
    spread = np.empty(n)
    chunk = max(1, _CHUNK // (count * min(count, _BLOCK)))
    for low in range(0, n, chunk):
        part = slice(low, low + chunk)
        spread[part] = _pair_term(flat[part], weights[part])
    # rounding may leave a hair below 0 where all samples coincide
    return np.asarray(np.maximum(first - spread, 0.0) / np.sqrt(steps))


def _pair_term(flat: Array, weight: Array) -> Array:
    """Sum over unordered pairs of w_a w_b / (1 - min(w_a, w_b)) |x_a - x_b|, for [n, S, d] and [n, S]."""
    order = np.argsort(weight, axis=1, kind="stable")
    weight = np.take_along_axis(weight, order, axis=1)
    flat = np.take_along_axis(flat, order[:, :, None], axis=1)
    # centred, the Gram matrix loses least to cancellation
    flat = flat - np.einsum("ns,nsd->nd", weight, flat)[:, None]
    square = np.einsum("nsd,nsd->ns", flat, flat)
    # ascending: the first of a pair is the lighter one; the last of all leads no pair
    lighter = np.zeros_like(weight)
    lighter[:, :-1] = weight[:, :-1] / (1.0 - weight[:, :-1])
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
        total += np.einsum("na,na->n", (distance @ weight[:, rest, None])[:, :, 0], lighter[:, rows])
    return total
