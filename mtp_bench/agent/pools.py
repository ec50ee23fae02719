"""Pools of samples: for each object, the forecasts of all tracks that stand for it."""

from typing import NamedTuple

import numpy as np

from ..types import Bools, Floats, Ints, Task
from .protocols import Forecasts, Sampler

_POOLED = 2048  # samples in one call of a sampler: its memory must not grow with hypotheses times objects


class Pools(NamedTuple):
    """Rows of `Forecasts` by object: E entries, the entries of one object after another.

    A row has one entry however many hypotheses hold it. Most objects have one entry; the sampler is for the others.
    """

    start: Ints  # [O + 1] first entry of each object
    row: Ints  # [E]
    hypothesis: Ints  # [E] the heaviest hypothesis that holds the row
    log_mass: Floats  # [E] log of the total weight of the hypotheses that hold the row


def make_pools(row: Ints, log_weight: Floats) -> Pools:
    """Pools of O objects: ``row`` [O, H] of each object in each hypothesis, -1: none; ``log_weight`` [H]."""
    owner, hypothesis = np.nonzero(row >= 0)
    rows = row[owner, hypothesis]
    order = np.lexsort((hypothesis, rows, owner))
    owner, rows, hypothesis = owner[order], rows[order], hypothesis[order]
    first = np.flatnonzero(np.append(True, (np.diff(owner) != 0) | (np.diff(rows) != 0))[: len(rows)])
    start = np.searchsorted(owner[first], np.arange(len(row) + 1))
    mass = log_weight[hypothesis]  # as logarithms: an object of very unlikely hypotheses must not come to a mass of 0
    log_mass = np.logaddexp.reduceat(mass, first) if len(first) else mass
    return Pools(start, rows[first], hypothesis[first], log_mass)


def reduce_pools(
    pools: Pools, forecasts: Forecasts, task: Task, sampler: Sampler, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Samples [O, K, T, 2] and log-weights [O, K] of the objects; -inf for samples that do not exist.

    Only objects with more than K samples go through the sampler.
    """
    each, future = forecasts.samples.shape[1:3]
    weight = normalised(forecasts)
    size = np.diff(pools.start) * each
    samples = np.zeros((len(size), task.samples, future, 2))
    log_weight = np.full(samples.shape[:2], -np.inf)
    small = size <= task.samples
    entry, owner, place = _entries(pools.start, small)
    if np.ndim(forecasts.row) == 2 and len(forecasts.row) * each <= task.samples:  # type: ignore[arg-type]
        place = pools.hypothesis[entry]  # where all fit, samples of one hypothesis have the same places in all objects
    slot = place[:, None] * each + np.arange(each)
    samples[owner[:, None], slot] = forecasts.samples[pools.row[entry]]
    log_weight[owner[:, None], slot] = weight[pools.row[entry]] + pools.log_mass[entry][:, None]
    large = np.flatnonzero(~small)
    row, log_mass = entry_table(pools, large)
    at_once = max(1, _POOLED // max(row.shape[1] * each, 1))
    for first in range(0, len(large), at_once):
        part = slice(first, first + at_once)
        pool = padded(forecasts.samples, weight, row[part], log_mass[part])
        samples[large[part]], log_weight[large[part]] = sampler.reduce(*pool, task.samples, rng)
    return samples, log_weight


def normalised(forecasts: Forecasts) -> Floats:
    """Log-weights [R, S] whose weights have the same sum in each row; -inf throughout where there is no forecast."""
    if forecasts.log_weight is None:
        return np.zeros(forecasts.samples.shape[:2])
    total = np.logaddexp.reduce(forecasts.log_weight, axis=1, keepdims=True)
    known = np.isfinite(total)
    return np.where(known, forecasts.log_weight - np.where(known, total, 0.0), -np.inf)


def _entries(start: Ints, wanted: Bools) -> tuple[Ints, Ints, Ints]:
    """Entries of the ``wanted`` [O] objects, the owner of each, and its place among the owner's entries."""
    count = np.where(wanted, np.diff(start), 0)
    owner = np.repeat(np.arange(len(count)), count)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    return start[owner] + place, owner, place


def entry_table(pools: Pools, objects: Ints) -> tuple[Ints, Floats]:
    """Rows [o, E] and log-masses [o, E] of the entries of some objects; row 0 of mass -inf for missing entries."""
    wanted = np.zeros(len(pools.start) - 1, dtype=bool)
    wanted[objects] = True
    entry, owner, place = _entries(pools.start, wanted)
    line = np.searchsorted(objects, owner)
    row = np.zeros((len(objects), place.max(initial=-1) + 1), dtype=np.int64)
    log_mass = np.full(row.shape, -np.inf)
    row[line, place], log_mass[line, place] = pools.row[entry], pools.log_mass[entry]
    return row, log_mass


def padded(samples: Floats, weight: Floats, row: Ints, log_mass: Floats) -> tuple[Floats, Floats]:
    """Samples [o, S, T, 2] and log-weights [o, S] of pools whose entries have the rows and log-masses [o, E]."""
    log_weight = weight[row] + log_mass[:, :, None]
    return samples[row].reshape(len(row), -1, *samples.shape[2:]), log_weight.reshape(len(row), -1)
