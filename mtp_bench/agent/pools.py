"""Pools of samples: for each object, the forecasts of all tracks that stand for it."""

from __future__ import annotations

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
    # As logarithms: an object of very unlikely hypotheses must not come to a mass of 0.
    mass = log_weight[hypothesis]
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
    for objects in _chunks(np.flatnonzero(~small), size):
        pool = padded(pools, objects, forecasts.samples, weight)
        samples[objects], log_weight[objects] = sampler.reduce(*pool, task.samples, rng)
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


def padded(pools: Pools, objects: Ints, samples: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Samples [o, S, T, 2] and log-weights [o, S] of the pools of some objects, -inf where they have fewer."""
    wanted = np.zeros(len(pools.start) - 1, dtype=bool)
    wanted[objects] = True
    entry, owner, place = _entries(pools.start, wanted)
    line, (each, future) = np.searchsorted(objects, owner), samples.shape[1:3]
    table = np.zeros((len(objects), place.max(initial=-1) + 1, each, future, 2))
    log_weight = np.full(table.shape[:3], -np.inf)
    table[line, place] = samples[pools.row[entry]]
    log_weight[line, place] = weight[pools.row[entry]] + pools.log_mass[entry][:, None]
    return table.reshape(len(objects), -1, future, 2), log_weight.reshape(len(objects), -1)


def _chunks(objects: Ints, size: Ints) -> list[Ints]:
    """The objects in groups whose tables have at most _POOLED samples, or a single object."""
    if len(objects) == 0:
        return []
    each = max(1, _POOLED // int(size[objects].max()))
    return np.array_split(objects, range(each, len(objects), each))
